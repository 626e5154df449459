"""How the sizes of a vehicle's effects differ from flight to flight where nothing changed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from models.common.frames import Array
from models.effects import AdoptedEffect, BelongsTo, Coefficient, Effect
from replay.residual.record import Record
from replay.search.evidence import Evidence
from replay.search.library import Library
from replay.search.terms import regressors_of

USUAL_SHARE = {
    BelongsTo.VEHICLE: 0.12,
    BelongsTo.PLACE: 0.25,
    BelongsTo.INSTRUMENT: 0.5,
    BelongsTo.LOAD: 0.25,
    BelongsTo.WEATHER: 1.0,
}
"""Spread of a size from flight to flight before any was seen, as a share of what is typical of it undeclared.

Parts hardly change, a sensor wakes up with another offset, and nothing is known of the weather.
"""
USUAL_FLIGHTS = 4.0
"""Flights that this counts for."""


@dataclass(frozen=True)
class VarianceComponent:
    """One coefficient of an effect in one shape, with its standard deviation from flight to flight."""

    effect: Effect
    shape: tuple[float, ...]
    coefficient: int
    sd: float

    def wrench(self, record: Record) -> Array:
        """Of one standard deviation (n, 6); zero where the log lacks what it needs."""
        if self.effect.lacking(record.context) is not None:
            return np.zeros((len(record.valid), 6))
        return regressors_of(self.effect, record, self.shape)[..., self.coefficient] * self.sd


def usual(
    effects: Sequence[Effect], found: Sequence[AdoptedEffect], record: Record
) -> list[VarianceComponent]:
    """Sizes of all effects that every flight has something of, with their usual spread; the weather's is its prior.

    ``found``: gives the shapes; else every kind of an effect, or the first of what would be tried.
    """
    shapes = {e.name: e.parameters for e in found}
    out = []
    for effect in effects:
        if effect.lacking(record.context) is not None or effect.belongs_to is BelongsTo.LOAD:
            continue
        grid = list(effect.shape_grid(record.context))
        if effect.name in shapes:
            grid = [tuple(shapes[effect.name][s.name] for s in effect.shapes)]
        elif any(s.continuous for s in effect.shapes):
            grid = grid[:1]
        for shape in grid:
            for i, c in enumerate(effect.coefficients):
                out.append(
                    VarianceComponent(
                        effect, shape, i, _share(effect, c) * c.spread(record.context)
                    )
                )
    return out


def _share(effect: Effect, coefficient: Coefficient) -> float:
    if effect.law:
        return 1.0
    # A battery is another one as a whole.
    of_load = any(c.belongs_to is BelongsTo.LOAD for c in effect.coefficients)
    own = coefficient.belongs_to or (BelongsTo.LOAD if of_load else effect.belongs_to)
    return USUAL_SHARE[effect.belongs_to if effect.belongs_to is BelongsTo.INSTRUMENT else own]


def as_flown(
    sizes: Sequence[VarianceComponent], records: Sequence[Record]
) -> list[VarianceComponent]:
    """Sizes with the spread that good flights, less what is known of the vehicle, have: one step of EM.

    The variance is the mean of the expected squares: Dempster, Laird & Rubin 1977, J. Royal Stat. Society B 39, 1.
    """
    square = np.full(len(sizes), USUAL_FLIGHTS)
    for record in records:
        evidence = Evidence(Library([record], [], [[size.wrench(record) for size in sizes]]))
        fit = evidence.fit([], evidence.noises.unfitted)
        square += fit.b[-len(sizes) :] ** 2 + np.diag(fit.cov)[-len(sizes) :]
    factors = np.sqrt(square / (USUAL_FLIGHTS + len(records)))
    return [
        replace(size, sd=size.sd * float(factor))
        for size, factor in zip(sizes, factors, strict=True)
    ]
