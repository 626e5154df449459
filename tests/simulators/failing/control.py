"""The autopilot: position, speed, attitude and rate in cascade, and a mixer that saturates as ArduPilot's does."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .craft import Array, Craft, G

LEAN_RAD = np.radians(32.0)
IDLE = 0.15
"""Command of a motor that is armed."""
CLIMB_M_S2 = 4.0
_NEXT = [1, 2, 0]
_LAST = [2, 0, 1]
"""Of every axis, the next one and the one after that."""


class Autopilot:
    """State of the loops of ``n`` flights side by side."""

    def __init__(self, crafts: Sequence[Craft], rng: np.random.Generator) -> None:
        n = len(crafts)
        self.crafts = crafts
        self.speed_sum = np.zeros((n, 3))
        self.rate_sum = np.zeros((n, 3))
        self.last_rates = np.zeros((n, 3))
        self.rate_gain = rng.uniform(7.0, 11.0, n)
        self.tilt_gain = rng.uniform(3.5, 5.0, n)
        self.known_mass = np.array([c.mass_kg for c in crafts]) * rng.uniform(0.95, 1.05, n)
        self.known_inertia = np.array([c.inertia for c in crafts])
        self.top = np.array([c.max_thrust_n for c in crafts])
        self.expo = np.array([c.expo for c in crafts])
        self.to_motors = np.stack([_to_motors(c) for c in crafts])

    def wanted_force(
        self, place: Array, speed: Array, target: Array, target_v: Array, dt: float
    ) -> Array:
        """World force over the mass (n, 3) that goes to ``target`` (n, 3)."""
        wanted_v = np.clip(0.8 * (target - place), -3.0, 3.0) + target_v
        error = wanted_v - speed
        self.speed_sum = np.clip(self.speed_sum + 0.5 * error * dt, -2.5, 2.5)
        accel = 2.2 * error + self.speed_sum
        accel[:, 2] = np.clip(accel[:, 2], -CLIMB_M_S2, CLIMB_M_S2)
        force = accel.copy()
        force[:, 2] -= G
        level = np.linalg.norm(force[:, :2], axis=1)
        most = np.tan(LEAN_RAD) * np.maximum(-force[:, 2], 3.0)
        force[:, :2] *= np.minimum(1.0, most / np.maximum(level, 1e-9))[:, None]
        return force

    def outputs(
        self, rotation: Array, rates: Array, force: Array, yaw: Array, turn: Array, dt: float
    ) -> Array:
        """Commands (n, motors) from 0 to 1. ``turn`` (n,): a roll rate that a pilot asks for; NaN: none."""
        up = force / np.linalg.norm(force, axis=1, keepdims=True)
        wanted = _leaning(up, yaw)
        error = np.einsum("nji,njk->nik", wanted, rotation)
        angle = 0.5 * np.stack(
            [
                error[:, 1, 2] - error[:, 2, 1],
                error[:, 2, 0] - error[:, 0, 2],
                error[:, 0, 1] - error[:, 1, 0],
            ],
            axis=1,
        )
        gain = np.stack([self.tilt_gain, self.tilt_gain, 0.5 * self.tilt_gain], axis=1)
        asked = np.clip(gain * angle, -4.0, 4.0)
        asked[:, 2] = np.clip(asked[:, 2], -1.5, 1.5)
        rolls = np.isfinite(turn)
        asked[rolls, 0] = turn[rolls]
        asked[rolls, 1] = 0.0
        miss = asked - rates
        self.rate_sum = np.clip(self.rate_sum + 2.0 * miss * dt, -1.5, 1.5)
        damping = -0.01 * (rates - self.last_rates) / dt
        self.last_rates = rates.copy()
        push = miss + self.rate_sum + damping
        spin_up = self.rate_gain[:, None] * push
        spin_up[:, 2] *= 0.4
        moment = self.known_inertia * spin_up
        upright = np.clip(rotation[:, 2, 2], 0.5, 1.0)
        lift = self.known_mass * np.maximum(-force[:, 2], 0.0) / upright
        return self._mixed(lift, moment)

    def _mixed(self, lift: Array, moment: Array) -> Array:
        """Thrust and moments to commands: roll and pitch first, then yaw, then lift."""
        count = self.to_motors.shape[1]
        mean = np.clip(lift / count / self.top, 0.05, 0.9)
        tilt = np.einsum("nmk,nk->nm", self.to_motors[:, :, :2], moment[:, :2]) / self.top[:, None]
        yaw = self.to_motors[:, :, 2] * moment[:, 2:3] / self.top[:, None]
        tilt = np.clip(tilt, -0.6, 0.6)
        room = np.maximum(0.2, np.minimum(mean, 1.0 - mean) - np.abs(tilt).max(axis=1))
        share = np.minimum(1.0, room / np.maximum(np.abs(yaw).max(axis=1), 1e-9))
        apart = tilt + share[:, None] * yaw
        width = np.ptp(apart, axis=1)
        apart *= np.minimum(1.0, 1.0 / np.maximum(width, 1e-9))[:, None]
        low = 0.02 - apart.min(axis=1)
        high = 1.0 - apart.max(axis=1)
        mean = np.clip(mean, np.minimum(low, high), np.maximum(low, high))
        thrust = np.clip(mean[:, None] + apart, 0.0, 1.0)
        command = _inverse_curve(thrust, self.expo[:, None])
        return np.clip(command, IDLE, 1.0)


def curve(command: Array, expo: Array) -> Array:
    """Share of the full thrust of a command."""
    return (1.0 - expo) * command + expo * command**2


def _inverse_curve(thrust: Array, expo: Array) -> Array:
    linear = 1.0 - expo
    return (np.sqrt(linear**2 + 4.0 * expo * thrust) - linear) / (2.0 * expo)


def _to_motors(craft: Craft) -> Array:
    """Thrusts of the motors (motors, 3) for one unit of each moment."""
    x, y, _ = craft.places.T
    effect = np.stack([-y, x, -craft.spins * craft.torque_m])
    return np.asarray(np.linalg.pinv(effect))


def _leaning(up: Array, yaw: Array) -> Array:
    """Attitudes (n, 3, 3), body FRD to NED, with the rotors' axis along ``up`` (n, 3) and this heading."""
    down = -up
    ahead = np.stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)], axis=1)
    right = cross(down, ahead)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return np.stack([cross(right, down), right, down], axis=2)


def cross(a: Array, b: Array) -> Array:
    """a x b of (..., 3): numpy's takes most of a flight's time on so few numbers."""
    ahead = a.take(_NEXT, axis=-1) * b.take(_LAST, axis=-1)
    behind = a.take(_LAST, axis=-1) * b.take(_NEXT, axis=-1)
    return np.asarray(ahead - behind)
