"""Evidence of a set of terms: marginal likelihood with every coefficient integrated out and the noise fitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from models.frames import Array
from replay.residual.grid import Mask
from replay.search.channel import Columns, Growing
from replay.search.disturbance import FITTED_SHARE, bank_energy, lag_products, spectra
from replay.search.library import Library
from replay.search.terms import STEP_S, Key, Term
from replay.search.worth import Contributions, beyond_bounds, form_variance, worth

TRUST = 0.5
"""Power of the likelihood: neither noise nor effects are quite of the assumed form (Miller & Dunson 2019)."""
FLOOR = 0.2
"""Smallest RMS of the fast and of the slow part of the noise, in hundredths of the weight: no model is better."""
QUIET_S, QUIET_SPECTRUM = 4.0, (1.0, 0.75)
"""Quiet noise is what the residual does within this time [s], with this spectrum (time [s], share) of the grid."""
UNWORTHY = 6.0
"""Largest cost (log) of what is not worth a name while a set grows."""
ROUNDS = 2
"""Noise and coefficients are fitted in turn, at most so often."""
SETTLED = 0.01
"""Relative change of the noise below which they agree."""
NOTHING: Mapping[int, Mask] = {}


@dataclass(frozen=True)
class Noise:
    """Spectrum (its number in the grid) and standard deviation [N or N m] of every channel."""

    spectrum: tuple[int, ...]
    sigma: tuple[float, ...]


@dataclass(frozen=True)
class Fit:
    """A set of terms, fitted: scaled coefficients ``b`` (trims behind) with their covariance, and the noise.

    ``evidence``: log marginal likelihood. ``within``: log share of it within the bounds. ``worth``: log share of what
    deserves a name. ``prior``: log odds of the terms. ``score``: log posterior.
    """

    terms: tuple[Term, ...]
    b: Array
    cov: Array
    noise: Noise
    evidence: float
    within: float = 0.0
    worth: float = 0.0
    prior: float = 0.0
    score: float = 0.0

    @property
    def promise(self) -> float:
        """Score of a set that is still to grow: another term may make worth a name what is not yet."""
        return self.score - self.worth + max(self.worth, -UNWORTHY)

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
    """Evidence of sets of terms of one library."""

    def __init__(self, library: Library) -> None:
        self.library = library
        self.floor = FLOOR
        self.spectra = spectra(STEP_S)
        self._white: dict[tuple[int, int], Growing] = {}
        self._white_y: dict[tuple[int, int], Array] = {}
        self._blocks: dict[tuple[int, int, int], Array] = {}
        self._smaller = np.array([min(s.slow_share, 1.0 - s.slow_share) for s in self.spectra])
        self._fitted = np.array([s.slow_share <= FITTED_SHARE for s in self.spectra])
        self._det = [[s.log_determinant(c.run) for s in self.spectra] for c in library.channels]

    def unfitted(self) -> Noise:
        """Noise of the residual as it is."""
        return self._noise([c.y for c in self.library.channels], np.zeros(len(self.library.channels)))

    def quiet(self) -> Noise:
        """Noise by what varies within seconds: beside it, slow effects show that pass for a disturbance."""
        sigma = []
        for channel in self.library.channels:
            known = (channel.run >= 0).astype(float)
            kernel = np.ones(min(round(QUIET_S / STEP_S), len(known)))
            mean = np.convolve(channel.y, kernel, "same") / np.maximum(np.convolve(known, kernel, "same"), 1.0)
            fast = np.where(known > 0, channel.y - mean, 0.0)
            sigma.append(float(np.sqrt(fast @ fast / max(channel.count, 1) + (FLOOR * channel.limit) ** 2)))
        number = [(s.slow_s, s.slow_share) for s in self.spectra].index(QUIET_SPECTRUM)
        return Noise((number,) * len(sigma), tuple(sigma))

    def fit(self, terms: Sequence[Term], noise: Noise) -> Fit:
        """Fit a set, its noise included, from a first guess of it."""
        for _ in range(ROUNDS):
            b, cov, _ = self._posterior(terms, noise)
            fresh = self._noise(self.rest(terms, b), form_variance(Contributions(self.library, terms, b, cov)))
            if fresh.spectrum == noise.spectrum and np.allclose(fresh.sigma, noise.sigma, rtol=SETTLED):
                break
            noise = fresh
        b, cov, _ = self._posterior(terms, noise)
        u, rest = Contributions(self.library, terms, b, cov), self.rest(terms, b)
        evidence = self._laplace(terms, b, cov, rest, form_variance(u))
        worthy = worth(u, rest)
        prior = sum(self.prior(t) for t in terms)
        within = beyond_bounds(terms, b, cov)
        score = TRUST * evidence + within + worthy + prior
        return Fit(tuple(terms), b, cov, noise, evidence, within, worthy, prior, score)

    def refit(self, terms: Sequence[Term], noise: Noise, left_out: Mapping[int, Mask] = NOTHING) -> Fit:
        """Coefficients beside a given noise, without a score; rows (n,) of flights in ``left_out`` are not used."""
        b, cov, evidence = self._posterior(terms, noise, left_out)
        return Fit(tuple(terms), b, cov, noise, evidence)

    def prior(self, term: Term) -> float:
        """Log odds of a term in its shape, before any flight was seen."""
        if term.effect is None:
            return term.log_shape
        return term.effect.log_odds(self.library.context(min(term.places))) + term.log_shape

    def rest(self, terms: Sequence[Term], b: Array) -> list[Array]:
        """What a set leaves of every channel, (n,) each."""
        columns = self._with_trim(terms)
        out = []
        for channel in self.library.channels:
            local = channel.where[columns]
            on = local >= 0
            out.append(channel.y - channel.x[:, local[on]] @ b[on] if on.any() else channel.y)
        return out

    def screen(self, fit: Fit) -> Array:
        """Gain in log evidence of every term of the library beside a fitted set, the noise kept, (terms,)."""
        columns = self._with_trim(fit.terms)
        cross, g = self._products(columns, fit.noise)
        g = g - cross @ fit.b
        out = np.zeros(len(self.library.terms))
        for width, (index, of_term) in self.library.groups().items():
            own = self._bias_blocks(of_term)
            for c in range(len(self.library.channels)):
                own = own + self._stack(c, fit.noise.spectrum[c], width, of_term) / fit.noise.sigma[c] ** 2
            beside = cross[of_term]
            own = own - beside @ fit.cov @ beside.transpose(0, 2, 1) + np.eye(width)
            centre = np.stack([self.library.terms[i].centre for i in index])
            v = g[of_term] + centre
            gain = (v * np.linalg.solve(own, v[..., None])[..., 0]).sum(axis=1) - (centre**2).sum(axis=1)
            out[index] = 0.5 * (gain - np.linalg.slogdet(own)[1])
        return out

    # --- Parts --------------------------------------------------------------------------------------------------------

    def _white_x(self, c: int, s: int) -> Array:
        channel = self.library.channels[c]
        known = self._white.setdefault((c, s), Growing(len(channel.y)))
        if known.count < channel.x.shape[1]:
            known.add(self.spectra[s].whiten(channel.x[:, known.count :], channel.run))
        return known.x

    def _white_residual(self, c: int, s: int) -> Array:
        if (c, s) not in self._white_y:
            channel = self.library.channels[c]
            self._white_y[c, s] = self.spectra[s].whiten(channel.y, channel.run)
        return self._white_y[c, s]

    def _noise(self, rest: Sequence[Array], form: Array) -> Noise:
        """The likeliest spectrum of what is left; no quieter than its raw energy, the errors of form, and the floor."""
        which, sigmas = [], []
        for c, e in enumerate(rest):
            channel = self.library.channels[c]
            count = max(channel.count, 1)
            energies = bank_energy(self.spectra, lag_products(e, channel.run))
            smallest = max(float(e @ e) / count, float(form[c]))
            variance = np.maximum(
                np.maximum(energies / count, smallest), (self.floor * channel.limit) ** 2 / self._smaller
            )
            cost = count * np.log(variance) + energies / variance + np.array(self._det[c])
            best = int(np.argmin(np.where(self._fitted, np.round(cost, 6), np.inf)))
            which.append(best)
            sigmas.append(float(np.sqrt(variance[best])))
        return Noise(tuple(which), tuple(sigmas))

    def _laplace(self, terms: Sequence[Term], b: Array, cov: Array, rest: Sequence[Array], form: Array) -> float:
        """Log marginal likelihood by Laplace's approximation: likelihood of what is left by its own best spectrum."""
        value = 0.0
        for c, e in enumerate(rest):
            channel = self.library.channels[c]
            count = max(channel.count, 1)
            energies = bank_energy(self.spectra, lag_products(e, channel.run))
            variance = np.maximum(
                np.maximum(energies / count, form[c]), (self.floor * channel.limit) ** 2 / self._smaller
            )
            cost = count * np.log(2.0 * np.pi * variance) + energies / variance + np.array(self._det[c])
            value -= 0.5 * float(cost.min())
        columns = self._with_trim(terms)
        for bias, x_bias in self.library.biases():
            left = bias - x_bias[:, columns] @ b
            value -= 0.5 * float(left @ left)
        off = b - np.concatenate([*(t.centre for t in terms), np.zeros(len(self.library.trim))])
        value -= 0.5 * float(off @ off)
        return value + 0.5 * float(np.linalg.slogdet(cov)[1]) if len(b) else value

    def _with_trim(self, terms: Sequence[Term]) -> Columns:
        return np.concatenate([*(t.columns for t in terms), self.library.trim])

    def _posterior(
        self, terms: Sequence[Term], noise: Noise, left_out: Mapping[int, Mask] = NOTHING
    ) -> tuple[Array, Array, float]:
        """Mean (k,) and covariance (k, k) of the scaled coefficients, and the log marginal likelihood."""
        columns = self._with_trim(terms)
        k = len(columns)
        mean = np.concatenate([*(t.centre for t in terms), np.zeros(len(self.library.trim))])
        a, r = np.eye(k), mean.copy()
        value = 0.0
        for c, channel in enumerate(self.library.channels):
            s, variance = noise.spectrum[c], noise.sigma[c] ** 2
            y = self._white_residual(c, s)
            value -= 0.5 * (channel.count * np.log(2.0 * np.pi * variance) + self._det[c][s] + float(y @ y) / variance)
            local = channel.where[columns]
            on = np.flatnonzero(local >= 0)
            if not on.size:
                continue
            x = self._white_x(c, s)[:, local[on]]
            if channel.flight in left_out:
                kept = ~left_out[channel.flight]
                x, y = x[kept], y[kept]
            a[np.ix_(on, on)] += x.T @ x / variance
            r[on] += x.T @ y / variance
        for bias, x_bias in self.library.biases():
            value -= 0.5 * float(bias @ bias)
            a += x_bias[:, columns].T @ x_bias[:, columns]
            r += x_bias[:, columns].T @ bias
        if not k:
            return mean, np.zeros((0, 0)), value
        factor = cho_factor(a, lower=True)
        b = cho_solve(factor, r)
        value += 0.5 * float(r @ b) - 0.5 * float(mean @ mean) - float(np.log(np.diag(factor[0])).sum())
        return b, cho_solve(factor, np.eye(k)), value

    def _products(self, columns: Columns, noise: Noise) -> tuple[Array, Array]:
        """X^T W X of all columns with ``columns`` (K, k), and X^T W y (K,)."""
        size = self.library.size
        cross, g = np.zeros((size, len(columns))), np.zeros(size)
        for c, channel in enumerate(self.library.channels):
            if not channel.x.shape[1]:
                continue
            s, variance = noise.spectrum[c], noise.sigma[c] ** 2
            x = self._white_x(c, s)
            back = np.flatnonzero(channel.where >= 0)
            order = channel.where[back]
            g[back] += (x.T @ self._white_residual(c, s))[order] / variance
            local = channel.where[columns]
            on = np.flatnonzero(local >= 0)
            if on.size:
                cross[np.ix_(back, on)] += (x.T @ x[:, local[on]])[order] / variance
        for bias, x_bias in self.library.biases():
            g += x_bias.T @ bias
            cross += x_bias.T @ x_bias[:, columns]
        return cross, g

    def _bias_blocks(self, of_term: NDArray[np.int64]) -> Array:
        out = np.zeros((*of_term.shape, of_term.shape[1]))
        for _, x_bias in self.library.biases():
            x = x_bias[:, of_term].transpose(1, 0, 2)
            out += x.transpose(0, 2, 1) @ x
        return out

    def _stack(self, c: int, s: int, width: int, of_term: NDArray[np.int64]) -> Array:
        """X^T W X of every term of one width with itself (m, width, width), unit noise."""
        known = self._blocks.get((c, s, width), np.zeros((0, width, width)))
        if len(known) < len(of_term):
            channel = self.library.channels[c]
            local = channel.where[of_term[len(known) :]]
            x = np.concatenate([self._white_x(c, s), np.zeros((len(channel.y), 1))], axis=1)[:, local]
            x = x.transpose(1, 2, 0)
            known = np.concatenate([known, x @ x.transpose(0, 2, 1)])
            self._blocks[c, s, width] = known
        return known
