"""The block mesh of one case: a fan of rings around the axis, a box around the rings, Cartesian blocks around the box.

The table of points of ``meridian`` is turned about the axis. Around the axis lies a core of quadrilaterals: cells that
collapse onto the axis let a jet of twice the fan's own speed grow there.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from models.cfd.blocks import Blocks
from models.cfd.config import Setup
from models.cfd.meridian import (
    CURVE_POINTS,
    LOWER_ROW,
    SOLID,
    UPPER_ROW,
    Meridian,
    both_ends,
    growing,
)
from models.cfd.position import Position
from models.common.frames import Array

# A wall closer to the box than this (over R) becomes the box's side: a thinner strip would have flat cells.
BOX_MERGE = 0.6
# Radius of the core over the hub's; chosen.
CORE = 0.5
# Type of each patch.
KINDS = dict.fromkeys(("ground", "wall", "duct", "hub"), "wall;") | {
    "far": "patch;",
    "mirror": "symmetryPlane;",
}
# Sides of a block by its corners: bottom, top and the four around. The solver takes any order, of
# patches too; these are those of the files from which the shipped cases were computed.
ENDS = ((0, 1, 2, 3), (4, 5, 6, 7))
RING_SIDES = (*ENDS, (0, 3, 7, 4), (1, 5, 6, 2), (0, 1, 5, 4), (3, 2, 6, 7))
CORE_SIDES = (*ENDS, (3, 0, 4, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6))
CUBOID_SIDES = (*ENDS, (0, 3, 7, 4), (1, 2, 6, 5), (3, 2, 6, 7), (0, 1, 5, 4))


def block_mesh(setup: Setup, position: Position) -> str:
    """Content of the mesh dictionary, lengths in m, corner frame (x to the wall, z up)."""
    return _Builder(setup, position).build()


class _Builder:
    """One case's geometry; see ``block_mesh``."""

    def __init__(self, setup: Setup, position: Position) -> None:
        fan = setup.fan
        mesh = setup.mesh
        self.setup = setup
        self.position = position
        self.out = Blocks()
        self.meridian = Meridian(setup, position)
        self.n = self.meridian.n
        self.rows = self.meridian.rows
        self.grade_z = self.meridian.grade_z
        hub = np.full(8, fan.hub_radius)
        self.radii = [CORE * hub, hub, self.meridian.bore, self.meridian.skin]
        # The box: to the wall where it is near.
        wall = fan.lip_radius + position.d
        self.wall_at_box = wall < mesh.box + BOX_MERGE
        self.box_right = wall if self.wall_at_box else mesh.box
        self.right = wall if math.isfinite(wall) else mesh.far
        corner = math.atan2(mesh.box, self.box_right)
        self.angles = [0.0, corner, 0.75 * math.pi, math.pi]
        if position.swirl:
            self.angles += [1.25 * math.pi, 2 * math.pi - corner, 2 * math.pi]
        self.scale_m = fan.radius_m
        # Sides of a core that face each other need equal counts.
        self.around = self.n(mesh.azimuth / 3)

    def build(self) -> str:
        halves = [1.0]
        if self.position.swirl:
            halves.append(-1.0)
        for a, b in itertools.pairwise(self.angles):
            for row, column in itertools.product(range(7), range(4)):
                if row not in SOLID.get(column, ()):
                    self._ring(row, column, a, b)
        for row in (0, 1, 5, 6):
            for half in range(len(halves)):
                self._core(row, self.angles[3 * half : 3 * half + 4])
        for row, side in itertools.product(range(7), halves):
            self._outside(row, side)
        patches = [self._bottom, "duct", "mirror", "hub", "far", "wall"]
        if self.wall_at_box:
            patches.insert(2, "wall")
        return self.out.text(self._patch, {name: KINDS[name] for name in patches})

    @property
    def _bottom(self) -> str:
        if math.isfinite(self.position.h):
            return "ground"
        return "far"

    def _patch(self, points: Array) -> str:
        """Patch on which an outer face with these points (4, 3) in m lies."""
        far = self.setup.mesh.far
        z = self.meridian.z

        def at(axis: int, place: float) -> bool:
            return np.allclose(points[:, axis], self.scale_m * place, rtol=0.0, atol=1e-9)

        if at(2, z[0]):
            return self._bottom
        if at(0, self.right) and math.isfinite(self.position.d):
            return "wall"
        if at(2, z[7]) or at(0, self.right) or at(0, -far) or at(1, far) or at(1, -far):
            return "far"
        if at(1, 0.0):
            return "mirror"
        hub_m = self.scale_m * self.setup.fan.hub_radius
        if np.hypot(points[:, 0], points[:, 1]).max() < hub_m + 1e-9:
            return "hub"
        return "duct"

    # Points

    def _on_circle(self, row: int, radius: float, angle: float) -> int:
        return self._cartesian(row, radius * math.cos(angle), radius * math.sin(angle))

    def _on_box(self, row: int, angle: float) -> int:
        s = math.sin(angle)
        box = self.setup.mesh.box
        x = self.box_right if math.cos(angle) > 0 else -box
        # Only the mirror plane's two points and the four corners occur.
        y = 0.0 if abs(s) < 1e-9 else math.copysign(box, s)
        return self._cartesian(row, x, y)

    def _cartesian(self, row: int, x: float, y: float) -> int:
        m = self.scale_m
        return self.out.vertex((m * x, m * y, m * self.meridian.z[row]))

    # Core and rings

    def _core(self, row: int, angles: Sequence[float]) -> None:
        """The quadrilateral of one half, above or below the hub."""
        corners = []
        for r in (row, row + 1):
            for t in angles:
                corners.append(self._on_circle(r, self.radii[0][r], t))
        cells = [self.around, self.around, self.rows[row]]
        self.out.block(corners, "", cells, ["1", "1", self.grade_z(row)])
        self.out.sides(corners, CORE_SIDES)

    def _ring(self, row: int, column: int, a: float, b: float) -> None:
        """One block between two angles: from core to hub, hub to bore, bore to skin or skin to box."""
        mesh = self.setup.mesh
        lo = self._corners(row, column, a, b)
        hi = self._corners(row + 1, column, a, b)
        zone = ""
        if column == 1:
            zone = {LOWER_ROW: "lowerDisc", UPPER_ROW: "upperDisc"}.get(row, "")
        grade_r = self.meridian.grade_r(column)
        if column == 3 and self.wall_at_box:
            grade_r = both_ends(3.0)
        counts = (mesh.hub, mesh.bore, mesh.lip, mesh.ring)
        cells = [self.n(counts[column]), self.around, self.rows[row]]
        self.out.block([*lo, *hi], zone, cells, [grade_r, "1", self.grade_z(row)])
        self.out.sides([*lo, *hi], RING_SIDES)
        for corners, r in ((lo, row), (hi, row + 1)):
            if column < 3:
                self._arc(corners[1], corners[2], r, column + 1, a, b)
            if column > 0:
                self._arc(corners[0], corners[3], r, column, a, b)
        self._lip(row, column, (a, b), lo, hi)

    def _corners(self, r: int, column: int, a: float, b: float) -> list[int]:
        inner = self.radii[column][r]
        near_a = self._on_circle(r, inner, a)
        near_b = self._on_circle(r, inner, b)
        if column == 3:
            return [near_a, self._on_box(r, a), self._on_box(r, b), near_b]
        outer = self.radii[column + 1][r]
        return [near_a, self._on_circle(r, outer, a), self._on_circle(r, outer, b), near_b]

    def _arc(self, p: int, q: int, row: int, line: int, a: float, b: float) -> None:
        radius = self.scale_m * self.radii[line][row]
        z = self.scale_m * self.meridian.z[row]
        angle = np.linspace(a, b, CURVE_POINTS + 2)[1:-1]
        self.out.curve(p, q, radius, z, angle)

    def _lip(
        self, row: int, column: int, angles: tuple[float, float], lo: list[int], hi: list[int]
    ) -> None:
        """The lip: its inner and outer eighths belong to row 5, the cap to the column of row 6."""
        line = self.meridian
        for angle, near, far in zip(angles, (0, 3), (1, 2), strict=True):
            if (row, column) == (5, 1):
                ends = (lo[far], hi[far])
                points = line.flank(outer=False)
            elif (row, column) == (5, 3):
                ends = (lo[near], hi[near])
                points = line.flank(outer=True)
            elif (row, column) == (6, 2):
                ends = (lo[near], lo[far])
                points = line.cap()
            else:
                return
            radius, z = self.scale_m * points.T
            self.out.curve(*ends, radius, z, angle)

    # Outside the box

    def _outside(self, row: int, side: float) -> None:
        mesh = self.setup.mesh
        box = mesh.box
        far = mesh.far
        n_outer = self.n(mesh.outer)
        across = growing(far - box, n_outer, 0.2)
        columns = [
            (-far, -box, n_outer, growing(far - box, n_outer, 0.2, downwards=True)),
            (-box, self.box_right, self.around, "1"),
        ]
        if self.right > self.box_right:
            room = self.right - self.box_right
            share = min(1.0, 0.35 + 0.65 * room / (far - box))
            cells = max(3, round(n_outer * share))
            grading = both_ends(2.0)
            if math.isinf(self.position.d):
                grading = growing(room, cells, 0.2)
            columns.append((self.box_right, self.right, cells, grading))
        for k, (x0, x1, nx, gx) in enumerate(columns):
            if k != 1:
                self._cuboid(row, (x0, x1), (0.0, side * box), (nx, self.around), (gx, "1"))
            self._cuboid(row, (x0, x1), (side * box, side * far), (nx, n_outer), (gx, across))

    def _cuboid(
        self,
        row: int,
        x: tuple[float, float],
        y: tuple[float, float],
        cells: tuple[int, int],
        grading: tuple[str, str],
    ) -> None:
        x0, x1 = x
        y0, y1 = y
        corners = []
        for r in (row, row + 1):
            for place in ((x0, y0), (x1, y0), (x1, y1), (x0, y1)):
                corners.append(self._cartesian(r, *place))
        order = [0, 1, 2, 3, 4, 5, 6, 7]
        step = 1
        if y1 < y0:
            # Mirrored side: y runs first so that the block stays right-handed.
            order = [0, 3, 2, 1, 4, 7, 6, 5]
            step = -1
        self.out.block(
            [corners[i] for i in order],
            "",
            [*cells[::step], self.rows[row]],
            [*grading[::step], self.grade_z(row)],
        )
        self.out.sides(corners, CUBOID_SIDES)
