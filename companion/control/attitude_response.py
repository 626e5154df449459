"""The attitude loop measured in flight: a bank of candidate loops fed with our own setpoints, the best one counts.

Every candidate is a dead time and two equal lags. Its output is compared with the measured tilt, both without their
slow means, over the last half minute; the gain is the least-squares one. Tilts are noted when they arrive and worked
into the bank some at a time (``settled``), where no setpoint waits for it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

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
_SETTLE_AT = 8
"""Tilts noted before the bank takes them in: an eighth of a second, a tenth of a millisecond of work."""
_KEPT_S = 0.5
"""History of setpoints: longer than the longest delay."""
_GAINS = (0.7, 1.6)
"""Of a loop that follows its setpoint; what lies outside is another thing that moves the vehicle."""


def _zeros() -> Array:
    return np.zeros((2, 2, len(_TAUS), len(_DELAYS)))


Sent = tuple[float, float, float]
"""(time, roll, pitch) of a setpoint, without its slow mean."""


class Heard(NamedTuple):
    """A tilt that the bank has not taken in yet, and the setpoints that were known when it came."""

    t_s: float
    dt_s: float
    roll: float
    """Without its slow mean [rad]."""
    pitch: float
    commands: tuple[Sent, ...]


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
    """Setpoints of the last half second, slow means, and the bank with the tilts that it has still to take in."""

    commands: tuple[Sent, ...] = ()
    command_mean: tuple[float, float] = (0.0, 0.0)
    tilt_mean: tuple[float, float] = (0.0, 0.0)
    t_s: float = -math.inf
    heard: tuple[Heard, ...] = ()
    bank: Bank = _EMPTY


def hear_tilt(response: AttitudeResponse, t_s: float, roll: float, pitch: float) -> AttitudeResponse:
    """Note a measured roll and pitch [rad]; without setpoints in the half second before, start again."""
    commands, dt = response.commands, t_s - response.t_s
    if not commands or not 0.0 < dt <= 0.3:
        mean = response.command_mean if commands else (0.0, 0.0)
        return AttitudeResponse(commands, mean, (roll, pitch), t_s, (), _EMPTY)
    share = min(dt / _MEAN_S, 1.0)
    mean_roll, mean_pitch = response.tilt_mean
    mean_roll, mean_pitch = mean_roll + (roll - mean_roll) * share, mean_pitch + (pitch - mean_pitch) * share
    heard = (*response.heard, Heard(t_s, dt, roll - mean_roll, pitch - mean_pitch, commands))
    return AttitudeResponse(commands, response.command_mean, (mean_roll, mean_pitch), t_s, heard, response.bank)


def sent(response: AttitudeResponse, t_s: float, roll: float, pitch: float) -> AttitudeResponse:
    """Remember a setpoint [rad]."""
    oldest = t_s - _KEPT_S
    kept = [c for c in response.commands if oldest <= c[0] < t_s]
    if kept:
        share = min((t_s - kept[-1][0]) / _MEAN_S, 1.0)
        mean_roll, mean_pitch = response.command_mean
        mean_roll, mean_pitch = mean_roll + (roll - mean_roll) * share, mean_pitch + (pitch - mean_pitch) * share
    else:
        mean_roll, mean_pitch = roll, pitch
    kept.append((t_s, roll - mean_roll, pitch - mean_pitch))
    return AttitudeResponse(
        tuple(kept), (mean_roll, mean_pitch), response.tilt_mean, response.t_s, response.heard, response.bank
    )


def settled(response: AttitudeResponse, at_least: int = _SETTLE_AT) -> AttitudeResponse:
    """With what was heard taken into the bank, once it is ``at_least`` so many tilts."""
    heard, bank = response.heard, response.bank
    if len(heard) < max(at_least, 1):
        return response
    delayed, shares = _delayed(heard), 1.0 - np.exp(-np.array([one.dt_s for one in heard])[:, None] / _TAUS)
    tilts = np.array([(one.roll, one.pitch) for one in heard])[:, :, None, None]
    first, second, sums = bank.stages[0], bank.stages[1], bank.sums
    tilt_power, command_power, seconds = bank.tilt_power, bank.command_power, bank.seconds
    for k, (_, dt, roll, pitch, commands) in enumerate(heard):
        share = shares[k][None, :, None]
        first = first + share * (delayed[k][:, None, :] - first)
        second = second + share * (first - second)
        forget = math.exp(-dt / _MEMORY_S)
        fresh = np.empty_like(sums)
        np.multiply(second, tilts[k], out=fresh[0])
        np.multiply(second, second, out=fresh[1])
        sums = forget * sums + dt * fresh
        newest = commands[-1]
        tilt_power = forget * tilt_power + dt * (roll * roll + pitch * pitch)
        command_power = forget * command_power + dt * (newest[1] ** 2 + newest[2] ** 2)
        seconds = forget * seconds + dt
    bank = Bank(np.stack([first, second]), sums, tilt_power, command_power, seconds)
    return AttitudeResponse(response.commands, response.command_mean, response.tilt_mean, response.t_s, (), bank)


def _delayed(heard: tuple[Heard, ...]) -> Array:
    """The setpoints as every candidate's dead time delays them: shape (heard, axis, delay).

    Each tilt sees the setpoints that were known when it came, the first and the last of them held.
    """
    known = list(heard[0].commands)
    for one in heard[1:]:
        last_s, fresh = known[-1][0], len(one.commands)
        while fresh and one.commands[fresh - 1][0] > last_s:
            fresh -= 1
        known += one.commands[fresh:]
    times, roll, pitch = np.array(known).T
    at = np.array([one.t_s for one in heard])[:, None] - _DELAYS
    at = np.clip(at, [[one.commands[0][0]] for one in heard], [[one.commands[-1][0]] for one in heard])
    return np.stack([np.interp(at, times, roll), np.interp(at, times, pitch)], axis=1)


def measured_loop(response: AttitudeResponse) -> AttitudeLoop | None:
    """The loop that explains the tilt best, or None while there was too little to see."""
    bank = settled(response, 1).bank
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
