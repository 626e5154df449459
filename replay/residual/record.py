"""Measured minus modelled wrench of a flight on one clock: delays first, one filter for both, bad time left out."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from models.effects import AdoptedEffect, Context, adopted_wrench, corrected_state
from models.errors import ConfigError, LogError
from models.frames import GRAVITY, Array, measured_wrench, rotation_from_quaternion
from models.surrogate.fan_surrogate import FanSurrogate
from models.vehicle import Vehicle
from models.vehicle_wrench import modelled_wrench
from replay.flightlog import FlightLog, ImuRecord
from replay.residual.channels import named_channels
from replay.residual.delays import Delay, range_delay_of, rotor_delay
from replay.residual.distances import MAX_GAP_S, distances, unseen_surfaces
from replay.residual.faults import LogFault, derived_accelerometer, doubted, without_stuck_beams
from replay.residual.grid import CUT_OFF_HZ, Grid, Mask, rate_of_change
from replay.residual.log_state import decimated, equal_outputs, neutral_servos, raw_state, rotor_columns
from replay.residual.validity import Excluded, judged_time

MOMENT_RATE_HZ = 20.0
FORCE_RATE_HZ = 4.0
SHORTEST_S = 4.0
"""Shortest flight that is looked at beside others."""
ENOUGH_S = 8.0
"""What all flights together have to hold."""
COMMANDED = 0.6
"""Correlation of lift with the accelerometer below which rotor speeds mostly answer noise, and motions are drift."""


@dataclass(frozen=True)
class Record:
    """One flight, ready to be searched: rows on a uniform clock, smoothed alike.

    ``residual`` (n, 6) in N and N m; ``valid`` (n,); ``axes`` the axes that this log can judge.
    ``kinematic_bias`` (n, 3): accelerometer minus the specific force that velocity and attitude imply, body FRD.
    """

    name: str
    log: FlightLog
    context: Context
    residual: Array
    measured: Array
    valid: Mask
    axes: tuple[int, ...]
    step_s: float
    kinematic_bias: Array
    channels: dict[str, Array]
    delays: tuple[Delay, ...]
    excluded: tuple[Excluded, ...]
    notes: tuple[str, ...] = field(default=())
    faults: tuple[LogFault, ...] = field(default=())
    """What is wrong with the log or the vehicle file, and is named as no effect."""
    blind: tuple[int, ...] = ()
    """Axes that are not judged because of a fault, but on which something acts all the same."""

    @property
    def time_s(self) -> Array:
        """(n,)."""
        return self.context.state.time_s

    @property
    def only_answers(self) -> bool:
        """Whether rotor speeds mostly answer noise, as in a flight that only hovers (``delays[0]`` is theirs)."""
        return bool(self.delays) and self.delays[0].correlation < COMMANDED

    @property
    def seconds(self) -> float:
        """Time that was judged."""
        return float(self.valid.sum() * self.step_s)


def build_record(
    log: FlightLog,
    vehicle: Vehicle,
    model: FanSurrogate | None,
    effects: tuple[AdoptedEffect, ...] = (),
    name: str = "",
) -> Record:
    """The residual of one flight. Raises LogError in one line where the log lacks what is needed."""
    imu = _imu(log)
    log, stuck = without_stuck_beams(log)
    assert log.attitude is not None
    start = max(imu.specific_force.t_s[0], log.attitude.t_s[0])
    end = min(imu.specific_force.t_s[-1], log.attitude.t_s[-1])
    if end - start < SHORTEST_S:
        raise LogError(
            f"{log.path}: only {max(end - start, 0.0):.0f} s with IMU and attitude; record {ENOUGH_S:.0f} s at least"
        )
    notes: list[str] = []
    rate = min(imu.specific_force.rate_hz, 100.0)
    if rate < FORCE_RATE_HZ:
        raise LogError(
            f"{log.path}: {imu.source} at {rate:.1f} Hz is too slow for forces; ask for {FORCE_RATE_HZ:.0f} Hz or more"
        )
    grid = Grid(start, end, rate, min(CUT_OFF_HZ, rate / 4.0))
    t = grid.t
    force = imu.specific_force.at(t, MAX_GAP_S)
    gyro_series = imu.gyro if len(imu.gyro) and np.isfinite(imu.gyro.values).any() else log.rates
    gyro = gyro_series.at(t, MAX_GAP_S) if gyro_series is not None else np.full((len(t), 3), np.nan)
    axes = list(range(6))
    gyro_rate = 0.0 if gyro_series is None else gyro_series.rate_hz
    if gyro_rate < MOMENT_RATE_HZ:
        axes = [0, 1, 2]
        notes.append(f"gyro at {gyro_rate:.0f} Hz: too slow for moments ({MOMENT_RATE_HZ:.0f} Hz needed), forces only")
    elif vehicle.throttle is not None and equal_outputs(log, vehicle):
        axes = [0, 1, 2]
        notes.append("all servo outputs are copies of one number: moments cannot be judged, forces only")
    rotation = rotation_from_quaternion(_unit(log.attitude.at(t, MAX_GAP_S)))
    position = log.position.at(t, 1.0) if log.position is not None else np.full((len(t), 3), np.nan)
    velocity = log.velocity.at(t, 1.0) if log.velocity is not None else np.full((len(t), 3), np.nan)
    state = raw_state(log, vehicle, t, force, gyro, rotation, position, velocity)
    context = Context(state, vehicle, model)
    rpm_delay = rotor_delay(context, grid)
    delays = [rpm_delay]
    range_delay = range_delay_of(log, vehicle, t, rotation, velocity, position)
    if range_delay is not None:
        delays.append(range_delay)
    state = replace(
        state,
        **rotor_columns(log, vehicle, t, rpm_delay.seconds if rpm_delay.corrected else 0.0),
        **distances(
            log, vehicle, t, rotation, position,
            range_delay.seconds if range_delay is not None and range_delay.corrected else 0.0,
        ),
    )  # fmt: skip
    notes += unseen_surfaces(log, vehicle)
    state = corrected_state(effects, state)
    context = Context(state, vehicle, model)
    with_rpm = replace(state, rpm=context.rotor_rpm)
    servo_filled = replace(
        with_rpm, servo_us=np.where(np.isfinite(state.servo_us), state.servo_us, neutral_servos(vehicle))
    )
    modelled = modelled_wrench(vehicle, model, servo_filled)
    if effects:
        modelled = modelled + adopted_wrench(effects, context)
    measured = measured_wrench(force, gyro, rate_of_change(gyro, grid.rate), vehicle.mass_kg, vehicle.inertia_kgm2)
    valid, excluded = judged_time(log, context, grid, force, modelled, notes, axes)
    doubts = doubted(log, context, grid, valid, axes)
    if (valid & doubts.left_out).any():
        reason = "after a crash"
        excluded.append(Excluded(reason, float((valid & doubts.left_out).sum() / grid.rate)))
    valid &= ~doubts.left_out
    axes = list(doubts.axes)
    residual = grid.smooth(np.where(valid[:, None], measured - modelled, np.nan))
    residual[:, [a for a in range(6) if a not in axes and a not in doubts.blind]] = 0.0
    kinematic = _kinematic_bias(force, rotation, velocity, grid)
    kinematic = grid.smooth(np.where(valid[:, None], kinematic, np.nan))
    faults = [*stuck, *doubts.faults]
    if derived_accelerometer(kinematic):
        faults.append(LogFault("ax_m_s2", "is derived from the velocity: it tells nothing that velocity does not"))
        kinematic[:] = np.nan
    small = decimated(state, grid)
    keep = np.isfinite(residual).all(axis=1) & grid.pick(valid)
    channels = named_channels(log, vehicle, small)
    record = Record(
        name=name or log.path.name,
        log=log,
        context=Context(
            small,
            vehicle,
            model,
            clock_moved_s=max(rpm_delay.seconds, 0.0) if rpm_delay.corrected else 0.0,
            only_answers=rpm_delay.correlation < COMMANDED,
        ),
        residual=residual,
        measured=grid.smooth(np.where(valid[:, None], measured, np.nan)),
        valid=keep,
        axes=tuple(axes),
        step_s=grid.every / grid.rate,
        kinematic_bias=kinematic,
        channels=channels,
        delays=tuple(delays),
        excluded=tuple(excluded),
        notes=tuple(notes),
        faults=tuple(faults),
        blind=doubts.blind,
    )
    if record.seconds < SHORTEST_S:
        raise too_short(record)
    return record


def too_short(record: Record) -> LogError:
    """What to say of a flight that does not last."""
    worst = max(record.excluded, key=lambda e: e.seconds).reason if record.excluded else "gaps"
    return LogError(
        f"{record.log.path}: only {record.seconds:.0f} s of flight can be judged (most time lost to: {worst}); "
        f"{ENOUGH_S:.0f} s are needed"
    )


def _imu(log: FlightLog) -> ImuRecord:
    if not log.imus:
        raise LogError(f"{log.path}: no HIGHRES_IMU, RAW_IMU or SCALED_IMU: a log without accelerometer tells no force")
    if log.attitude is None:
        raise LogError(f"{log.path}: no ATTITUDE or ATTITUDE_QUATERNION; stream one of them")
    return max(log.imus, key=lambda i: (i.specific_force.rate_hz >= FORCE_RATE_HZ, i is log.imus[0]))


def _unit(q: Array) -> Array:
    with np.errstate(invalid="ignore"):
        unit: Array = q / np.linalg.norm(q, axis=1, keepdims=True)
    return unit


def _kinematic_bias(force: Array, rotation: Array, velocity: Array, grid: Grid) -> Array:
    if not np.isfinite(velocity).any():
        return np.full_like(force, np.nan)
    accel = rate_of_change(velocity, grid.rate)
    accel[:, 2] -= GRAVITY
    out: Array = force - np.einsum("nji,nj->ni", rotation, accel)
    return out


def check_model(vehicle: Vehicle, model: FanSurrogate | None) -> None:
    """ConfigError where the empty model is asked of a vehicle file without ``ct``."""
    if model is None and vehicle.telemetered and any(f.ct is None for f in vehicle.fans):
        raise ConfigError("vehicle file: key 'fan.ct' is missing, and --model none has no free-air rows to replace it")
