"""The attitude loop measured in flight: a bank of candidate loops fed with our own setpoints, the best one counts.

Every candidate is a dead time and two equal lags. Its output is compared with the measured tilt, both without their
slow means, over the last half minute; the gain is the least-squares one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from companion.control.plant import AttitudeLoop, Source
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


@dataclass(frozen=True, slots=True, eq=False)
class AttitudeResponse:
    """Sums so far. Arrays over (stage or sum, axis roll pitch, tau, delay)."""

    commands: tuple[tuple[float, float, float], ...] = ()
    """(time, roll, pitch) of the newest setpoints, without their slow mean."""
    command_mean: Array = field(default_factory=lambda: np.zeros(2))
    tilt_mean: Array = field(default_factory=lambda: np.zeros(2))
    stages: Array = field(default_factory=_zeros)
    sums: Array = field(default_factory=_zeros)
    """Model times tilt, and model squared, with forgetting."""
    tilt_power: float = 0.0
    command_power: float = 0.0
    seconds: float = 0.0
    t_s: float = -math.inf


def hear_tilt(response: AttitudeResponse, t_s: float, tilt: Array) -> AttitudeResponse:
    """Take in a measured roll and pitch (2,) [rad]; without setpoints in the half second before, start again."""
    dt = t_s - response.t_s
    if not response.commands or not 0.0 < dt <= 0.3:
        fresh = AttitudeResponse(
            commands=response.commands, command_mean=response.command_mean, tilt_mean=tilt, t_s=t_s
        )
        return fresh if response.commands else AttitudeResponse(tilt_mean=tilt, t_s=t_s)
    mean = response.tilt_mean + (tilt - response.tilt_mean) * min(dt / _MEAN_S, 1.0)
    off = tilt - mean
    times, roll, pitch = np.array(response.commands).T
    delayed = np.array([np.interp(t_s - _DELAYS, times, roll), np.interp(t_s - _DELAYS, times, pitch)])
    share = 1.0 - np.exp(-dt / _TAUS)[None, :, None]
    first = response.stages[0] + share * (delayed[:, None, :] - response.stages[0])
    second = response.stages[1] + share * (first - response.stages[1])
    forget = math.exp(-dt / _MEMORY_S)
    sums = forget * response.sums + dt * np.stack([second * off[:, None, None], second**2])
    newest = response.commands[-1]
    return AttitudeResponse(
        commands=response.commands,
        command_mean=response.command_mean,
        tilt_mean=mean,
        stages=np.stack([first, second]),
        sums=sums,
        tilt_power=forget * response.tilt_power + dt * float(off @ off),
        command_power=forget * response.command_power + dt * (newest[1] ** 2 + newest[2] ** 2),
        seconds=forget * response.seconds + dt,
        t_s=t_s,
    )


def sent(response: AttitudeResponse, t_s: float, command: Array) -> AttitudeResponse:
    """Remember a setpoint: roll and pitch (2,) [rad]."""
    kept = tuple(c for c in response.commands if t_s - _KEPT_S <= c[0] < t_s)
    dt = t_s - kept[-1][0] if kept else 0.0
    mean = response.command_mean + (command - response.command_mean) * min(dt / _MEAN_S, 1.0) if kept else command
    off = command - mean
    return AttitudeResponse(
        commands=(*kept, (t_s, float(off[0]), float(off[1]))),
        command_mean=mean,
        tilt_mean=response.tilt_mean,
        stages=response.stages,
        sums=response.sums,
        tilt_power=response.tilt_power,
        command_power=response.command_power,
        seconds=response.seconds,
        t_s=response.t_s,
    )


def measured_loop(response: AttitudeResponse) -> AttitudeLoop | None:
    """The loop that explains the tilt best, or None while there was too little to see."""
    if response.seconds < _LEAST_S or response.command_power < response.seconds * _LEAST_RAD**2:
        return None
    cross, square = response.sums.sum(axis=1)
    gain = np.clip(cross / np.maximum(square, 1e-12), *_GAINS)
    left = response.tilt_power - 2.0 * gain * cross + gain**2 * square
    best = np.unravel_index(int(np.argmin(left)), left.shape)
    if left[best] > _MOST_UNEXPLAINED**2 * response.tilt_power:
        return None
    return AttitudeLoop(
        float(_TAUS[best[0]]), float(_DELAYS[best[1]]), round(float(gain[best]), 1), source=Source.MEASURED
    )
