"""Measured minus modelled wrench of a flight on one clock: delays first, one filter for both, bad time left out."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from models.air_state import AirState
from models.common.errors import ConfigError, LogError
from models.common.frames import AXES, Array, measured_wrench
from models.effects import AdoptedEffect, Context, adopted_wrench, corrected_state
from models.surrogate.fan_surrogate import FanSurrogate
from models.vehicle import Vehicle
from models.vehicle_wrench import modelled_wrench
from replay.flightlog import FlightLog, LogFault, SourceChoice
from replay.identity import VehicleIdentity
from replay.residual.delays import Delay, commanded, range_delay_of, rotor_delay
from replay.residual.distances import distances, unseen_surfaces
from replay.residual.faults import Doubts, doubted, without_stuck_beams
from replay.residual.grid import Mask, rate_of_change
from replay.residual.held_down import DID_NOT_FLY
from replay.residual.hops import NOT_CLEAR
from replay.residual.log_state import (
    decimated,
    named_channels,
    neutral_servos,
    raw_state,
    rotor_columns,
    under_open_sky,
)
from replay.residual.motion import ENOUGH_S, SHORTEST_S, Trajectory, judged_axes, read_motion
from replay.residual.motion_faults import DERIVED_ACCELEROMETER, derived_accelerometer
from replay.residual.motor_failure import motor_faults
from replay.residual.reassigned import motors_reassigned
from replay.residual.rotor_faults import too_slow_to_fly
from replay.residual.unknown_distances import resolved
from replay.residual.validity import Airborne, Excluded, JudgedTime, airborne, judged_time


@dataclass(frozen=True, kw_only=True)
class Record:
    """One flight, ready to be searched: ``n`` rows on a uniform clock, smoothed alike.

    Examples
    --------
    >>> import replay
    >>> from models.vehicle import load_vehicle
    >>> (flight,) = replay.load("flight.tlog")
    >>> record = replay.build_record(flight, load_vehicle("my.toml"), model=None)
    >>> record.residual.shape == (len(record.time_s), 6), record.axes
    (True, (0, 1, 2, 3, 4, 5))
    """

    name: str
    """In texts."""
    path: Path
    """Of the log."""
    context: Context
    """State of the air and the vehicle, row by row: what effects look at."""
    residual: Array
    """(n, 6) measured minus modelled force and moment [N, N m], body FRD about the CG."""
    measured: Array
    """(n, 6) what the motion takes [N, N m]."""
    valid: Mask
    """(n,) rows that are judged."""
    axes: tuple[int, ...]
    """Axes that this log can judge: 0 to 2 forces, 3 to 5 moments."""
    step_s: float
    """Of the clock."""
    kinematic_bias: Array
    """(n, 3) accelerometer minus the specific force that velocity and attitude imply [m/s^2], body FRD."""
    channels: dict[str, Array]
    """Named quantities (n,), for plots and regressions."""
    delays: tuple[Delay, ...]
    """By how much rotor speeds and ranges are late."""
    excluded: tuple[Excluded, ...]
    """Time that is not judged, and why."""
    notes: tuple[str, ...] = field(default=())
    """For people, one sentence each."""
    faults: tuple[LogFault, ...] = field(default=())
    """What is wrong with the log or the vehicle file, and is named as no effect."""
    blind: tuple[int, ...] = ()
    """Axes that are not judged because of a fault, but on which something acts all the same."""
    sources: tuple[SourceChoice, ...] = ()
    """Which instance each quantity was read from."""
    identity: VehicleIdentity | None = None
    """Which vehicle flew, as far as its log says."""

    def __repr__(self) -> str:
        axes = " ".join(AXES[axis] for axis in self.axes)
        return f"Record({self.name!r}, {self.seconds:.1f} s judged, {axes})"

    @property
    def time_s(self) -> Array:
        """(n,) boot time of the autopilot [s]."""
        return self.context.state.time_s

    @property
    def seconds(self) -> float:
        """Time that was judged [s]."""
        return float(self.valid.sum() * self.step_s)


@dataclass(frozen=True, kw_only=True)
class Flown:
    """A flight at the raw rate of its log, ``n`` rows, before anything is smoothed."""

    log: FlightLog
    motion: Trajectory
    context: Context
    modelled: Array
    measured: Array
    """Wrenches (n, 6)."""
    air: Airborne
    time: JudgedTime
    """What of it can be judged."""
    doubts: Doubts
    """Axes that are judged, and faults that take some of them."""
    motors: tuple[LogFault, ...]
    """Motors that failed."""
    stuck: tuple[LogFault, ...]
    """Range sensors that repeat one reading."""
    delays: tuple[Delay, ...]
    notes: tuple[str, ...]


def fly_again(
    log: FlightLog,
    vehicle: Vehicle,
    model: FanSurrogate | None,
    effects: tuple[AdoptedEffect, ...] = (),
) -> Flown:
    """A log's motion, and the wrench that the model has for it, on one clock. Raises LogError in one line."""
    motion = read_motion(log, vehicle)
    log, stuck = without_stuck_beams(log)
    grid = motion.grid
    axes, notes = judged_axes(motion, vehicle)
    state, delays = _on_one_clock(log, vehicle, model, motion)
    state = corrected_state(effects, state)
    air = airborne(log, Context(state=state, vehicle=vehicle, model=model), motion)
    state, left_out, said = resolved(log, vehicle, grid, state, air.flying)
    context = Context(state=state, vehicle=vehicle, model=model)
    modelled = _modelled(context, effects)
    motors = motor_faults(log, context, motion, air.flying)
    begins_s = min((f.since_s for f in motors if f.since_s is not None), default=np.inf)
    failed = ("after a motor failed", grid.t >= begins_s - grid.smooth_s)
    reassigned = ("an output was taken from its motor", motors_reassigned(log, grid.t))
    left_out = [*left_out, reassigned, failed]
    time = judged_time(context, motion, modelled, air.flying, left_out)
    judged = [axis for axis in axes if axis not in time.unjudged_axes]
    doubts = doubted(log, context, motion, time.valid, judged)
    for why, when in doubts.left_out:
        time = time.without(why, when, grid.rate)
    return Flown(
        log=log,
        motion=motion,
        context=context,
        modelled=modelled,
        measured=_measured(motion, vehicle),
        air=air,
        time=time,
        doubts=doubts,
        motors=tuple(motors),
        stuck=tuple(stuck),
        delays=delays,
        notes=(*notes, *unseen_surfaces(log, vehicle), *said, *time.notes),
    )


def build_record(
    log: FlightLog,
    vehicle: Vehicle,
    model: FanSurrogate | None,
    effects: tuple[AdoptedEffect, ...] = (),
    name: str = "",
) -> Record:
    """The residual of one flight: measured minus modelled force and moment.

    Parameters
    ----------
    log : FlightLog
        One boot.
    vehicle : Vehicle
        What flew.
    model : FanSurrogate or None
        Of its fans. None: rotors in free air.
    effects : tuple of AdoptedEffect
        What acts besides.
    name : str
        In texts; the name of the file where empty.

    Returns
    -------
    Record
        Rows on one clock [N, N m], body FRD about the CG.

    Raises
    ------
    LogError
        The log lacks what is needed, or too little of it can be judged.
    ConfigError
        ``vehicle`` is no vehicle.

    Examples
    --------
    >>> import replay
    >>> from models.vehicle import load_vehicle
    >>> (flight,) = replay.load("flight.tlog")
    >>> record = replay.build_record(flight, load_vehicle("my.toml"), model=None)
    >>> push = record.residual[record.valid].mean(axis=0)
    >>> float(push[2].round(0))  # a load of 0.6 kg that the file does not know [N, down]
    6.0
    """
    if not isinstance(vehicle, Vehicle):
        raise ConfigError(
            f"build_record: vehicle is a {type(vehicle).__name__}; give load_vehicle(FILE)"
        )
    flown = fly_again(log, vehicle, model, effects)
    record = _smoothed(flown, name or log.path.name)
    if record.seconds < SHORTEST_S:
        raise _why_short(record, flown)
    return record


def _smoothed(flown: Flown, name: str) -> Record:
    """A flight, smoothed and at the rate of records; residuals of axes that are not seen are 0."""
    motion = flown.motion
    grid = motion.grid
    doubts = flown.doubts
    residual = _smoothed_where_judged(flown, flown.measured - flown.modelled)
    seen = np.isin(np.arange(6), (*doubts.axes, *doubts.blind))
    residual[:, ~seen] = 0.0
    valid = np.isfinite(residual).all(axis=1) & flown.time.valid[:: grid.every]
    kinematic_bias = _smoothed_where_judged(flown, motion.kinematic_bias)
    faults = (*flown.motors, *flown.stuck, *doubts.faults)
    derived = derived_accelerometer(motion, flown.time.valid)
    if derived:
        kinematic_bias = np.full_like(kinematic_bias, np.nan)
        faults = (*faults, DERIVED_ACCELEROMETER)
    context = _smoothed_context(flown, valid, accelerometer=not derived)
    return Record(
        name=name,
        path=flown.log.path,
        context=context,
        residual=residual,
        measured=_smoothed_where_judged(flown, flown.measured),
        valid=valid,
        axes=doubts.axes,
        step_s=grid.every / grid.rate,
        kinematic_bias=kinematic_bias,
        channels=named_channels(context.vehicle, context.state),
        delays=flown.delays,
        excluded=flown.time.excluded,
        notes=flown.notes,
        faults=faults,
        blind=doubts.blind,
        sources=flown.log.sources,
    )


def _smoothed_where_judged(flown: Flown, x: Array) -> Array:
    judged = flown.time.valid[:, None]
    return flown.motion.grid.smooth(np.where(judged, x, np.nan))


def _smoothed_context(flown: Flown, valid: Mask, *, accelerometer: bool) -> Context:
    """The context at the rate of records, with what was found out about the flight."""
    grid = flown.motion.grid
    state = decimated(flown.context.state, grid)
    rotors = flown.delays[0]
    seconds = float(valid.sum() * grid.every / grid.rate)
    judged_s = None
    if valid.any():
        time_s = state.time_s[valid]
        judged_s = float(time_s[0]), float(time_s[-1])
    return Context(
        state=state,
        vehicle=flown.context.vehicle,
        model=flown.context.model,
        clock_moved_s=max(rotors.correction_s, 0.0),
        commanded=commanded(rotors, seconds),
        accelerometer=accelerometer,
        open_sky=under_open_sky(flown.log),
        smoothed_s=grid.spread_s,
        judged_s=judged_s,
    )


def _on_one_clock(
    log: FlightLog, vehicle: Vehicle, model: FanSurrogate | None, motion: Trajectory
) -> tuple[AirState, tuple[Delay, ...]]:
    """The flight at the raw rate with the delays of rotor speeds and ranges taken out, and those delays, rotors first.

    The rotors' delay is found without distances: near a surface lift changes too slowly to move it.
    """
    t = motion.grid.t
    rotation = motion.rotation
    state = raw_state(log, vehicle, motion)
    rotors = rotor_delay(Context(state=state, vehicle=vehicle, model=model), motion.grid)
    ranges = range_delay_of(log, vehicle, t, rotation, motion.velocity, motion.position)
    if ranges is None:
        range_late_s = 0.0
    else:
        range_late_s = ranges.correction_s
    state = replace(
        state,
        **rotor_columns(log, vehicle, t, rotors.correction_s),
        **distances(log, vehicle, t, rotation, motion.position, range_late_s),
    )
    return state, (rotors,) if ranges is None else (rotors, ranges)


def _modelled(context: Context, effects: tuple[AdoptedEffect, ...]) -> Array:
    """Modelled wrench (n, 6). A vane whose output is not in the log is taken to be straight."""
    state = replace(context.state, rpm=context.rotor_rpm)
    straight = np.where(
        np.isfinite(state.servo_us), state.servo_us, neutral_servos(context.vehicle)
    )
    out = modelled_wrench(context.vehicle, context.model, replace(state, servo_us=straight))
    if effects:
        return out + adopted_wrench(effects, context)
    return out


def _measured(motion: Trajectory, vehicle: Vehicle) -> Array:
    """Measured wrench (n, 6): what the motion takes, by the vehicle's mass and inertia."""
    return measured_wrench(
        motion.force,
        motion.gyro,
        rate_of_change(motion.gyro, motion.grid.rate),
        vehicle.mass_kg,
        vehicle.inertia_kgm2,
    )


def _why_short(record: Record, flown: Flown) -> LogError:
    """Why too little of a log can be judged: it did not fly, or most of it is lost."""
    path = flown.log.path
    if flown.air.never:
        return LogError(f"{path}: {DID_NOT_FLY}")
    if flown.air.hops:
        return LogError(f"{path}: {NOT_CLEAR}")
    if not flown.air.flying.any():
        slow = too_slow_to_fly(flown.log, flown.context, flown.motion)
        if slow is not None:
            return LogError(f"{path}: {slow}")
    return too_short(record)


def too_short(record: Record) -> LogError:
    """What to say of a flight that does not last."""
    lost = max(record.excluded, key=lambda e: e.seconds, default=None)
    if lost:
        why = f" (most time lost to: {lost.reason})"
    else:
        why = ""
    # Rounded down: 7.8 s are not the 8 s that are needed.
    seconds = math.floor(10.0 * record.seconds) / 10.0
    short = (
        f"{record.path}: only {seconds:g} s of flight can be judged{why}; {ENOUGH_S:.0f} s are "
        "needed"
    )
    failed = "".join(f"; {fault.what}" for fault in record.faults if fault.motors)
    return LogError(short + failed)


def check_model(vehicle: Vehicle, model: FanSurrogate | None) -> None:
    """ConfigError where the empty model is asked of a vehicle file without ``ct``."""
    if model is None and vehicle.telemetered and any(f.ct is None for f in vehicle.fans):
        raise ConfigError(
            "vehicle file: key 'fan.ct' is missing, and --model none has no free-air rows to "
            "replace it"
        )
