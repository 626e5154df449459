"""Which accelerometer and gyro are alive and turn as the vehicle does."""

from __future__ import annotations

import numpy as np

from models.common.frames import GRAVITY, Array
from replay.flightlog import FlightLog, ImuRecord, Series
from replay.sources.candidates import Candidate
from replay.spill import Spool, blocks

_OF_GRAVITY = (0.5, 2.0)
"""Median specific force of a flight over gravity. A hover has 1; no pilot flies half of a log at 2."""
_STILL = 1e-6
"""A live sensor has noise; one whose readings never differ by more is frozen, and agrees with nothing."""
_FEWEST = 50
"""Samples from which on turning is compared."""


def imus(log: FlightLog) -> list[Candidate]:
    """Every IMU of the log, in the order of the reader: float before quantised, fast before slow."""
    turning = _turning(log.attitude)
    return [
        Candidate(
            name=imu.source,
            fault=_fault(log, imu),
            agreement=_agreement(imu.gyro, turning),
            because="its gyro turns as the attitude does",
        )
        for imu in log.imus
    ]


def _fault(log: FlightLog, imu: ImuRecord) -> str:
    force = imu.specific_force.values
    norms = Spool(np.float64)
    for rows in blocks(len(force)):
        known = force[rows][np.isfinite(force[rows]).all(axis=1)]
        norms.append(np.linalg.norm(known, axis=1))
    lengths = norms.array()
    if not len(lengths):
        return "no number"
    over_gravity = float(np.median(lengths)) / GRAVITY
    low, high = _OF_GRAVITY
    if not low <= over_gravity <= high:
        return f"measures {over_gravity:.2f} g"
    if imu.healthy is False:
        return "the autopilot calls it unhealthy"
    if imu.instance:
        number = str(imu.instance + 1)
    else:
        number = ""
    use = f"INS_USE{number}"
    if log.parameters.get(use) == 0.0:
        return f"{use} is 0"
    return ""


def _turning(attitude: Series | None) -> Series | None:
    """Angular speed (n, 1) [rad/s] between successive attitudes, at the later one."""
    if attitude is None or len(attitude) < _FEWEST:
        return None
    speeds = Spool(np.float64, (1,))
    for rows in blocks(len(attitude) - 1):
        q = attitude.values[rows.start : rows.stop + 1]
        overlap = np.abs(np.einsum("ij,ij->i", q[1:], q[:-1]))
        angle = 2.0 * np.arccos(np.clip(overlap, 0.0, 1.0))
        speeds.append((angle / np.diff(attitude.t_s[rows.start : rows.stop + 1]))[:, None])
    return Series(attitude.t_s[1:], speeds.array(), attitude.source)


def _agreement(gyro: Series, turning: Series | None) -> float:
    """Correlation of the gyro's angular speed with the attitude's; 0 where neither is known or it opposes."""
    if turning is None or len(gyro) < _FEWEST:
        return 0.0
    measured = Spool(np.float64)
    for rows in blocks(len(turning)):
        measured.append(np.linalg.norm(gyro.at(turning.t_s[rows]), axis=1))
    return max(correlation(measured.array(), turning.values[:, 0]), 0.0)


def correlation(a: Array, b: Array) -> float:
    """Of (n,) and (n,) where both are known; 0 where too little is, or one of them stands still."""
    both = np.isfinite(a) & np.isfinite(b)
    if int(both.sum()) < _FEWEST:
        return 0.0
    first = a[both]
    second = b[both]
    if float(np.ptp(first)) < _STILL or float(np.ptp(second)) < _STILL:
        return 0.0
    return float(np.corrcoef(first, second)[0, 1])
