"""The estimates of one instant as the record that adopted effects look at (models/air_state.py)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from companion.estimation.estimator import Estimates, FanQuery, Seen, Surface
from models.air_state import DIRECTIONS, AirState, blank_state
from models.frames import Array
from models.vehicle import Vehicle

_LEVEL_BEAMS = {
    "down": (0.0, 0.0, 1.0), "up": (0.0, 0.0, -1.0), "forward": (1.0, 0.0, 0.0),
    "right": (0.0, 1.0, 0.0), "back": (-1.0, 0.0, 0.0), "left": (0.0, -1.0, 0.0),
}  # fmt: skip


def air_state(
    estimates: Estimates,
    vehicle: Vehicle,
    query: FanQuery,
    ceiling: Surface,
    rotor_rpm: Array,
    t_s: float,
    lead_s: float = 0.0,
) -> AirState:
    """An ``AirState`` of leading shape (): what was not measured is NaN, what is not there is inf.

    The ceiling is where its track has it ``lead_s`` ahead, as the query's distances are.
    """
    state = blank_state((), len(vehicle.fans), len(vehicle.rotors))
    rotation = estimates.rotation if estimates.rotation is not None else state.rotation
    changes: dict[str, Array] = {
        "time_s": np.asarray(t_s),
        "rotation": rotation,
        "h_m": query.h_m,
        "d_m": query.d_m,
        "wall_bearing_rad": np.asarray(query.wall_bearing_rad),
        "ceiling_m": _fan_ceilings(vehicle, ceiling, rotation, lead_s),
        "rpm": rotor_rpm,
        "ranges_m": _ranges(estimates, rotation),
    }
    if estimates.position is not None:
        changes["position_ned"] = np.asarray(estimates.position.position_ned)
        changes["velocity_ned"] = np.asarray(estimates.position.velocity_ned)
    if estimates.attitude is not None:
        changes["rates"] = np.asarray(estimates.attitude.rates_frd)
    if estimates.servo is not None:
        changes["servo_us"] = np.asarray(estimates.servo.pwm_us, dtype=float)
    if estimates.battery is not None:
        changes["battery_voltage_v"] = np.asarray(estimates.battery.voltage_v)
        changes["battery_current_a"] = np.asarray(estimates.battery.current_a)
    if estimates.pressure is not None:
        changes["pressure_pa"] = np.asarray(estimates.pressure.pressure_pa)
        changes["air_temperature_c"] = np.asarray(estimates.pressure.temperature_c)
    if estimates.esc_temperature_c is not None:
        changes["esc_temperature_c"] = np.asarray(estimates.esc_temperature_c)
    # The specific force that a steady vehicle feels: the accelerometer's own noise must not become a command.
    changes["specific_force"] = -9.80665 * rotation[2]
    return replace(state, **changes)


def _fan_ceilings(vehicle: Vehicle, ceiling: Surface, rotation: Array, lead_s: float) -> Array:
    if ceiling.seen is not Seen.SURFACE:
        return np.full(len(vehicle.fans), np.inf if ceiling.known else np.nan)
    above = np.array([float(rotation[2] @ np.asarray(fan.position_m)) for fan in vehicle.fans])
    return np.maximum(ceiling.distance_m + ceiling.rate_m_s * lead_s + above, 0.0)


def _ranges(estimates: Estimates, rotation: Array) -> Array:
    """Distance of the CG to what each direction's beam sees, by ``DIRECTIONS``; inf where nothing is tracked."""
    out = np.full(len(DIRECTIONS), np.inf)
    for beam in estimates.beams:
        if beam.track is None or beam.normal_ned is None:
            continue
        toward = beam.normal_ned @ rotation
        nearest = max(range(len(DIRECTIONS)), key=lambda i: float(np.dot(toward, _LEVEL_BEAMS[DIRECTIONS[i]])))
        out[nearest] = min(out[nearest], beam.track.value)
    return out
