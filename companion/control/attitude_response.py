"""The attitude loop measured in flight: a bank of candidate loops fed with our own setpoints, the best one counts.

Every candidate is a dead time and two equal lags. Its output is compared with the measured tilt, both without their
slow means, over the last half minute; the gain is the least-squares one. No setpoint waits for it.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from companion.control.plant import AttitudeLoop, Source
from models.common.frames import Array

_TAUS = np.array([0.03, 0.045, 0.065, 0.09, 0.12, 0.16, 0.22, 0.30])
_DELAYS = np.array([0.02, 0.05, 0.08, 0.12, 0.17, 0.24, 0.34])
"""Candidates of lag and dead time [s], in steps of a third: from a racing quadrotor's to a slow heavy vehicle's."""
_MEAN_S = 2.0
"""Slower parts are trim and wind, not the answer to a setpoint."""
_MEMORY_S = 30.0
"""A sum forgets in this time: long enough for manoeuvres, short enough for a parameter that was changed."""
_LEAST_S = 8.0
"""Seconds of flight before a measurement counts ..."""
_LEAST_RAD = math.radians(0.35)
"""... and RMS of the setpoints in them: below, turbulence is as large as the answer."""
_MOST_UNEXPLAINED = 0.35
"""RMS of what the best candidate leaves over that of the tilt: above, something else moves the vehicle."""
_KEPT_S = 0.5
"""History of setpoints: longer than the longest delay."""
_GAINS = (0.7, 1.6)
"""Of a loop that follows its setpoint; what lies outside is another thing that moves the vehicle."""


Stage = NDArray[np.complexfloating[Any, Any]]
Sent = tuple[float, complex]
"""Time and tilt of a setpoint. A tilt is roll + j pitch [rad] without its slow mean: both axes answer alike."""


class Bank(NamedTuple):
    """The candidates' states and, with forgetting, their sums so far: arrays over (tau, delay)."""

    first: Stage
    second: Stage
    """What a candidate makes of the setpoints: behind one lag, and behind both."""
    cross: Array
    """Of model times tilt."""
    square: Array
    """Of the model squared."""
    tilt_power: float
    command_power: float
    seconds: float


_START = np.zeros((len(_TAUS), len(_DELAYS)))
_EMPTY = Bank(
    first=_START.astype(complex),
    second=_START.astype(complex),
    cross=_START,
    square=_START,
    tilt_power=0.0,
    command_power=0.0,
    seconds=0.0,
)


class AttitudeResponse(NamedTuple):
    """Setpoints of the last half second, slow means, and the bank."""

    commands: tuple[Sent, ...] = ()
    command_mean: complex = 0.0
    tilt_mean: complex = 0.0
    t_s: float = -math.inf
    bank: Bank = _EMPTY


def hear_tilt(
    response: AttitudeResponse, t_s: float, roll: float, pitch: float
) -> AttitudeResponse:
    """Take in a measured roll and pitch [rad]; without any setpoint, or after a gap, start again."""
    tilt = complex(roll, pitch)
    dt = t_s - response.t_s
    if not response.commands or not 0.0 < dt <= 0.3:
        return response._replace(tilt_mean=tilt, t_s=t_s, bank=_EMPTY)
    mean = response.tilt_mean + min(dt / _MEAN_S, 1.0) * (tilt - response.tilt_mean)
    bank = _compared(response.bank, response.commands, t_s, dt, tilt - mean)
    return response._replace(tilt_mean=mean, t_s=t_s, bank=bank)


def sent(response: AttitudeResponse, t_s: float, roll: float, pitch: float) -> AttitudeResponse:
    """Remember a setpoint [rad]."""
    tilt = mean = complex(roll, pitch)
    kept = [c for c in response.commands if t_s - _KEPT_S <= c[0] < t_s]
    if kept:
        mean = response.command_mean + min((t_s - kept[-1][0]) / _MEAN_S, 1.0) * (
            tilt - response.command_mean
        )
    return response._replace(commands=(*kept, (t_s, tilt - mean)), command_mean=mean)


def _compared(
    bank: Bank, commands: tuple[Sent, ...], t_s: float, dt_s: float, tilt: complex
) -> Bank:
    """The bank with one tilt more: every candidate one step on, and compared with it."""
    times, setpoints = zip(*commands, strict=True)
    # The setpoints as every dead time delays them, the first and the last of them held.
    delayed = np.interp(t_s - _DELAYS, times, setpoints)
    share = (1.0 - np.exp(-dt_s / _TAUS))[:, None]
    first = bank.first + share * (delayed - bank.first)
    second = bank.second + share * (first - bank.second)
    forget = math.exp(-dt_s / _MEMORY_S)
    return Bank(
        first=first,
        second=second,
        cross=forget * bank.cross + dt_s * (second * tilt.conjugate()).real,
        square=forget * bank.square + dt_s * (second * second.conj()).real,
        tilt_power=forget * bank.tilt_power + dt_s * abs(tilt) ** 2,
        command_power=forget * bank.command_power + dt_s * abs(setpoints[-1]) ** 2,
        seconds=forget * bank.seconds + dt_s,
    )


def measured_loop(response: AttitudeResponse) -> AttitudeLoop | None:
    """The loop that explains the tilt best, or None while there was too little to see."""
    bank = response.bank
    if bank.seconds < _LEAST_S or bank.command_power < bank.seconds * _LEAST_RAD**2:
        return None
    gain = np.clip(bank.cross / np.maximum(bank.square, 1e-12), *_GAINS)
    left = bank.tilt_power - 2.0 * gain * bank.cross + gain**2 * bank.square
    best = np.unravel_index(int(np.argmin(left)), left.shape)
    if left[best] > _MOST_UNEXPLAINED**2 * bank.tilt_power:
        return None
    return AttitudeLoop(
        float(_TAUS[best[0]]),
        float(_DELAYS[best[1]]),
        round(float(gain[best]), 1),
        source=Source.MEASURED,
    )
