"""A small multirotor that takes off, flies gently at 3 m and lands: what its sensors would say. For logs of tests.

The place is chosen, and everything else follows from it: thrust is along the specific force, and the rotors share it
so that their moments turn the body. There is no air but the rotors' own: no drag, no wind.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.common.frames import GRAVITY, Array

SECONDS = 28.0
TAKE_OFF_S = 3.0
LANDED_S = 27.0
HEIGHT_M = 3.0
RATE_HZ = 200.0

MASS_KG = 1.6
INERTIA = np.array([0.014, 0.014, 0.026])
THRUST_PER_RPM2 = 1.1e-7
"""N / rpm2 of a propeller of ten inches: 6 000 rpm carry a quarter of the weight."""
TORQUE_PER_THRUST_M = 0.016
MOST_THRUST_N = 11.0
EXPO = 0.65
IDLE_THRUST_N = 0.05


@dataclass(frozen=True)
class Craft:
    """Where the motors are [m], body FRD, and how they spin, seen from above: +1 clockwise."""

    places: Array
    spins: Array


def ring(angles_deg: tuple[float, ...], spins: tuple[float, ...], arm_m: float = 0.23) -> Craft:
    """Motors on a circle; angles from ahead, clockwise."""
    angles = np.radians(angles_deg)
    places = arm_m * np.column_stack([np.cos(angles), np.sin(angles)])
    return Craft(places, np.array(spins))


QUAD_X = ring((45.0, -135.0, -45.0, 135.0), (-1.0, -1.0, 1.0, 1.0))
"""In the order of ArduPilot, which is that of PX4, too."""
HEXA_X = ring((90.0, -90.0, -30.0, 150.0, 30.0, -150.0), (1.0, -1.0, 1.0, -1.0, -1.0, 1.0))
"""In the order of both firmwares."""


@dataclass(frozen=True, kw_only=True)
class Flight:
    """What happened at ``RATE_HZ``: rows (n, …) of the time [s] since the log began."""

    t: Array
    quaternion: Array
    """FRD to NED, w first."""
    euler: Array
    """Roll, pitch, yaw [rad]."""
    rates: Array
    position: Array
    velocity: Array
    force: Array
    """Specific force [m/s2], body."""
    thrust: Array
    """Of each motor [N]."""
    volts: Array
    amps: Array

    @property
    def rpm(self) -> Array:
        """Of each motor."""
        return np.sqrt(self.thrust / THRUST_PER_RPM2)

    @property
    def command(self) -> Array:
        """Of each motor, 0 to 1: what gives its thrust through ``EXPO``."""
        share = self.thrust / MOST_THRUST_N
        slope = 1.0 - EXPO
        root = np.sqrt(slope**2 + 4.0 * EXPO * share)
        return (root - slope) / (2.0 * EXPO)

    def airborne(self, t: float) -> bool:
        """Off the ground at ``t``."""
        return TAKE_OFF_S <= t < LANDED_S

    def at(self, values: Array, t: float) -> Array:
        """The row of ``values`` at ``t``."""
        return values[round(t * RATE_HZ)]


def fly(craft: Craft = QUAD_X) -> Flight:
    """One flight of ``SECONDS``."""
    t = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    aloft = _rise(t, TAKE_OFF_S, 3.0) - _rise(t, 24.0, 3.0)
    north = aloft * 1.2 * np.sin(0.9 * t)
    east = aloft * 0.9 * np.sin(1.3 * t + 1.0)
    climb = aloft * (HEIGHT_M + 0.3 * np.sin(1.1 * t))
    position = np.column_stack([north, east, -climb])
    velocity = _rate(position)
    force = _rate(velocity) - np.array([0.0, 0.0, GRAVITY])
    yaw = aloft * 0.4 * np.sin(0.5 * t)
    rotation = _attitude(force, yaw)
    rates = _body_rates(rotation)
    lift = MASS_KG * np.linalg.norm(force, axis=1)
    thrust = _shares(craft, lift, _moments(rates))
    grounded = (t < TAKE_OFF_S) | (t >= LANDED_S)
    thrust[grounded] = IDLE_THRUST_N
    amps = 2.0 + 0.9 * thrust.sum(axis=1)
    return Flight(
        t=t,
        quaternion=_quaternion(rotation),
        euler=_euler(rotation),
        rates=rates,
        position=position,
        velocity=velocity,
        force=np.einsum("nji,nj->ni", rotation, force),
        thrust=thrust,
        volts=16.5 - 0.006 * t - 0.02 * amps,
        amps=amps,
    )


def _rise(t: Array, start_s: float, length_s: float) -> Array:
    """From 0 to 1, with no jump of the acceleration."""
    x = np.clip((t - start_s) / length_s, 0.0, 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x**2)


def _rate(values: Array) -> Array:
    return np.gradient(values, 1.0 / RATE_HZ, axis=0)


def _attitude(force: Array, yaw: Array) -> Array:
    """Rotations (n, 3, 3) whose z axis is against the force and whose x axis looks along ``yaw``."""
    z = -force / np.linalg.norm(force, axis=1, keepdims=True)
    ahead = np.column_stack([np.cos(yaw), np.sin(yaw), 0.0 * yaw])
    y = np.cross(z, ahead)
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    return np.stack([np.cross(y, z), y, z], axis=2)


def _body_rates(rotation: Array) -> Array:
    turned = np.einsum("nji,njk->nik", rotation, _rate(rotation))
    return np.column_stack([turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]])


def _moments(rates: Array) -> Array:
    """I·dω/dt + ω×Iω."""
    spin = INERTIA * rates
    return INERTIA * _rate(rates) + np.cross(rates, spin)


def _shares(craft: Craft, lift: Array, moments: Array) -> Array:
    """Thrusts (n, motors) that give lift and moments together; the smallest ones."""
    forward = craft.places[:, 0]
    right = craft.places[:, 1]
    torque = -craft.spins * TORQUE_PER_THRUST_M
    effects = np.stack([np.ones(len(forward)), -right, forward, torque])
    wanted = np.column_stack([lift, moments])
    return wanted @ np.linalg.pinv(effects).T


def _euler(rotation: Array) -> Array:
    roll = np.arctan2(rotation[:, 2, 1], rotation[:, 2, 2])
    pitch = -np.arcsin(rotation[:, 2, 0])
    yaw = np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0])
    return np.column_stack([roll, pitch, yaw])


def _quaternion(rotation: Array) -> Array:
    """Of small tilts, where w is far from 0."""
    w = 0.5 * np.sqrt(1.0 + np.trace(rotation, axis1=1, axis2=2))
    x = (rotation[:, 2, 1] - rotation[:, 1, 2]) / (4.0 * w)
    y = (rotation[:, 0, 2] - rotation[:, 2, 0]) / (4.0 * w)
    z = (rotation[:, 1, 0] - rotation[:, 0, 1]) / (4.0 * w)
    return np.column_stack([w, x, y, z])
