"""Forces and moments on the airframe, from states: the same functions fly the vehicle and explain the flight.

Arrays end in one axis of ``n`` flights (in flight) or of time (explaining); rotor arrays are (rotors, n), vectors
(3, n), vectors at rotors (3, rotors, n). Body FRD about the declared CG unless said otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from . import surfaces
from .airframes import RHO0, Airframe, Array
from .conditions import Conditions


def rotation(q: Array) -> Array:
    """Body to NED (3, 3, n) from unit quaternions (4, n)."""
    w, x, y, z = q
    xx, yy, zz, xy, xz, yz, wx, wy, wz = (
        x * x,
        y * y,
        z * z,
        x * y,
        x * z,
        y * z,
        w * x,
        w * y,
        w * z,
    )
    R = np.empty((3, 3, *q.shape[1:]))
    R[0, 0], R[0, 1], R[0, 2] = 1 - 2 * (yy + zz), 2 * (xy - wz), 2 * (xz + wy)
    R[1, 0], R[1, 1], R[1, 2] = 2 * (xy + wz), 1 - 2 * (xx + zz), 2 * (yz - wx)
    R[2, 0], R[2, 1], R[2, 2] = 2 * (xz - wy), 2 * (yz + wx), 1 - 2 * (xx + yy)
    return R


def into_body(R: Array, v: Array) -> Array:
    """NED vector (3, n) in body axes."""
    return R[0] * v[0] + R[1] * v[1] + R[2] * v[2]


def into_world(R: Array, v: Array) -> Array:
    """Body vector (3, n) in NED."""
    return R[:, 0] * v[0] + R[:, 1] * v[1] + R[:, 2] * v[2]


def cross(a: Array, b: Array) -> Array:
    """a x b along axis 0."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[0], out[1], out[2] = (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )
    return out


@lru_cache
def arms(frame: Airframe) -> Array:
    """Rotor positions (3, rotors, 1)."""
    return np.array(frame.arms).T[:, :, None]


@dataclass(frozen=True)
class Near:
    """What surfaces do to each rotor, (rotors, n): shares of its thrust, and of thrust times radius."""

    ground: Array
    ceiling: Array
    pull: tuple[Array, Array]
    """To the wall in the north, to that in the east; with gain."""
    tilt: tuple[Array, Array]
    loss: Array

    @property
    def factor(self) -> Array:
        """On thrust."""
        return (1.0 + self.ground) * (1.0 + self.ceiling) * (1.0 - self.loss)


def at_rotors(frame: Airframe, air: Array, rates: Array) -> tuple[Array, Array, Array]:
    """Velocity relative to the air at each rotor: forward, right, and up through the disc [m/s], (rotors, n)."""
    a = arms(frame)
    p, q, r = rates
    return (
        air[0] + q * a[2] - r * a[1],
        air[1] + r * a[0] - p * a[2],
        -(air[2] + p * a[1] - q * a[0]),
    )


def rotor_places(frame: Airframe, R: Array, position: Array) -> Array:
    """NED (3, rotors, n)."""
    return position[:, None] + np.einsum(
        "jkn,krn->jrn", R, np.broadcast_to(arms(frame), (3, frame.count, R.shape[-1]))
    )


def covered(frame: Airframe, north: Array, edge_north: Array) -> Array:
    """Share of a disc at ``north`` that is over the table beyond the edge (a circle's segment)."""
    s = np.clip((north - edge_north) / frame.radius_m, -1.0, 1.0)
    s = np.where(np.isfinite(s), s, -1.0)
    return 0.5 + (np.arcsin(s) + s * np.sqrt(1.0 - s * s)) / np.pi


def near_surfaces(frame: Airframe, c: Conditions, places: Array) -> Near:
    """For rotors at ``places`` (3, rotors, n)."""
    height = np.maximum(-places[2], 0.0)
    ground = surfaces.ground_gain(frame, height)
    if np.isfinite(c.edge_north).any():
        over = covered(frame, places[0], c.edge_north)
        table = surfaces.ground_gain(frame, np.maximum(height - c.table_m, 0.0))
        ground = (1.0 - over) * ground + over * table
    ground = c.ground_gain * ground
    nothing = np.zeros_like(height)
    ceiling = nothing
    if np.isfinite(c.ceiling_m).any():
        ceiling = c.ceiling_gain * surfaces.ceiling_gain(
            frame, np.maximum(c.ceiling_m - height, 0.0)
        )
    north = east = (nothing, nothing, nothing)
    if np.isfinite(c.wall_north).any():
        north = surfaces.wall_terms(frame, c.wall_north - places[0] - frame.lip_m, height)
    if np.isfinite(c.wall_east).any():
        east = surfaces.wall_terms(frame, c.wall_east - places[1] - frame.lip_m, height)
    g = c.wall_gain
    # In the corner of two walls the streams meet: losses grow by their geometric mean besides.
    loss = np.minimum(g * (north[2] + east[2] + 1.5 * np.sqrt(north[2] * east[2])), 0.5)
    return Near(ground, ceiling, (g * north[0], g * east[0]), (g * north[1], g * east[1]), loss)


def wall_wrench(
    frame: Airframe, near: Near, lift: Array, R: Array, which: int
) -> tuple[Array, Array]:
    """Pull and tilt of one wall: force and moment, body (3, n)."""
    force = near.pull[which] * lift
    tilt = (near.tilt[which] * lift * frame.radius_m).sum(axis=0)
    normal = R[which]  # the wall's normal (north or east) in body axes
    at = np.broadcast_to(arms(frame), (3, *force.shape))
    moment = cross(at, force[None] * normal[:, None]).sum(axis=1)
    # Body z (down) cross the direction to the wall, negative: the edge at the wall goes down.
    down = R[2]
    return force.sum(axis=0) * normal, moment + tilt * cross(-down, normal)


def rotor_drag_constant(frame: Airframe, c: Conditions) -> Array | float:
    """lambda_1 of Martin & Salaun: side force over (rotor speed times air speed) of one rotor [N s^2/m]."""
    return c.rotor_drag * frame.mass_kg / (frame.count * frame.hover_speed) * c.rho / RHO0


def from_rotors(frame: Airframe, lift: Array, side: Array) -> tuple[Array, Array]:
    """Force and moment (3, n) of ``lift`` (rotors, n) along -z and ``side`` forces (2, rotors, n) at the rotors."""
    a = arms(frame)
    fx, fy = side
    force = np.stack([fx.sum(axis=0), fy.sum(axis=0), -lift.sum(axis=0)])
    moment = np.stack(
        [
            (-a[1] * lift - a[2] * fy).sum(axis=0),
            (a[2] * fx + a[0] * lift).sum(axis=0),
            (a[0] * fy - a[1] * fx).sum(axis=0),
        ]
    )
    return force, moment


def body_drag(c: Conditions, air: Array) -> Array:
    """Quadratic drag (3, n) on the air's velocity relative to the body, twice as large from below as from the side."""
    speed = np.sqrt((air**2).sum(axis=0))
    return -0.5 * c.rho * c.body_cda * speed * air * np.array([1.0, 1.0, 2.0])[:, None]


def contact(
    frame: Airframe, c: Conditions, R: Array, places: Array, velocity: Array
) -> tuple[Array, Array]:
    """A soft bumper at the two or three foremost lips against the wall in the north: spring and damper, body (3, n)."""
    depth = np.maximum(frame.lip_m + c.bumper_m - (c.wall_north - places[0]), 0.0)
    depth = np.where(np.isfinite(depth), depth, 0.0)
    damper = 0.5 * np.sqrt(c.bumper_n_m * frame.mass_kg) * velocity[0]
    press = np.where(depth > 0.0, np.maximum(c.bumper_n_m * depth + damper, 0.0), 0.0)
    at = np.broadcast_to(arms(frame), (3, *press.shape))
    normal = R[0]
    return -press.sum(axis=0) * normal, cross(at, -press[None] * normal[:, None]).sum(axis=1)


def no_catalogue(
    c: Conditions, t: Array | float, R: Array, position: Array
) -> dict[str, tuple[Array, Array]]:
    """Forces (body, (3, n)) and moments that no effect of the contract stands for, by name."""
    zero = np.zeros_like(position)
    wave = c.grate_n * np.sin(2.0 * np.pi * position[0] / c.grate_m)
    # A neighbour passes overhead: a smooth pulse of 6 s, spaced irregularly.
    phase = t / c.downwash_s + 0.23 * np.sin(0.71 * t / c.downwash_s * 2.0 * np.pi)
    pulse = np.exp(-0.5 * ((phase - np.round(phase)) * c.downwash_s / 1.6) ** 2)
    rock = c.rock_nm * np.sin(2.0 * np.pi * c.rock_hz * t)
    down = R[2]
    return {
        "x_grate": (wave * down, zero),
        "x_downwash": (c.downwash_n * pulse * down, zero),
        "x_rock": (zero, np.stack([zero[0] + rock, zero[0], zero[0]])),
    }
