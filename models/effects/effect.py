"""One effect: its identity, its linear regressors, and its wrench."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from models.common.frames import Array
from models.effects.adopted_effect import FROM_S, UNTIL_S, AdoptedEffect
from models.effects.coefficient import BelongsTo, Coefficient, Shape
from models.effects.context import Context
from models.effects.flight_use import FlightUse
from models.effects.lacking import always
from models.effects.search_hints import SearchHints
from models.effects.shown import Shown

Wrenches = Callable[[Context, tuple[float, ...]], tuple[Array, ...]]
Grid = Callable[[Context], Sequence[tuple[float, ...]]]
_SHOWN = Shown()
_FLOWN = FlightUse()
_SEARCHED = SearchHints()


@dataclass(frozen=True, kw_only=True)
class Effect:
    """One entry of the catalogue.

    ``wrenches(ctx, shape)``: one (..., 6) for each coefficient at 1, body FRD about the CG, N and N m. What it does is
    their sum times the coefficients: linear in ``coefficients``, and in ``shapes`` profiled on
    ``shape_grid(ctx)``. ``lacking(ctx)`` says in a few words which measurement is missing, or None. Where it is valid
    and where that was found says the docstring of its file.
    """

    # What it is.
    name: str
    equation: str
    sign: str
    axes: tuple[str, ...]
    channels: tuple[str, ...]
    excite: str
    # How it acts.
    coefficients: tuple[Coefficient, ...]
    wrenches: Wrenches
    belongs_to: BelongsTo = BelongsTo.VEHICLE
    law: bool = False
    """A law of the air, of throttle or of lag: flights differ by what it leaves out, as much as is typical of it."""
    every_flight: bool = False
    """Every flight has something of it: what a sensor reads too much, the load, and the wind."""
    every_vehicle: bool = False
    """Every vehicle has it: a model that says nothing of it was made from a flight that did not show it."""
    shapes: tuple[Shape, ...] = ()
    grid: Grid | None = None
    """Places that are tried, by the flight; None: every combination of what its shapes name."""
    of_inputs: bool = False
    """It follows from the rotors' past alone, and from nothing of the motion: a record of them says it ahead."""
    mixing: Callable[[tuple[float, ...]], Array] | None = None
    """(k, k) by shape: the coefficients are this times independent ones, whose priors ``coefficients`` give.

    The regressors are then the same in every shape, and there are no model-form errors."""
    kinematic_bias: Callable[[Context, tuple[float, ...]], Array] | None = None
    """(3, k): what it adds to accelerometer minus what velocity and attitude imply [m/s^2]; None: nothing."""
    # Which flights can show it, and by which axes.
    lacking: Callable[[Context], str | None] = always
    # How it is looked for, and when it is believed.
    search: SearchHints = _SEARCHED
    main: tuple[str, ...] = ()
    """Coefficients of which at least one must be significant; empty: any."""
    together: tuple[str, ...] = ()
    """Axes on which it acts alike: what makes the error of one of them larger is another effect."""
    # Its relatives.
    aliases: tuple[str, ...] = ()
    """Effects that can stand in the place of this one. One way: ``thrust_scale`` can pass for ``thrust_curve``, a curve
    not for a scale."""
    contains: tuple[str, ...] = ()
    """Effects whose terms it has among its own."""
    # What is made of it.
    stays: Callable[[Mapping[str, float]], AdoptedEffect] | None = None
    """Of an effect of one flight, what of it the next one has, by its parameters; None: itself, its coefficients of
    one flight at zero."""
    in_flight: FlightUse = _FLOWN
    shown: Shown = _SHOWN

    def regressors(self, ctx: Context, shape: tuple[float, ...]) -> Array:
        """``wrenches`` beside each other (..., 6, k)."""
        return np.stack(self.wrenches(ctx, shape), axis=-1)

    def shape_grid(self, ctx: Context) -> Sequence[tuple[float, ...]]:
        """The places at which its shapes are tried on a flight; one empty place without shapes."""
        if self.grid is None:
            return tuple(product(*(s.tried for s in self.shapes)))
        return self.grid(ctx)

    def of_day(self, coefficient: Coefficient) -> bool:
        """Whether every flight has its own."""
        return (coefficient.belongs_to or self.belongs_to).of_day

    @property
    def all_of_day(self) -> bool:
        """Whether flights share nothing of it, its shape included."""
        return all(self.of_day(c) for c in self.coefficients)

    @property
    def kept(self) -> bool:
        """Whether an amended model takes it to the next flight: what makes the effect is not of one flight."""
        lasting = {c.name for c in self.coefficients if not self.of_day(c)}
        return not self.main_names.isdisjoint(lasting)

    def of_next_flight(self, parameters: Mapping[str, float]) -> dict[str, float]:
        """Adopted parameters as the next flight starts with them: what is of one flight at zero.

        Times of a log do not carry over: what began in it is there from the start.
        """
        times = {FROM_S, UNTIL_S}
        gone = {c.name for c in self.coefficients if self.of_day(c)} | times
        own = {s.name for s in self.shapes}
        out = {}
        for name, value in parameters.items():
            if name not in times or name in own:
                out[name] = 0.0 if name in gone else value
        return out

    @property
    def for_a_time(self) -> Effect:
        """The same with two shapes more: times [s] from and until which it acts; 0 stands for none."""

        def wrenches(ctx: Context, shape: tuple[float, ...]) -> tuple[Array, ...]:
            *own, start, end = shape
            acts = ctx.state.time_s >= start
            if end > 0.0:
                acts = acts & (ctx.state.time_s < end)
            return tuple(wrench * acts[..., None] for wrench in self.wrenches(ctx, tuple(own)))

        def grid(ctx: Context) -> Sequence[tuple[float, ...]]:
            return [(*shape, 0.0, 0.0) for shape in self.shape_grid(ctx)]

        times = (
            Shape(name=FROM_S, unit="s", kinds=(0.0,)),
            Shape(name=UNTIL_S, unit="s", kinds=(0.0,)),
        )
        return replace(self, shapes=(*self.shapes, *times), wrenches=wrenches, grid=grid)

    def next_flight(self, adopted: AdoptedEffect) -> AdoptedEffect:
        """What an amended model takes of it to the next flight."""
        if self.stays is None:
            return replace(adopted, parameters=self.of_next_flight(adopted.parameters))
        return replace(self.stays(adopted.parameters), without=adopted.without)

    @property
    def main_names(self) -> frozenset[str]:
        """Coefficients that make the effect: all, where ``main`` names none."""
        return frozenset(self.main or [c.name for c in self.coefficients])

    def parameters(self, coefficients: ArrayLike, shape: tuple[float, ...]) -> dict[str, float]:
        """Names to numbers, as a model directory keeps them."""
        mixed = self.mixed(np.asarray(coefficients), shape)
        values = {c.name: float(v) for c, v in zip(self.coefficients, mixed, strict=True)}
        return values | {s.name: float(v) for s, v in zip(self.shapes, shape, strict=True)}

    def said(self, ctx: Context, parameters: Mapping[str, float]) -> dict[str, float]:
        """Parameters as people say them: the quantities in place of those that they stand for."""
        numbers = {name: np.array([value]) for name, value in parameters.items()}
        quantities = {q.instead_of: q for q in self.shown.quantities}
        out = {}
        for name, value in parameters.items():
            quantity = quantities.get(name)
            if quantity is None:
                out[name] = value
            elif quantity.of is None:
                out[quantity.name] = value
            else:
                out[quantity.name] = float(quantity.of(ctx, numbers)[0])
        return out

    def mixed(self, independent: Array, shape: tuple[float, ...]) -> Array:
        """Coefficients (..., k) from independent ones (..., k)."""
        if self.mixing is None:
            return independent
        return np.asarray(independent @ self.mixing(shape).T)

    def wrench(self, ctx: Context, parameters: Mapping[str, float]) -> Array:
        """The effect's wrench (..., 6) with adopted parameters."""
        shape = tuple(parameters[s.name] for s in self.shapes)
        coefficients = np.array([parameters[c.name] for c in self.coefficients])
        return np.asarray(self.regressors(ctx, shape) @ coefficients)
