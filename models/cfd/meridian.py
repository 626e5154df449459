"""The fan cut through its axis: heights and radii of the mesh lines, cells along them and how the cells grow.

A table of points, rows (heights) by columns (radii), which every mesh turns about the axis. The column lines are the
hub, the bore and the outer skin of the duct; the row that meets the lip does so at 45 deg of its semicircle on either
side, so that no cell is flattened where the curve runs along a mesh line.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import brentq

from models.cfd.config import Setup
from models.cfd.position import Position
from models.common.frames import Array

UPPER_ROW = 4
LOWER_ROW = 2
"""Rows of cells (counted from the ground) that are the rotor discs."""
LAYERS = 3
"""Layers of cells in a disc: with one the source is unstable."""
# First cell at a wall or ground against the mean cell of its direction.
CLUSTER = 4.0
LIP_TURN = math.pi / 4
"""Angle of the points of the lip at which mesh lines leave it."""
# Points on a curved edge of a block.
CURVE_POINTS = 10
# Cells of duct and hub that are solid, by column (axis to hub, hub to bore, bore to skin, skin to box): the rows.
SOLID: dict[int, tuple[int, ...]] = {0: (2, 3, 4), 2: (1, 2, 3, 4, 5)}


class Meridian:
    """Lengths over R. ``z`` (8,) heights of the rows of points from the ground up, ``bore`` and ``skin`` (8,) radii."""

    def __init__(self, setup: Setup, position: Position) -> None:
        fan = setup.fan
        rotor = setup.rotor
        mesh = setup.mesh
        self.setup = setup
        self.position = position
        self.centre = fan.lip_foot
        self.lip = fan.lip_thickness / 2
        lower = (rotor.lower_height, rotor.lower_height + rotor.thickness)
        upper = (rotor.upper_height, rotor.upper_height + rotor.thickness)
        bottom = -position.h if math.isfinite(position.h) else -mesh.far_below
        # Row 6 lies at 45 deg of the lip.
        lip_z = self.centre + self.lip * math.sin(LIP_TURN)
        self.z = np.array([bottom, fan.exit_height, *lower, *upper, lip_z, mesh.far])
        self.bore, self.skin = self._column_radii()
        self.rows = self._row_cells()

    def n(self, count: float) -> int:
        """Cells at this case's level."""
        return max(2, round(count * self.position.level))

    def cap(self) -> Array:
        """Points (n, 2) over the top of the lip from 45 deg inside to 45 deg outside."""
        t = np.linspace(math.pi - LIP_TURN, LIP_TURN, 2 * CURVE_POINTS + 2)[1:-1]
        radius = 1 + self.lip + self.lip * np.cos(t)
        z = self.centre + self.lip * np.sin(t)
        return np.column_stack([radius, z])

    def flank(self, *, outer: bool) -> Array:
        """Points (n, 2) from the upper disc's height up the straight part and to 45 deg of the lip."""
        crest = 1 + self.lip
        reach = self.lip if outer else -self.lip
        start = np.array([self.skin[5] if outer else 1.0, self.z[5]])
        foot = np.array([crest + reach, self.centre])
        straight = np.linspace(0, 1, 6)[1:, None] * (foot - start) + start
        t = np.linspace(0, LIP_TURN, CURVE_POINTS + 1)[1:-1]
        radius = crest + reach * np.cos(t)
        z = self.centre + self.lip * np.sin(t)
        return np.concatenate([straight, np.column_stack([radius, z])])

    def grade_z(self, row: int) -> str:
        """Grading of a row's cells in height."""
        if row == 0 and math.isfinite(self.position.h):
            return both_ends(CLUSTER)
        if row == 0:
            return growing(self.z[1] - self.z[0], self.rows[0], 0.06, downwards=True)
        if row == 6:
            return growing(self.z[7] - self.z[6], self.rows[6], 0.05)
        return "1"

    def grade_r(self, column: int) -> str:
        """Grading of a column's cells in radius."""
        if column == 1:
            return "((0.3 0.25 1) (0.7 0.75 0.35))"
        if column == 3:
            return growing(self.setup.mesh.box - 1.3, self.n(self.setup.mesh.ring), 0.03)
        return "1"

    def _column_radii(self) -> tuple[Array, Array]:
        """Radii over R of the bore line and of the skin line at each row of points."""
        fan = self.setup.fan
        gone = self.lip * (1 - math.cos(LIP_TURN))
        bore = np.ones(8)
        skin = np.zeros(8)
        bore[1] = fan.exit_radius
        inside = (self.z > fan.exit_height) & (self.z < 0.0)
        above_exit = self.z[inside] - fan.exit_height
        narrower = (1 - fan.exit_radius) * above_exit / -fan.exit_height
        bore[inside] = fan.exit_radius + narrower
        along = (self.z[1:6] - fan.exit_height) / (self.centre - fan.exit_height)
        skin[1:6] = fan.exit_skin + along * (fan.lip_radius - fan.exit_skin)
        bore[6] = 1 + gone
        skin[6] = fan.lip_radius - gone
        # The lines open below the duct and above the lip.
        bore[0] = 0.97
        skin[0] = min(fan.exit_skin + 0.12, fan.lip_radius)
        bore[7] = 1.0
        skin[7] = fan.lip_radius
        return bore, skin

    def _row_cells(self) -> list[int]:
        mesh = self.setup.mesh
        gap = self.z[1] - self.z[0]
        # Few cells in a thin gap, the full number from 3 R on.
        below = mesh.below * min(1.0, 0.45 + 0.55 * gap / 3.0)
        duct = list(map(self.n, mesh.duct))
        duct[LOWER_ROW - 1] = duct[UPPER_ROW - 1] = LAYERS
        return [self.n(below), *duct, self.n(mesh.above)]


def both_ends(ratio: float) -> str:
    """Cells grow by ``ratio`` from either end to the middle."""
    return f"((0.5 0.5 {ratio:g}) (0.5 0.5 {1 / ratio:g}))"


def growing(length: float, cells: int, first: float, *, downwards: bool = False) -> str:
    """Expansion (last over first cell) for which the first of ``cells`` cells over ``length`` measures ``first``."""
    if first * cells >= length:
        return "1"
    places = np.arange(cells)
    ratio = brentq(lambda r: first * np.sum(r**places) - length, 1.0, 3.0)
    expansion = ratio ** (cells - 1)
    return f"{1 / expansion if downwards else expansion:.6g}"
