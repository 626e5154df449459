"""Measured minus modelled wrench of one block of flight, and what each size would add to it.

The formulas are those of diagnosis (``models.common.frames.wrench_of_motion``, the surrogate,
``models.vehicle_wrench.vane_wrench``); the one filter that both sides go through is here a mean over the block in place
of a Gaussian over the record, and the delay of rotor speeds is a lag of the accelerometer.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from companion.adaptation import sizes as at
from companion.disturbance.about_cg import about_cg
from companion.disturbance.records import Parts
from companion.mavlink.samples import Imu
from models.common.frames import Array, Rows, at_cg, wrench_of_motion
from models.vehicle import RHO_SEA_LEVEL, Vector3, Vehicle

IMU_LAG_S = 0.03
"""The accelerometer is delayed by this, which is how late rotor speeds are."""
AXES = 5
"""Fx Fy Fz Mx My: no size acts by the yaw moment."""


_EQUAL = 1e-9
"""N m per kg: rotors that never differ are copies of one number, and tell no moments, as in diagnosis."""


class Block(NamedTuple):
    """Sums over the samples of the accelerometer since ``start_s``; immutable, so that ``step`` stays pure."""

    start_s: float
    end_s: float
    lagged: tuple[float, ...]
    """(6,): specific force and rates behind the lag, at the newest sample."""
    rates_at_start: tuple[float, ...]
    samples: int = 0
    motion: tuple[float, ...] = (0.0,) * 9
    """Of specific force and rates behind the lag, and velocity NED."""
    vanes_us: tuple[float, ...] = ()
    """Outputs of the vanes' servos."""
    at_fans: Array | None = None
    """Of ``Parts``: (2, fans, 6)."""
    effects: Array | None = None
    tip_m_s: float = 0.0


def begin(imu: Imu) -> Block:
    """A block that starts with a sample, without counting it."""
    return Block(imu.t_s, imu.t_s, (*imu.specific_force_frd, *imu.gyro_frd), imu.gyro_frd)


def follow(block: Block) -> Block:
    """The block after one that is full: the lag goes on."""
    return Block(block.end_s, block.end_s, block.lagged, block.lagged[3:])


def add(
    block: Block, imu: Imu, parts: Parts, velocity: Vector3, vanes_us: tuple[float, ...]
) -> Block:
    """The block with one sample more; ``vanes_us`` as ``vane_outputs`` has them, ``velocity`` NED."""
    share = (imu.t_s - block.end_s) / (IMU_LAG_S + imu.t_s - block.end_s)
    (a, b, c, p, q, r), (fx, fy, fz), (gx, gy, gz) = (
        block.lagged,
        imu.specific_force_frd,
        imu.gyro_frd,
    )
    force = (a + share * (fx - a), b + share * (fy - b), c + share * (fz - c))
    rates = (p + share * (gx - p), q + share * (gy - q), r + share * (gz - r))
    lagged = (*force, *rates)
    motion = tuple([old + new for old, new in zip(block.motion, (*lagged, *velocity), strict=True)])
    at_fans = parts.at_fans
    effects = parts.effects
    vanes = vanes_us
    if block.at_fans is not None and block.effects is not None:
        at_fans = block.at_fans + at_fans
        if effects.size:
            effects = block.effects + effects
        vanes = tuple([a + b for a, b in zip(block.vanes_us, vanes_us, strict=True)])
    tip_m_s = block.tip_m_s + parts.tip_m_s
    return Block(
        start_s=block.start_s,
        end_s=imu.t_s,
        lagged=lagged,
        rates_at_start=block.rates_at_start,
        samples=block.samples + 1,
        motion=motion,
        vanes_us=vanes,
        at_fans=at_fans,
        effects=effects,
        tip_m_s=tip_m_s,
    )


@dataclass(frozen=True, slots=True)
class BlockResidual:
    """One block: ``residual`` (5,) with all sizes as modelled, ``regressors`` (5, n), ``modelled`` (5,)."""

    residual: Array
    regressors: Array
    modelled: Array


def block_residual(
    block: Block,
    vehicle: Vehicle,
    rotation: Rows,
    bearing_rad: float,
    sizes: int,
    wind_ne: tuple[float, float] = (0.0, 0.0),
) -> BlockResidual:
    """The residual of a full block. ``rotation`` FRD -> NED and the wall's bearing at its end; ``wind_ne`` as believed
    [m/s]."""
    assert block.at_fans is not None
    assert block.effects is not None
    share = 1.0 / block.samples
    near, free = (block.at_fans * share).tolist()
    above = [
        [x - y for x, y in zip(one, alone, strict=True)]
        for one, alone in zip(near, free, strict=True)
    ]
    lift, pull, tilt = about_cg(vehicle, above, bearing_rad)
    alone = [a + b + c for a, b, c in zip(*about_cg(vehicle, free, bearing_rad), strict=True)]
    effects = (block.effects * share).tolist()
    declared = alone[2] + sum([effect[2] for effect in effects])
    modelled = [sum(column) for column in zip(lift, pull, tilt, alone, *effects, strict=True)][
        :AXES
    ]
    if vehicle.vanes:
        of_vanes = vanes_wrench(
            vehicle, [v * share for v in block.vanes_us], [fan[2] for fan in near]
        )
        declared += of_vanes[2]
        modelled = [a + b for a, b in zip(modelled, of_vanes, strict=False)]
    seen = measured(block, vehicle)
    if not vehicle.vanes and abs(alone[3]) + abs(alone[4]) < _EQUAL * vehicle.mass_kg:
        seen = [*seen[:3], math.nan, math.nan]
    rows = [
        [a, b, c, *[0.0] * (sizes - at.THRUST)]
        for a, b, c in zip(lift[:AXES], pull, tilt, strict=False)
    ]
    for k, effect in enumerate(effects, at.FIRST_EFFECT):
        for row, value in zip(rows, effect, strict=False):
            row[k] = value
    velocity = _through_the_air([v * share for v in block.motion[6:]], rotation, wind_ne)
    _common(
        out=rows,
        vehicle=vehicle,
        rotation=rotation,
        velocity=velocity,
        free=alone,
        lifted=declared,
        tip_m_s=block.tip_m_s * share,
    )
    residual = [a - b for a, b in zip(seen, modelled, strict=True)]
    return BlockResidual(np.array(residual), np.array(rows), np.array(modelled))


def measured(block: Block, vehicle: Vehicle) -> list[float]:
    """(5,): the wrench of the air that the accelerometer and the gyro of a block tell."""
    share = 1.0 / block.samples
    seconds = block.end_s - block.start_s
    mean = [v * share for v in block.motion[:6]]
    change = [
        (last - first) / seconds
        for first, last in zip(block.rates_at_start, block.lagged[3:], strict=True)
    ]
    motion = [*mean, *change, vehicle.mass_kg, *vehicle.inertia_kgm2]
    return list(wrench_of_motion(*motion)[:AXES])


def _through_the_air(
    velocity: Sequence[float], rotation: Rows, wind_ne: tuple[float, float]
) -> list[float]:
    """Along x and y over ground, along the rotors' axis through the air; ``velocity`` and ``wind_ne`` NED [m/s]."""
    (xn, yn, zn), (xe, ye, ze), (xd, yd, zd) = rotation
    (n, e, d), (north, east) = velocity, wind_ne
    return [
        n * xn + e * xe + d * xd,
        n * yn + e * ye + d * yd,
        (n - north) * zn + (e - east) * ze + d * zd,
    ]


def _common(
    out: list[list[float]],
    vehicle: Vehicle,
    rotation: Rows,
    velocity: list[float],
    free: list[float],
    lifted: float,
    tip_m_s: float,
) -> None:
    """Fill in the columns of the sizes that every vehicle has; the catalogue's regressors (see the tests).

    ``velocity``: along x and y over ground, along the rotors' axis through the air. ``lifted``: declared vertical force
    of rotors and vanes in free air, body FRD.
    """
    fx, fy, fz, mx, my = out
    lift = max(-free[2], 0.0)
    fz[at.THRUST] = free[2]
    flow = mass_flow(vehicle, lift)
    above = mean_height(vehicle)
    radius = vehicle.rotor_radius_m
    for column, (x, y, _) in ((at.NORTH, rotation[0]), (at.EAST, rotation[1])):
        fx[column] = flow * x
        fy[column] = flow * y
        # Acts at the fans: their height about the CG.
        mx[column] = -above * flow * y
        my[column] = above * flow * x
    my[at.CG_X] = lifted
    mx[at.CG_Y] = -lifted
    vx, vy, vz = velocity
    x = -flow * vx
    y = -flow * vy
    fx[at.DRAG] = x
    fy[at.DRAG] = y
    mx[at.DRAG] = -above * y
    my[at.DRAG] = above * x
    mx[at.DRAG_ARM] = radius * y
    my[at.DRAG_ARM] = -radius * x
    fz[at.INFLOW] = -lift * vz / max(tip_m_s, 1.0)


def mass_flow(vehicle: Vehicle, lift_n: float) -> float:
    """Sum over the fans of momentum theory's mass flow in hover, sqrt(rho A T) [kg/s], at equal lift."""
    fans = len(vehicle.fans)
    return fans * math.sqrt(RHO_SEA_LEVEL * vehicle.disc_area_m2 * lift_n / fans)


@lru_cache(maxsize=8)
def mean_height(vehicle: Vehicle) -> float:
    """Body z of the fans' reference points, averaged [m]."""
    return float(vehicle.fan_positions_m[:, 2].mean())


@lru_cache(maxsize=8)
def _vane_units(vehicle: Vehicle) -> list[list[float]]:
    """(vanes, 6): wrench about the CG per radian of each vane and newton of its fan's lift."""
    force = []
    for vane in vehicle.vanes:
        force.append((*(vane.force_per_thrust_rad * c for c in vane.axis), 0.0, 0.0, 0.0))
    out: list[list[float]] = at_cg(
        np.array(force), np.array([vane.position_m for vane in vehicle.vanes])
    ).tolist()
    return out


def vanes_wrench(
    vehicle: Vehicle, outputs_us: Sequence[float], fan_lift_n: Sequence[float]
) -> list[float]:
    """(6,): ``models.vehicle_wrench.vane_wrench`` for ``vane_outputs`` or their mean, and lifts (fans,) [N].

    NaN in the axes of a vane whose output is NaN.
    """
    out = [0.0] * 6
    for output_us, vane, unit in zip(outputs_us, vehicle.vanes, _vane_units(vehicle), strict=True):
        load = vane.rad_per_us * (output_us - vane.neutral_us) * fan_lift_n[vane.fan - 1]
        out = [v + load * u if u else v for v, u in zip(out, unit, strict=True)]
    return out


def vane_outputs(vehicle: Vehicle, pwm_us: Sequence[float]) -> tuple[float, ...]:
    """Of every vane's servo [us]; NaN where it is not known."""
    return tuple([pwm_us[vane.servo - 1] or math.nan for vane in vehicle.vanes])
