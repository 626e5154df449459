"""The autopilot: position, velocity, attitude (on SO(3): Lee, Leok & McClamroch 2010) and rate loops, and a mixer."""

from __future__ import annotations

import numpy as np

from .airframes import Airframe, Array, G
from .power import calibrated, motor_constant

MAX_TILT = np.tan(np.radians(28.0))


def motor_tau(frame: Airframe, slow: Array) -> Array:
    """Time constant of the rotors' speed about hover [s] (n,)."""
    k = motor_constant(frame)
    return (
        frame.rotor_inertia
        * slow
        / (k * k / frame.motor_ohm + 2.0 * frame.hover_torque / frame.hover_speed)
    )


class Autopilot:
    """State and gains of several autopilots side by side; ``step`` gives output shares (rotors, n)."""

    def __init__(self, frame: Airframe, slow: Array, dt: float) -> None:
        n = len(slow)
        self.frame, self.dt, self.curve = frame, dt, calibrated(frame)
        self.rate_gain = np.minimum(18.0, 0.45 / motor_tau(frame, slow))
        # Loops around slow motors are kept further apart.
        apart = 1.0 + 0.08 * (slow - 1.0)
        self.tilt_gain = self.rate_gain / (2.4 * apart)
        # Up and down needs no tilt, and is held more tightly.
        level = np.minimum(3.2, self.tilt_gain / (1.9 * apart))
        self.speed_gain = np.stack([level, level, 1.5 * level])
        self.place_gain = self.speed_gain / (2.1 * apart)
        self.push = np.zeros((3, n))
        self.twist = np.zeros((3, n))
        rows = [np.ones(frame.count)]
        x, y, _ = np.array(frame.arms).T
        rows += [-y, x, -np.array(frame.spin) * frame.hover_torque / frame.hover_thrust]
        self.mix = np.linalg.pinv(np.array(rows))
        self.inertia = np.array(frame.inertia)[:, None]

    def step(
        self,
        R: Array,
        position: Array,
        velocity: Array,
        rates: Array,
        to: Array,
        to_velocity: Array,
        yaw: Array,
    ) -> Array:
        """One control cycle: ``R`` (3, 3, n) body to NED, the rest (3, n); ``yaw`` (n,)."""
        frame, dt = self.frame, self.dt
        late = to_velocity + self.place_gain * np.clip(to - position, -1.5, 1.5) - velocity
        self.push = np.clip(self.push + dt * 0.35 * self.speed_gain**2 * late, -4.0, 4.0)
        force = self.speed_gain * late + self.push
        force[2] -= G
        level = np.sqrt(force[0] ** 2 + force[1] ** 2)
        upward = np.maximum(-force[2], 0.4 * G)
        keep = np.minimum(1.0, MAX_TILT * upward / np.maximum(level, 1e-9))
        force = np.stack([force[0] * keep, force[1] * keep, -upward])
        wanted = self._attitude(force, yaw)
        turn = np.einsum("jkn,jln->kln", wanted, R)
        error = 0.5 * np.stack(
            [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
        )
        scale = np.array([1.0, 1.0, 0.5])[:, None]
        miss = -self.tilt_gain * scale * error - rates
        self.twist = np.clip(self.twist + dt * 0.25 * self.rate_gain**2 * scale * miss, -60.0, 60.0)
        moment = self.inertia * (self.rate_gain * scale * miss + self.twist)
        thrust = frame.mass_kg * np.maximum(-(force * R[:, 2]).sum(axis=0), 0.2 * G)
        moment[2] = np.clip(moment[2], -0.05 * thrust * frame.arm_m, 0.05 * thrust * frame.arm_m)
        share = self.mix @ np.concatenate([thrust[None], moment])
        return self.curve.output(share)

    @staticmethod
    def _attitude(force: Array, yaw: Array) -> Array:
        """Rotation (3, 3, n) whose -z axis is along ``force`` and whose nose is at ``yaw``."""
        z = -force / np.sqrt((force**2).sum(axis=0))
        c, s = np.cos(yaw), np.sin(yaw)
        y = np.stack([-s * z[2], c * z[2], s * z[0] - c * z[1]])
        y = y / np.sqrt((y**2).sum(axis=0))
        x = np.stack(
            [y[1] * z[2] - y[2] * z[1], y[2] * z[0] - y[0] * z[2], y[0] * z[1] - y[1] * z[0]]
        )
        return np.stack([x, y, z], axis=1)
