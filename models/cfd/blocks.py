"""The mesh dictionary: vertices, curved edges, blocks and patches, collected and written."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from models.frames import Array

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

    def turned(self, a: int, b: int, points: Array, angle: float, scale_m: float) -> None:
        """A curved edge through ``points`` (n, 2) = (radius, z) in the half-plane at ``angle`` about the axis."""
        radius, z = scale_m * points.T
        self.curve(a, b, np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z]))

    def block(self, corners: Sequence[int], zone: str, cells: Sequence[int], grading: Sequence[str]) -> None:
        """One hexahedron, corners in the mesher's order."""
        self.blocks.append(f"hex ({_join(corners)}) {zone} ({_join(cells)}) simpleGrading ({_join(grading)})")

    def face(self, patch: str, corners: Sequence[int]) -> None:
        """A boundary face."""
        self.patches.setdefault(patch, []).append(f"({_join(corners)})")

    def text(self, kinds: dict[str, str]) -> str:
        """The mesh dictionary's content; ``kinds`` gives each patch's type and what else it needs."""
        patches = "\n".join(
            f"{name} {{ type {kinds[name]} faces ( {' '.join(faces)} ); }}" for name, faces in self.patches.items()
        )
        return (
            f"scale 1;\nvertices\n(\n{chr(10).join(_point(v) for v in self.vertices)}\n);\n"
            f"blocks\n(\n{chr(10).join(self.blocks)}\n);\nedges\n(\n{chr(10).join(self.edges.values())}\n);\n"
            f"boundary\n(\n{patches}\n);\nmergePatchPairs ();\n"
        )


def _point(p: Iterable[float]) -> str:
    return "(" + " ".join(f"{v:.8g}" for v in p) + ")"


def _join(items: Iterable[object]) -> str:
    return " ".join(str(i) for i in items)
