"""The estimates of one instant as the record that adopted effects look at (models/air_state.py)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from companion.config import PipelineConfig
from companion.disturbance.fan_query import FanQuery, lips_to_wall
from companion.estimation.estimates import Estimates
from companion.estimation.range_geometry import fan_ceilings
from companion.estimation.surfaces import Seen, Surface, walls
from models.air_state import AirState, blank_state
from models.common.frames import GRAVITY, LEVEL, Array


def air_state(
    estimates: Estimates,
    config: PipelineConfig,
    query: FanQuery,
    ceiling: Surface,
    rotor_rpm: Sequence[float],
    t_s: float,
    lead_s: float = 0.0,
) -> AirState:
    """An ``AirState`` of leading shape (): what was not measured is NaN, what is not there is inf.

    The ceiling is where its track has it ``lead_s`` ahead, as the query's distances are.
    """
    vehicle = config.vehicle
    state = blank_state((), len(vehicle.fans), len(vehicle.rotors))
    if estimates.rows is None:
        rows = LEVEL
    else:
        rows = estimates.rows
    rotation = np.array(rows)
    second_d, second_bearing = lips_to_wall(vehicle, walls(estimates, config, t_s)[1], rows, lead_s)
    changes: dict[str, Array] = {
        "time_s": np.asarray(t_s),
        "rotation": rotation,
        "h_m": np.array(query.h_m),
        "d_m": np.array(query.d_m),
        "wall_bearing_rad": np.asarray(query.wall_bearing_rad),
        "second_d_m": np.array(second_d),
        "second_bearing_rad": np.asarray(second_bearing),
        "ceiling_m": fan_ceilings(vehicle, _ahead(ceiling, lead_s), rotation),
        "rpm": np.array(rotor_rpm),
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
    changes["specific_force"] = -GRAVITY * rotation[2]
    return replace(state, **changes)


def _ahead(seen: Surface, lead_s: float) -> float:
    if seen.seen is Seen.SURFACE:
        return seen.distance_m + seen.rate_m_s * lead_s
    if seen.known:
        return math.inf
    return math.nan
