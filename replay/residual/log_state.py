"""A recorded flight as an ``AirState`` on the grid: at the raw rate, and smoothed at the record's rate."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import fields, replace

import numpy as np

from models.air_state import DIRECTIONS, AirState, blank_state
from models.common.errors import LogError
from models.common.frames import Array, euler_angles
from models.vehicle import Vehicle
from replay.flightlog import EscRecord, FlightLog
from replay.logs.names import called
from replay.residual.distances import MAX_GAP_S
from replay.residual.grid import Grid
from replay.residual.motion import Trajectory, sampled

DISTANCES = ("ranges_m", "h_m", "d_m", "second_d_m", "ceiling_m")
"""Columns of ``AirState`` that are infinite where nothing is seen."""
_ALONE = (
    "thrust_command",
    "battery_voltage_v",
    "battery_current_a",
    "esc_temperature_c",
    "pressure_pa",
    "air_temperature_c",
)
"""Columns that are channels by the same name."""

_FIX_IN_SPACE = 3
"""GPS_FIX_TYPE from which the satellites give height, too."""


def rotor_columns(log: FlightLog, vehicle: Vehicle, t: Array, late_s: float) -> dict[str, Array]:
    """``rpm`` (n, rotors) and ``servo_us`` (n, 16) of ``AirState``, taken ``late_s`` later than stamped."""
    rpm = np.full((len(t), len(vehicle.rotors)), np.nan)
    for k, rotor in enumerate(vehicle.rotors):
        if rotor.esc is not None:
            esc = log.escs.get(rotor.esc)
        else:
            esc = None
        if esc is not None and esc.rpm is not None:
            rpm[:, k] = esc.rpm.at(t + late_s, MAX_GAP_S)[:, 0]
    servo = np.full((len(t), 16), np.nan)
    if log.servo is not None:
        late = (
            late_s if not vehicle.telemetered else 0.0
        )  # vanes share the clock of the outputs, not of the ESCs
        columns = min(16, log.servo.values.shape[1])
        servo[:, :columns] = log.servo.at(t + late, MAX_GAP_S)[:, :columns]
        servo[servo == 0.0] = np.nan
    return {"rpm": rpm, "servo_us": servo}


def raw_state(log: FlightLog, vehicle: Vehicle, motion: Trajectory) -> AirState:
    """The flight at the raw rate (n rows), without distances. LogError where rotor speeds or outputs are missing."""
    t = motion.grid.t
    if vehicle.telemetered:
        known = {number for number, esc in log.escs.items() if esc.rpm is not None}
        lacking = ", ".join(str(r.esc) for r in vehicle.rotors if r.esc not in known)
        if lacking:
            raise LogError(
                f"{log.path}: no rotor speed of ESC {lacking} "
                f"({called(log.path, 'rotor speeds')}); log it, or declare [throttle] and servo "
                "outputs in the vehicle file"
            )
    elif log.servo is None:
        outputs = called(log.path, "outputs")
        raise LogError(
            f"{log.path}: no {outputs}, and the vehicle file declares thrust by servo outputs"
        )
    own = [log.escs[r.esc] for r in vehicle.rotors if r.esc is not None and r.esc in log.escs]
    temperatures = _temperatures(own, t) or _temperatures(log.escs.values(), t)
    battery = sampled(log.battery, 2, t, 10.0)
    pressure = sampled(log.pressure, 2, t, 10.0)
    return replace(
        blank_state((len(t),), len(vehicle.fans), len(vehicle.rotors)),
        time_s=t,
        position_ned=motion.position,
        velocity_ned=motion.velocity,
        rotation=motion.rotation,
        rates=motion.gyro,
        specific_force=motion.force,
        thrust_command=sampled(log.thrust_command, 1, t, 1.0)[:, 0],
        battery_voltage_v=battery[:, 0],
        battery_current_a=battery[:, 1],
        esc_temperature_c=np.mean(temperatures or [np.full(len(t), np.nan)], axis=0),
        pressure_pa=pressure[:, 0],
        air_temperature_c=pressure[:, 1],
        **rotor_columns(log, vehicle, t, 0.0),
    )


def _temperatures(escs: Iterable[EscRecord], t: Array) -> list[Array]:
    """Of the ESCs that tell one, (n,) each."""
    return [e.temperature_c.at(t, 5.0)[:, 0] for e in escs if e.temperature_c is not None]


def neutral_servos(vehicle: Vehicle) -> Array:
    """Outputs (16,) [us] at which every vane is straight; NaN for the others."""
    out = np.full(16, np.nan)
    for vane in vehicle.vanes:
        out[vane.servo - 1] = vane.neutral_us
    return out


def decimated(state: AirState, grid: Grid) -> AirState:
    """The state at the record's rate: smooth quantities smoothed, distances with their infinities kept."""

    def at_rate(name: str, x: Array) -> Array:
        if name == "time_s" or name.endswith("_bearing_rad"):
            return x[:: grid.every]
        if name not in DISTANCES:
            return grid.smooth(x)
        smooth = grid.smooth(np.where(np.isfinite(x), x, np.nan))
        picked = x[:: grid.every]
        return np.asarray(np.where(np.isfinite(picked) & np.isfinite(smooth), smooth, picked))

    return AirState(**{f.name: at_rate(f.name, getattr(state, f.name)) for f in fields(state)})


def named_channels(vehicle: Vehicle, state: AirState) -> dict[str, Array]:
    """What the flexible search may look at, by the channel names of docs/formats.md."""
    roll, pitch, yaw = euler_angles(state.rotation)
    out = {"time_s": state.time_s, "roll_rad": roll, "pitch_rad": pitch, "yaw_rad": yaw}
    names: dict[str, Sequence[str]] = {
        "position_ned": ("north_m", "east_m", "down_m"),
        "velocity_ned": ("vn_m_s", "ve_m_s", "vd_m_s"),
        "rates": ("p_rad_s", "q_rad_s", "r_rad_s"),
        "specific_force": ("ax_m_s2", "ay_m_s2", "az_m_s2"),
        "ranges_m": [f"range_{name}_m" for name in DIRECTIONS],
        "rpm": [f"rpm_{rotor.esc or k}" for k, rotor in enumerate(vehicle.rotors, 1)],
        "servo_us": [f"servo_{k}" for k in range(1, 17)],
    }
    for field, columns in names.items():
        out |= dict(zip(columns, getattr(state, field).T, strict=True))
    out |= {name: getattr(state, name) for name in _ALONE}
    return {name: values for name, values in out.items() if np.isfinite(values).mean() > 0.3}


def under_open_sky(log: FlightLog) -> bool:
    """Whether satellites gave a place in space most of the time."""
    if log.gps_fix is None:
        return False
    return bool(np.median(log.gps_fix.values) >= _FIX_IN_SPACE)
