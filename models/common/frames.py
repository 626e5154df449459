"""Frames and rotations of wrenches ``Fx Fy Fz Mx My Mz`` (N, N m). World NED, body FRD (docs/formats.md)."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Whole = NDArray[np.int64]
Mask = NDArray[np.bool_]
Row = tuple[float, float, float]
Rows = tuple[Row, Row, Row]
"""A rotation matrix in plain floats, row by row."""
AnyRow = tuple[Any, Any, Any]
"""The same of floats or of arrays."""
LEVEL: Rows = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""No rotation."""
AXES = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
GRAVITY = 9.80665


def corner_to_body(wrench: ArrayLike, wall_bearing_rad: ArrayLike) -> Array:
    """Rotate a wrench of one fan from its corner frame to body axes, about the same point.

    ``wrench`` shape (..., 6), corner frame: X towards the wall, Z up, Y = Z x X.
    ``wall_bearing_rad`` shape (...), the wall seen from the nose, positive to the right; 0 where there is no wall.
    Returns shape (..., 6), body FRD.
    """
    w = np.asarray(wrench, dtype=float)
    c = np.cos(wall_bearing_rad)
    s = np.sin(wall_bearing_rad)
    x = w[..., 0::3]
    y = w[..., 1::3]
    z = w[..., 2::3]
    c = np.asarray(c)[..., None]
    s = np.asarray(s)[..., None]
    out = np.empty(np.broadcast_shapes(w.shape, (*c.shape[:-1], 6)))
    out[..., 0::3] = c * x + s * y
    out[..., 1::3] = s * x - c * y
    out[..., 2::3] = -z
    return out


def at_cg(wrench: ArrayLike, position_m: ArrayLike) -> Array:
    """Move a body wrench (..., 6) that acts at ``position_m`` (..., 3) from the CG to the CG: M += r x F."""
    w = np.array(wrench, dtype=float)
    x, y, z = (np.asarray(position_m, dtype=float)[..., i] for i in range(3))
    fx = w[..., 0]
    fy = w[..., 1]
    fz = w[..., 2]
    # Written out: numpy's cross costs ten times as much on three numbers.
    w[..., 3] += y * fz - z * fy
    w[..., 4] += z * fx - x * fz
    w[..., 5] += x * fy - y * fx
    return w


def rotation_from_quaternion(q: ArrayLike) -> Array:
    """Rotation matrices (..., 3, 3), body FRD to world NED, of unit quaternions (..., 4), w first (MAVLink's order)."""
    rows = rotation_rows(*np.moveaxis(np.asarray(q, dtype=float), -1, 0))
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rotation_rows(w: Any, x: Any, y: Any, z: Any) -> tuple[AnyRow, AnyRow, AnyRow]:
    """The three rows of the rotation of a unit quaternion, body FRD to world NED: of floats, or of arrays (...)."""
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


def euler_angles(rotation: Array) -> Array:
    """Roll, pitch, yaw (3, n) [rad] of rotations (n, 3, 3) from FRD to NED, aerospace 3-2-1."""
    roll = np.arctan2(rotation[:, 2, 1], rotation[:, 2, 2])
    pitch = -np.arcsin(np.clip(rotation[:, 2, 0], -1.0, 1.0))
    yaw = np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0])
    return np.stack([roll, pitch, yaw])


def quaternion_from_euler(
    roll: float, pitch: float, yaw: float
) -> tuple[float, float, float, float]:
    """Unit quaternion (w, x, y, z), FRD to NED, of the aerospace 3-2-1 angles in rad."""
    half = (roll / 2, pitch / 2, yaw / 2)
    return quaternion_of_halves([math.cos(a) for a in half], [math.sin(a) for a in half])


def quaternion_of_halves(cosines: Iterable[Any], sines: Iterable[Any]) -> tuple[Any, Any, Any, Any]:
    """The same from cosine and sine of half of roll, pitch and yaw: floats, or arrays (...)."""
    (cr, cp, cy), (sr, sp, sy) = cosines, sines
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def measured_wrench(
    specific_force: ArrayLike,
    rates: ArrayLike,
    rate_derivatives: ArrayLike,
    mass_kg: float,
    inertia_kgm2: ArrayLike,
) -> Array:
    """The wrench of the air on the body, from the IMU, about the CG.

    Force = m f with f the specific force at the CG (gravity never enters); moment = I w' + w x (I w).
    All inputs shape (..., 3), body FRD, m/s^2, rad/s, rad/s^2; returns shape (..., 6).
    """
    f, w, wd = (
        np.moveaxis(np.asarray(a, dtype=float), -1, 0)
        for a in (specific_force, rates, rate_derivatives)
    )
    ix, iy, iz = np.asarray(inertia_kgm2, dtype=float).tolist()
    (fx, fy, fz), (p, q, r), (pd, qd, rd) = f, w, wd
    return np.stack(
        wrench_of_motion(
            fx=fx,
            fy=fy,
            fz=fz,
            p=p,
            q=q,
            r=r,
            pd=pd,
            qd=qd,
            rd=rd,
            mass_kg=mass_kg,
            ixx=ix,
            iyy=iy,
            izz=iz,
        ),
        axis=-1,
    )


def wrench_of_motion(
    fx: Any,
    fy: Any,
    fz: Any,
    p: Any,
    q: Any,
    r: Any,
    pd: Any,
    qd: Any,
    rd: Any,
    mass_kg: float,
    ixx: float,
    iyy: float,
    izz: float,
) -> tuple[Any, Any, Any, Any, Any, Any]:
    """``measured_wrench`` by components, the same for floats (one instant in flight) and arrays (a record)."""
    return (
        mass_kg * fx,
        mass_kg * fy,
        mass_kg * fz,
        ixx * pd + (q * (izz * r) - r * (iyy * q)),
        iyy * qd + (r * (ixx * p) - p * (izz * r)),
        izz * rd + (p * (iyy * q) - q * (ixx * p)),
    )
