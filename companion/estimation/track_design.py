"""The tracks of flight as filterpy designs them; ``kalman`` is their scalar form, written out for speed.

Not for flight, which does without filterpy: ``pip install "corner-compensator[design]"``. The tests hold both equal. A
state is x = (value, rate), driven by white acceleration:

    x = F x + noise of Q,      F = [[1, dt], [0, 1]],  Q = a^2 [[dt^4/4, dt^3/2], [dt^3/2, dt^2]]
    z = H x + noise of R,      H = [1, -delay] of a value that is stamped late, [0, 1] of a rate

Source of the smoother: Rauch, Tung and Striebel 1965, AIAA Journal 3, 1445.
"""

from __future__ import annotations

import numpy as np
from filterpy.common import Q_discrete_white_noise
from filterpy.kalman import KalmanFilter

from companion.estimation.kalman import TrackModel
from models.common.frames import Array

_OF_RATE = np.array([[0.0, 1.0]])


def designed(model: TrackModel, value: float, sigma: float) -> KalmanFilter:
    """A filter at a first measurement ``value`` with standard deviation ``sigma``; ``step_to`` moves it on."""
    track = KalmanFilter(dim_x=2, dim_z=1)
    track.x = np.array([value, 0.0])
    track.P = np.diag([sigma**2, model.initial_rate_sd**2])
    return track


def step_to(track: KalmanFilter, model: TrackModel, dt_s: float) -> None:
    """Predict ``dt_s`` ahead."""
    track.F = np.array([[1.0, dt_s], [0.0, 1.0]])
    track.Q = Q_discrete_white_noise(dim=2, dt=dt_s, var=model.acceleration_sd**2)
    track.predict()


def take_value(track: KalmanFilter, value: float, sigma: float, delay_s: float = 0.0) -> None:
    """Take in a measurement of the value ``delay_s`` ago."""
    track.update(value, R=sigma**2, H=np.array([[1.0, -delay_s]]))


def take_rate(track: KalmanFilter, rate: float, sigma: float) -> None:
    """Take in a measurement of the rate."""
    track.update(rate, R=sigma**2, H=_OF_RATE)


def smoothed(
    model: TrackModel,
    dt_s: float,
    values: Array,
    rates: Array,
    *,
    sigma: float,
    rate_sigma: float,
) -> Array:
    """Value and rate (n, 2) at ``n`` times ``dt_s`` apart, by all measurements before and after (fixed interval).

    ``values`` and ``rates`` (n,), NaN where nothing was measured. Raises ValueError where the first value is NaN.
    """
    if not np.isfinite(values[0]):
        raise ValueError("a track begins at a measured value")
    track = designed(model, float(values[0]), sigma)
    means = np.empty((len(values), 2))
    covariances = np.empty((len(values), 2, 2))
    for k, (value, rate) in enumerate(zip(values.tolist(), rates.tolist(), strict=True)):
        if k:
            step_to(track, model, dt_s)
            if np.isfinite(value):
                take_value(track, value, sigma)
        if np.isfinite(rate):
            take_rate(track, rate, rate_sigma)
        means[k] = track.x
        covariances[k] = track.P
    out: Array = track.rts_smoother(means, covariances)[0]
    return out
