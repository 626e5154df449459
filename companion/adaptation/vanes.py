"""Wrench of the vanes, in plain floats: ``models.vehicle_wrench.vane_wrench`` for one block."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from models.common.frames import at_cg
from models.vehicle import Vehicle


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
    """(6,), body FRD about the CG, for ``vane_outputs`` or their mean, and lifts (fans,) [N].

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
