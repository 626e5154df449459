"""Measured minus modelled wrench of one block of flight, and what each size would add to it.

The formulas are those of diagnosis (``models.frames.wrench_of_motion``, ``models.vehicle_wrench.vane_wrench``, the
surrogate); the one filter that both sides go through is here a mean over the block in place of a Gaussian over the
record, and the delay of rotor speeds is a lag of the accelerometer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from companion.adaptation import sizes as at
from companion.adaptation.parts import Parts, rows_of
from companion.mavlink.samples import Imu, Vector3
from models.frames import Array, wrench_of_motion
from models.vehicle import RHO_SEA_LEVEL, Vehicle
from models.vehicle_wrench import vane_wrench

AXES = 5
"""Fx Fy Fz Mx My: no size acts by the yaw moment."""


_EQUAL = 1e-9
"""N m per kg: rotors that never differ are copies of one number, and tell no moments, as in diagnosis."""


@dataclass(frozen=True, slots=True)
class Block:
    """Sums over the samples of the accelerometer since ``start_s``; immutable, so that ``step`` stays pure."""

    start_s: float
    end_s: float
    lagged: tuple[float, float, float, float, float, float]
    """Specific force and rates behind the lag, at the newest sample."""
    rates_at_start: Vector3
    samples: int
    force: Vector3
    rates: Vector3
    velocity: Vector3
    vanes: tuple[float, ...]
    at_fans: Array | None
    """Of ``Parts``: (2, fans, 6)."""
    effects: Array | None
    tip_m_s: float


def begin(imu: Imu) -> Block:
    """A block that starts with a sample, without counting it."""
    zero = (0.0, 0.0, 0.0)
    lagged = (*imu.specific_force_frd, *imu.gyro_frd)
    return Block(imu.t_s, imu.t_s, lagged, imu.gyro_frd, 0, zero, zero, zero, (), None, None, 0.0)


def follow(block: Block) -> Block:
    """The block after one that is full: the lag goes on."""
    zero, (p, q, r) = (0.0, 0.0, 0.0), block.lagged[3:]
    return Block(block.end_s, block.end_s, block.lagged, (p, q, r), 0, zero, zero, zero, (), None, None, 0.0)


def add(block: Block, imu: Imu, parts: Parts, velocity: Vector3, vanes: tuple[float, ...], lag_s: float) -> Block:
    """The block with one sample more; ``vanes`` are their deflections [rad], ``velocity`` NED."""
    dt = imu.t_s - block.end_s
    share = dt / (lag_s + dt)
    a, b, c, p, q, r = block.lagged
    (fx, fy, fz), (gx, gy, gz) = imu.specific_force_frd, imu.gyro_frd
    a += share * (fx - a)
    b += share * (fy - b)
    c += share * (fz - c)
    p += share * (gx - p)
    q += share * (gy - q)
    r += share * (gz - r)
    (sa, sb, sc), (sp, sq, sr), (vn, ve, vd) = block.force, block.rates, block.velocity
    n, e, d = velocity
    return Block(
        block.start_s,
        imu.t_s,
        (a, b, c, p, q, r),
        block.rates_at_start,
        block.samples + 1,
        (sa + a, sb + b, sc + c),
        (sp + p, sq + q, sr + r),
        (vn + n, ve + e, vd + d),
        vanes if not block.vanes else tuple(x + y for x, y in zip(block.vanes, vanes, strict=True)),
        parts.at_fans if block.at_fans is None else block.at_fans + parts.at_fans,
        parts.effects if block.effects is None or not len(parts.effects) else block.effects + parts.effects,
        block.tip_m_s + parts.tip_m_s,
    )


@dataclass(frozen=True, slots=True)
class Seen:
    """One block: ``residual`` (5,) with all sizes as modelled, ``regressors`` (5, n), ``modelled`` (5,)."""

    residual: Array
    regressors: Array
    modelled: Array
    lift_n: float
    """Free-air lift of all fans."""


def see(
    block: Block, vehicle: Vehicle, rotation: Array, bearing_rad: float, sizes: int,
    wind_ne: tuple[float, float] = (0.0, 0.0),
) -> Seen:  # fmt: skip
    """The residual of a full block. ``rotation`` FRD -> NED and the wall's bearing at its end; ``wind_ne`` as believed
    [m/s]."""
    assert block.at_fans is not None
    assert block.effects is not None
    share = 1.0 / block.samples
    at_fans = block.at_fans * share
    parts = rows_of(vehicle, at_fans, block.effects * share, bearing_rad)
    wrench = measured(block, vehicle)
    modelled = parts.sum(axis=0)[:AXES]
    if vehicle.vanes:
        modelled = modelled + vanes_wrench(
            vehicle, [v * share for v in block.vanes], at_fans[0, :, 2].tolist()
        )[:AXES]  # fmt: skip
    velocity = (np.array(block.velocity) * share) @ rotation
    if not vehicle.vanes and float(np.abs(parts[3, 3:AXES]).sum()) < _EQUAL * vehicle.mass_kg:
        wrench[3:] = np.nan
    regressors = np.zeros((AXES, sizes))
    regressors[:, : at.THRUST] = parts[:3, :AXES].T
    regressors[:, at.FIRST_EFFECT :] = parts[4:, :AXES].T
    free = parts[3]
    north, east = wind_ne
    climb = float(velocity[2]) - north * float(rotation[0, 2]) - east * float(rotation[1, 2])
    lifted = float(modelled[2] - parts[:3, 2].sum())
    _common(
        regressors, vehicle, rotation, [*velocity.tolist()[:2], climb], free.tolist(), lifted, block.tip_m_s * share
    )
    return Seen(wrench - modelled, regressors, modelled, -float(free[2]))


def measured(block: Block, vehicle: Vehicle) -> Array:
    """(5,): the wrench of the air that the accelerometer and the gyro of a block tell."""
    share, seconds = 1.0 / block.samples, block.end_s - block.start_s
    p0, q0, r0 = block.rates_at_start
    _, _, _, p1, q1, r1 = block.lagged
    fx, fy, fz = block.force
    p, q, r = block.rates
    wrench = wrench_of_motion(
        fx * share, fy * share, fz * share, p * share, q * share, r * share,
        (p1 - p0) / seconds, (q1 - q0) / seconds, (r1 - r0) / seconds, vehicle.mass_kg, *vehicle.inertia_kgm2,
    )  # fmt: skip
    return np.array(wrench[:AXES])


def _common(
    out: Array, vehicle: Vehicle, rotation: Array, velocity: list[float], free: list[float], lifted: float,
    tip_m_s: float,
) -> None:  # fmt: skip
    """Fill in the columns of the sizes that every vehicle has; the catalogue's regressors (see the tests).

    ``velocity``: along x and y over ground, along the rotors' axis through the air. ``lifted``: declared vertical force
    of rotors and vanes in free air, body FRD.
    """
    lift = max(-free[2], 0.0)
    out[2, at.THRUST] = free[2]
    flow, above, radius = mass_flow(vehicle, lift), mean_height(vehicle), vehicle.rotor_radius_m
    for column, axis in ((at.NORTH, 0), (at.EAST, 1)):
        out[0, column], out[1, column] = flow * float(rotation[axis, 0]), flow * float(rotation[axis, 1])
        # Acts at the fans: their height about the CG.
        out[3, column], out[4, column] = -above * out[1, column], above * out[0, column]
    out[4, at.CG_X], out[3, at.CG_Y] = lifted, -lifted
    vx, vy, vz = velocity
    out[0, at.DRAG], out[1, at.DRAG] = -flow * vx, -flow * vy
    out[3, at.DRAG], out[4, at.DRAG] = -above * out[1, at.DRAG], above * out[0, at.DRAG]
    out[3, at.DRAG_ARM], out[4, at.DRAG_ARM] = radius * out[1, at.DRAG], -radius * out[0, at.DRAG]
    out[2, at.INFLOW] = -lift * vz / max(tip_m_s, 1.0)


def mass_flow(vehicle: Vehicle, lift_n: float) -> float:
    """Sum over the fans of momentum theory's mass flow in hover, sqrt(rho A T) [kg/s], at equal lift."""
    fans = len(vehicle.fans)
    return fans * math.sqrt(RHO_SEA_LEVEL * vehicle.disc_area_m2 * lift_n / fans)


@lru_cache(maxsize=8)
def mean_height(vehicle: Vehicle) -> float:
    """Body z of the fans' reference points, averaged [m]."""
    return float(vehicle.fan_positions_m[:, 2].mean())


@lru_cache(maxsize=8)
def _vane_units(vehicle: Vehicle) -> Array:
    """(vanes, 6): wrench about the CG per radian of each vane and newton of its fan's lift."""
    rows = []
    for vane in vehicle.vanes:
        servo = np.array([next((v.neutral_us for v in vehicle.vanes if v.servo - 1 == k), 0.0) for k in range(16)])
        servo[vane.servo - 1] += 1.0 / vane.rad_per_us
        rows.append(vane_wrench(vehicle, servo, np.ones(len(vehicle.fans))))
    return np.array(rows)


def vanes_wrench(vehicle: Vehicle, deflections: list[float], fan_lift_n: list[float]) -> Array:
    """(6,): ``models.vehicle_wrench.vane_wrench`` for deflections [rad] and lifts (fans,) [N] in flight.

    NaN in the axes of a vane whose deflection is NaN.
    """
    loads = np.array([a * fan_lift_n[v.fan - 1] for a, v in zip(deflections, vehicle.vanes, strict=True)])
    units = _vane_units(vehicle)
    out: Array = np.where(units == 0.0, 0.0, loads[:, None] * units).sum(axis=0)
    return out


def deflections(vehicle: Vehicle, pwm_us: tuple[float, ...]) -> tuple[float, ...]:
    """Of every vane [rad]; NaN where its output is not told."""
    return tuple([(pwm_us[k] or math.nan) * per_us - straight for k, per_us, straight in _vane_scales(vehicle)])


@lru_cache(maxsize=8)
def _vane_scales(vehicle: Vehicle) -> tuple[tuple[int, float, float], ...]:
    return tuple((v.servo - 1, v.rad_per_us, v.rad_per_us * v.neutral_us) for v in vehicle.vanes)
