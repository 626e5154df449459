"""The attitude loop measured in flight: a bank of candidate loops fed with our own setpoints, the best one counts.

Every candidate is a dead time and two equal lags. Its output is compared with the measured tilt, both without their
slow means, over the last half minute; the gain is the least-squares one. No setpoint waits for it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from companion.control.plant import AttitudeLoop, Source
from companion.estimation.vectors import Level, lagged
from models.frames import Array

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


def _zeros() -> Array:
    return np.zeros((2, 2, len(_TAUS), len(_DELAYS)))


Sent = tuple[float, float, float]
"""(time, roll, pitch) of a setpoint, without its slow mean."""


@dataclass(frozen=True, slots=True, eq=False)
class Bank:
    """Sums of the candidates so far. Arrays over (stage or sum, axis roll pitch, tau, delay)."""

    stages: Array = field(default_factory=_zeros)
    sums: Array = field(default_factory=_zeros)
    """Model times tilt, and model squared, with forgetting."""
    tilt_power: float = 0.0
    command_power: float = 0.0
    seconds: float = 0.0


_EMPTY = Bank()


class AttitudeResponse(NamedTuple):
    """Setpoints of the last half second, slow means, and the bank."""

    commands: tuple[Sent, ...] = ()
    command_mean: Level = (0.0, 0.0)
    tilt_mean: Level = (0.0, 0.0)
    t_s: float = -math.inf
    bank: Bank = _EMPTY


def hear_tilt(response: AttitudeResponse, t_s: float, roll: float, pitch: float) -> AttitudeResponse:
    """Take in a measured roll and pitch [rad]; without any setpoint, or after a gap, start again."""
    dt = t_s - response.t_s
    if not response.commands or not 0.0 < dt <= 0.3:
        return response._replace(tilt_mean=(roll, pitch), t_s=t_s, bank=_EMPTY)
    mean = lagged(response.tilt_mean, (roll, pitch), min(dt / _MEAN_S, 1.0))
    bank = _longer(response.bank, response.commands, t_s, dt, (roll - mean[0], pitch - mean[1]))
    return response._replace(tilt_mean=mean, t_s=t_s, bank=bank)


def sent(response: AttitudeResponse, t_s: float, roll: float, pitch: float) -> AttitudeResponse:
    """Remember a setpoint [rad]."""
    kept = [c for c in response.commands if t_s - _KEPT_S <= c[0] < t_s]
    share = min((t_s - kept[-1][0]) / _MEAN_S, 1.0) if kept else 1.0
    mean = lagged(response.command_mean, (roll, pitch), share) if kept else (roll, pitch)
    return response._replace(commands=(*kept, (t_s, roll - mean[0], pitch - mean[1])), command_mean=mean)


def _longer(bank: Bank, commands: tuple[Sent, ...], t_s: float, dt_s: float, tilt: Level) -> Bank:
    """The bank with one tilt more: every candidate one step on, and compared with it."""
    times, roll, pitch = np.array(commands).T
    # The setpoints as every dead time delays them, the first and the last of them held.
    at = t_s - _DELAYS
    delayed = np.stack([np.interp(at, times, roll), np.interp(at, times, pitch)])[:, None, :]
    share = (1.0 - np.exp(-dt_s / _TAUS))[:, None]
    first = bank.stages[0] + share * (delayed - bank.stages[0])
    second = bank.stages[1] + share * (first - bank.stages[1])
    forget = math.exp(-dt_s / _MEMORY_S)
    fresh = np.stack([second * np.array(tilt)[:, None, None], second * second])
    return Bank(
        np.stack([first, second]),
        forget * bank.sums + dt_s * fresh,
        forget * bank.tilt_power + dt_s * (tilt[0] * tilt[0] + tilt[1] * tilt[1]),
        forget * bank.command_power + dt_s * (commands[-1][1] ** 2 + commands[-1][2] ** 2),
        forget * bank.seconds + dt_s,
    )


def measured_loop(response: AttitudeResponse) -> AttitudeLoop | None:
    """The loop that explains the tilt best, or None while there was too little to see."""
    bank = response.bank
    if bank.seconds < _LEAST_S or bank.command_power < bank.seconds * _LEAST_RAD**2:
        return None
    cross, square = bank.sums.sum(axis=1)
    gain = np.clip(cross / np.maximum(square, 1e-12), *_GAINS)
    left = bank.tilt_power - 2.0 * gain * cross + gain**2 * square
    best = np.unravel_index(int(np.argmin(left)), left.shape)
    if left[best] > _MOST_UNEXPLAINED**2 * bank.tilt_power:
        return None
    return AttitudeLoop(
        float(_TAUS[best[0]]), float(_DELAYS[best[1]]), round(float(gain[best]), 1), source=Source.MEASURED
    )
