"""A term: one effect in one shape (or one free curve) with its prior, its wrench, and its model-form error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import log_ndtr

from models.common.frames import Array
from models.effects import Context, Effect
from replay.residual.grid import Mask
from replay.residual.record import Record
from replay.search.channel import Columns
from replay.search.thresholds import AT_SHAPE_SPREAD, FORM_LEAST, FORM_PRIOR

Key = tuple[str, int | None, str | None, int]
"""Name, flight (of an effect of one flight), axis (of a free curve) and which of several such effects (from 1): what
may be in a set only once."""
Shape = tuple[float, ...]
"""Shape parameters of an effect, in their order."""
STEP_S = 0.2
"""Spacing of the samples that are searched: the residual holds nothing above 2 Hz."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Term:
    """One effect in one shape (or one free curve): Gaussian prior on its coefficients, cut off at bounds.

    Columns are in units of the prior's standard deviation: a coefficient has prior N(``centre``, 1) there.
    """

    name: str
    effect: Effect | None
    shape: Shape
    columns: Columns
    scale: Array
    centre: Array
    low: Array
    high: Array
    log_shape: float
    """Log prior of this shape among the effect's."""
    log_odds: float
    """Of the effect, or of the free curve, before any flight was seen."""
    main: Array
    """(k,) 1 for coefficients that make the effect what it is, else 0."""
    places: dict[int, Columns]
    """Of every flight that it acts on: columns of its coefficients there, in their order."""
    flight: int | None = None
    axis: str | None = None
    """Of a free curve."""
    instance: int = 1
    """Which one of an effect that a vehicle may have several times."""

    @property
    def named(self) -> Effect:
        """The effect; not to be asked of a free curve."""
        assert self.effect is not None
        return self.effect

    @property
    def prior(self) -> float:
        """Log odds of it in its shape, before any flight was seen."""
        return self.log_odds + self.log_shape

    @cached_property
    def log_within(self) -> float:
        """Log share of the prior that lies within the bounds."""
        return float(log_mass(self.low, self.high, self.centre, np.ones(len(self.low))).sum())

    @cached_property
    def form(self) -> Mask:
        """(k,) whether a coefficient is a model-form error."""
        coefficients = np.concatenate([np.empty(0, np.int64), *self.places.values()])
        return ~np.isin(self.columns, coefficients)

    def place(self, flight: int) -> Columns:
        """Which of its columns are the coefficients on a flight (k,)."""
        return np.searchsorted(self.columns, self.places[flight])

    @cached_property
    def key(self) -> Key:
        """What may be there only once."""
        return (self.name, self.flight, self.axis, self.instance)

    @cached_property
    def order(self) -> str:
        """Where it stands among others."""
        return str(self.key)


def without_form(term: Term) -> Term:
    """The term without its model-form errors."""
    by_column = ("columns", "scale", "centre", "low", "high", "main")
    return replace(term, **{name: getattr(term, name)[~term.form] for name in by_column})


def log_mass(low: Array, high: Array, mean: Array, sd: Array) -> Array:
    """Log of the probability of N(mean, sd) between low and high, element by element."""
    lo = np.maximum((low - mean) / sd, -1e8)
    hi = np.minimum((high - mean) / sd, 1e8)
    # Logarithms are exact in the lower tail.
    flip = lo > 0.0
    log_lower = log_ndtr(np.where(flip, -hi, lo))
    log_upper = log_ndtr(np.where(flip, -lo, hi))
    log_ratio = np.minimum(log_lower - log_upper, -1e-12)
    return np.asarray(log_upper + np.log1p(-np.exp(log_ratio)))


def prior_of(effect: Effect, context: Context, shape: Shape) -> tuple[Array, Array]:
    """Standard deviation and mean of the prior of every coefficient (k,), in the coefficients' own units."""
    spread = np.array([c.spread(context) for c in effect.coefficients])
    centre = np.array([c.mean(context) for c in effect.coefficients])
    if effect.search.at_shape:
        spread[0] = AT_SHAPE_SPREAD * abs(shape[0])
        centre[0] = shape[0]
    return spread, centre


def regressors_of(effect: Effect, record: Record, shape: Shape) -> Array:
    """Wrenches (n, 6, k) per independent coefficient [N, N m], 0 where a measurement is missing."""
    x = unmixed_regressors(effect, record, shape)
    if effect.mixing is None:
        return x
    return np.asarray(x @ effect.mixing(shape))


def unmixed_regressors(effect: Effect, record: Record, shape: Shape) -> Array:
    """Wrenches (n, 6, k) per coefficient [N, N m], 0 where a measurement is missing."""
    with np.errstate(invalid="ignore", over="ignore"):
        return np.nan_to_num(effect.regressors(record.context, shape), posinf=0.0, neginf=0.0)


def bent_forms(x: Array, record: Record) -> list[Array]:
    """What a wrong form adds to a contribution (n, 6): a gain that goes with its size, orthogonal to itself.

    FORM_PRIOR phi_p(u) x, with u the size of x over its 99th percentile (1 at most) and phi_1, phi_2 the polynomials of
    degree 1 and 2 that are orthogonal to those of lower degree with weight |x|^2 (Gram-Schmidt), of unit norm.
    """
    valid = record.valid
    force = (x[:, :3] ** 2).sum(axis=1)
    moment = (x[:, 3:] ** 2).sum(axis=1)
    size = np.sqrt(force + moment / record.context.lever**2)
    if not valid.any():
        return []
    top = float(np.quantile(size[valid], 0.99))
    if top < 1e-9 * record.context.weight:
        return []
    u = np.minimum(size / top, 1.0)
    weight = np.where(valid, size**2, 0.0)
    whole = float(weight.sum())
    out = []
    basis = [np.ones_like(u)]
    for degree in (1, 2):
        phi = u**degree
        for lower in basis:
            projection = (weight * phi * lower).sum() / (weight * lower**2).sum()
            phi = phi - lower * float(projection)
        energy = float((weight * phi**2).sum())
        if energy < FORM_LEAST**2 * whole:
            break
        basis.append(phi)
        norm = float(np.sqrt(energy / whole))
        gain = FORM_PRIOR * phi / norm
        out.append(x * gain[:, None])
    return out


def log_shapes(effect: Effect, shapes: Sequence[Shape]) -> list[float]:
    """Log prior of every shape of the grid: half of it to kinds, the rest as the shapes' own priors say.

    A shape v has exp(-1/2 sum (v_i / typical_i)^2) over the sum of all that are kinds, or of all that are not.
    """
    kinds = []
    exponents = []
    for shape in shapes:
        values = list(zip(shape, effect.shapes, strict=True))
        kinds.append(any(value in parameter.kinds for value, parameter in values))
        squares = [(v / p.typical) ** 2 for v, p in values if p.typical]
        exponents.append(-0.5 * sum(squares))
    is_kind = np.array(kinds)
    weight = np.exp(exponents)
    groups = [group for group in (is_kind, ~is_kind) if group.any()]
    for group in groups:
        weight[group] *= 1.0 / len(groups) / weight[group].sum()
    return list(map(float, np.log(weight)))
