"""Everything that was logged, by the channel names of the JSON answer."""

from __future__ import annotations

import numpy as np

from models.air_state import DIRECTIONS, AirState
from models.frames import Array
from models.vehicle import Vehicle


def named_channels(vehicle: Vehicle, state: AirState) -> dict[str, Array]:
    """What the flexible search may look at, by the channel names of docs/formats.md."""
    r = state.rotation
    with np.errstate(invalid="ignore"):
        out = {
            "time_s": state.time_s,
            "roll_rad": np.arctan2(r[:, 2, 1], r[:, 2, 2]),
            "pitch_rad": -np.arcsin(np.clip(r[:, 2, 0], -1.0, 1.0)),
            "yaw_rad": np.arctan2(r[:, 1, 0], r[:, 0, 0]),
        }
    for names, values in (
        (("north_m", "east_m", "down_m"), state.position_ned),
        (("vn_m_s", "ve_m_s", "vd_m_s"), state.velocity_ned),
        (("p_rad_s", "q_rad_s", "r_rad_s"), state.rates),
        (("ax_m_s2", "ay_m_s2", "az_m_s2"), state.specific_force),
    ):
        out |= {name: values[:, i] for i, name in enumerate(names)}
    out |= {f"range_{name}_m": state.ranges_m[:, i] for i, name in enumerate(DIRECTIONS)}
    out |= {
        f"rpm_{k + 1 if rotor.esc is None else rotor.esc}": state.rpm[:, k] for k, rotor in enumerate(vehicle.rotors)
    }
    out |= {f"servo_{k + 1}": state.servo_us[:, k] for k in range(16)}
    out |= {
        "thrust_command": state.thrust_command,
        "battery_voltage_v": state.battery_voltage_v,
        "battery_current_a": state.battery_current_a,
        "esc_temperature_c": state.esc_temperature_c,
        "pressure_pa": state.pressure_pa,
        "air_temperature_c": state.air_temperature_c,
    }
    return {name: values for name, values in out.items() if np.isfinite(values).mean() > 0.3}
