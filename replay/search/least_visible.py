"""The smallest size of every effect that these flights would have shown.

An effect that acts with size b is named where its set gains more than its prior odds cost, and where it stands out
(significance.py). With s the standard deviation of the posterior in units of the prior, b = z s gains by Laplace's
approximation (evidence.py), the noise as it is,

    log odds = TRUST (z^2 / 2 + log s) + log prior odds

so the least z for log odds of ``NAMED`` is z^2 = 2 (NAMED - log prior odds) / TRUST - 2 log s. Without the effect the
noise takes what it can, and z^2 / 2 becomes what its likelihood loses (``Evidence.score_disturbed``). What is estimated
is (1 - s^2) b, and at least (1 - s^2) b - 1.64 s in 95 of 100 flights. Nor may it be small in the whole flight
(``FlightFit.is_small``). ``SURE`` is for all else.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.common.frames import AXES, Array
from models.effects import Coefficient, Context
from replay.search.posterior import Walked
from replay.search.significance import tops_of_columns
from replay.search.terms import Term
from replay.search.thresholds import LEARNT, NAMED, SMALL, TRUST

_ONE_SIDED = 1.64
"""Standard deviations that 95 of 100 estimates lie above, below their mean."""

SURE = 1.3
"""By this the least size is larger: held-out time asks for more, and of several shapes another one may be taken."""
STEP = 1.2
STEPS = 12
"""By this a size is raised until it is named, and tried so often: to seven times what the noise as it is asks for."""

TINY = 1e-12
"""Keeps a division finite where a column does nothing."""


@dataclass(frozen=True)
class LeastSize:
    """The least size of the coefficient of a term that would have shown soonest, in its own unit, on one flight."""

    term: Term
    number: int
    flight: int
    size: float

    @property
    def coefficient(self) -> Coefficient:
        """What has that size."""
        return self.term.named.coefficients[self.number]


@dataclass(frozen=True)
class Visible:
    """The same as people say it."""

    what: str
    coefficient: str
    axes: tuple[str, ...]
    least: float
    unit: str


def visible(walked: Walked) -> tuple[Visible, ...]:
    """For every effect that is not in the best set what it would have taken, beside that set."""
    library = walked.evidence.library
    out = []
    for least in least_sizes(walked):
        name, size, unit = _said(least, library.records[least.flight].context)
        axes = _axes(walked, least)
        out.append(Visible(least.term.name, name, axes, size, unit))
    return tuple(out)


def least_sizes(walked: Walked) -> list[LeastSize]:
    """Of every effect that is not in the best set, in its likeliest shape beside that set.

    Effects that the flights cannot show are left out: ``Library.lacking`` and ``excited`` say why.
    """
    library = walked.evidence.library
    gain = walked.evidence.screen(walked.best)
    known = set(walked.best.effects)
    out = []
    for numbers in library.numbers_of.values():
        likeliest = max(numbers, key=lambda number: float(gain[number]))
        term = library.terms[likeliest]
        if term.effect is None or term.effect.search.remainder or term.name in known:
            continue
        known.add(term.name)
        if not excited(walked, term):
            continue
        least = _least_size(walked, term)
        context = library.records[least.flight].context
        farthest = max(least.coefficient.most(context), -least.coefficient.least(context))
        if least.size <= farthest:
            out.append(least)
    return out


def excited(walked: Walked, term: Term) -> bool:
    """Whether the flights would know one of its main coefficients, beside the set.

    Its standard deviation s / sqrt(TRUST) makes less than a hundredth of the weight, the smallest effect that is named.
    """
    evidence = walked.evidence
    fit = evidence.refit([*walked.best.terms, term], walked.best.noise)
    part = fit.part(term)
    variance = np.diag(fit.cov[part, part]) / TRUST
    error = np.sqrt(variance)
    # Where the prior alone says as much, the flight has said nothing.
    known = error < LEARNT / np.sqrt(TRUST)
    unit = np.zeros(len(term.columns))
    for channel in evidence.library.channels:
        unit = np.maximum(unit, tops_of_columns(channel, term))
    shown = known & (term.main > 0) & (error * unit < 1.0)
    return bool(shown.any())


def _said(least: LeastSize, context: Context) -> tuple[str, float, str]:
    """Name, size and unit as people say it: with the other parameters at their prior mean."""
    effect = least.term.named
    coefficient = least.coefficient
    quantity = next((q for q in effect.shown.quantities if q.instead_of == coefficient.name), None)
    if quantity is None:
        return coefficient.name, least.size, coefficient.unit
    usual = {c.name: c.mean(context) for c in effect.coefficients}
    usual |= {s.name: value for s, value in zip(effect.shapes, least.term.shape, strict=True)}
    said = effect.said(context, usual | {coefficient.name: least.size})
    return quantity.name, said[quantity.name], quantity.unit


def _least_size(walked: Walked, term: Term) -> LeastSize:
    """Of the coefficient of a term that would have shown soonest; infinite where none would."""
    best = walked.best
    fit = walked.evidence.refit([*best.terms, term], best.noise)
    part = fit.part(term)
    flight = min(term.places)
    place = term.place(flight)
    # In units of the prior from here on.
    variance = np.diag(fit.cov[part, part])[place]
    sd = np.minimum(np.sqrt(variance), 1.0)
    log_odds = NAMED - term.log_odds - TRUST * np.log(sd)
    z = np.sqrt(np.maximum(2.0 / TRUST * log_odds, 0.0))
    sizes = np.maximum(z * sd, _not_small(walked, term)[place])
    for number in range(len(place)):
        sizes[number] = _standing_from(walked, term, int(place[number]), float(sizes[number]))
    # Sizes of several units are compared by the prior: what would be least unusual.
    number = int(np.argmin(sizes))
    size = _named_from(walked, term, int(place[number]), float(sizes[number]))
    shown = max(1.0 - float(variance[number]), TINY)
    size = SURE * (size + _ONE_SIDED * float(sd[number])) / shown
    return LeastSize(
        term=term,
        number=number,
        flight=flight,
        size=size * float(term.scale[place[number]]),
    )


def _standing_from(walked: Walked, term: Term, column: int, size: float) -> float:
    """The size, from ``size`` on, at which a column of a term stands out; infinite where it is no main one."""
    if term.main[column] == 0.0 or not np.isfinite(size):
        return np.inf
    acting = np.zeros(len(term.columns))
    acting[column] = size
    stands_out = walked.evidence.stands_out_with(walked.best, term, acting)
    return size / min(max(stands_out, TINY), 1.0)


def _named_from(walked: Walked, term: Term, column: int, size: float) -> float:
    """The size, from ``size`` on, at which a term with one column is likelier than not; infinite for none."""
    evidence = walked.evidence
    best = walked.best
    named = evidence.fit([*best.terms, term], best.noise)
    named_score = TRUST * named.evidence + named.prior
    acting = np.zeros(len(term.columns))
    for _ in range(STEPS):
        if not np.isfinite(size):
            break
        acting[column] = size
        unusual = 0.5 * TRUST * size**2
        gained = named_score - unusual - evidence.score_disturbed(best, term, acting)
        if gained >= NAMED:
            return size
        size *= STEP
    return np.inf


def _not_small(walked: Walked, term: Term) -> Array:
    """Size (k,) from which on each column is not small in the whole flight where that is soonest.

    A column of mean square x^2, in hundredths of the weight, is at size b a hundredth of it where b x = 1. It is the
    share ``SMALL`` of an axis that has y^2 without it where b^2 x^2 (1 - SMALL) = SMALL y^2.
    """
    least = np.full(len(term.columns), np.inf)
    of_flight: dict[int, Array] = {}
    for channel in walked.evidence.library.channels:
        rows = channel.where[term.columns]
        square = np.zeros(len(rows))
        columns = channel.rows[rows[rows >= 0]]
        square[rows >= 0] = (columns**2).sum(axis=1) / channel.count / channel.limit**2
        residual = (channel.rows[0] ** 2).sum() / channel.count / channel.limit**2
        share = SMALL / (1.0 - SMALL) * residual / np.maximum(square, TINY)
        least = np.minimum(least, np.sqrt(share))
        of_flight[channel.flight] = of_flight.get(channel.flight, 0.0) + square
    for square in of_flight.values():
        least = np.minimum(least, 1.0 / np.sqrt(np.maximum(square, TINY)))
    return least


def _axes(walked: Walked, least: LeastSize) -> tuple[str, ...]:
    """Axes that were judged and on which the coefficient acts."""
    term = least.term
    column = term.columns[term.place(least.flight)[least.number]]
    channels = walked.evidence.library.channels
    acting = {channel.axis for channel in channels if channel.where[column] >= 0}
    return tuple(AXES[axis] for axis in sorted(acting))
