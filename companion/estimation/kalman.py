"""A gated, delay-aware Kalman track of one scalar and its rate; frozen, so that ``step`` stays pure.

The two formulas are the linear Kalman filter's (Kalman 1960, J. Basic Eng. 82; Joseph's form of the update: Bucy and
Joseph 1968), equal by test to the filter that filterpy designs (``track_design``). Around them: the measurement is of
the past (H = [1, -delay]), an innovation gate, and a restart after several rejected samples that agree with each other
(the world jumped, not the sensor).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple


@dataclass(frozen=True, slots=True)
class TrackModel:
    """Noise of a track: ``acceleration_sd`` [unit/s^2] drives it, ``gate`` limits the normalised innovation squared."""

    acceleration_sd: float
    initial_rate_sd: float
    gate: float
    restart_after: int
    agree_within: float
    """Consecutive outliers within this many units of each other restart the track there."""


class Outcome(Enum):
    """What became of one measurement."""

    ACCEPTED = "accepted"
    OUTLIER = "outlier"
    RESTARTED = "restarted"
    UNUSABLE = "not finite, or older than the track"


class Track(NamedTuple):
    """State at ``t_s``: value and rate with their covariance; ``updated_s`` stamps the last accepted sample.

    Plain floats in a tuple: made several times at every message, and two numbers are too few for an array to be quick.
    """

    t_s: float
    value: float
    """The tracked quantity at ``t_s``."""
    rate: float
    """Its rate [1/s]."""
    value_variance: float
    covariance: float
    """Of value and rate."""
    rate_variance: float
    updated_s: float
    outliers: tuple[float, ...] = ()
    restarted_s: float = -math.inf

    @property
    def sigma(self) -> float:
        """Standard deviation of ``value``."""
        return math.sqrt(max(self.value_variance, 0.0))

    def at(self, t_s: float) -> float:
        """The value extrapolated to ``t_s``, at most 0.3 s ahead."""
        return self.value + self.rate * min(max(t_s - self.t_s, 0.0), 0.3)

    def age(self, t_s: float) -> float:
        """Seconds since the last accepted sample."""
        return t_s - self.updated_s


def predict(track: Track, model: TrackModel, t_s: float) -> Track:
    """The track at ``t_s``, its rate constant but for white acceleration of standard deviation a; never backwards.

    x = F x, P = F P F' + Q with F = [[1, dt], [0, 1]] and Q = q [[dt^2/4, dt/2], [dt/2, 1]], q = a^2 dt^2: the
    acceleration is constant within a step (Bar-Shalom, Li and Kirubarajan 2001, Estimation with Applications to
    Tracking and Navigation, 6.3.2).
    """
    dt = t_s - track.t_s
    if dt <= 0.0:
        return track
    q = model.acceleration_sd * model.acceleration_sd * dt * dt
    rate = track.rate
    p11 = track.value_variance
    p12 = track.covariance
    p22 = track.rate_variance
    value = track.value + dt * rate
    p11 = p11 + dt * (2.0 * p12 + dt * p22) + 0.25 * q * dt * dt
    p12 = p12 + dt * p22 + 0.5 * q * dt
    p22 = p22 + q
    return Track(
        t_s=t_s,
        value=value,
        rate=rate,
        value_variance=p11,
        covariance=p12,
        rate_variance=p22,
        updated_s=track.updated_s,
        outliers=track.outliers,
        restarted_s=track.restarted_s,
    )


def update(track: Track, measured: float, variance: float, h1: float, h2: float) -> Track:
    """The track after ``measured`` z = H x + noise of ``variance`` R, with H = [h1, h2] of value and rate.

    S = H P H' + R, K = P H' / S, x = x + K (z - H x). Joseph's form of the covariance, with A = 1 - K H,
    P = A P A' + R K K', stays symmetric and positive for any gain.
    """
    value = track.value
    rate = track.rate
    p11 = track.value_variance
    p12 = track.covariance
    p22 = track.rate_variance
    # P H' and the variance S of the innovation.
    ph1 = p11 * h1 + p12 * h2
    ph2 = p12 * h1 + p22 * h2
    s = h1 * ph1 + h2 * ph2 + variance
    k1 = ph1 / s
    k2 = ph2 / s
    innovation = measured - (h1 * value + h2 * rate)
    a11 = 1.0 - k1 * h1
    a12 = -k1 * h2
    a21 = -k2 * h1
    a22 = 1.0 - k2 * h2
    # A P.
    ap11 = a11 * p11 + a12 * p12
    ap12 = a11 * p12 + a12 * p22
    ap21 = a21 * p11 + a22 * p12
    ap22 = a21 * p12 + a22 * p22
    p11 = ap11 * a11 + ap12 * a12 + variance * k1 * k1
    p12 = ap11 * a21 + ap12 * a22 + variance * k1 * k2
    p22 = ap21 * a21 + ap22 * a22 + variance * k2 * k2
    value = value + k1 * innovation
    rate = rate + k2 * innovation
    return Track(
        t_s=track.t_s,
        value=value,
        rate=rate,
        value_variance=p11,
        covariance=p12,
        rate_variance=p22,
        updated_s=track.updated_s,
        outliers=track.outliers,
        restarted_s=track.restarted_s,
    )


def begin(model: TrackModel, t_s: float, value: float, sigma: float) -> Track:
    """A new track at a first measurement."""
    return Track(
        t_s=t_s,
        value=value,
        rate=0.0,
        value_variance=sigma * sigma,
        covariance=0.0,
        rate_variance=model.initial_rate_sd**2,
        updated_s=t_s,
    )


def measure(
    track: Track | None,
    model: TrackModel,
    t_s: float,
    value: float,
    sigma: float,
    delay_s: float = 0.0,
) -> tuple[Track | None, Outcome]:
    """Take in a measurement stamped ``t_s`` of the value ``delay_s`` earlier. A NaN never reaches the filter."""
    if not (math.isfinite(value) and math.isfinite(sigma) and math.isfinite(t_s)):
        return track, Outcome.UNUSABLE
    if track is None:
        return begin(model, t_s, value, sigma), Outcome.RESTARTED
    if t_s < track.t_s - 0.5:
        return track, Outcome.UNUSABLE
    ahead = predict(track, model, t_s)
    innovation = value - (ahead.value - delay_s * ahead.rate)
    spread = (
        ahead.value_variance
        - delay_s * (2.0 * ahead.covariance - delay_s * ahead.rate_variance)
        + sigma * sigma
    )
    if innovation * innovation > model.gate * spread:
        outliers = (*track.outliers, value)[-model.restart_after :]
        if (
            len(outliers) == model.restart_after
            and max(outliers) - min(outliers) <= model.agree_within
        ):
            return begin(model, t_s, value, sigma)._replace(restarted_s=t_s), Outcome.RESTARTED
        return ahead._replace(outliers=outliers), Outcome.OUTLIER
    heard = ahead._replace(updated_s=t_s, outliers=())
    return update(heard, value, sigma * sigma, 1.0, -delay_s), Outcome.ACCEPTED


def measure_rate(track: Track, model: TrackModel, t_s: float, rate: float, sigma: float) -> Track:
    """Take in a measurement of the rate (the vehicle's own velocity along the beam); does not refresh the age."""
    if not (math.isfinite(rate) and math.isfinite(sigma)) or t_s < track.t_s - 0.5:
        return track
    return update(predict(track, model, t_s), rate, sigma * sigma, 0.0, 1.0)
