"""Evidence of a set of terms: marginal likelihood with every coefficient integrated out and the noise fitted.

The model of a channel is y = X b + e, with b ~ N(c, I) in units of the prior's standard deviation and e ~ N(0, s^2 R),
R of one spectrum of a grid (noise.py). With W = R^-1 / s^2, summed over the channels, the posterior of b is
N(m, S), S = (X^T W X + I)^-1, m = S (X^T W y + c), and

    log p(y) = - 1/2 sum over channels (n log(2 pi s^2) + (y - X m)^T R^-1 (y - X m) / s^2 + log det R)
               - 1/2 |m - c|^2 + 1/2 log det S

where X, y and W hold three more rows a flight: the accelerometer's offset by velocity and attitude, library.py
(Bishop 2006, Pattern Recognition and Machine Learning, §3.5; Rasmussen & Williams 2006, §2.7). s and R are fitted, and
the likelihood has the power ``TRUST`` (Miller & Dunson 2019, JASA 114, 1113).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from models.common.frames import Array
from replay.residual.grid import Mask
from replay.search.channel import Whitened
from replay.search.design import Design
from replay.search.library import Library
from replay.search.noise import Noise, NoiseModel
from replay.search.screening import Screening, WhitenedChannels
from replay.search.significance import (
    Contributions,
    beyond_bounds,
    form_variance,
    log_significance,
    standing,
)
from replay.search.terms import Key, Term
from replay.search.thresholds import TRUST

ROUNDS = 2
"""Noise and coefficients are fitted in turn, at most so often."""
SETTLED = 0.01
"""Relative change of the noise below which they agree."""
LOUD_NATS = 0.5
"""Minus the log prior of the noise above which a set is fitted from quiet noise, too."""
SET_COSTS = 1.0 / 240_000.0
TERM_SCREENED_COSTS = 1.0 / 120.0
SAMPLE_ADDED_COSTS = 1.0 / 620.0
"""Work beside that of solving one set, which is 1: for every column and sample of the set, for every term and axis that
is screened, and for every sample of a term that is taken in. By least squares over 91 flights, whose time it tells to
15 %."""
KEPT_DESIGNS = 8
"""Sets of which the columns are kept: each is some MiB of a long flight."""
KEPT_POSTERIORS = 64
"""More than what is screened before the first of it is fitted."""
ALL_ROWS_USED: Mapping[int, Mask] = {}
"""No row of any flight is left out."""
K = TypeVar("K")
V = TypeVar("V")


@dataclass(frozen=True, kw_only=True)
class Fit:
    """A set of terms, fitted: scaled coefficients ``b`` (trims behind) with their covariance, and the noise.

    score = TRUST evidence + log_in_bounds + significance + prior. ``evidence``: log marginal likelihood.
    ``log_in_bounds``: log share of it within the bounds. ``significance``: log share of what deserves
    a name. ``prior``: log odds of the terms, and log prior of the noise.
    """

    terms: tuple[Term, ...]
    b: Array
    cov: Array
    noise: Noise
    evidence: float = 0.0
    log_in_bounds: float = 0.0
    significance: float = 0.0
    prior: float = 0.0

    @property
    def score(self) -> float:
        """Log posterior of the set, up to a constant."""
        return self.score_at_any_size + self.significance

    @property
    def score_at_any_size(self) -> float:
        """Whatever the size of its terms: of a set that is still to grow, as another term may make them larger."""
        return TRUST * self.evidence + self.log_in_bounds + self.prior

    @property
    def key(self) -> frozenset[Key]:
        """Keys of its terms."""
        return frozenset(t.key for t in self.terms)

    @property
    def of_effects(self) -> list[Term]:
        """Its terms that are effects; the others are free curves."""
        return [t for t in self.terms if t.effect is not None]

    @property
    def effects(self) -> set[str]:
        """Names of its effects."""
        return {t.name for t in self.of_effects}

    def terms_without(self, term: Term) -> list[Term]:
        """Its terms but for one."""
        return [t for t in self.terms if t is not term]

    def part(self, term: Term) -> slice:
        """Where a term's coefficients stand in ``b``."""
        start = sum(len(t.columns) for t in self.terms[: self.terms.index(term)])
        return slice(start, start + len(term.columns))

    def sizes(self, term: Term, flight: int) -> Array:
        """A term's coefficients on a flight (k,), in their own units."""
        place = term.place(flight)
        return self.b[self.part(term)][place] * term.scale[place]


class Evidence:
    """Evidence of sets of terms of one library."""

    def __init__(self, library: Library) -> None:
        self.library = library
        self.noises = NoiseModel(library)
        self._white: dict[tuple[int, int], Whitened] = {}
        """By channel and spectrum."""
        self._fits: dict[tuple[tuple[Term, ...], Noise], Fit] = {}
        self._designs: dict[tuple[Term, ...], Design] = {}
        self._posteriors: dict[tuple[tuple[Term, ...], Noise], tuple[Array, Array]] = {}
        self._samples = sum(len(c.run) for c in library.channels)
        self._solved = 0.0

    @property
    def work(self) -> float:
        """What was spent so far, the same on every machine: about one for each set that was solved."""
        return self._solved + SAMPLE_ADDED_COSTS * self._samples * self.library.taken_in

    def fit(self, terms: Sequence[Term], noise: Noise) -> Fit:
        """Fit a set, its noise included, from a first guess of it; where that is loud, from quiet noise, too.

        Beside noise as loud as what the terms explain they seem to explain nothing: that is a local optimum.
        """
        fit = self._fit_from(terms, noise)
        quiet = self.noises.quiet
        if noise == quiet or self.noises.loudness(noise) <= LOUD_NATS:
            return fit
        from_quiet = self._fit_from(terms, quiet)
        return max(fit, from_quiet, key=lambda f: f.score)

    def _fit_from(self, terms: Sequence[Term], noise: Noise) -> Fit:
        """The same from one first guess; all are kept."""
        key = tuple(terms), noise
        if key not in self._fits:
            self._fits[key] = self._fit(*key)
        return self._fits[key]

    def _fit(self, terms: tuple[Term, ...], noise: Noise) -> Fit:
        design = self._design(terms)
        for rounds_left in reversed(range(ROUNDS + 1)):
            mean, cov = self._posterior(design, noise)
            contributions = Contributions(design, mean, cov)
            form = form_variance(contributions)
            energies = self.noises.energies(contributions.rest)
            fresh = self.noises.likeliest(contributions.rest, energies, form)
            if not rounds_left or _agree(noise, fresh):
                break
            noise = fresh
        log_likelihood, loudness = self.noises.log_likelihood(energies, form)
        return Fit(
            terms=terms,
            b=mean,
            cov=cov,
            noise=noise,
            evidence=self._laplace(design, mean, cov, log_likelihood),
            log_in_bounds=beyond_bounds(terms, mean, cov),
            significance=log_significance(contributions),
            prior=sum(t.prior for t in terms) - loudness,
        )

    def log_factors(self, terms: Sequence[Term], noise: Noise, least: float) -> float:
        """``log_in_bounds`` plus ``significance`` of a set beside a given noise.

        Something below ``least`` where they are below it. At most ``most_log_factors``.
        """
        terms = in_order(terms)
        design = self._design(terms)
        mean, cov = self._posterior(design, noise)
        in_bounds = beyond_bounds(terms, mean, cov)
        if in_bounds < least:
            return in_bounds
        return in_bounds + log_significance(Contributions(design, mean, cov))

    def stands_out(self, fit: Fit, term: Term) -> float:
        """How far a further term would do so, beside a set and its noise: 1 is just enough to be named.

        Wherever its coefficients are: of several shapes the first may be one that is not possible.
        """
        terms = in_order((*fit.terms, term))
        design = self._design(terms)
        mean, cov = self._posterior(design, fit.noise)
        contributions = Contributions(design, mean, cov)
        number = terms.index(term)
        z = standing(contributions, contributions.anywhere, [number])
        return float(z[0])

    def stands_out_with(self, fit: Fit, term: Term, sizes: Array) -> float:
        """The same of a further term that has these coefficients (k,)."""
        terms = in_order((*fit.terms, term))
        design = self._design(terms)
        mean, cov = self._posterior(design, fit.noise)
        number = terms.index(term)
        part = slice(design.edges[number], design.edges[number + 1])
        of_others = mean.copy()
        of_others[part] = 0.0
        with_term = of_others.copy()
        with_term[part] = sizes
        acting = Contributions(design, with_term, cov)
        acting.rest = Contributions(design, of_others, cov).rest
        z = standing(acting, acting.main, [number])
        return float(z[0])

    def score_disturbed(self, fit: Fit, term: Term, sizes: Array) -> float:
        """What the score of a set would be, were a further term there with these coefficients (k,), and not in the set.

        The residual plus the term's part is fitted by the others, which is to hold the term's coefficients at
        ``-sizes``: the others are N(m_o - S_ot S_tt^-1 (m_t + sizes), S_oo - S_ot S_tt^-1 S_to). Noise is as likely as
        it is then, and takes what it can.
        """
        terms = in_order((*fit.terms, term))
        both = self._design(terms)
        alone = self._design(fit.terms)
        number = terms.index(term)
        held = np.arange(both.edges[number], both.edges[number + 1])
        free = np.setdiff1d(np.arange(len(both.columns)), held)
        noise = fit.noise
        for rounds_left in reversed(range(ROUNDS + 1)):
            mean, cov = self._posterior(both, noise)
            gain = np.linalg.solve(cov[np.ix_(held, held)], cov[held])
            mean = mean - (mean[held] + sizes) @ gain
            cov = cov - cov[:, held] @ gain
            rest = Contributions(both, mean, cov).rest
            of_others = mean[free], cov[np.ix_(free, free)]
            form = form_variance(Contributions(alone, *of_others))
            energies = self.noises.energies(rest)
            fresh = self.noises.likeliest(rest, energies, form)
            if not rounds_left or _agree(noise, fresh):
                break
            noise = fresh
        log_likelihood, loudness = self.noises.log_likelihood(energies, form)
        evidence = self._laplace(alone, *of_others, log_likelihood)
        return TRUST * evidence + sum(t.prior for t in fit.terms) - loudness

    @staticmethod
    def most_log_factors(terms: Sequence[Term]) -> float:
        """What ``log_factors`` is where every coefficient is surely within its bounds, and every term worth a name."""
        return -sum(t.log_within for t in terms)

    def refit(
        self, terms: Sequence[Term], noise: Noise, left_out: Mapping[int, Mask] = ALL_ROWS_USED
    ) -> Fit:
        """Coefficients beside a given noise, without a score; rows (n,) of flights in ``left_out`` are not used."""
        design = self._design(tuple(terms))
        mean, cov = self._posterior(design, noise, left_out)
        return Fit(terms=design.terms, b=mean, cov=cov, noise=noise)

    @staticmethod
    def held_at_bounds(fit: Fit) -> Fit | None:
        """A fit with every coefficient that is beyond a bound held there; None where none is.

        The others are N(m, S) given those: m_o - S_ob S_bb^-1 (m_b - bound), S_oo - S_ob S_bb^-1 S_bo.
        """
        low = np.concatenate([t.low for t in fit.terms] or [np.empty(0)])
        high = np.concatenate([t.high for t in fit.terms] or [np.empty(0)])
        beyond = fit.b[: len(low)] - np.clip(fit.b[: len(low)], low, high)
        held = np.flatnonzero(beyond)
        if not held.size:
            return None
        gain = np.linalg.solve(fit.cov[np.ix_(held, held)], fit.cov[held])
        return replace(fit, b=fit.b - beyond[held] @ gain, cov=fit.cov - fit.cov[:, held] @ gain)

    def screen(self, fit: Fit, key: Key | None = None) -> Array:
        """Gain in log evidence of every term of the library beside a fitted set, the noise kept, (terms,).

        With a ``key``: of the terms with that key only, NaN for the others.
        """
        groups = self.library.alike(key)
        if not groups:
            return np.full(len(self.library.terms), np.nan)
        terms = sum(len(group.numbers) for group in groups)
        self._solved += TERM_SCREENED_COSTS * terms * len(self.library.channels)
        screening = Screening(
            library=self.library,
            set_columns=self._design(fit.terms).columns,
            groups=groups,
            channels=self._channels(fit.noise),
        )
        return screening.gains(fit.b, fit.cov)

    def promising(self, fit: Fit, candidates: Iterable[int]) -> list[tuple[float, Term]]:
        """The best shape of every key among terms of the library (their numbers), by log posterior odds, best first.

        The odds are those of ``screen``: TRUST times the gain in log evidence, and the log prior odds.
        """
        gains = self.screen(fit)
        best: dict[Key, tuple[float, Term]] = {}
        for number in candidates:
            term = self.library.terms[number]
            odds = round(TRUST * float(gains[number]) + term.prior, 6)
            if term.key not in best or odds > best[term.key][0]:
                best[term.key] = (odds, term)
        return sorted(best.values(), key=lambda p: (-p[0], str(p[1].key)))

    def forget(self, term: Term) -> None:
        """Take the library's last term out: it is not weighed any more."""
        self.library.forget(term)
        for white in self._white.values():
            white.forget()

    # --- Parts --------------------------------------------------------------------------------------------------------

    def _design(self, terms: tuple[Term, ...]) -> Design:
        """Of a set; the latest are kept, as a set is often weighed beside several noises in a row."""
        design = self._designs.pop(terms, None) or Design(self.library, terms)
        _keep(self._designs, terms, design, KEPT_DESIGNS)
        return design

    def _channels(self, noise: Noise) -> WhitenedChannels:
        out = []
        for number, channel in enumerate(self.library.channels):
            spectrum = noise.spectrum[number]
            key = number, spectrum
            if key not in self._white:
                self._white[key] = Whitened(channel, self.noises.spectra[spectrum])
            variance = noise.sigma[number] ** 2
            out.append((self._white[key], variance))
        return out

    def _laplace(self, design: Design, mean: Array, cov: Array, log_likelihood: float) -> float:
        """Log marginal likelihood by Laplace's approximation, from the log likelihood at the posterior mean."""
        value = log_likelihood
        bias_left = self.library.bias - self.library.x_bias[:, design.columns] @ mean
        value -= 0.5 * float(bias_left @ bias_left)
        from_prior = mean - design.centre
        value -= 0.5 * float(from_prior @ from_prior)
        if len(mean):
            _, log_det = np.linalg.slogdet(cov)
            value += 0.5 * float(log_det)
        return value

    def _posterior(
        self, design: Design, noise: Noise, left_out: Mapping[int, Mask] = ALL_ROWS_USED
    ) -> tuple[Array, Array]:
        """Mean (k,) and covariance (k, k) of the scaled coefficients; the latest are kept.

        A set that was looked at beside some noise is often fitted from there.
        """
        self._solved += 1.0 + SET_COSTS * self._samples * len(design.columns)
        if left_out:
            return self._solve(design, noise, left_out)
        key = design.terms, noise
        posterior = self._posteriors.pop(key, None) or self._solve(design, noise, left_out)
        _keep(self._posteriors, key, posterior, KEPT_POSTERIORS)
        return posterior

    def _solve(
        self, design: Design, noise: Noise, left_out: Mapping[int, Mask]
    ) -> tuple[Array, Array]:
        """Normal equations: S = (X^T W X + I)^-1 and m = S (X^T W y + c)."""
        right_side = design.centre.copy()
        precision = np.eye(len(right_side))
        for white, variance in self._channels(noise):
            left_out_here = left_out.get(white.channel.flight)
            products = _products(design, white, left_out_here)
            precision += products[1:, 1:] / variance
            right_side += products[0, 1:] / variance
        x_bias = self.library.x_bias[:, design.columns]
        precision += x_bias.T @ x_bias
        right_side += x_bias.T @ self.library.bias
        cov = np.asarray(np.linalg.inv(precision))
        return np.asarray(cov @ right_side), cov


def _products(design: Design, white: Whitened, left_out: Mask | None) -> Array:
    """Inner products (1 + k, 1 + k) of residual and columns on a channel; those of all samples are kept."""
    rows = np.concatenate([[0], white.channel.where[design.columns]])
    if left_out is not None:
        return white.gram_of(rows, ~left_out)
    if white not in design.products:
        design.products[white] = white.between(rows, rows)
    return design.products[white]


def _agree(noise: Noise, fresh: Noise) -> bool:
    """Whether the noise beside which a set was fitted is that of what the set leaves."""
    same = fresh.spectrum == noise.spectrum
    return same and np.allclose(fresh.sigma, noise.sigma, rtol=SETTLED)


def in_order(terms: Iterable[Term]) -> tuple[Term, ...]:
    """The same set in the same order, however it came about."""
    return tuple(sorted(terms, key=lambda t: t.order))


def _keep(latest: dict[K, V], key: K, value: V, most: int) -> None:
    """Put a value at the end of the ``latest``, of which there are ``most``."""
    latest[key] = value
    if len(latest) > most:
        del latest[next(iter(latest))]
