"""The wrench of one simulated fan by cause, about the CG in body FRD: near walls, in its own turbulence, moving.

Plain floats, called hundreds of times per simulated second. A wrench is (Fx, Fy, Fz, Mx, My, Mz) in N and N m.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from companion.sim.air import Increments

Vec = tuple[float, float, float]
Wrench6 = tuple[float, float, float, float, float, float]
ZERO6: Wrench6 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

INFLOW_PER_M_S = 0.062
"""Share of its thrust that a rotor gains per m/s of sinking and loses per m/s of climbing [s/m]: a choice, of the size
that blade-element momentum theory gives (Leishman 2006, ch. 3); the surrogate does not hold it."""
LEVEL_SHARE = 0.33
"""Unsteady side force over unsteady lift, and unsteady tilting moment over it times radius [1]: a choice, so that the
noise is not along the rotor axis alone."""
YAW_SHARE = 0.3
"""Unsteady yaw moment over unsteady tilting moment [1]: a choice."""
DRAG_ARM_RADII = 0.75
"""Momentum drag acts this far above the fan's reference point [rotor radii]: where a duct's inlet takes the air in."""


@dataclass(frozen=True, kw_only=True)
class SimFan:
    """A fan prepared for the inner loop: reference point from the CG [m], lip radius [m], indices of its rotors."""

    x: float
    y: float
    z: float
    lip: float
    rotors: tuple[int, ...]
    ct: float
    cq_torque: tuple[float, ...]
    """N m per rpm^2 and rotor, signed: the reaction on the body."""
    net_torque: float
    """N m per rpm^2 of a whole fan: scale of the law's unbalanced torque."""


def added(a: Wrench6, b: Wrench6) -> Wrench6:
    """Sum of two wrenches about one point."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5])


def wrench_of(force: Vec, at: Vec) -> Wrench6:
    """A force at a place, as a wrench about the CG."""
    (fx, fy, fz), (x, y, z) = force, at
    return (fx, fy, fz, y * fz - z * fy, z * fx - x * fz, x * fy - y * fx)


def corner_wrench(
    fan: SimFan, lift: float, square: float, inc: Increments, radius: float, cb: float, sb: float
) -> Wrench6:
    """What ground and wall add: increments in the corner frame, turned to the body, moved to the CG.

    ``lift``: of the fan in free air [N]; ``square``: mean square of its rotor speeds [rpm^2]; ``cb``, ``sb``: cosine
    and sine of the wall's bearing in the body frame.
    """
    a = lift * inc.x
    b = lift * inc.y
    c = lift * inc.z
    ma = lift * radius * inc.mx
    mb = lift * radius * inc.my
    fx = cb * a + sb * b
    fy = sb * a - cb * b
    fz = -c
    return (
        fx,
        fy,
        fz,
        cb * ma + sb * mb + fan.y * fz - fan.z * fy,
        sb * ma - cb * mb + fan.z * fx - fan.x * fz,
        fan.x * fy - fan.y * fx - fan.net_torque * square * inc.mz,
    )


def unsteady_wrench(
    fan: SimFan, scale: float, noise: Sequence[float], first: int, radius: float
) -> Wrench6:
    """Turbulence: ``scale`` is the RMS of the lift [N]; six numbers of ``noise`` from ``first`` on."""
    level = LEVEL_SHARE * scale
    fx = level * noise[first]
    fy = level * noise[first + 1]
    fz = -scale * noise[first + 2]
    moment = level * radius
    return (
        fx,
        fy,
        fz,
        moment * noise[first + 3] + fan.y * fz - fan.z * fy,
        moment * noise[first + 4] + fan.z * fx - fan.x * fz,
        YAW_SHARE * moment * noise[first + 5] + fan.x * fy - fan.y * fx,
    )


def momentum_drag(fan: SimFan, flow_kg_s: float, u: float, v: float, radius: float) -> Wrench6:
    """Drag of the air taken in: mass flow times velocity through the air (``u`` forward, ``v`` right) [m/s]."""
    arm = fan.z - DRAG_ARM_RADII * radius
    return wrench_of((-flow_kg_s * u, -flow_kg_s * v, 0.0), (fan.x, fan.y, arm))
