"""What deserves a name: contributions of a set's terms against the weight, each other, and physical bounds."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from models.common.frames import AXES, Array
from replay.search.channel import ResidualChannel
from replay.search.design import Design
from replay.search.terms import STEP_S, Term, log_mass
from replay.search.thresholds import (
    CANCEL,
    CANCEL_COST,
    CANCEL_FREE,
    CURVE_FORM,
    FORM_LEFT,
    OWN,
    SOFT,
    UNEXPLAINED_S,
    USUAL,
    USUAL_TRIM,
    YAW,
)


class Contributions:
    """What every term of a set does to every channel; ``b`` (k,), ``cov`` (k, k) with the trims behind.

    Of every flight one array: ``rest`` (axes, n), all others (axes, terms, n).
    """

    def __init__(self, design: Design, b: Array, cov: Array) -> None:
        self.design = design
        self._b = b
        self._cov = cov
        of_trims = ~design.of_term.any(axis=0)
        of_each = np.vstack([design.of_term, of_trims])
        terms_and_trims = design.times(np.where(of_each, b, 0.0))
        self.whole = [each[:, :-1] for each in terms_and_trims]
        self.rest = []
        """What the set leaves of every axis."""
        for axes, each in zip(design.library.flights, terms_and_trims, strict=True):
            measured = np.stack([channel.rows[0] for channel in axes])
            modelled = each.sum(axis=1)
            self.rest.append(measured - modelled)

    @cached_property
    def main(self) -> list[Array]:
        """As ``whole``, of the coefficients that make the effect what it is, no farther than their bounds."""
        return self._by_main(within_bounds=True)

    @cached_property
    def anywhere(self) -> list[Array]:
        """The same wherever the coefficients are: of a shape that pushes the other way."""
        return self._by_main(within_bounds=False)

    def _by_main(self, *, within_bounds: bool) -> list[Array]:
        b = self._b.copy()
        design = self.design
        for number, term in enumerate(design.terms):
            part = slice(design.edges[number], design.edges[number + 1])
            if within_bounds:
                b[part] = np.clip(b[part], term.low, term.high)
            if (term.main == 0.0).any():
                b[part] *= term.main
        return design.times(np.where(design.of_term, b, 0.0))

    def own(self, numbers: Sequence[int]) -> list[Array]:
        """Minimum unique contribution of the terms with these numbers: what no other term would take over.

        With b the coefficients and g those of a term's main coefficients and model-form errors, the posterior mean of
        the others given that g are zero is b - S_bg S_gg^-1 g. They stay within their bounds, and within ``USUAL``
        standard deviations of their prior. Laws that can stand in the place of a law stay as they are, and S is the
        covariance given their coefficients: laws add up, and the evidence has told how much of each acts.
        """
        design = self.design
        centre = design.centre
        of_terms = np.arange(len(centre)) < design.edges[-1]
        usual = np.where(of_terms, USUAL, USUAL_TRIM)
        least, most = self._bounds()
        low = np.minimum(self._b, np.maximum(centre - usual, least))
        high = np.maximum(self._b, np.minimum(centre + usual, most))
        lost = np.empty((len(numbers), len(centre)))
        for i, number in enumerate(numbers):
            term = design.terms[number]
            removable = (term.main > 0.0) | term.form
            gone = design.edges[number] + np.flatnonzero(removable)
            cov = self._cov
            alike = self._alike(term)
            if alike.size:
                cov_of_alike = cov[np.ix_(alike, alike)]
                cov = cov - cov[:, alike] @ np.linalg.solve(cov_of_alike, cov[alike])
            weights = np.linalg.solve(cov[np.ix_(gone, gone)], self._b[gone])
            conditional = self._b - cov[:, gone] @ weights
            others = np.clip(conditional, low, high)
            others[alike] = self._b[alike]
            others[gone] = 0.0
            lost[i] = self._b - others
        return design.times(lost)

    def _alike(self, term: Term) -> NDArray[np.int64]:
        """Numbers of the coefficients of laws that can stand in the place of one."""
        out = [np.empty(0, np.int64)]
        if not _is_law(term):
            return out[0]
        edges = self.design.edges
        for number, other in enumerate(self.design.terms):
            if _is_law(other) and other.name in term.named.aliases:
                out.append(np.arange(edges[number], edges[number + 1]))
        return np.concatenate(out)

    def _bounds(self) -> tuple[Array, Array]:
        """The least and the most that every coefficient (k,) may be; a trim has no bounds."""
        trims = np.full(len(self.design.library.trim), np.inf)
        terms = self.design.terms
        low = np.concatenate([*(t.low for t in terms), -trims])
        high = np.concatenate([*(t.high for t in terms), trims])
        return low, high


def _is_law(term: Term) -> bool:
    return term.effect is not None and term.effect.law


def form_variance(u: Contributions) -> Array:
    """Variance (channels,) of what is left by the effects' model-form errors."""
    is_effect = np.array([t.effect is not None for t in u.design.terms], bool)
    out = [np.empty(0)]
    for axes, whole in zip(u.design.library.flights, u.whole, strict=True):
        count = axes[0].count
        mean = whole.sum(axis=2) / count
        mean_square = np.einsum("atn,atn->at", whole, whole) / count
        variance = np.maximum(mean_square - mean**2, 0.0)
        out.append(FORM_LEFT**2 * variance @ is_effect)
    return np.concatenate(out)


def log_significance(u: Contributions) -> float:
    """Log factor of a set for what is too small to be named, softly, and for what cancels.

    - 1/2 sum max((1 - z) / SOFT, 0)^2 - CANCEL_COST max(k - CANCEL, 0)

    over the terms, with z of ``standing`` and k of ``cancelled``. It is no part of the posterior but a loss: a name
    that nobody could act on is worth nothing.
    """
    if not u.design.terms:
        return 0.0
    z = standing(u, u.main, range(len(u.design.terms)))
    short = np.maximum(1.0 - z, 0.0) / SOFT
    too_small = -0.5 * short @ short
    too_much = max(cancelled(u) - CANCEL, 0.0)
    return float(too_small - CANCEL_COST * too_much)


def cancelled(u: Contributions) -> float:
    """Contributions over what they remove together, on the axis where that ratio is largest.

    k^2 = sum |u_i|^2 / (|sum u_i|^2 + n (CANCEL_FREE l)^2), u_i (n,) what a term does and l a hundredth of the weight.
    """
    worst = 0.0
    for axes, whole in zip(u.design.library.flights, u.whole, strict=True):
        together = whole.sum(axis=1)
        hundredths = np.array([channel.limit for channel in axes])
        free = axes[0].count * (CANCEL_FREE * hundredths) ** 2
        each = np.einsum("atn,atn->a", whole, whole)
        all_together = np.einsum("an,an->a", together, together)
        ratio = each / (all_together + free)
        several = np.count_nonzero(whole.any(axis=2), axis=1) > 1
        worst = max(worst, float(np.max(ratio, where=several, initial=0.0)))
    return float(np.sqrt(worst))


def standing(u: Contributions, parts: Sequence[Array], numbers: Sequence[int]) -> Array:
    """How far terms with these numbers stand out by ``parts`` of what they do: from 1 on, a name.

    z = max over channels of min(T / sqrt(1 + F^2 + R^2), O / OWN). In hundredths of the weight: T the top of what a
    term does, F what the other terms may leave by their form, R the slow rest, O its minimum unique contribution.
    """
    terms = u.design.terms
    library = u.design.library
    sizes = tops(u, parts)
    form = (sizes * _errors_of_form(terms)[:, None]) ** 2
    slow = np.concatenate(list(map(slow_rms, u.rest, library.flights)))
    form_of_others = form.sum(axis=0) - form
    beside = (form_of_others + slow**2)[numbers]
    over_rest = sizes[numbers] / np.sqrt(1.0 + beside)
    unique = tops(u, u.own(numbers)) / OWN
    z = np.minimum(over_rest, unique)
    # Lift alone could come from any rotor: an effect that is known by its moment has to show that.
    on_force = np.array([c.axis < 3 for c in library.channels])
    for of_term, number in zip(z, numbers, strict=True):
        effect = terms[number].effect
        if effect is not None and effect.search.needs_moments:
            of_term[on_force] = 0.0
    return np.asarray(z.max(axis=1))


def _errors_of_form(terms: Sequence[Term]) -> Array:
    """What every term (terms,) may leave by its form, as a share of its own."""
    errors = []
    for term in terms:
        if term.effect is None:
            errors.append(CURVE_FORM)
        else:
            errors.append(term.effect.search.form)
    return np.array(errors)


def tops(u: Contributions, parts: Sequence[Array]) -> Array:
    """The top of what every term does to every channel (terms, channels), in hundredths of the weight."""
    sizes = []
    for axes, part in zip(u.design.library.flights, parts, strict=True):
        largest = top(part, axes[0].count)
        sizes.append(largest / units(axes)[:, None])
    return np.concatenate(sizes).T


def tops_of_columns(channel: ResidualChannel, term: Term) -> Array:
    """The top of what every column of a term (k,) does to a channel, in hundredths of the weight."""
    rows = channel.where[term.columns]
    acting = rows >= 0
    columns = channel.rows[rows[acting]]
    out = np.zeros(len(rows))
    out[acting] = top(columns, channel.count) / unit_of(channel)
    return out


def units(axes: Sequence[ResidualChannel]) -> Array:
    """Of every axis (axes,), what a size counts in."""
    return np.array([unit_of(channel) for channel in axes])


def unit_of(channel: ResidualChannel) -> float:
    """What a size counts in: one hundredth of the weight, times the lever for moments, of that ``YAW`` for yaw."""
    if channel.axis == AXES.index("Mz"):
        return YAW * channel.limit
    return channel.limit


def slow_rms(rest: Array, axes: Sequence[ResidualChannel]) -> Array:
    """RMS (axes,) of what is left of a flight (axes, n), averaged over ``UNEXPLAINED_S``, in percent of the weight."""
    width = max(round(UNEXPLAINED_S / STEP_S), 1)
    sum_before = np.zeros((len(rest), rest.shape[1] + 1))
    np.cumsum(rest, axis=1, out=sum_before[:, 1:])
    valid_before = np.concatenate([[0], np.cumsum(axes[0].valid)])
    total = sum_before[:, width:] - sum_before[:, :-width]
    samples = valid_before[width:] - valid_before[:-width]
    mean = total / np.maximum(samples, 1)
    mean_square = (mean**2).sum(axis=1) / max(mean.shape[1], 1)
    return np.asarray(np.sqrt(mean_square) / units(axes))


def top(x: Array, count: int) -> Array:
    """About the 99th percentile of the size of (..., n), of which ``count`` samples are valid and the rest 0."""
    from_largest = max(count // 100, 1)
    out = np.zeros(x.shape[:-1])
    acting = x.any(axis=-1)
    size = np.abs(x[acting])
    # In place: another copy takes as long again.
    size.partition(-from_largest, axis=-1)
    out[acting] = size[:, -from_largest]
    return out


def beyond_bounds(terms: Sequence[Term], b: Array, cov: Array) -> float:
    """Log share of the posterior within the bounds, over that of the prior, coefficient by coefficient.

    sum log(Phi((h - m) / s) - Phi((l - m) / s)) of N(m, s) between l and h, less the same of the prior: the factor by
    which truncating both changes the evidence (Klugkist & Hoijtink 2007, Comput. Stat. & Data Analysis 51, 6367).
    """
    if not terms:
        return 0.0
    low = np.concatenate([t.low for t in terms])
    high = np.concatenate([t.high for t in terms])
    k = len(low)
    sd = np.sqrt(np.diag(cov)[:k])
    posterior = float(log_mass(low, high, b[:k], sd).sum())
    prior = sum(t.log_within for t in terms)
    return posterior - prior
