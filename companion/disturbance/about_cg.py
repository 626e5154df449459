"""Wrenches at the fans as one about the centre of gravity."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from models.vehicle import Vehicle


def about_cg(
    vehicle: Vehicle, at_fans: Iterable[Sequence[float]], bearing_rad: float
) -> list[list[float]]:
    """Lift, pull and tilt (3, 6), body FRD about the CG, of wrenches at the fans (fans, 6), corner frame.

    Vertical forces make the lift, level ones the pull; both act at their fans, so their moments belong to them. As
    ``models.common.frames.corner_to_body`` and ``at_cg`` have it for arrays.
    """
    c = math.cos(bearing_rad)
    s = math.sin(bearing_rad)
    lz = lx = ly = px = py = pmx = pmy = pmz = tx = ty = tz = 0.0
    for fan, (x, y, lift, roll, pitch, yaw) in zip(vehicle.fans, at_fans, strict=True):
        ax, ay, az = fan.position_m
        north = c * x + s * y
        east = s * x - c * y
        lz = lz - lift
        lx = lx - ay * lift
        ly = ly + ax * lift
        px = px + north
        py = py + east
        pmx = pmx - az * east
        pmy = pmy + az * north
        pmz = pmz + ax * east - ay * north
        tx = tx + c * roll + s * pitch
        ty = ty + s * roll - c * pitch
        tz = tz - yaw
    return [[0.0, 0.0, lz, lx, ly, 0.0], [px, py, 0.0, pmx, pmy, pmz], [0.0, 0.0, 0.0, tx, ty, tz]]
