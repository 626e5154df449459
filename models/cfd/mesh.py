"""The block mesh of one case: a fan of rings around the axis, a box around the rings, Cartesian blocks around the box.

The table of points of ``meridian`` is turned about the axis. Around the axis lies a core of quadrilaterals: cells that
collapse onto the axis let a jet of twice the fan's own speed grow there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from models.cfd.blocks import Blocks
from models.cfd.config import Setup
from models.cfd.meridian import CURVE_POINTS, KINDS, LOWER_ROW, SOLID, UPPER_ROW, Meridian, both_ends, growing
from models.cfd.position import Position
from models.frames import Array

# A wall closer to the box than this (over R) becomes the box's side: a thinner strip would have flat cells.
BOX_MERGE = 0.6
# Radius of the core over the hub's; chosen.
CORE = 0.5


def block_mesh(setup: Setup, position: Position) -> str:
    """Content of the mesh dictionary, lengths in m, corner frame (x to the wall, z up)."""
    return _Builder(setup, position).build()


class _Builder:
    """One case's geometry; see ``block_mesh``."""

    def __init__(self, setup: Setup, position: Position) -> None:
        fan, mesh = setup.fan, setup.mesh
        self.setup, self.position, self.out = setup, position, Blocks()
        self.meridian = Meridian(setup, position)
        self.n, self.rows = self.meridian.n, self.meridian.rows
        # The box: to the wall where it is near.
        wall = fan.lip_radius + position.d
        self.box_right = wall if wall < mesh.box + BOX_MERGE else mesh.box
        self.right = wall if math.isfinite(wall) else mesh.far
        corner = math.atan2(mesh.box, self.box_right)
        half = [0.0, corner, 0.75 * math.pi, math.pi]
        self.angles = half if not position.swirl else [*half, 1.25 * math.pi, 2 * math.pi - corner, 2 * math.pi]
        self.scale_m = self.meridian.scale_m
        # Sides of a core that face each other need equal counts.
        self.around = self.n(mesh.azimuth / 3)

    def build(self) -> str:
        sectors = list(zip(self.angles[:-1], self.angles[1:], strict=True))
        for a, b in sectors:
            for row in range(7):
                self._rings(row, a, b)
        for row in (0, 1, 5, 6):
            self._core(row, self.angles[:4])
            if self.position.swirl:
                self._core(row, self.angles[3:])
        for row in range(7):
            for side in (1.0,) if not self.position.swirl else (1.0, -1.0):
                self._outside(row, side)
        return self.out.text(KINDS)

    # Points

    def _on_circle(self, row: int, radius: float, angle: float) -> int:
        return self._cartesian(row, radius * math.cos(angle), radius * math.sin(angle))

    def _on_box(self, row: int, angle: float) -> int:
        c, s = math.cos(angle), math.sin(angle)
        box = self.setup.mesh.box
        x = self.box_right if c > 0 else -box
        # Only the mirror plane's two points and the four corners occur.
        y = 0.0 if abs(s) < 1e-9 else math.copysign(box, s)
        return self._cartesian(row, x, y)

    def _cartesian(self, row: int, x: float, y: float) -> int:
        m = self.scale_m
        return self.out.vertex((m * x, m * y, m * self.meridian.z[row]))

    # Core and rings

    def _core(self, row: int, angles: Sequence[float]) -> None:
        """The quadrilateral of one half, above or below the hub."""
        radius = CORE * self.setup.fan.hub_radius
        lo, hi = ([self._on_circle(row + k, radius, t) for t in angles] for k in (0, 1))
        self.out.block(
            [*lo, *hi], "", [self.around, self.around, self.rows[row]], ["1", "1", self.meridian.grade_z(row)]
        )
        if row == 0:
            self.out.face(self.meridian.bottom, lo)
        if row == 6:
            self.out.face("far", hi)
        if row in (1, 5):
            self.out.face("hub", hi if row == 1 else lo)
        if not self.position.swirl:
            self.out.face("mirror", [lo[3], lo[0], hi[0], hi[3]])

    def _rings(self, row: int, a: float, b: float) -> None:
        """The four blocks of one sector in one row: hub, bore, lip column, ring to the box."""
        mesh = self.setup.mesh
        hub = np.full(8, self.setup.fan.hub_radius)
        radii = [CORE * hub, hub, self.meridian.bore, self.meridian.skin]
        counts = [self.n(mesh.hub), self.n(mesh.bore), self.n(mesh.lip), self.n(mesh.ring)]
        grade_z = self.meridian.grade_z(row)
        for column in range(4):
            if row in SOLID.get(column, ()):
                continue
            lo, hi = (self._corners(row + k, column, a, b, radii) for k in (0, 1))
            zone = ""
            if column == 1 and row in (LOWER_ROW, UPPER_ROW):
                zone = "lowerDisc" if row == LOWER_ROW else "upperDisc"
            grade_r = self._grade_r(column)
            self.out.block([*lo, *hi], zone, [counts[column], self.around, self.rows[row]], [grade_r, "1", grade_z])
            for k, r in enumerate((row, row + 1)):
                corners = (lo, hi)[k]
                if column < 3:
                    self._arc(corners[1], corners[2], r, radii[column + 1][r], a, b)
                if column > 0:
                    self._arc(corners[0], corners[3], r, radii[column][r], a, b)
            self._curves(row, column, (a, b), lo, hi)
            self._ring_patches(row, column, lo, hi)
        if not self.position.swirl:
            self._mirror_rings(row, a, b, radii)

    def _corners(self, r: int, column: int, a: float, b: float, radii: Sequence[Array]) -> list[int]:
        inner = [self._on_circle(r, radii[column][r], t) for t in (a, b)]
        if column == 3:
            outer = [self._on_box(r, t) for t in (a, b)]
        else:
            outer = [self._on_circle(r, radii[column + 1][r], t) for t in (a, b)]
        return [inner[0], outer[0], outer[1], inner[1]]

    def _arc(self, p: int, q: int, row: int, radius: float, a: float, b: float) -> None:
        t = np.linspace(a, b, CURVE_POINTS + 2)[1:-1]
        m = self.scale_m
        points = np.column_stack(
            [m * radius * np.cos(t), m * radius * np.sin(t), np.full_like(t, m * self.meridian.z[row])]
        )
        self.out.curve(p, q, points)

    def _curves(self, row: int, column: int, angles: tuple[float, float], lo: list[int], hi: list[int]) -> None:
        """The lip: its inner and outer eighths belong to row 5, the cap to the column of row 6."""
        line = self.meridian
        for k, angle in enumerate(angles):
            near, far = (0, 1) if k == 0 else (3, 2)
            if row == 5 and column == 1:
                self.out.turned(lo[far], hi[far], line.flank(outer=False), angle, self.scale_m)
            elif row == 5 and column == 3:
                self.out.turned(lo[near], hi[near], line.flank(outer=True), angle, self.scale_m)
            elif row == 6 and column == 2:
                self.out.turned(lo[near], lo[far], line.cap(), angle, self.scale_m)

    def _ring_patches(self, row: int, column: int, lo: list[int], hi: list[int]) -> None:
        sides = {"low": lo, "high": hi, "inner": [lo[0], lo[3], hi[3], hi[0]], "outer": [lo[1], hi[1], hi[2], lo[2]]}
        for side, name in self.meridian.patch(row, column).items():
            self.out.face(name, sides[side])
        if column == 3 and self._box_is_wall and self._faces_wall(lo):
            self.out.face("wall", sides["outer"])

    def _mirror_rings(self, row: int, a: float, b: float, radii: Sequence[Array]) -> None:
        for angle in (a, b):
            if abs(math.sin(angle)) > 1e-9:
                continue
            for column in range(4):
                if row in SOLID.get(column, ()):
                    continue
                lo, hi = (self._corners(row + k, column, angle, angle, radii) for k in (0, 1))
                self.out.face("mirror", [lo[0], lo[1], hi[1], hi[0]])

    @property
    def _box_is_wall(self) -> bool:
        return self.box_right == self.right and math.isfinite(self.position.d)

    def _faces_wall(self, lo: list[int]) -> bool:
        x = self.scale_m * self.box_right
        return all(abs(self.out.vertices[v][0] - x) < 1e-9 for v in lo[1:3])

    # Grading

    def _grade_r(self, column: int) -> str:
        return both_ends(3.0) if column == 3 and self._box_is_wall else self.meridian.grade_r(column)

    # Outside the box

    def _outside(self, row: int, side: float) -> None:
        mesh = self.setup.mesh
        box, far = mesh.box, mesh.far
        n_outer = self.n(mesh.outer)
        middle = (-box, self.box_right, self.around, "1")
        left = (-far, -box, n_outer, growing(far - box, n_outer, 0.2, downwards=True))
        columns = [left, middle]
        if self.right > self.box_right:
            room = self.right - self.box_right
            cells = max(3, round(n_outer * min(1.0, 0.35 + 0.65 * room / (far - box))))
            if math.isfinite(self.position.d):
                columns.append((self.box_right, self.right, cells, both_ends(2.0)))
            else:
                columns.append((self.box_right, self.right, cells, growing(room, cells, 0.2)))
        for x0, x1, nx, gx in columns:
            inner = (x0, x1) == (-box, self.box_right)
            if not inner:
                self._cuboid(row, (x0, x1), (0.0, side * box), (nx, self.around), (gx, "1"))
            self._cuboid(row, (x0, x1), (side * box, side * far), (nx, n_outer), (gx, growing(far - box, n_outer, 0.2)))

    def _cuboid(
        self,
        row: int,
        x: tuple[float, float],
        y: tuple[float, float],
        cells: tuple[int, int],
        grading: tuple[str, str],
    ) -> None:
        (x0, x1), (y0, y1) = x, y
        lo, hi = (
            [self._cartesian(row + k, px, py) for px, py in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))] for k in (0, 1)
        )
        if y1 > y0:
            order, n, g = [0, 1, 2, 3], (cells[0], cells[1]), (grading[0], grading[1])
        else:
            # Mirrored side: y runs first so that the block stays right-handed.
            order, n, g = [0, 3, 2, 1], (cells[1], cells[0]), (grading[1], grading[0])
        corners = [*(lo[i] for i in order), *(hi[i] for i in order)]
        self.out.block(corners, "", [*n, self.rows[row]], [*g, self.meridian.grade_z(row)])
        if row == 0:
            self.out.face(self.meridian.bottom, lo)
        if row == 6:
            self.out.face("far", hi)
        if abs(x0) == self.setup.mesh.far and x0 < 0:
            self.out.face("far", [lo[0], lo[3], hi[3], hi[0]])
        if x1 == self.right:
            self.out.face("wall" if math.isfinite(self.position.d) else "far", [lo[1], lo[2], hi[2], hi[1]])
        if abs(y1) == self.setup.mesh.far:
            self.out.face("far", [lo[3], lo[2], hi[2], hi[3]])
        if y0 == 0.0 and not self.position.swirl:
            self.out.face("mirror", [lo[0], lo[1], hi[1], hi[0]])
