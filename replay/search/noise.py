"""The noise of every channel: which spectra and variances are likely, and which of them is likeliest.

Noise e of a channel with n samples is N(0, s^2 R), with R of one spectrum of a grid (noise_spectra.py). With E the sum
of squares of the innovations of what a set leaves,

    - 2 log p(e) = n log(2 pi s^2) + E / s^2 + log det R

The standard deviation of the slow and of the fast part has a half-normal prior each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from models.common.frames import Array
from replay.search.channel import ResidualChannel
from replay.search.library import Library
from replay.search.noise_spectra import FITTED_SHARE, Spectrum, spectra, whitened_energies
from replay.search.terms import STEP_S
from replay.search.thresholds import FLOOR, GUST_S, LOUDEST, TRUST

QUIET_S = 4.0
QUIET_SPECTRUM = (1.0, 0.75)
"""Quiet noise is what the residual does within this time [s], with this spectrum (time [s], share) of the grid."""


@dataclass(frozen=True)
class Noise:
    """Spectrum (its number in the grid) and standard deviation [N or N m] of every channel."""

    spectrum: tuple[int, ...]
    sigma: tuple[float, ...]


class NoiseModel:
    """What the noise of some channels may be. Arrays are (channels, spectra)."""

    def __init__(self, library: Library) -> None:
        self.spectra = spectra(STEP_S)
        self._flights = library.flights
        self._channels = library.channels
        self._filters = np.stack([s.filters for s in self.spectra])
        self._counts = np.array([c.count for c in self._channels])[:, None]
        log_dets = [_log_determinants(c, self.spectra) for c in self._channels]
        self._log_det = np.reshape(log_dets, (-1, len(self.spectra)))
        limit = np.array([c.limit for c in self._channels])[:, None]
        share = np.array([s.slow_share for s in self.spectra])
        slow_s = np.array([s.slow_s for s in self.spectra])
        self._fitted = share <= FITTED_SHARE
        # The mean of gusts over a longer time is smaller: of what lasts, and is louder, something steady is the cause.
        slower = np.maximum(slow_s / GUST_S, 1.0)
        self._prior_precision = 0.5 * (share * slower + 1.0 - share) / (LOUDEST * limit) ** 2
        """Minus the log prior of the noise over its variance."""
        self._least_variance = (FLOOR * limit) ** 2 / np.minimum(share, 1.0 - share)
        """The fast and the slow part are above ``FLOOR`` each."""

    @cached_property
    def unfitted(self) -> Noise:
        """Of the residual as it is."""
        residuals = []
        for axes in self._flights:
            residuals.append(np.stack([channel.rows[0] for channel in axes]))
        no_errors_of_form = np.zeros(len(self._channels))
        return self.likeliest(residuals, self.energies(residuals), no_errors_of_form)

    @cached_property
    def quiet(self) -> Noise:
        """By what varies within seconds: beside it, slow effects show that pass for a disturbance."""
        sigma = [_quiet_sigma(channel) for channel in self._channels]
        grid = [(s.slow_s, s.slow_share) for s in self.spectra]
        number = grid.index(QUIET_SPECTRUM)
        return Noise((number,) * len(sigma), tuple(sigma))

    def loudness(self, noise: Noise) -> float:
        """Minus the log prior of the noise: half-normal in the standard deviation of its slow and its fast part."""
        channels = np.arange(len(noise.spectrum))
        prior_precision = self._prior_precision[channels, list(noise.spectrum)]
        return float(prior_precision @ np.square(noise.sigma))

    def energies(self, rest: Sequence[Array]) -> Array:
        """Sum of squares of the innovations of what is left of every flight (axes, n), by every spectrum."""
        out = [np.empty((0, len(self.spectra)))]
        for left, axes in zip(rest, self._flights, strict=True):
            out.append(whitened_energies(self._filters, left, axes[0].run))
        return np.concatenate(out)

    def likeliest(self, rest: Sequence[Array], energies: Array, form: Array) -> Noise:
        """Of what is left: no quieter than its raw energy, the model-form errors ``form`` (channels,), and the floor.

        The least n log s^2 + E / s^2 + log det R of those with a slow share up to FITTED_SHARE: E ``energies``.
        """
        squares = [np.empty(0)]
        for left in rest:
            squares.append((left**2).sum(axis=1))
        raw = np.concatenate(squares) / self._counts[:, 0]
        variance = self._variance(energies, np.maximum(raw, form))
        log_variance = self._counts * np.log(variance)
        cost = log_variance + energies / variance + self._log_det
        cost = np.where(self._fitted, np.round(cost, 6), np.inf)
        best = np.argmin(cost, axis=1)
        of_best = np.take_along_axis(variance, best[:, None], axis=1)
        sigma = np.sqrt(of_best[:, 0])
        return Noise(tuple(best.tolist()), tuple(sigma.tolist()))

    def log_likelihood(self, energies: Array, form: Array) -> tuple[float, float]:
        """Of what is left, by the spectrum that is likeliest with its prior; and minus the log of that prior."""
        variance = self._variance(energies, form)
        log_variance = self._counts * np.log(2.0 * np.pi * variance)
        cost = 0.5 * (log_variance + energies / variance + self._log_det)
        loudness = self._prior_precision * variance
        posterior_cost = np.round(TRUST * cost + loudness, 6)
        best = np.arange(len(cost)), np.argmin(posterior_cost, axis=1)
        return -float(cost[best].sum()), float(loudness[best].sum())

    def _variance(self, energies: Array, least: Array) -> Array:
        """s^2 = max(E / n, least, FLOOR^2 / min(share, 1 - share)), with ``least`` (channels,)."""
        lowest = np.maximum(least[:, None], self._least_variance)
        return np.asarray(np.maximum(energies / self._counts, lowest))


def _log_determinants(channel: ResidualChannel, grid: Sequence[Spectrum]) -> list[float]:
    return [spectrum.log_determinant(channel.run) for spectrum in grid]


def _quiet_sigma(channel: ResidualChannel) -> float:
    """RMS of the residual less its mean over ``QUIET_S``, and the floor [N or N m]."""
    residual = channel.rows[0]
    valid = channel.valid.astype(float)
    width = min(round(QUIET_S / STEP_S), len(valid))
    kernel = np.ones(width)
    samples = np.maximum(np.convolve(valid, kernel, "same"), 1.0)
    mean = np.convolve(residual, kernel, "same") / samples
    fast = np.where(channel.valid, residual - mean, 0.0)
    floor = (FLOOR * channel.limit) ** 2
    variance = fast @ fast / channel.count + floor
    return float(np.sqrt(variance))
