"""The smallest size of every effect that these flights would have shown.

An effect that acts with size b is named where its set gains more than its prior odds cost, and where it does more than
one percent of the weight (significance.py). With s the standard deviation of the posterior in units of the prior,
b = z s gains by Laplace's approximation (evidence.py)

    log odds = TRUST (z^2 / 2 + log s) + log prior odds

so the least z for log odds of ``NAMED`` is z^2 = 2 (NAMED - log prior odds) / TRUST - 2 log s. A size of (z + 1.64) s
is estimated at z s or more in 95 of 100 flights. Nor may it be small in the whole flight (``FlightFit.is_small``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.common.frames import AXES, Array
from models.effects import Coefficient, Context
from replay.search.posterior import Walked
from replay.search.significance import tops_of_columns
from replay.search.terms import Term
from replay.search.thresholds import NAMED, OWN, SMALL, TRUST

_ONE_SIDED = 1.64
"""Standard deviations that 95 of 100 estimates lie above, below their mean."""
_NAMED_SIZE = 1.0
"""Smallest top of a named contribution, in hundredths of the weight (``significance.standing``)."""

TINY = 1e-12
"""Keeps a division finite where a column does nothing."""


@dataclass(frozen=True)
class Visible:
    """The least size of one coefficient of an effect that would have been named."""

    what: str
    coefficient: str
    axes: tuple[str, ...]
    least: float
    unit: str


def visible(walked: Walked) -> tuple[Visible, ...]:
    """For every effect that is not in the best set what it would have taken, beside that set.

    Of an effect with several coefficients it is the one that would have shown soonest, in the shape that would. Effects
    that the flights cannot show are left out: ``Library.lacking`` says why.
    """
    named = walked.best.effects
    by_name: dict[str, list[Term]] = {}
    for term in walked.evidence.library.terms:
        if term.effect is None or term.effect.search.remainder:
            continue
        if term.name not in named:
            by_name.setdefault(term.name, []).append(term)
    gain = walked.evidence.screen(walked.best)
    found = [_least_of(walked, terms, gain) for terms in by_name.values()]
    return tuple(one for one in found if one is not None)


def _least_of(walked: Walked, terms: Sequence[Term], gain: Array) -> Visible | None:
    """Of one effect, in its likeliest shape beside the best set by the ``gain`` of every term."""
    library = walked.evidence.library
    numbers = library.numbers_of[terms[0].key]
    likeliest = max(numbers, key=lambda number: float(gain[number]))
    term = library.terms[likeliest]
    sizes = _least_sizes(walked, term)
    # Sizes of several units are compared by the prior: what would be least unusual.
    soonest = int(np.argmin(sizes))
    if not np.isfinite(sizes[soonest]):
        return None
    flight = min(term.places)
    context = library.records[flight].context
    scale = term.scale[term.place(flight)]
    least = float(sizes[soonest] * scale[soonest])
    coefficient = term.named.coefficients[soonest]
    farthest = max(coefficient.most(context), -coefficient.least(context))
    if least > farthest:
        return None
    name, size, unit = _said(term, context, coefficient, least)
    return Visible(
        what=term.name,
        coefficient=name,
        axes=_axes(walked, term, soonest),
        least=size,
        unit=unit,
    )


def _said(
    term: Term, context: Context, coefficient: Coefficient, least: float
) -> tuple[str, float, str]:
    """Name, size and unit as people say it: with the other parameters at their prior mean."""
    effect = term.named
    quantity = next((q for q in effect.shown.quantities if q.instead_of == coefficient.name), None)
    if quantity is None:
        return coefficient.name, least, coefficient.unit
    usual = {c.name: c.mean(context) for c in effect.coefficients}
    usual |= {s.name: value for s, value in zip(effect.shapes, term.shape, strict=True)}
    said = effect.said(context, usual | {coefficient.name: least})
    return quantity.name, said[quantity.name], quantity.unit


def _least_sizes(walked: Walked, term: Term) -> Array:
    """Of every coefficient (k,) in units of its prior; infinite where none would do."""
    best = walked.best
    fit = walked.evidence.refit([*best.terms, term], best.noise)
    part = fit.part(term)
    place = term.place(min(term.places))
    variance = np.diag(fit.cov[part, part])
    sd = np.sqrt(variance)[place]
    odds = (NAMED - term.log_odds) / TRUST
    log_sd = np.log(np.minimum(sd, 1.0))
    z = np.sqrt(np.maximum(2.0 * odds - 2.0 * log_sd, 0.0))
    by_evidence = (z + _ONE_SIDED) * sd
    by_weight = np.maximum(_for_a_hundredth(walked, term), _not_small(walked, term))[place]
    main = term.main[place] > 0.0
    return np.where(main, np.maximum(by_evidence, by_weight), np.inf)


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


def _for_a_hundredth(walked: Walked, term: Term) -> Array:
    """Size (k,) at which each column does what a name takes, on the channel where that is soonest."""
    out = np.full(len(term.columns), np.inf)
    for channel in walked.evidence.library.channels:
        if term.named.search.needs_moments and channel.axis < 3:
            continue
        share = tops_of_columns(channel, term)
        acting = channel.where[term.columns] >= 0
        size = max(_NAMED_SIZE, OWN) / np.maximum(share, TINY)
        out = np.minimum(out, np.where(acting, size, np.inf))
    return out


def _axes(walked: Walked, term: Term, coefficient: int) -> tuple[str, ...]:
    """Axes that were judged and on which the coefficient acts."""
    column = term.columns[term.place(min(term.places))[coefficient]]
    channels = walked.evidence.library.channels
    acting = {channel.axis for channel in channels if channel.where[column] >= 0}
    return tuple(AXES[axis] for axis in sorted(acting))
