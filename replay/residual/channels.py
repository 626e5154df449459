"""Everything that was logged, by the channel names of the JSON answer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from models.air_state import DIRECTIONS, AirState
from models.frames import Array
from models.vehicle import Vehicle

_ALONE = (
    "thrust_command", "battery_voltage_v", "battery_current_a", "esc_temperature_c", "pressure_pa", "air_temperature_c",
)  # fmt: skip


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
    names: dict[str, Sequence[str]] = {
        "position_ned": ("north_m", "east_m", "down_m"),
        "velocity_ned": ("vn_m_s", "ve_m_s", "vd_m_s"),
        "rates": ("p_rad_s", "q_rad_s", "r_rad_s"),
        "specific_force": ("ax_m_s2", "ay_m_s2", "az_m_s2"),
        "ranges_m": [f"range_{name}_m" for name in DIRECTIONS],
        "rpm": [f"rpm_{k if rotor.esc is None else rotor.esc}" for k, rotor in enumerate(vehicle.rotors, 1)],
        "servo_us": [f"servo_{k}" for k in range(1, 17)],
    }
    for field, columns in names.items():
        out |= dict(zip(columns, getattr(state, field).T, strict=True))
    out |= {name: getattr(state, name) for name in _ALONE}
    return {name: values for name, values in out.items() if np.isfinite(values).mean() > 0.3}
