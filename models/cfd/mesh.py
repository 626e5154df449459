"""The block mesh of one case: a fan of rings around the axis, a box around the rings, Cartesian blocks around the box.

The meridian plane is a table of points, rows (heights) by columns (radii); every column is turned about the axis. The
column lines are the hub, the bore and the outer skin of the duct; the row that meets the lip does so at 45 deg of its
semicircle on either side, so that no cell is flattened where the curve runs along a mesh line. Around the axis lies a
core of quadrilaterals: cells that collapse onto the axis let a jet of twice the fan's own speed grow there.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from models.cfd.config import Setup
from models.cfd.position import Position
from models.frames import Array

UPPER_ROW, LOWER_ROW = 4, 2
"""Rows of cells (counted from the ground) that are the rotor discs."""
LAYERS = 3
# A wall or ground closer to the box than this becomes the box's side.
BOX_MERGE = 0.6
# First cell at a wall or ground against the mean cell of its direction.
CLUSTER = 4.0
CURVE_POINTS = 10
# Radius of the core over the hub's.
CORE = 0.5

Point = tuple[float, float, float]


@dataclass
class Blocks:
    """Collects vertices, curved edges, blocks and patches; writes the dictionary."""

    vertices: list[Point] = field(default_factory=list)
    index: dict[tuple[int, int, int], int] = field(default_factory=dict)
    blocks: list[str] = field(default_factory=list)
    edges: dict[tuple[int, int], str] = field(default_factory=dict)
    patches: dict[str, list[str]] = field(default_factory=dict)

    def vertex(self, p: Iterable[float]) -> int:
        """Number of the vertex at ``p``; one at a place."""
        x, y, z = (float(v) for v in p)
        key = (round(x * 1e7), round(y * 1e7), round(z * 1e7))
        if key not in self.index:
            self.index[key] = len(self.vertices)
            self.vertices.append((x, y, z))
        return self.index[key]

    def curve(self, a: int, b: int, points: Array) -> None:
        """A curved edge from ``a`` to ``b`` through ``points`` (n, 3)."""
        if a != b and (a, b) not in self.edges and (b, a) not in self.edges:
            inner = " ".join(_point(p) for p in points)
            self.edges[a, b] = f"polyLine {a} {b} ({inner})"

    def block(self, corners: Sequence[int], zone: str, cells: Sequence[int], grading: Sequence[str]) -> None:
        """One hexahedron, corners in the mesher's order."""
        self.blocks.append(f"hex ({_join(corners)}) {zone} ({_join(cells)}) simpleGrading ({_join(grading)})")

    def face(self, patch: str, corners: Sequence[int]) -> None:
        """A boundary face."""
        self.patches.setdefault(patch, []).append(f"({_join(corners)})")

    def text(self, kinds: dict[str, str]) -> str:
        """The mesh dictionary's content; ``kinds`` gives each patch's type."""
        patches = "\n".join(
            f"{name} {{ type {kinds[name]}; faces ( {' '.join(faces)} ); }}" for name, faces in self.patches.items()
        )
        return (
            f"scale 1;\nvertices\n(\n{chr(10).join(_point(v) for v in self.vertices)}\n);\n"
            f"blocks\n(\n{chr(10).join(self.blocks)}\n);\nedges\n(\n{chr(10).join(self.edges.values())}\n);\n"
            f"boundary\n(\n{patches}\n);\nmergePatchPairs ();\n"
        )


KINDS = {"ground": "wall", "wall": "wall", "duct": "wall", "hub": "wall", "far": "patch", "mirror": "symmetryPlane"}


def block_mesh(setup: Setup, position: Position) -> str:
    """Content of the mesh dictionary, lengths in m, corner frame (x to the wall, z up)."""
    return _Builder(setup, position).build()


class _Builder:
    """One case's geometry; see ``block_mesh``."""

    def __init__(self, setup: Setup, position: Position) -> None:
        fan, rotor, mesh = setup.fan, setup.rotor, setup.mesh
        self.setup, self.position, self.out = setup, position, Blocks()
        r = fan.radius_m
        centre = fan.lip_top - fan.lip_thickness / 2
        rotors = (rotor.lower_height, rotor.lower_height + rotor.thickness)
        upper = (rotor.upper_height, rotor.upper_height + rotor.thickness)
        bottom = -position.h if math.isfinite(position.h) else -mesh.far_below
        # Rows of points from the ground up; row 6 lies at 45 deg of the lip.
        lip_z = centre + fan.lip_thickness / 2 * math.sin(math.pi / 4)
        self.z = np.array([bottom, fan.exit_height, *rotors, *upper, lip_z, mesh.far])
        self.centre = centre
        self.bore, self.skin = self._column_radii()
        # The box: to the wall where it is near.
        wall = fan.lip_radius + position.d
        self.box_right = wall if wall < mesh.box + BOX_MERGE else mesh.box
        self.right = wall if math.isfinite(wall) else mesh.far
        corner = math.atan2(mesh.box, self.box_right)
        half = [0.0, corner, 0.75 * math.pi, math.pi]
        self.angles = half if not position.swirl else [*half, 1.25 * math.pi, 2 * math.pi - corner, 2 * math.pi]
        self.scale_m = r
        # Sides of a core that face each other need equal counts.
        self.around = self.n(mesh.azimuth / 3)
        self.rows = self._row_cells()

    def n(self, count: float) -> int:
        """Cells at this case's level."""
        return max(2, round(count * self.position.level))

    def _column_radii(self) -> tuple[Array, Array]:
        """Radii over R of the bore line and of the skin line at each row of points."""
        fan = self.setup.fan
        quarter = fan.lip_thickness / 2 * (1 - math.cos(math.pi / 4))
        bore, skin = np.ones(8), np.zeros(8)
        bore[1] = fan.exit_radius
        inside = (self.z > fan.exit_height) & (self.z < 0.0)
        bore[inside] = fan.exit_radius + (1 - fan.exit_radius) * (self.z[inside] - fan.exit_height) / -fan.exit_height
        along = (self.z[1:6] - fan.exit_height) / (self.centre - fan.exit_height)
        skin[1:6] = fan.exit_skin + along * (fan.lip_radius - fan.exit_skin)
        bore[6], skin[6] = 1 + quarter, fan.lip_radius - quarter
        # The lines open below the duct and above the lip.
        bore[0], skin[0] = 0.97, min(fan.exit_skin + 0.12, fan.lip_radius)
        bore[7], skin[7] = 1.0, fan.lip_radius
        return bore, skin

    def _row_cells(self) -> list[int]:
        mesh = self.setup.mesh
        gap = self.z[1] - self.z[0]
        # Few cells in a thin gap, the full number from 3 R on.
        below = mesh.below * min(1.0, 0.45 + 0.55 * gap / 3.0)
        duct = [LAYERS if i in (1, 3) else self.n(c) for i, c in enumerate(mesh.duct)]
        return [self.n(below), *duct, self.n(mesh.above)]

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
        m = self.scale_m
        return self.out.vertex((m * radius * math.cos(angle), m * radius * math.sin(angle), m * self.z[row]))

    def _on_box(self, row: int, angle: float) -> int:
        c, s = math.cos(angle), math.sin(angle)
        box = self.setup.mesh.box
        x = self.box_right if c > 0 else -box
        # Only the mirror plane's two points and the four corners occur.
        y = 0.0 if abs(s) < 1e-9 else math.copysign(box, s)
        return self._cartesian(row, x, y)

    def _cartesian(self, row: int, x: float, y: float) -> int:
        m = self.scale_m
        return self.out.vertex((m * x, m * y, m * self.z[row]))

    # Core and rings

    def _core(self, row: int, angles: Sequence[float]) -> None:
        """The quadrilateral of one half, above or below the hub."""
        radius = CORE * self.setup.fan.hub_radius
        lo, hi = ([self._on_circle(row + k, radius, t) for t in angles] for k in (0, 1))
        self.out.block([*lo, *hi], "", [self.around, self.around, self.rows[row]], ["1", "1", self._grade_z(row)])
        if row == 0:
            self.out.face(self._bottom, lo)
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
        radii = [CORE * hub, hub, self.bore, self.skin]
        counts = [self.n(mesh.hub), self.n(mesh.bore), self.n(mesh.lip), self.n(mesh.ring)]
        solid = {0: row in (2, 3, 4), 2: row in (1, 2, 3, 4, 5)}
        grade_z = self._grade_z(row)
        for column in range(4):
            if solid.get(column, False):
                continue
            lo, hi = (self._corners(row + k, column, a, b, radii) for k in (0, 1))
            zone = ""
            if column == 1 and row in (LOWER_ROW, UPPER_ROW):
                zone = "lowerDisc" if row == LOWER_ROW else "upperDisc"
            grade_r = self._grade_r(column, row)
            self.out.block([*lo, *hi], zone, [counts[column], self.around, self.rows[row]], [grade_r, "1", grade_z])
            for k, r in enumerate((row, row + 1)):
                corners = (lo, hi)[k]
                if column < 3:
                    self._arc(corners[1], corners[2], r, radii[column + 1][r], a, b)
                if column > 0:
                    self._arc(corners[0], corners[3], r, radii[column][r], a, b)
            self._lip_curves(row, column, (a, b), lo, hi)
            self._ring_patches(row, column, lo, hi)
        if not self.position.swirl and row < 7:
            self._mirror_rings(row, a, b, radii, solid)

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
        points = np.column_stack([m * radius * np.cos(t), m * radius * np.sin(t), np.full_like(t, m * self.z[row])])
        self.out.curve(p, q, points)

    def _lip_curves(self, row: int, column: int, angles: tuple[float, float], lo: list[int], hi: list[int]) -> None:
        """The semicircle: its inner and outer eighths belong to row 5, the cap to the lip column of row 6."""
        r = self.setup.fan.lip_thickness / 2
        middle = 1 + r
        for k, angle in enumerate(angles):
            near, far = (0, 1) if k == 0 else (3, 2)
            if row == 5 and column == 1:
                self._meridian(lo[far], hi[far], angle, self._flank(self.z[5], 1.0, middle, r, -1.0))
            elif row == 5 and column == 3:
                self._meridian(lo[near], hi[near], angle, self._flank(self.z[5], self.skin[5], middle, r, 1.0))
            elif row == 6 and column == 2:
                t = np.linspace(0.75 * math.pi, 0.25 * math.pi, 2 * CURVE_POINTS + 2)[1:-1]
                cap = np.column_stack([middle + r * np.cos(t), self.centre + r * np.sin(t)])
                self._meridian(lo[near], lo[far], angle, cap)

    def _flank(self, z0: float, r0: float, middle: float, r: float, side: float) -> Array:
        """Points (n, 2) = (radius, z) from the disc's height up the straight part and an eighth of the circle."""
        straight = np.linspace(0, 1, 6)[1:, None] * [middle + side * r - r0, self.centre - z0] + [r0, z0]
        t = np.linspace(0, math.pi / 4, CURVE_POINTS + 1)[1:-1]
        bend = np.column_stack([middle + side * r * np.cos(t), self.centre + r * np.sin(t)])
        return np.concatenate([straight, bend])

    def _meridian(self, p: int, q: int, angle: float, points: Array) -> None:
        m = self.scale_m
        xyz = np.column_stack(
            [m * points[:, 0] * math.cos(angle), m * points[:, 0] * math.sin(angle), m * points[:, 1]]
        )
        self.out.curve(p, q, xyz)

    def _ring_patches(self, row: int, column: int, lo: list[int], hi: list[int]) -> None:
        inner = [lo[0], lo[3], hi[3], hi[0]]
        outer = [lo[1], hi[1], hi[2], lo[2]]
        if row == 0:
            self.out.face(self._bottom, lo)
        if row == 6:
            self.out.face("far", hi)
        if column == 0 and row == 1:
            self.out.face("hub", hi)
        if column == 0 and row == 5:
            self.out.face("hub", lo)
        if column == 1 and row in (2, 3, 4):
            self.out.face("hub", inner)
        if column == 1 and 1 <= row <= 5:
            self.out.face("duct", outer)
        if column == 3 and 1 <= row <= 5:
            self.out.face("duct", inner)
        if column == 2 and row == 0:
            self.out.face("duct", hi)
        if column == 2 and row == 6:
            self.out.face("duct", lo)
        if column == 3 and self._box_is_wall and self._faces_wall(lo):
            self.out.face("wall", outer)

    def _mirror_rings(self, row: int, a: float, b: float, radii: Sequence[Array], solid: dict[int, bool]) -> None:
        for angle in (a, b):
            if abs(math.sin(angle)) > 1e-9:
                continue
            for column in range(4):
                if solid.get(column, False):
                    continue
                lo, hi = (self._corners(row + k, column, angle, angle, radii) for k in (0, 1))
                self.out.face("mirror", [lo[0], lo[1], hi[1], hi[0]])

    @property
    def _bottom(self) -> str:
        return "ground" if math.isfinite(self.position.h) else "far"

    @property
    def _box_is_wall(self) -> bool:
        return self.box_right == self.right and math.isfinite(self.position.d)

    def _faces_wall(self, lo: list[int]) -> bool:
        x = self.scale_m * self.box_right
        return all(abs(self.out.vertices[v][0] - x) < 1e-9 for v in lo[1:3])

    # Grading

    def _grade_z(self, row: int) -> str:
        if row == 0 and math.isfinite(self.position.h):
            return _both_ends(CLUSTER)
        if row == 0:
            return _growing(self.z[1] - self.z[0], self.rows[0], 0.06, downwards=True)
        if row == 6:
            return _growing(self.z[7] - self.z[6], self.rows[6], 0.05)
        return "1"

    def _grade_r(self, column: int, row: int) -> str:
        if column == 1:
            return "((0.3 0.25 1) (0.7 0.75 0.35))"
        if column == 3:
            near = self._box_is_wall
            return _both_ends(3.0) if near else _growing(self.setup.mesh.box - 1.3, self.n(self.setup.mesh.ring), 0.03)
        return "1"

    # Outside the box

    def _outside(self, row: int, side: float) -> None:
        mesh = self.setup.mesh
        box, far = mesh.box, mesh.far
        n_outer = self.n(mesh.outer)
        middle = (-box, self.box_right, self.around, "1")
        left = (-far, -box, n_outer, _growing(far - box, n_outer, 0.2, downwards=True))
        columns = [left, middle]
        if self.right > self.box_right:
            room = self.right - self.box_right
            cells = max(3, round(n_outer * min(1.0, 0.35 + 0.65 * room / (far - box))))
            if math.isfinite(self.position.d):
                columns.append((self.box_right, self.right, cells, _both_ends(2.0)))
            else:
                columns.append((self.box_right, self.right, cells, _growing(room, cells, 0.2)))
        for x0, x1, nx, gx in columns:
            inner = (x0, x1) == (-box, self.box_right)
            if not inner:
                self._cuboid(row, (x0, x1), (0.0, side * box), (nx, self.around), (gx, "1"))
            self._cuboid(
                row, (x0, x1), (side * box, side * far), (nx, n_outer), (gx, _growing(far - box, n_outer, 0.2))
            )

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
        self.out.block(corners, "", [*n, self.rows[row]], [*g, self._grade_z(row)])
        if row == 0:
            self.out.face(self._bottom, lo)
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


def _both_ends(ratio: float) -> str:
    """Cells grow by ``ratio`` from either end to the middle."""
    return f"((0.5 0.5 {ratio:g}) (0.5 0.5 {1 / ratio:g}))"


def _growing(length: float, cells: int, first: float, *, downwards: bool = False) -> str:
    """Expansion (last over first cell) for which the first of ``cells`` cells over ``length`` measures ``first``."""
    if first * cells >= length:
        return "1"
    low, high = 1.0, 3.0
    for _ in range(60):
        ratio = (low + high) / 2
        total = first * cells if ratio == 1.0 else first * (ratio**cells - 1) / (ratio - 1)
        low, high = (ratio, high) if total < length else (low, ratio)
    expansion = ((low + high) / 2) ** (cells - 1)
    return f"{1 / expansion if downwards else expansion:.6g}"


def _point(p: Iterable[float]) -> str:
    return "(" + " ".join(f"{v:.8g}" for v in p) + ")"


def _join(items: Iterable[object]) -> str:
    return " ".join(str(i) for i in items)
