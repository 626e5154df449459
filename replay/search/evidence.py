"""Evidence of a set of terms: marginal likelihood with every coefficient integrated out and the noise fitted.

The model of a channel is y = X b + e, with b ~ N(c, I) in units of the prior's standard deviation and e ~ N(0, s^2 R),
R of one spectrum of a grid (noise_spectra.py). With W = R^-1 / s^2, summed over the channels, the posterior of b is
N(m, S), S = (X^T W X + I)^-1, m = S (X^T W y + c), and

    log p(y) = - 1/2 sum over channels (n log(2 pi s^2) + (y - X m)^T R^-1 (y - X m) / s^2 + log det R)
               - 1/2 |m - c|^2 + 1/2 log det S

where X, y and W hold three more rows a flight: the accelerometer's offset by velocity and attitude, library.py
(Bishop 2006, Pattern Recognition and Machine Learning, §3.5; Rasmussen & Williams 2006, §2.7). s and R are fitted, and
the likelihood has the power ``TRUST`` (Miller & Dunson 2019, JASA 114, 1113).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np

from models.common.frames import Array
from replay.residual.grid import Mask
from replay.search.channel import Whitened
from replay.search.library import Design, Library
from replay.search.noise_spectra import FITTED_SHARE, spectra, whitened_energies
from replay.search.significance import Contributions, beyond_bounds, form_variance, standing, worth
from replay.search.terms import STEP_S, Key, Term
from replay.search.thresholds import (
    FLOOR,
    GUST_S,
    LOUDEST,
    TRUST,
)

QUIET_S = 4.0
QUIET_SPECTRUM = (1.0, 0.75)
"""Quiet noise is what the residual does within this time [s], with this spectrum (time [s], share) of the grid."""
ROUNDS = 2
"""Noise and coefficients are fitted in turn, at most so often."""
SETTLED = 0.01
"""Relative change of the noise below which they agree."""
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


@dataclass(frozen=True)
class Noise:
    """Spectrum (its number in the grid) and standard deviation [N or N m] of every channel."""

    spectrum: tuple[int, ...]
    sigma: tuple[float, ...]


@dataclass(frozen=True)
class Fit:
    """A set of terms, fitted: scaled coefficients ``b`` (trims behind) with their covariance, and the noise.

    score = TRUST evidence + within + worth + prior. ``evidence``: log marginal likelihood.
    ``within``: log share of it within the bounds. ``worth``: log share of what deserves a name. ``prior``: log odds of
    the terms, and log prior of the noise.
    """

    terms: tuple[Term, ...]
    b: Array
    cov: Array
    noise: Noise
    evidence: float = 0.0
    within: float = 0.0
    worth: float = 0.0
    prior: float = 0.0

    @property
    def score(self) -> float:
        """Log posterior of the set, up to a constant."""
        return self.promise + self.worth

    @property
    def promise(self) -> float:
        """Whatever the size of its terms: of a set that is still to grow, as another term may make them larger."""
        return TRUST * self.evidence + self.within + self.prior

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

    def beside(self, term: Term) -> list[Term]:
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
        self.spectra = spectra(STEP_S)
        self._filters = np.stack([s.filters for s in self.spectra])
        self._white: dict[tuple[int, int], Whitened] = {}
        self._fitted = np.array([s.slow_share <= FITTED_SHARE for s in self.spectra])
        channels = library.channels
        determinants = []
        for channel in channels:
            determinants.append([s.log_determinant(channel.run) for s in self.spectra])
        self._det = np.array(determinants).reshape(-1, len(self.spectra))
        self._counts = np.array([c.count for c in channels])
        limit = np.array([c.limit for c in channels])[:, None]
        share = np.array([s.slow_share for s in self.spectra])
        slow_s = np.array([s.slow_s for s in self.spectra])
        # The mean of gusts over a longer time is smaller: of what lasts, and is louder, something steady is the cause.
        slower = np.maximum(slow_s / GUST_S, 1.0)
        self._unlikely = 0.5 * (share * slower + 1.0 - share) / (LOUDEST * limit) ** 2
        """Minus the log prior of the noise over its variance, (channels, spectra)."""
        self._floor = (FLOOR * limit) ** 2 / np.minimum(share, 1.0 - share)
        self._fits: dict[tuple[tuple[Term, ...], Noise], Fit] = {}
        self._designs: dict[tuple[Term, ...], Design] = {}
        self._posteriors: dict[tuple[tuple[Term, ...], Noise], tuple[Array, Array]] = {}
        self._samples = sum(len(c.run) for c in channels)
        self._solved = 0.0

    @property
    def work(self) -> float:
        """What was spent so far, the same on every machine: about one for each set that was solved."""
        return self._solved + SAMPLE_ADDED_COSTS * self._samples * self.library.taken_in

    def unfitted(self) -> Noise:
        """Noise of the residual as it is."""
        rest = []
        for axes in self.library.flights:
            rest.append(np.stack([channel.rows[0] for channel in axes]))
        return self._noise(rest, self._energies(rest), np.zeros(len(self.library.channels)))

    @cached_property
    def quiet(self) -> Noise:
        """Noise by what varies within seconds: beside it, slow effects show that pass for a disturbance."""
        sigma = []
        for channel in self.library.channels:
            residual = channel.rows[0]
            known = channel.valid.astype(float)
            kernel = np.ones(min(round(QUIET_S / STEP_S), len(known)))
            samples = np.maximum(np.convolve(known, kernel, "same"), 1.0)
            mean = np.convolve(residual, kernel, "same") / samples
            fast = np.where(channel.valid, residual - mean, 0.0)
            floor = (FLOOR * channel.limit) ** 2
            sigma.append(float(np.sqrt(fast @ fast / channel.count + floor)))
        number = [(s.slow_s, s.slow_share) for s in self.spectra].index(QUIET_SPECTRUM)
        return Noise((number,) * len(sigma), tuple(sigma))

    def fit(self, terms: Sequence[Term], noise: Noise) -> Fit:
        """Fit a set, its noise included, from a first guess of it; where that is loud, from quiet noise, too.

        Beside noise as loud as what the terms explain they seem to explain nothing: that is a local optimum.
        """
        fit = self._once(terms, noise)
        if noise != self.quiet and self._loud(noise) > 0.5:
            return max(fit, self._once(terms, self.quiet), key=lambda f: f.score)
        return fit

    def _loud(self, noise: Noise) -> float:
        """Minus the log prior of the noise: half-normal in the standard deviation of its slow and its fast part."""
        unlikely = self._unlikely[np.arange(len(noise.spectrum)), list(noise.spectrum)]
        return float(unlikely @ np.square(noise.sigma))

    def _once(self, terms: Sequence[Term], noise: Noise) -> Fit:
        key = tuple(terms), noise
        if key not in self._fits:
            self._fits[key] = self._fit(*key)
        return self._fits[key]

    def _fit(self, terms: tuple[Term, ...], noise: Noise) -> Fit:
        design = self._design(terms)
        for left in reversed(range(ROUNDS + 1)):
            b, cov = self._posterior(design, noise)
            u = Contributions(design, b, cov)
            form = form_variance(u)
            energies = self._energies(u.rest)
            fresh = self._noise(u.rest, energies, form)
            same = fresh.spectrum == noise.spectrum
            if not left or (same and np.allclose(fresh.sigma, noise.sigma, rtol=SETTLED)):
                break
            noise = fresh
        evidence, loud = self._laplace(design, b, cov, energies, form)
        prior = sum(t.prior for t in terms) - loud
        return Fit(
            terms=terms,
            b=b,
            cov=cov,
            noise=noise,
            evidence=evidence,
            within=beyond_bounds(terms, b, cov),
            worth=worth(u),
            prior=prior,
        )

    def deserved(self, terms: Sequence[Term], noise: Noise, least: float) -> float:
        """``within`` and ``worth`` of a set beside a given noise; where it is below ``least``, something below that.

        At most ``possible``.
        """
        terms = in_order(terms)
        design = self._design(terms)
        b, cov = self._posterior(design, noise)
        within = beyond_bounds(terms, b, cov)
        if within < least:
            return within
        return within + worth(Contributions(design, b, cov))

    def stands_out(self, fit: Fit, term: Term) -> float:
        """How far a further term would do so, beside a set and its noise: 1 is just enough to be named.

        Wherever its coefficients are: of several shapes the first may be one that is not possible.
        """
        terms = in_order((*fit.terms, term))
        design = self._design(terms)
        u = Contributions(design, *self._posterior(design, fit.noise))
        return float(standing(u, u.anywhere, [terms.index(term)])[0])

    @staticmethod
    def possible(terms: Sequence[Term]) -> float:
        """What ``deserved`` is where every coefficient is surely within its bounds, and every term worth a name."""
        return -sum(t.log_within for t in terms)

    def refit(
        self, terms: Sequence[Term], noise: Noise, left_out: Mapping[int, Mask] = ALL_ROWS_USED
    ) -> Fit:
        """Coefficients beside a given noise, without a score; rows (n,) of flights in ``left_out`` are not used."""
        design = self._design(tuple(terms))
        b, cov = self._posterior(design, noise, left_out)
        return Fit(terms=design.terms, b=b, cov=cov, noise=noise)

    def screen(self, fit: Fit, key: Key | None = None) -> Array:
        """Gain in log evidence of every term of the library beside a fitted set, the noise kept, (terms,).

        1/2 (v^T P^-1 v - c^T c - log det P) for a term with columns X and prior mean c, beside a set with columns A:
        P = I + X^T W X - X^T W A S A^T W X (Schur's complement), v = X^T W (y - A m) + c.
        With a ``key``: of the terms with that key only, NaN for the others.
        """
        library = self.library
        out = np.full(len(library.terms), np.nan)
        groups = library.alike(key)
        if not groups:
            return out
        screened = sum(len(g.numbers) for g in groups)
        self._solved += TERM_SCREENED_COSTS * screened * len(library.channels)
        columns_of_terms = np.unique(np.concatenate([g.columns.ravel() for g in groups]))
        set_columns = self._design(fit.terms).columns
        x_bias = library.x_bias[:, columns_of_terms]
        cross = library.x_bias[:, set_columns].T @ x_bias
        g = library.bias @ x_bias
        channels = list(self._channels(fit.noise))
        for white, variance in channels:
            where = white.channel.where
            beside = np.concatenate([[0], where[set_columns]])
            gram = white.between(beside, where[columns_of_terms]) / variance
            g += gram[0]
            cross += gram[1:]
        g = g - fit.b @ cross
        across = (fit.cov @ cross).T
        for group in groups:
            columns = group.columns
            centre = group.centre
            at = np.searchsorted(columns_of_terms, columns)
            bias = x_bias[:, at].transpose(1, 2, 0)
            own = np.eye(columns.shape[1]) - across[at] @ cross[:, at].transpose(1, 0, 2)
            own += bias @ bias.transpose(0, 2, 1)
            for white, variance in channels:
                own += white.within(white.channel.where[columns]) / variance
            v = g[at] + centre
            solved = np.linalg.solve(own, v[..., None])[..., 0]
            v_p_v = (v * solved).sum(axis=1)
            c_c = (centre**2).sum(axis=1)
            _, log_det = np.linalg.slogdet(own)
            out[group.numbers] = 0.5 * (v_p_v - c_c - log_det)
        return out

    def promising(self, fit: Fit, candidates: Iterable[int]) -> list[tuple[float, Term]]:
        """The best shape of every key among terms of the library (their numbers), by log posterior odds, best first.

        The odds are those of ``screen``: TRUST times the gain in log evidence, and the log prior odds.
        """
        screened = self.screen(fit)
        best: dict[Key, tuple[float, Term]] = {}
        for i in candidates:
            term = self.library.terms[i]
            odds = round(TRUST * float(screened[i]) + term.prior, 6)
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

    def _channels(self, noise: Noise) -> Iterator[tuple[Whitened, float]]:
        """Every channel through the filter of its noise, and the variance of that."""
        for c, (s, sigma) in enumerate(zip(noise.spectrum, noise.sigma, strict=True)):
            if (c, s) not in self._white:
                self._white[c, s] = Whitened(self.library.channels[c], self.spectra[s])
            yield self._white[c, s], sigma**2

    def _energies(self, rest: Sequence[Array]) -> Array:
        """Sum of squares of the innovations of every channel by every spectrum, (channels, spectra)."""
        flights = zip(rest, self.library.flights, strict=True)
        energies = [whitened_energies(self._filters, e, axes[0].run) for e, axes in flights]
        return np.concatenate([np.empty((0, len(self.spectra))), *energies])

    def _noise(self, rest: Sequence[Array], energies: Array, form: Array) -> Noise:
        """The likeliest spectrum of the rest; no quieter than its raw energy, the model-form errors, and the floor.

        The least n log s^2 + E / s^2 + log det R of those with a slow share up to FITTED_SHARE: E ``energies``.
        """
        counts = self._counts[:, None]
        raw = np.concatenate([np.empty(0), *((e**2).sum(axis=1) for e in rest)]) / self._counts
        variance = self._variance(energies, np.maximum(raw, form))
        cost = counts * np.log(variance) + energies / variance + self._det
        best = np.argmin(np.where(self._fitted, np.round(cost, 6), np.inf), axis=1)
        sigma = np.sqrt(np.take_along_axis(variance, best[:, None], axis=1)[:, 0])
        return Noise(tuple(best.tolist()), tuple(sigma.tolist()))

    def _variance(self, energies: Array, least: Array) -> Array:
        """Of the innovations by every spectrum (channels, spectra), no smaller than ``least`` and the floor.

        s^2 = max(E / n, least, FLOOR^2 / min(share, 1 - share)): the fast and the slow part are above FLOOR each.
        """
        lowest = np.maximum(least[:, None], self._floor)
        return np.asarray(np.maximum(energies / self._counts[:, None], lowest))

    def _laplace(
        self, design: Design, b: Array, cov: Array, energies: Array, form: Array
    ) -> tuple[float, float]:
        """Log marginal likelihood by Laplace's approximation, and minus the log prior of the noise in it.

        The noise is what is left, by the spectrum that is likeliest with its prior.
        """
        variance = self._variance(energies, form)
        density = self._counts[:, None] * np.log(2.0 * np.pi * variance)
        cost = 0.5 * (density + energies / variance + self._det)
        loud = self._unlikely * variance
        best = np.arange(len(cost)), np.argmin(np.round(TRUST * cost + loud, 6), axis=1)
        value = -float(cost[best].sum())
        left = self.library.bias - self.library.x_bias[:, design.columns] @ b
        value -= 0.5 * float(left @ left)
        off = b - design.centre
        value -= 0.5 * float(off @ off)
        if len(b):
            value += 0.5 * float(np.linalg.slogdet(cov)[1])
        return value, float(loud[best].sum())

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
        """(X^T W X + I)^-1 (X^T W y + prior mean), and the inverse."""
        r = design.centre.copy()
        a = np.eye(len(r))
        for white, variance in self._channels(noise):
            flight = white.channel.flight
            rows = np.concatenate([[0], white.channel.where[design.columns]])
            if flight in left_out:
                gram = white.gram_of(rows, ~left_out[flight])
            elif white in design.products:
                gram = design.products[white]
            else:
                gram = design.products[white] = white.between(rows, rows)
            a += gram[1:, 1:] / variance
            r += gram[0, 1:] / variance
        x_bias = self.library.x_bias[:, design.columns]
        a += x_bias.T @ x_bias
        r += x_bias.T @ self.library.bias
        cov = np.asarray(np.linalg.inv(a))
        return np.asarray(cov @ r), cov


def in_order(terms: Iterable[Term]) -> tuple[Term, ...]:
    """The same set in the same order, however it came about."""
    return tuple(sorted(terms, key=lambda t: t.order))


def _keep(latest: dict[K, V], key: K, value: V, most: int) -> None:
    """Put a value at the end of the ``latest``, of which there are ``most``."""
    latest[key] = value
    if len(latest) > most:
        del latest[next(iter(latest))]
