"""A gated, delay-aware Kalman track of one scalar and its rate; frozen, so that ``step`` stays pure.

The two formulas are the linear Kalman filter's (Kalman 1960, J. Basic Eng. 82; Joseph's form of the update: Bucy and
Joseph 1968), checked against filterpy in the tests. Around them: the measurement is of the past (H = [1, -delay]), an
innovation gate, and a restart after several rejected samples that agree with each other (the world jumped, not the
sensor).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from models.frames import Array


class Verdict(Enum):
    """What became of one measurement."""

    ACCEPTED = "accepted"
    NOT_FINITE = "not finite"
    OUTLIER = "outlier"
    RESTARTED = "restarted"
    OLD = "older than the track"


@dataclass(frozen=True, slots=True)
class TrackModel:
    """Noise of a track: ``acceleration_sd`` [unit/s^2] drives it, ``gate`` limits the normalised innovation squared."""

    acceleration_sd: float
    initial_rate_sd: float
    gate: float = 16.0
    restart_after: int = 5
    agree_within: float = 0.10
    """Consecutive outliers within this many units of each other restart the track there."""


@dataclass(frozen=True, slots=True)
class Track:
    """State at ``t_s``: ``x`` = (value, rate), covariance ``p``; ``updated_s`` stamps the last accepted sample."""

    t_s: float
    x: Array
    p: Array
    updated_s: float
    outliers: tuple[float, ...] = ()
    restarted_s: float = -math.inf

    @property
    def value(self) -> float:
        """The tracked quantity at ``t_s``."""
        return float(self.x[0])

    @property
    def rate(self) -> float:
        """Its rate [1/s]."""
        return float(self.x[1])

    @property
    def sigma(self) -> float:
        """Standard deviation of ``value``."""
        return math.sqrt(max(float(self.p[0, 0]), 0.0))

    def at(self, t_s: float) -> float:
        """The value extrapolated to ``t_s``, at most 0.3 s ahead."""
        return self.value + self.rate * min(max(t_s - self.t_s, 0.0), 0.3)

    def age(self, t_s: float) -> float:
        """Seconds since the last accepted sample."""
        return t_s - self.updated_s


def predict(x: Array, p: Array, f: Array, q: Array) -> tuple[Array, Array]:
    """State (n,) and covariance (n, n) a step on: x = F x, P = F P F' + Q."""
    return f @ x, f @ p @ f.T + q


def update(x: Array, p: Array, value: float, variance: float, h: Array) -> tuple[Array, Array]:
    """State (n,) and covariance (n, n) after a scalar measurement ``value`` = h x + noise of ``variance``; h is (n,).

    Joseph's form of the covariance stays symmetric and positive for any gain.
    """
    ph = p @ h
    gain = ph / (float(h @ ph) + variance)
    keep = np.eye(len(x)) - np.outer(gain, h)
    return x + gain * (value - float(h @ x)), keep @ p @ keep.T + variance * np.outer(gain, gain)


def begin(model: TrackModel, t_s: float, value: float, sigma: float) -> Track:
    """A new track at a first measurement."""
    p = np.diag([sigma * sigma, model.initial_rate_sd**2])
    return Track(t_s=t_s, x=np.array([value, 0.0]), p=p, updated_s=t_s)


def propagate(track: Track, model: TrackModel, t_s: float) -> Track:
    """Predict to ``t_s`` with a constant rate driven by white acceleration; never backwards."""
    dt = t_s - track.t_s
    if dt <= 0.0:
        return track
    q = model.acceleration_sd**2
    f = np.array([[1.0, dt], [0.0, 1.0]])
    noise = q * np.array([[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]])
    x, p = predict(track.x, track.p, f, noise)
    return replace(track, t_s=t_s, x=x, p=p)


def measure(
    track: Track | None, model: TrackModel, t_s: float, value: float, sigma: float, delay_s: float = 0.0
) -> tuple[Track | None, Verdict]:
    """Take in a measurement stamped ``t_s`` of the value ``delay_s`` earlier. A NaN never reaches the filter."""
    if not (math.isfinite(value) and math.isfinite(sigma) and math.isfinite(t_s)):
        return track, Verdict.NOT_FINITE
    if track is None:
        return begin(model, t_s, value, sigma), Verdict.RESTARTED
    if t_s < track.t_s - 0.5:
        return track, Verdict.OLD
    ahead = propagate(track, model, t_s)
    h = np.array([1.0, -delay_s])
    innovation = value - float(h @ ahead.x)
    variance = float(h @ ahead.p @ h) + sigma * sigma
    if innovation * innovation > model.gate * variance:
        outliers = (*track.outliers, value)[-model.restart_after :]
        if len(outliers) == model.restart_after and max(outliers) - min(outliers) <= model.agree_within:
            return replace(begin(model, t_s, value, sigma), restarted_s=t_s), Verdict.RESTARTED
        return replace(ahead, outliers=outliers), Verdict.OUTLIER
    x, p = update(ahead.x, ahead.p, value, sigma * sigma, h)
    return replace(ahead, x=x, p=p, updated_s=t_s, outliers=()), Verdict.ACCEPTED


def measure_rate(track: Track, model: TrackModel, t_s: float, rate: float, sigma: float) -> Track:
    """Take in a measurement of the rate (the vehicle's own velocity along the beam); does not refresh the age."""
    if not (math.isfinite(rate) and math.isfinite(sigma)) or t_s < track.t_s - 0.5:
        return track
    ahead = propagate(track, model, t_s)
    x, p = update(ahead.x, ahead.p, rate, sigma * sigma, np.array([0.0, 1.0]))
    return replace(ahead, x=x, p=p)
