"""What the air may depend on: one frozen record of measured quantities, scalar in flight, columns in replay."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from models.common.frames import GRAVITY, Array

DIRECTIONS = ("down", "up", "forward", "right", "back", "left")


@dataclass(frozen=True, kw_only=True)
class AirState:
    """One instant (leading shape ``()``) or a record (leading shape ``(n,)``) of a flight; SI units.

    Every array shares the leading shape ``(...)``. NaN means unknown, ``inf`` in a distance means nothing is there.
    World NED, body FRD. ``h_m`` and ``d_m`` are per fan (reference point to ground, outer lip to wall), filtered,
    tilt-corrected; ``second_d_m`` and ``second_bearing_rad`` the same of the nearest wall at another bearing.
    ``ranges_m`` are the raw beams by direction (``DIRECTIONS``), slant and from the sensor. A record has them as
    channels; in flight they are NaN. No shipped effect reads them: use the distances.
    """

    time_s: Array  # (...)
    position_ned: Array  # (..., 3)
    velocity_ned: Array  # (..., 3)
    rotation: Array  # (..., 3, 3) FRD -> NED
    rates: Array  # (..., 3) rad/s
    specific_force: Array  # (..., 3) m/s^2, at the CG
    ranges_m: Array  # (..., 6)
    h_m: Array  # (..., fans)
    d_m: Array  # (..., fans)
    wall_bearing_rad: Array  # (...), 0 where there is no wall
    second_d_m: Array  # (..., fans), inf where there is no second wall
    second_bearing_rad: Array  # (...), 0 where there is no second wall
    ceiling_m: Array  # (..., fans) rotor plane to ceiling, inf where none is seen
    rpm: Array  # (..., rotors), in the order of Vehicle.rotors
    servo_us: Array  # (..., 16)
    thrust_command: Array  # (...)
    battery_voltage_v: Array  # (...)
    battery_current_a: Array  # (...)
    esc_temperature_c: Array  # (...)
    pressure_pa: Array  # (...)
    air_temperature_c: Array  # (...)

    def __len__(self) -> int:
        return int(self.time_s.shape[0])

    @property
    def step_s(self) -> float:
        """Of a record: time between samples."""
        return float(np.median(np.diff(self.time_s)))

    def take(self, index: object) -> AirState:
        """The samples ``index`` (slice, mask or integers) of a record."""
        return replace(self, **{f.name: getattr(self, f.name)[index] for f in fields(self)})


def blank_state(shape: tuple[int, ...], fans: int, rotors: int) -> AirState:
    """A level, still state of leading ``shape`` in free air, with everything unmeasured NaN."""

    def full(value: float, *tail: int) -> Array:
        return np.full(shape + tail, value)

    return AirState(
        time_s=full(0.0),
        position_ned=full(0.0, 3),
        velocity_ned=full(0.0, 3),
        rotation=np.broadcast_to(np.eye(3), (*shape, 3, 3)).copy(),
        rates=full(0.0, 3),
        specific_force=np.broadcast_to(np.array([0.0, 0.0, -GRAVITY]), (*shape, 3)).copy(),
        ranges_m=full(np.nan, 6),
        h_m=full(np.inf, fans),
        d_m=full(np.inf, fans),
        wall_bearing_rad=full(0.0),
        second_d_m=full(np.inf, fans),
        second_bearing_rad=full(0.0),
        ceiling_m=full(np.inf, fans),
        rpm=full(np.nan, rotors),
        servo_us=full(np.nan, 16),
        thrust_command=full(np.nan),
        battery_voltage_v=full(np.nan),
        battery_current_a=full(np.nan),
        esc_temperature_c=full(np.nan),
        pressure_pa=full(np.nan),
        air_temperature_c=full(np.nan),
    )
