"""How the vehicle moved, by IMU and estimator, on one clock; and which axes of the wrench that can judge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.common.errors import LogError
from models.common.frames import GRAVITY, Array, rotation_from_quaternion
from models.vehicle import Vehicle
from replay.flightlog import FlightLog, ImuRecord, Series
from replay.logs.names import called
from replay.logs.settings import change_for
from replay.residual.distances import MAX_GAP_S
from replay.residual.grid import CUT_OFF_HZ, Grid, rate_of_change

MOMENT_RATE_HZ = 20.0
"""Slowest gyro whose derivative is an angular acceleration: ten samples a period of the 2 Hz that are judged."""
FORCE_RATE_HZ = 4.0
"""Slowest accelerometer for forces: its half is the 2 Hz that are judged (Nyquist)."""
FASTEST_HZ = 100.0
"""Rate of the clock at most: fifty times what is judged, and a longer log costs no more than that."""
POSITION_GAP_S = 1.0
"""Longest gap of the estimator's position and velocity that is interpolated: both are smooth over a second."""
SHORTEST_S = 4.0
"""Shortest flight that is looked at beside others."""
ENOUGH_S = 8.0
"""What all flights together have to hold."""


@dataclass(frozen=True, kw_only=True)
class Trajectory:
    """What the log says of the motion at the ``n`` times ``grid.t``; NaN where it says nothing.

    ``force`` (n, 3) specific force [m/s^2] and ``gyro`` (n, 3) [rad/s], body FRD; ``rotation`` (n, 3, 3) body to world;
    ``position`` (n, 3) [m] and ``velocity`` (n, 3) [m/s], world NED. ``gyro_hz`` is 0 without a gyro.
    """

    grid: Grid
    force: Array
    gyro: Array
    gyro_hz: float
    rotation: Array
    position: Array
    velocity: Array
    attitude_hz: float

    @property
    def kinematic_bias(self) -> Array:
        """Accelerometer minus the specific force of velocity and attitude (n, 3) [m/s^2], body FRD; NaN without."""
        if not np.isfinite(self.velocity).any():
            return np.full_like(self.force, np.nan)
        accel = rate_of_change(self.velocity, self.grid.rate)
        accel[:, 2] -= GRAVITY
        return np.asarray(self.force - np.einsum("nji,nj->ni", self.rotation, accel))


def read_motion(log: FlightLog, vehicle: Vehicle) -> Trajectory:
    """The motion over the time with IMU and attitude. Raises LogError in one line where one is missing or too slow."""
    if not log.imus:
        raise LogError(
            f"{log.path}: no {called(log.path, 'imu')}: without an accelerometer no force can be "
            f"judged; it is recorded by {change_for(log, 'imu')}"
        )
    if log.attitude is None:
        raise LogError(
            f"{log.path}: no {called(log.path, 'attitude')}: it is recorded by "
            f"{change_for(log, 'attitude')}"
        )
    imu: ImuRecord = max(
        log.imus, key=lambda i: (i.specific_force.rate_hz >= FORCE_RATE_HZ, i is log.imus[0])
    )
    start = max(imu.specific_force.t_s[0], log.attitude.t_s[0])
    end = min(imu.specific_force.t_s[-1], log.attitude.t_s[-1])
    if end - start < SHORTEST_S:
        raise LogError(
            f"{log.path}: only {max(end - start, 0.0):.0f} s with IMU and attitude; record "
            f"{ENOUGH_S:.0f} s at least"
        )
    rate = min(imu.specific_force.rate_hz, FASTEST_HZ)
    if rate < FORCE_RATE_HZ:
        raise LogError(
            f"{log.path}: {imu.source} at {rate:.1f} Hz is too slow for forces; ask for "
            f"{FORCE_RATE_HZ:.0f} Hz or more: {change_for(log, 'imu')}"
        )
    # A quarter of the rate is carried by linear interpolation; rotor speeds are no better known than they are sent.
    grid = Grid(start, end, rate, min(CUT_OFF_HZ, rate / 4.0, rotor_rate_hz(log, vehicle) / 4.0))
    gyro: Series | None
    if len(imu.gyro) and np.isfinite(imu.gyro.values).any():
        gyro = imu.gyro
    else:
        gyro = log.rates
    return Trajectory(
        grid=grid,
        force=imu.specific_force.at(grid.t, MAX_GAP_S),
        gyro=sampled(gyro, 3, grid.t, MAX_GAP_S),
        gyro_hz=0.0 if gyro is None else gyro.rate_hz,
        rotation=rotation_from_quaternion(_unit(log.attitude.at(grid.t, MAX_GAP_S))),
        position=sampled(log.position, 3, grid.t, POSITION_GAP_S),
        velocity=sampled(log.velocity, 3, grid.t, POSITION_GAP_S),
        attitude_hz=log.attitude.rate_hz,
    )


def rotor_rate_hz(log: FlightLog, vehicle: Vehicle) -> float:
    """Rate of the slowest rotor speed, or of the outputs where they declare the thrust; inf without either."""
    if vehicle.telemetered:
        numbers = {rotor.esc for rotor in vehicle.rotors}
        speeds = [esc.rpm for number, esc in log.escs.items() if number in numbers]
        return min((carried_hz(series) for series in speeds if series is not None), default=np.inf)
    if log.servo is not None:
        return carried_hz(log.servo)
    return np.inf


def carried_hz(series: Series) -> float:
    """One over the step in which the record is in the middle of its time; NaN below two samples.

    Samples that are missing now and then leave the median step as it is, and yet half of the time may lie in longer
    steps. Steps beyond ``MAX_GAP_S`` are not bridged, so they do not count.
    """
    steps = np.sort(np.diff(series.t_s))
    bridged = steps[steps <= MAX_GAP_S]
    if not len(bridged):
        return series.rate_hz
    elapsed = np.cumsum(bridged)
    middle = np.searchsorted(elapsed, 0.5 * elapsed[-1])
    return float(1.0 / bridged[middle])


def judged_axes(motion: Trajectory, vehicle: Vehicle) -> tuple[list[int], list[str]]:
    """Axes of the wrench that log and vehicle file can judge, and a note where it is not all six."""
    if "position_m" in vehicle.assumed:
        return [0, 1, 2], ["where the rotors are is assumed: forces only"]
    if motion.gyro_hz < MOMENT_RATE_HZ:
        needed = f"{MOMENT_RATE_HZ:.0f} Hz needed"
        return [0, 1, 2], [
            f"gyro at {motion.gyro_hz:.0f} Hz: too slow for moments ({needed}), forces only"
        ]
    return list(range(6)), []


def sampled(series: Series | None, width: int, t: Array, gap_s: float) -> Array:
    """A series of ``width`` columns at the times ``t``, (n, width); NaN where it is absent or ``gap_s`` away."""
    if series is None:
        return np.full((len(t), width), np.nan)
    return series.at(t, gap_s)


def _unit(q: Array) -> Array:
    with np.errstate(invalid="ignore"):
        return np.asarray(q / np.linalg.norm(q, axis=1, keepdims=True))
