"""Demanded lift and moments to servo outputs, from the vehicle file's own geometry."""

from __future__ import annotations

import numpy as np

from companion.sim.body import (
    ARDUPILOT_MOTOR,
    VANE_LIMIT_RAD,
    MotorOutput,
    channel_of,
    clipped,
    pulses,
)
from models.common.errors import ConfigError
from models.common.frames import GRAVITY, Array
from models.vehicle import Vehicle

SPIN_ARM = 0.10
"""Output of an idle motor: ArduPilot's MOT_SPIN_ARM."""


class Mixer:
    """Least-effort allocation onto fans (throttle) and vanes (deflection).

    The autopilot knows its nominal vehicle only: full throttle lifts weight / hover_thrust, and a vane works in the
    stream of a hovering fan.
    """

    def __init__(
        self, vehicle: Vehicle, hover: float, motor: MotorOutput = ARDUPILOT_MOTOR
    ) -> None:
        fans = vehicle.fans
        vanes = vehicle.vanes
        full = effectiveness(vehicle)
        if np.linalg.matrix_rank(full, tol=1e-3) < 4:
            raise ConfigError(
                "vehicle file: fans and vanes cannot hold roll, pitch and yaw; give each "
                "single-rotor 'fan' its 'ct' and 'cq', or add a 'vane'"
            )
        # (actuators, 3): share of hover lift, or of vane travel, per N m.
        rows = np.linalg.pinv(full)[:, 1:].tolist()
        self._fan_rows = rows[: len(fans)]
        self._vane_rows = rows[len(fans) :]
        self._hover = hover
        self._motor = motor
        self._fans = [list(map(channel_of, fan.rotors)) for fan in fans]
        self._vanes = []
        for v in vanes:
            travel_us = VANE_LIMIT_RAD / v.rad_per_us if v.rad_per_us else 0.0
            self._vanes.append((v.servo - 1, v.neutral_us, travel_us))
        self._low, self._span = pulses(vehicle)
        self.pwm = [0.0] * 16
        self.saturated = False
        self.stop()

    def stop(self) -> None:
        """Disarmed: motors off, vanes neutral."""
        self._write_fans([0.0] * len(self._fans))
        for channel, neutral, _ in self._vanes:
            self.pwm[channel] = neutral

    def idle(self) -> None:
        """Armed on the ground without demand."""
        self.stop()
        self._write_fans([SPIN_ARM] * len(self._fans))

    def drive(self, throttle: float, roll: float, pitch: float, yaw: float) -> None:
        """Set the outputs for a mean throttle 0...1 and moments [N m]."""
        parts = [self._hover * (a * roll + b * pitch + c * yaw) for a, b, c in self._fan_rows]
        # Moments come first: the mean throttle gives way so that no fan leaves 0...1.
        low = min(parts)
        high = max(parts)
        if high - low < 1.0:
            throttle = min(max(throttle, -low), 1.0 - high)
        else:
            throttle = 0.5
        self._write_fans([self._motor.output(throttle + part) for part in parts])
        self.saturated = False
        for (channel, neutral, travel), (a, b, c) in zip(self._vanes, self._vane_rows, strict=True):
            share = a * roll + b * pitch + c * yaw
            if abs(share) > 1.0:
                self.saturated = True
                share = clipped(share, 1.0)
            self.pwm[channel] = round(neutral + share * travel)

    def _write_fans(self, actuators: list[float]) -> None:
        for channels, actuator in zip(self._fans, actuators, strict=True):
            for channel in channels:
                self.pwm[channel] = round(self._low + self._span * actuator)


def effectiveness(vehicle: Vehicle) -> Array:
    """Lift [N] and moments [N m] of full hover lift of each fan and full travel of each vane: shape (4, actuators)."""
    lift_each = vehicle.mass_kg * GRAVITY / len(vehicle.fans)
    columns = []
    scale = [lift_each] * len(vehicle.fans)
    for fan in vehicle.fans:
        x, y, _ = fan.position_m
        spin = sum(r.spin for r in fan.rotors) / len(fan.rotors)
        torque = 0.0
        if fan.cq and fan.ct:
            torque = -spin * vehicle.rotor_radius_m * fan.cq / fan.ct
        columns.append((1.0, -y, x, torque))
    for vane in vehicle.vanes:
        columns.append((0.0, *np.cross(vane.position_m, vane.axis)))
        scale.append(vane.force_per_thrust_rad * lift_each * VANE_LIMIT_RAD)  # at the end of travel
    out: Array = np.array(columns).T * np.array(scale)
    return out
