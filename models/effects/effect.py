"""What an effect is: its description, its linear regressors, and the wrench of one that was adopted."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.air_state import AirState
from models.common.frames import GRAVITY, Array, at_cg, corner_to_body
from models.vehicle import RHO_SEA_LEVEL, Vehicle
from models.vehicle_wrench import (
    FanModel,
    fan_rpm,
    fan_torques,
    free_air_thrust,
    rpm_from_servos,
    servo_thrust,
)

GAS_CONSTANT_AIR = 287.05
DOWNWARD = np.array([0.0, 0.0, 1.0])
PULL, TILT = np.eye(6)[[0, 4]]
"""Force towards the wall and moment that tilts to it, in a fan's corner frame."""
APART_S = 0.5
"""Time over which changes of thrust and specific force are compared: what drifts does not count [s]."""


IMPOSSIBLE = 1e-30
"""Probability of what is as good as impossible: its logarithm is a number."""
LEAST_COMMANDED = 0.01
"""Probability that the thrust was commanded, below which nothing that hangs on it is asked: odds of 1 to 100."""
LEAST_LOAD = 0.2
"""Share of its mass that every vehicle lifts besides: without that much thrust to spare it would not be flown."""


class InFlight(Enum):
    """What the flight program may do about an adopted effect."""

    WRENCH = "compensated as a wrench of the air"
    MEASUREMENT = "corrects a measurement"
    MODEL = "part of the model's own answer"
    NONE = "not compensated in flight"


class BelongsTo(Enum):
    """What an effect, or one coefficient of it, is a property of: whether the next flight has it, too."""

    VEHICLE = "vehicle"
    """Thrust, drag, centre of gravity, the law of ground and walls."""
    WEATHER = "weather"
    """Wind and density: every flight has its own."""
    LOAD = "load"
    """Battery and load: every flight has its own."""
    INSTRUMENT = "instrument"
    """Offset of a sensor: corrects what that sensor reads, and is no force."""
    PLACE = "place"
    """Of surroundings that a range measures: there only where they are seen."""

    @property
    def of_day(self) -> bool:
        """Every flight has its own; the next one starts from the prior."""
        return self in (BelongsTo.WEATHER, BelongsTo.LOAD)


Size = float | Callable[["Context"], float]
"""A number, or one that follows from the vehicle and the flight."""


@dataclass(frozen=True, kw_only=True)
class Coefficient:
    """One linear coefficient: name, unit, the range in which physics expects it, and its prior.

    The prior is a Gaussian about ``centre`` with standard deviation ``typical`` (before any flight was seen), cut off
    at ``low`` and ``high``. ``belongs_to`` is given where it is not what its effect belongs to.
    """

    name: str
    unit: str
    low: Size
    high: Size
    typical: Size = 1.0
    centre: Size = 0.0
    belongs_to: BelongsTo | None = None
    optional: bool = False
    """A model directory may lack it: 0 there."""
    foretold: bool = False
    """What it multiplies is a motion that no sensor saw, foretold with errors: the fit comes out too small."""

    def spread(self, ctx: Context) -> float:
        """Standard deviation of the prior."""
        if callable(self.typical):
            return self.typical(ctx)
        return self.typical

    def least(self, ctx: Context) -> float:
        """Lower end of what physics expects."""
        if callable(self.low):
            return self.low(ctx)
        return self.low

    def most(self, ctx: Context) -> float:
        """Upper end of what physics expects."""
        if callable(self.high):
            return self.high(ctx)
        return self.high

    def mean(self, ctx: Context) -> float:
        """Mean of the prior."""
        if callable(self.centre):
            return self.centre(ctx)
        return self.centre


@dataclass(frozen=True, kw_only=True)
class Shape:
    """One non-linear parameter, profiled on a grid; ``kinds`` are values that have nothing in between.

    A parameter without ``continuous`` is a kind (a fan's number) or a reference, and never moves off its grid.
    """

    name: str
    unit: str
    continuous: bool = True
    kinds: tuple[float, ...] = ()
    typical: float | None = None
    """Standard deviation of the prior about zero; None: all values are as likely."""
    free_at_zero: bool = False
    """Zero is a value like others (there is no dead time), not the edge of what was tried."""
    tried: tuple[float, ...] = ()
    """Its values on the grid, where they are the same on every flight."""


@dataclass(frozen=True, kw_only=True)
class Context:
    """What an effect may look at: the state of the air, the vehicle, and the fan model (None: the empty model).

    ``state`` has leading shape () in flight and (n,) in replay, there on a uniform time axis with NaN where unknown.
    """

    state: AirState
    vehicle: Vehicle
    model: FanModel | None = None
    clock_moved_s: float = 0.0
    """How much later than stamped the rotor speeds were taken to be."""
    commanded: float = 1.0
    """Probability that the thrust changed by command, and not only in response to disturbances (``delays.py``)."""
    accelerometer: bool = True
    """Whether the specific force was measured, and not computed from the velocity."""
    open_sky: bool = False
    """Whether satellites gave a place: the vehicle flew outdoors, where some wind blows on most days."""
    judged_s: tuple[float, float] | None = None
    """First and last time of a record that is judged, in the air; None: all of it."""

    @property
    def record(self) -> bool:
        """True for a record (n,), False for one instant."""
        return self.state.time_s.ndim == 1

    @cached_property
    def rotor_rpm(self) -> Array:
        """(..., rotors): telemetered, or as the servo outputs declare."""
        if self.vehicle.telemetered or np.isfinite(self.state.rpm).any():
            return self.state.rpm
        return rpm_from_servos(self.vehicle, self.model, self.state.servo_us)

    @cached_property
    def rpm(self) -> Array:
        """(..., fans)."""
        return fan_rpm(self.vehicle, self.rotor_rpm)

    @cached_property
    def thrust(self) -> Array:
        """Declared free-air thrust of every fan [N], (..., fans)."""
        if not self.vehicle.telemetered and not np.isfinite(self.state.rpm).any():
            per_rotor = servo_thrust(self.vehicle, self.state.servo_us)
            return np.asarray(np.add.reduceat(per_rotor, self.vehicle.first_rotors, axis=-1))
        each = zip(self.vehicle.fans, np.moveaxis(self.rpm, -1, 0), strict=True)
        return np.stack(
            [free_air_thrust(self.vehicle, self.model, fan, rpm) for fan, rpm in each], axis=-1
        )

    @cached_property
    def shared_thrust(self) -> Array:
        """Declared free-air thrust of every fan by its mean share of the total in a record [N], (..., fans).

        What a fan does more than its share answers disturbances of the moment within the control loop: an effect that
        scales it would be fitted to those. In flight (one instant) it is ``thrust``.
        """
        if not self.record:
            return self.thrust
        total = self.thrust.sum(axis=-1)
        share = np.nanmean(self.thrust, axis=0) / np.nanmean(total)
        return np.asarray(total[..., None] * share)

    @cached_property
    def felt_slope(self) -> float:
        """How much more than declared a change of thrust does in a record, by what the accelerometer feels of it.

        Two-stage least squares with the specific force as instrument (Wooldridge 2010, Econometric Analysis of Cross
        Section and Panel Data, ch. 5): thrust that takes off a disturbance within the control loop is not felt. Noise
        of the accelerometer makes it too large, nothing makes it too small.
        """
        thrust = self.thrust.sum(axis=-1) / self.weight
        felt = -self.state.specific_force[:, 2] / GRAVITY
        apart = max(round(APART_S / float(np.median(np.diff(self.state.time_s)))), 1)
        a, b = (x[apart:] - x[:-apart] for x in (thrust, felt))
        known = np.isfinite(a) & np.isfinite(b)
        return float(b[known] @ b[known]) / max(float(a[known] @ b[known]), 1e-12) - 1.0

    @cached_property
    def shared_rpm(self) -> Array:
        """Rotor speeds (..., rotors) at which every fan gives its ``shared_thrust``."""
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.sqrt(self.shared_thrust / self.thrust)
        return (
            self.rotor_rpm
            * np.where(np.isfinite(ratio), ratio, 1.0)[..., np.asarray(self.vehicle.rotor_fan)]
        )

    @cached_property
    def rotor_wrench(self) -> Array:
        """Declared free-air wrench of all rotors about the CG, (..., 6)."""
        return self.lift(self.thrust)

    @cached_property
    def rotor_moment(self) -> Array:
        """Declared moment of all rotors about the CG, their torques included, (..., 3)."""
        out: Array = self.rotor_wrench[..., 3:].copy()
        out[..., 2] += fan_torques(self.vehicle, self.rotor_rpm).sum(axis=-1)
        return out

    @cached_property
    def rotor_force(self) -> Array:
        """``rotor_wrench`` without its moments (..., 6).

        For scales of the whole thrust: differential thrust depends on inertia and geometry more than on a common scale.
        """
        out = self.rotor_wrench.copy()
        out[..., 3:] = 0.0
        return out

    @cached_property
    def velocity(self) -> Array:
        """Velocity over ground, body FRD, (..., 3)."""
        return np.asarray(
            np.einsum("...ji,...j->...i", self.state.rotation, self.state.velocity_ned)
        )

    @cached_property
    def turning(self) -> Array:
        """What turning adds to the velocity of every fan's reference point, omega x r, body FRD, (..., fans, 3)."""
        return np.asarray(np.cross(self.state.rates[..., None, :], self.vehicle.fan_positions_m))

    @cached_property
    def density(self) -> Array:
        """Air density [kg/m^3] of the ideal gas, (...); NaN where pressure or temperature is unknown."""
        return self.state.pressure_pa / (GAS_CONSTANT_AIR * (self.state.air_temperature_c + 273.15))

    @cached_property
    def mass_flow(self) -> Array:
        """Momentum theory's mass flow of every fan in hover, sqrt(rho A T) [kg/s], (..., fans)."""
        return np.sqrt(RHO_SEA_LEVEL * self.vehicle.disc_area_m2 * np.maximum(self.thrust, 0.0))

    def level_drag(self, velocity: Array, flow: Array, above_m: float) -> Array:
        """Wrench about the CG (..., 6) that takes ``flow`` (..., fans) of air up to the level part of ``velocity``."""
        level = -velocity
        level[..., 2] = 0.0
        return self.wrench_at_cg(flow[..., None] * level, above_m)

    def own_drag(self, above_m: float) -> tuple[Array, Array, Array]:
        """``level_drag`` of moving over ground, of turning, and what sinking adds to that of moving.

        Sinking along the rotor axis adds rho A v_down to the mass flow.
        """
        own = self.velocity[..., None, :]
        sinking = (
            RHO_SEA_LEVEL
            * self.vehicle.disc_area_m2
            * own[..., 2]
            * np.ones(len(self.vehicle.fans))
        )
        return (
            self.level_drag(own, self.mass_flow, above_m),
            self.level_drag(self.turning, self.mass_flow, above_m),
            self.level_drag(own, sinking, above_m),
        )

    def by_model(self, declared: float, empty: float) -> float:
        """One of two numbers: where a model of the surroundings is declared, or none, so that all of it is missing."""
        if self.model is None:
            return empty
        return declared

    def by_kind(self, speeds: float, outputs: float) -> float:
        """One of two numbers: where thrust is declared by rotor speeds, or by servo outputs, which say less."""
        if self.vehicle.telemetered:
            return speeds
        return outputs

    def if_outdoors(self, outdoors: float, elsewhere: float) -> float:
        """One of two numbers: where satellites were received, or where nothing says that the flight was outdoors."""
        if self.open_sky:
            return outdoors
        return elsewhere

    def if_commanded(self, chance: float) -> float:
        """The chance of an effect that shows in commanded changes of the thrust only: others pass for it."""
        return max(chance * self.commanded, IMPOSSIBLE)

    @property
    def most_load_kg(self) -> float:
        """What the rotors can lift besides the vehicle: by their full thrust, or else as much again as it weighs."""
        throttle = self.vehicle.throttle
        if throttle is None:
            return self.vehicle.mass_kg
        lifted = throttle.max_thrust_n * len(self.vehicle.rotors) / GRAVITY
        return max(lifted - self.vehicle.mass_kg, LEAST_LOAD * self.vehicle.mass_kg)

    @property
    def weight(self) -> float:
        """Declared weight [N]."""
        return self.vehicle.mass_kg * GRAVITY

    @property
    def lever(self) -> float:
        """Farthest fan from the CG, or the rotor's radius where that is larger [m]: unit of arms."""
        return float(
            max(
                np.linalg.norm(self.vehicle.fan_positions_m, axis=1).max(),
                self.vehicle.rotor_radius_m,
            )
        )

    def wrench_at_cg(self, forces: Array, above_m: float = 0.0) -> Array:
        """Wrench about the CG (..., 6) of body forces (..., fans, 3) that act ``above_m`` over the reference points."""
        wrenches = np.concatenate([forces, np.zeros_like(forces)], axis=-1)
        return np.asarray(
            at_cg(wrenches, self.vehicle.fan_positions_m - above_m * DOWNWARD).sum(axis=-2)
        )

    def lift(self, forces: Array) -> Array:
        """Wrench about the CG (..., 6) of forces (..., fans) up the fans' axes."""
        return self.wrench_at_cg(-forces[..., None] * DOWNWARD)

    def corners(self, wrenches: Array, bearing: ArrayLike) -> Array:
        """Wrench about the CG (..., 6) of the fans' corner-frame wrenches (..., fans, 6), wall at ``bearing``."""
        body = corner_to_body(wrenches, np.asarray(bearing)[..., None])
        return np.asarray(at_cg(body, self.vehicle.fan_positions_m).sum(axis=-2))

    def pull(self, forces: Array, bearing: ArrayLike) -> Array:
        """Wrench about the CG (..., 6) of forces (..., fans) towards a wall at ``bearing``."""
        return self.corners(forces[..., None] * PULL, bearing)

    def tilt(self, forces: Array, bearing: ArrayLike) -> Array:
        """Wrench about the CG (..., 6) of moments, a force (..., fans) times the radius, that tilt towards a wall."""
        return self.corners((self.vehicle.rotor_radius_m * forces)[..., None] * TILT, bearing)


FROM_S = "from_s"
UNTIL_S = "until_s"
"""Shapes of what begins or ends in flight: the times from and until which it acts [s]."""
Wrenches = Callable[[Context, tuple[float, ...]], tuple[Array, ...]]
Grid = Callable[[Context], Sequence[tuple[float, ...]]]


def always(_: Context) -> str | None:
    """``lacking`` of effects that need nothing besides rotors and IMU."""
    return None


def where_commanded(ctx: Context) -> str | None:
    """``lacking`` of effects that show in commanded changes of the thrust only.

    A response to a disturbance looks like such an effect however much data there is. So the odds of the effect are
    never better than those of the command.
    """
    if ctx.commanded < LEAST_COMMANDED:
        return "the thrust changed only in response to disturbances"
    return None


def where_seen(distance: str, otherwise: str) -> Callable[[Context], str | None]:
    """``lacking`` of an effect of what is at this ``distance`` of the state; ``otherwise`` says that none was seen."""
    return lambda ctx: None if np.isfinite(getattr(ctx.state, distance)).any() else otherwise


@dataclass(frozen=True)
class Drawn:
    """How a record shows an effect: force or moment in ``direction`` (6,) or (n, 6) over a quantity ``values`` (n,)."""

    label: str
    """Of the quantity, with its unit."""
    values: Array
    force_label: str
    direction: Array


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A number that is said in place of one parameter, in the words and units of people.

    A model directory keeps the parameter: the force that it stands for is the same.
    """

    instead_of: str
    name: str
    unit: str
    of: Callable[[Context, Mapping[str, Array]], Array] | None = None
    """Of draws (m,) of every parameter, draws (m,) of the quantity; None: the parameter itself, by another name."""


@dataclass(frozen=True)
class Shown:
    """How people see an effect: its picture, its size as a pilot says it, its numbers, and a remark."""

    drawn: Callable[[Context, str], Drawn] | None = None
    """The picture that shows it on one axis; None: over time."""
    in_words: Callable[[Context, Mapping[str, float]], str] | None = None
    """Its size on a record, by its numbers as they are said; None: by these numbers."""
    quantities: tuple[Quantity, ...] = ()
    """Numbers that are said in place of parameters; all other parameters are said as they are."""
    log_weight: Callable[[Context, Mapping[str, Array]], Array] | None = None
    """Of draws (m,) of every parameter, log weights (m,): prior of the quantities over that of the parameters."""
    remark: Callable[[Mapping[str, bool]], str | None] | None = None
    """By which parameters the flights determine."""


@dataclass(frozen=True)
class FlightUse:
    """What the flight program does with an adopted effect."""

    use: InFlight = InFlight.WRENCH
    gain: bool = False
    """A gain on it is measured (``--adapt``): it comes with a place, so nothing steady is taken for it."""
    corrected: Callable[[AirState, Mapping[str, float]], AirState] | None = None
    """Of what corrects a measurement: the state without the instrument's error, by adopted parameters."""
    covered: tuple[str, ...] = ()
    """Parameters that say where flights have measured it; empty: it holds everywhere."""
    coverage: Callable[[Sequence[Context]], Mapping[str, float]] | None = None
    """Those parameters by flights."""


_SHOWN = Shown()
_FLOWN = FlightUse()
NOT_FLOWN = FlightUse(InFlight.NONE)


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
    shapes: tuple[Shape, ...] = ()
    grid: Grid | None = None
    """Places that are tried, by the flight; None: every combination of what its shapes name."""
    halvings: int = 2
    """How often the grid of its shapes is halved about the best."""
    of_inputs: bool = False
    """It follows from the rotors' past alone, and from nothing of the motion: a record of them says it ahead."""
    may_begin: bool = False
    """It may begin or end in flight: the search of one flight tries times at which the residual changes."""
    at_shape: bool = False
    """The one coefficient is a length at which the one shape linearises: both have to agree."""
    mixing: Callable[[tuple[float, ...]], Array] | None = None
    """(k, k) by shape: the coefficients are this times independent ones, whose priors ``coefficients`` give.

    The regressors are then the same in every shape, and there are no model-form errors."""
    kinematic_bias: Callable[[Context, tuple[float, ...]], Array] | None = None
    """(3, k): what it adds to accelerometer minus what velocity and attitude imply [m/s^2]; None: nothing."""
    # Which flights can show it, and by which axes.
    lacking: Callable[[Context], str | None] = always
    needs_moments: bool = False
    """Without moments it cannot be distinguished from others."""
    searched: tuple[str, ...] = ()
    """Axes by which it is looked for, where others would only answer disturbances; empty: all that it acts on."""
    # When it is believed.
    chance: Size = 0.05
    """Probability: how often such a thing is undeclared, before any flight was seen."""
    main: tuple[str, ...] = ()
    """Coefficients of which at least one must be significant; empty: any."""
    exact: bool = False
    """A law of mechanics: no error of its form stands beside it, which could pass for another effect's."""
    form: float = 0.12
    """What it may leave at most by an error of its form, as a share of its own: less is not believed beside it."""
    remainder: bool = False
    """Weighed after all others, for what they leave."""
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
        return any(self.is_main(c) and not self.of_day(c) for c in self.coefficients)

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

    def is_main(self, coefficient: Coefficient) -> bool:
        """Whether the effect is not there without it."""
        return not self.main or coefficient.name in self.main

    def log_odds(self, ctx: Context) -> float:
        """Log odds of its being there, before any flight was seen: log(p / (1 - p))."""
        if callable(self.chance):
            chance = self.chance(ctx)
        else:
            chance = self.chance
        return math.log(chance / (1.0 - chance))

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


@dataclass(frozen=True)
class AdoptedEffect:
    """An effect that the diagnosis found missing and added: its catalogue name and fitted parameters, SI."""

    name: str
    parameters: Mapping[str, float] = field(default_factory=dict)
    without: tuple[str, ...] = ()
    """Axes (body FRD about the CG) on which it does not act: there it made the error of the flights larger."""


def when(parameters: Mapping[str, float]) -> str:
    """``, from 12 s on`` and ``, until 40 s`` of an effect that begins or ends in flight; empty for always."""
    start = parameters.get(FROM_S, 0.0)
    end = parameters.get(UNTIL_S, 0.0)
    words = []
    if start > 0.0:
        words.append(f", from {start:.0f} s on")
    if end > 0.0:
        words.append(f", until {end:.0f} s")
    return "".join(words)


def decay(distance: Array, length: float) -> Array:
    """exp(-distance/length), 0 at infinity, no more than at contact; NaN stays NaN."""
    return np.exp(-np.maximum(distance, 0.0) / length)


def through(ctx: Context, values: Array, response: Callable[[NDArray[Any]], NDArray[Any]]) -> Array:
    """A record (n, k) through a linear filter given by its response at angular frequencies [rad/s]; NaN is bridged."""
    n = len(values)
    step = float(np.median(np.diff(ctx.state.time_s)))
    pad = min(n, int(20.0 / step) + 1)
    index = np.arange(n)
    gain = response(2.0 * np.pi * np.fft.rfftfreq(n + 2 * pad, step))
    out = np.full_like(values, np.nan)
    for k, column in enumerate(values.T):
        known = np.isfinite(column)
        if known.any():
            x = np.pad(np.interp(index, index[known], column[known]), pad, mode="edge")
            out[known, k] = np.fft.irfft(np.fft.rfft(x) * gain, len(x))[pad : pad + n][known]
    return out
