"""The mesh of the fan without a wall: a sector one cell wide, whose sides are one, stands for the whole turn."""

from __future__ import annotations

import math

import numpy as np

from models.cfd.blocks import Blocks
from models.cfd.config import Setup
from models.cfd.meridian import KINDS, LOWER_ROW, SOLID, UPPER_ROW, Meridian
from models.cfd.position import Position

HALF_ANGLE = math.radians(3.0)
"""Half of the sector; chosen."""
TURN = math.pi / HALF_ANGLE
"""Sectors in a turn."""
AXIS = "axis"
# The sector ends in a frictionless tube about the axis, radius over R: cells that collapse onto the axis blow up.
TUBE = 0.1


def wedge_mesh(setup: Setup, position: Position) -> str:
    """Content of the mesh dictionary, lengths in m; the sector lies about the x axis, z up."""
    line, out, mesh = Meridian(setup, position), Blocks(), setup.mesh
    even = np.ones(8)
    radii = [TUBE * even, setup.fan.hub_radius * even, line.bore, line.skin, mesh.box * even, mesh.far * even]
    cells = [line.n(c) for c in (2 * mesh.hub, mesh.bore, mesh.lip, mesh.ring, mesh.outer)]
    m = line.scale_m

    def point(row: int, radius: float, side: int) -> int:
        x, y = radius * math.cos(HALF_ANGLE), side * radius * math.sin(HALF_ANGLE)
        return out.vertex((m * x, m * y, m * line.height(row, radius)))

    for row in range(7):
        for column in range(5):
            if row in SOLID.get(column, ()):
                continue
            lo, hi = (
                [point(r, radii[column + k][r], side) for k, side in ((0, -1), (1, -1), (1, 1), (0, 1))]
                for r in (row, row + 1)
            )
            disc = {LOWER_ROW: "lowerDisc", UPPER_ROW: "upperDisc"}.get(row, "") if column == 1 else ""
            grading = [line.grade_r(column), "1", line.grade_z(row)]
            out.block([*lo, *hi], disc, [cells[column], 1, line.rows[row]], grading)
            sides = {
                "low": lo,
                "high": hi,
                "inner": [lo[0], lo[3], hi[3], hi[0]],
                "outer": [lo[1], hi[1], hi[2], lo[2]],
            }
            for side, name in line.patch(row, column).items():
                out.face(name, sides[side])
            if column == 0:
                out.face(AXIS, sides["inner"])
            if column == 4:
                out.face("far", sides["outer"])
            out.face("front", [lo[0], lo[1], hi[1], hi[0]])
            out.face("back", [lo[3], hi[3], hi[2], lo[2]])
            _curves(out, line, row, column, lo, hi)
    return out.text(KINDS)


def _curves(out: Blocks, line: Meridian, row: int, column: int, lo: list[int], hi: list[int]) -> None:
    fan = line.setup.fan
    for angle, near, far in ((-HALF_ANGLE, 0, 1), (HALF_ANGLE, 3, 2)):
        if row == UPPER_ROW + 1 and column == 0 and fan.hub_nose:
            out.turned(lo[near], lo[far], line.hub_end(row, TUBE), angle, line.scale_m)
        elif row == LOWER_ROW - 1 and column == 0 and fan.hub_tail:
            out.turned(hi[near], hi[far], line.hub_end(LOWER_ROW, TUBE), angle, line.scale_m)
        elif row == 5 and column == 1:
            out.turned(lo[far], hi[far], line.flank(outer=False), angle, line.scale_m)
        elif row == 5 and column == 3:
            out.turned(lo[near], hi[near], line.flank(outer=True), angle, line.scale_m)
        elif row == 6 and column == 2:
            out.turned(lo[near], lo[far], line.cap(), angle, line.scale_m)
