"""Evidence of a set of terms: marginal likelihood with every coefficient integrated out and the noise fitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.special import log_ndtr

from models.frames import Array
from replay.search.disturbance import bank_energy, lag_products, spectra
from replay.search.terms import STEP_S, TOLD_S, Columns, Key, Library, Term

FORM = 0.12
"""Error of form of an effect, as a share of what it contributes: less than that beside it is not believed."""
FORM_LEFT = 0.06
"""RMS that an effect leaves by its error of form, as a share of its own."""
CANCEL, CANCEL_COST = 2.0, 40.0
"""Effects may not be larger (root of the sum of squares) than what they take off together by more than this."""
NOTHING_LEFT_OUT: Mapping[int, NDArray[np.bool_]] = {}
QUIET_S, QUIET = 4.0, 4
CURVE_FORM = 1.2
"""The same of a free curve: it has no mean, and one beside it may be its."""
SOFT = 0.02
TRUST = 0.3
"""Power of the likelihood: neither noise nor effects are quite of the assumed form."""
FLOOR = 0.3
"""Smallest RMS of the noise in hundredths of the weight: the declared model is no better than that."""


@dataclass(frozen=True)
class Noise:
    """Spectrum and standard deviation of every channel."""

    spectrum: tuple[int, ...]
    sigma: tuple[float, ...]


@dataclass(frozen=True)
class Fit:
    """A set of terms, fitted: scaled coefficients ``b`` with covariance, the noise, and the log posterior."""

    terms: tuple[Term, ...]
    b: Array
    cov: Array
    noise: Noise
    evidence: float
    """Log marginal likelihood."""
    worth: float
    prior: float
    score: float
    """Log posterior: evidence, cut-offs, worth and priors."""

    @property
    def key(self) -> frozenset[Key]:
        """Keys of its terms."""
        return frozenset(t.key for t in self.terms)

    def part(self, term: Term) -> slice:
        """Where a term's coefficients stand in ``b``."""
        start = 0
        for t in self.terms:
            if t is term:
                break
            start += len(t.columns)
        return slice(start, start + len(term.columns))


class Evidence:
    """Evidence of sets from one library."""

    def __init__(self, library: Library) -> None:
        self.library = library
        self.spectra = spectra(STEP_S)
        self._white: dict[tuple[int, int], Array] = {}
        self._white_y: dict[tuple[int, int], Array] = {}
        self._blocks: dict[tuple[int, int], list[Array]] = {}
        self._det = [[s.log_determinant(c.run) for s in self.spectra] for c in library.channels]
        self.calls = 0

    def white(self, c: int, s: int) -> Array:
        x, run = self.library.channels[c].x, self.library.channels[c].run
        known = self._white.get((c, s))
        have = 0 if known is None else known.shape[1]
        if known is None or have < x.shape[1]:
            # Columns are only ever added behind those there are.
            fresh = self.spectra[s].whiten(x[:, have:], run)
            known = fresh if known is None else np.concatenate([known, fresh], axis=1)
            self._white[c, s] = known
        return known

    def white_y(self, c: int, s: int) -> Array:
        if (c, s) not in self._white_y:
            channel = self.library.channels[c]
            self._white_y[c, s] = self.spectra[s].whiten(channel.y, channel.run)
        return self._white_y[c, s]

    def start(self) -> Noise:
        """Noise of the residual as it is."""
        return self._noise([c.y for c in self.library.channels], np.zeros(len(self.library.channels)))

    def quiet(self) -> Noise:
        """Noise as what varies within seconds tells it: beside it, slow effects show that pass for a disturbance."""
        sigma = []
        for channel in self.library.channels:
            known = (channel.run >= 0).astype(float)
            kernel = np.ones(min(round(QUIET_S / STEP_S), len(known)))
            mean = np.convolve(channel.y, kernel, "same") / np.maximum(np.convolve(known, kernel, "same"), 1.0)
            fast = np.where(known > 0, channel.y - mean, 0.0)
            sigma.append(float(np.sqrt(fast @ fast / max(channel.count, 1) + (FLOOR * channel.limit) ** 2)))
        return Noise((QUIET,) * len(sigma), tuple(sigma))

    def form_floor(self, terms: Sequence[Term], b: Array) -> Array:
        """Variance (channels,) of what is left by the terms' errors of form."""
        out = np.zeros(len(self.library.channels))
        start = 0
        for term in terms:
            part = b[start : start + len(term.columns)]
            start += len(term.columns)
            if term.effect is None:
                continue
            for c, channel in enumerate(self.library.channels):
                local = channel.where[term.columns]
                on = local >= 0
                if on.any():
                    u = channel.x[:, local[on]] @ part[on]
                    moved = u[channel.run >= 0]
                    out[c] += FORM_LEFT**2 * float(moved.var())
        return out

    def _noise(self, rest: Sequence[Array], floor: Array) -> Noise:
        which, sigmas = [], []
        for c, e in enumerate(rest):
            channel = self.library.channels[c]
            best, least, sigma_best = 0, np.inf, 1.0
            products = lag_products(e, channel.run)
            smallest = max((FLOOR * channel.limit) ** 2, floor[c])
            raw = float(e @ e) / max(channel.count, 1)
            energies = bank_energy(self.spectra, products)
            for s in range(len(self.spectra)):
                q, n = float(energies[s]), max(channel.count, 1)
                sigma2 = max(q / n, raw, smallest)
                cost = n * np.log(sigma2) + q / sigma2 + self._det[c][s]
                if cost < least - 1e-9:
                    best, least, sigma_best = s, cost, float(np.sqrt(sigma2))
            which.append(best)
            sigmas.append(sigma_best)
        return Noise(tuple(which), tuple(sigmas))

    def fit(self, terms: Sequence[Term], noise: Noise, rounds: int = 2) -> Fit:
        """Fit a set, its noise included, from a first guess of it."""
        self.calls += 1
        for _ in range(rounds):
            b, _, _ = self._posterior(terms, noise)
            fresh = self._noise(self.rest(terms, b), self.form_floor(terms, b))
            if fresh.spectrum == noise.spectrum and np.allclose(fresh.sigma, noise.sigma, rtol=0.01):
                break
            noise = fresh
        b, cov, evidence = self._posterior(terms, noise)
        worth = self._worth(terms, b)
        prior = sum(self.prior(t) for t in terms)
        score = TRUST * evidence + self._cut(terms, b, cov) + worth + prior
        return Fit(tuple(terms), b, cov, noise, evidence, worth, prior, score)

    def refit(
        self, terms: Sequence[Term], noise: Noise, left_out: Mapping[int, NDArray[np.bool_]] | None = None
    ) -> Fit:
        """Coefficients beside a given noise, without a score; rows of flights in ``left_out`` (n,) are not looked at."""
        b, cov, evidence = self._posterior(terms, noise, left_out or {})
        return Fit(tuple(terms), b, cov, noise, evidence, 0.0, 0.0, evidence)

    def prior(self, term: Term) -> float:
        """Log odds of a term in its shape, before any flight was seen."""
        if term.effect is None:
            return term.log_shape
        return term.effect.log_odds(self.library.context(min(term.places))) + term.log_shape

    def _with_trim(self, terms: Sequence[Term]) -> Columns:
        return np.concatenate([columns_of(terms), self.library.trim])

    def rest(self, terms: Sequence[Term], b: Array) -> list[Array]:
        """What a set leaves of every channel."""
        columns = self._with_trim(terms)
        out = []
        for channel in self.library.channels:
            local = channel.where[columns]
            on = local >= 0
            out.append(channel.y - channel.x[:, local[on]] @ b[on] if on.any() else channel.y)
        return out

    def _posterior(
        self, terms: Sequence[Term], noise: Noise, left_out: Mapping[int, NDArray[np.bool_]] = NOTHING_LEFT_OUT
    ) -> tuple[Array, Array, float]:
        columns = self._with_trim(terms)
        k = len(columns)
        mean = np.concatenate([*(t.centre for t in terms), np.zeros(len(self.library.trim))])
        a, r = np.eye(k), mean.copy()
        value = 0.0
        for c, channel in enumerate(self.library.channels):
            s, sigma2 = noise.spectrum[c], noise.sigma[c] ** 2
            yw = self.white_y(c, s)
            value -= 0.5 * (channel.count * np.log(2.0 * np.pi * sigma2) + self._det[c][s] + float(yw @ yw) / sigma2)
            local = channel.where[columns]
            on = np.flatnonzero(local >= 0)
            if not on.size:
                continue
            x = self.white(c, s)[:, local[on]]
            if channel.flight in left_out:
                kept = ~left_out[channel.flight]
                x, yw = x[kept], yw[kept]
            a[np.ix_(on, on)] += x.T @ x / sigma2
            r[on] += x.T @ yw / sigma2
        for y, x_all in zip(self.library.told_y, self.library.told_x, strict=True):
            if not np.isfinite(y).all():
                continue
            x = x_all[:, columns] / TOLD_S
            yt = y / TOLD_S
            value -= 0.5 * float(yt @ yt)
            a += x.T @ x
            r += x.T @ yt
        if not k:
            return mean, np.zeros((0, 0)), value
        factor = cho_factor(a, lower=True)
        b = cho_solve(factor, r)
        cov = cho_solve(factor, np.eye(k))
        value += 0.5 * float(r @ b) - 0.5 * float(mean @ mean) - float(np.log(np.diag(factor[0])).sum())
        return b, cov, value

    def _cut(self, terms: Sequence[Term], b: Array, cov: Array) -> float:
        """Log share of the posterior within the bounds, over that of the prior."""
        if not terms:
            return 0.0
        k = len(columns_of(terms))
        b, cov = b[:k], cov[:k, :k]
        low = np.concatenate([t.low for t in terms])
        high = np.concatenate([t.high for t in terms])
        mean = np.concatenate([t.centre for t in terms])
        sd = np.sqrt(np.diag(cov))
        return float((_log_mass(low, high, b, sd) - _log_mass(low, high, mean, np.ones_like(sd))).sum())

    def _worth(self, terms: Sequence[Term], b: Array) -> float:
        """Log share of what is worth a name, softly.

        Some axis must carry a hundredth of the weight of it, more than what the others may leave by their form, and a
        part of what is left there without it.
        """
        out = -CANCEL_COST * max(self.cancelled(terms, b) - CANCEL, 0.0)
        for z in self.standing(terms, b):
            out -= 0.5 * max((1.0 - z) / SOFT, 0.0) ** 2 + 1e3 * max(0.9 - z, 0.0)
        return out

    def cancelled(self, terms: Sequence[Term], b: Array) -> float:
        """Contributions over what they take off together, on the axis where that ratio is largest."""
        columns = columns_of(terms)
        owner = np.repeat(np.arange(len(terms)), [len(t.columns) for t in terms])
        worst = 0.0
        for channel in self.library.channels:
            local = channel.where[columns]
            on = local >= 0
            if not on.any():
                continue
            parts = channel.x[:, local[on]] * b[: len(columns)][on]
            each = sum(float((parts[:, owner[on] == i].sum(axis=1) ** 2).sum()) for i in np.unique(owner[on]))
            both = float((parts.sum(axis=1) ** 2).sum()) + channel.count * (2.0 * channel.limit) ** 2
            worst = max(worst, float(np.sqrt(each / both)))
        return worst

    def standing(self, terms: Sequence[Term], b: Array) -> Array:
        """How far every term stands out, (terms,): 1 is just worth a name."""
        if not terms:
            return np.empty(0)
        tops, shares = self._tops(terms, b)
        form = np.array([FORM if t.effect is not None else CURVE_FORM for t in terms])
        out = np.empty(len(terms))
        for i, term in enumerate(terms):
            others = np.delete(tops * form[:, None], i, axis=0)
            allowed = np.sqrt(1.0 + (others**2).sum(axis=0))
            out[i] = np.minimum(tops[i] / allowed, shares[i] / term.share).max()
        return out

    def _tops(self, terms: Sequence[Term], b: Array) -> tuple[Array, Array]:
        """Of every term (terms, channels): 99th percentile in the channel's limit, share of the energy without it."""
        tops = np.zeros((len(terms), len(self.library.channels)))
        shares = np.zeros_like(tops)
        rest = self.rest(terms, b)
        energy = [float(e @ e) for e in rest]
        start = 0
        for i, term in enumerate(terms):
            part = b[start : start + len(term.columns)] * term.main
            start += len(term.columns)
            for c, channel in enumerate(self.library.channels):
                local = channel.where[term.columns]
                on = local >= 0
                if not on.any():
                    continue
                u = channel.x[:, local[on]] @ part[on]
                with_it = float((rest[c] + u) @ (rest[c] + u))
                shares[i, c] = 1.0 - energy[c] / max(with_it, 1e-30)
                u = np.abs(u)
                m = max(channel.count // 100, 1)
                tops[i, c] = np.partition(u, -m)[-m] / channel.limit
        return tops, shares

    def unit_tops(self, term: Term) -> Array:
        """99th percentile (k,) of every scaled coefficient's column, in the limit of the axis where it is largest."""
        out = np.zeros(len(term.columns))
        for channel in self.library.channels:
            local = channel.where[term.columns]
            for i in np.flatnonzero(local >= 0):
                out[i] = max(out[i], float(np.quantile(np.abs(channel.x[:, local[i]]), 0.99)) / channel.limit)
        return out

    def screen(self, fit: Fit, terms: Sequence[Term]) -> Array:
        """Gain in log evidence of each of ``terms`` beside a fitted set, its noise kept (m,)."""
        library, noise = self.library, fit.noise
        columns = self._with_trim(fit.terms)
        size = library.size
        cross, d = np.zeros((size, len(columns))), np.zeros(size)
        for c, channel in enumerate(library.channels):
            if not channel.x.shape[1]:
                continue
            s, sigma2 = noise.spectrum[c], noise.sigma[c] ** 2
            x = self.white(c, s)
            back = np.flatnonzero(channel.where >= 0)
            order = channel.where[back]
            d[back] += (x.T @ self.white_y(c, s))[order] / sigma2
            local = channel.where[columns]
            on = np.flatnonzero(local >= 0)
            if on.size:
                cross[np.ix_(back, on)] += (x.T @ x[:, local[on]])[order] / sigma2
        for y, x_all in zip(library.told_y, library.told_x, strict=True):
            if np.isfinite(y).all():
                d += x_all.T @ y / TOLD_S**2
                if len(columns):
                    cross += x_all.T @ x_all[:, columns] / TOLD_S**2
        g = d - cross @ fit.b if len(columns) else d
        out = np.empty(len(terms))
        for i, term in enumerate(terms):
            k = term.columns
            own = np.zeros((len(k), len(k)))
            for c in range(len(library.channels)):
                own += self._block(c, noise.spectrum[c], term) / noise.sigma[c] ** 2
            for y, x_all in zip(library.told_y, library.told_x, strict=True):
                if np.isfinite(y).all():
                    own += x_all[:, k].T @ x_all[:, k] / TOLD_S**2
            if len(columns):
                own -= cross[k] @ fit.cov @ cross[k].T
            m = own + np.eye(len(k))
            v = g[k] + term.centre
            sign, logdet = np.linalg.slogdet(m)
            out[i] = 0.5 * float(v @ np.linalg.solve(m, v)) - 0.5 * float(term.centre @ term.centre) - 0.5 * logdet
        return out

    def _block(self, c: int, s: int, term: Term) -> Array:
        key = (c, s, int(term.columns[0]))
        found = self._blocks.get(key)
        if found is None:
            channel = self.library.channels[c]
            local = channel.where[term.columns]
            on = np.flatnonzero(local >= 0)
            found = np.zeros((len(local), len(local)))
            if on.size:
                x = self.white(c, s)[:, local[on]]
                found[np.ix_(on, on)] = x.T @ x
            self._blocks[key] = found
        return found


def columns_of(terms: Sequence[Term]) -> np.ndarray:
    """Columns of several terms, one after the other."""
    return np.concatenate([t.columns for t in terms]) if terms else np.empty(0, np.int64)


def _log_mass(low: Array, high: Array, mean: Array, sd: Array) -> Array:
    """Log of the probability of N(mean, sd) between low and high, element by element."""
    lo, hi = np.maximum((low - mean) / sd, -1e8), np.minimum((high - mean) / sd, 1e8)
    flip = lo > 0.0
    lo, hi = np.where(flip, -hi, lo), np.where(flip, -lo, hi)
    upper, lower = log_ndtr(hi), log_ndtr(lo)
    return upper + np.log1p(-np.exp(np.minimum(lower - upper, -1e-12)))
