"""A block of flight: sums over the samples of the accelerometer, and the wrench that its motion tells."""

from __future__ import annotations

from typing import NamedTuple

from companion.disturbance.records import Parts
from companion.mavlink.samples import Imu
from models.common.frames import Array, wrench_of_motion
from models.vehicle import Vector3, Vehicle

IMU_LAG_S = 0.03
"""The accelerometer is delayed by this, which is how late rotor speeds are."""
BLOCK_S = 0.2
"""Measured and modelled wrench are averaged over this: the one filter that both go through."""
AXES = 5
"""Fx Fy Fz Mx My: no size acts by the yaw moment."""


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
    """The block with one sample more; ``vanes_us`` as ``vane_outputs`` has them, ``velocity`` NED.

    The lag is of first order, x = x + dt / (tau + dt) (u - x).
    """
    share = (imu.t_s - block.end_s) / (IMU_LAG_S + imu.t_s - block.end_s)
    felt = (*imu.specific_force_frd, *imu.gyro_frd)
    lagged = tuple([x + share * (u - x) for x, u in zip(block.lagged, felt, strict=True)])
    motion = tuple([old + new for old, new in zip(block.motion, (*lagged, *velocity), strict=True)])
    at_fans = parts.at_fans
    effects = parts.effects
    vanes = vanes_us
    if block.at_fans is not None and block.effects is not None:
        at_fans = block.at_fans + at_fans
        if effects.size:
            effects = block.effects + effects
        vanes = tuple([a + b for a, b in zip(block.vanes_us, vanes_us, strict=True)])
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
        tip_m_s=block.tip_m_s + parts.tip_m_s,
    )


def measured(block: Block, vehicle: Vehicle) -> list[float]:
    """(5,): the wrench of the air that the accelerometer and the gyro of a block tell, body FRD."""
    share = 1.0 / block.samples
    seconds = block.end_s - block.start_s
    mean = [v * share for v in block.motion[:6]]
    change = [
        (last - first) / seconds
        for first, last in zip(block.rates_at_start, block.lagged[3:], strict=True)
    ]
    motion = [*mean, *change, vehicle.mass_kg, *vehicle.inertia_kgm2]
    return list(wrench_of_motion(*motion)[:AXES])
