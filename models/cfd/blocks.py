"""The mesh dictionary: vertices, curved edges, blocks and their outer faces, collected and written."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from models.common.frames import Array

Point = tuple[float, float, float]


@dataclass
class Blocks:
    """Collects vertices, curved edges, blocks and their faces; writes the dictionary."""

    vertices: list[Point] = field(default_factory=list)
    index: dict[tuple[int, int, int], int] = field(default_factory=dict)
    blocks: list[str] = field(default_factory=list)
    edges: dict[tuple[int, int], str] = field(default_factory=dict)
    faces: dict[frozenset[int], list[Sequence[int]]] = field(default_factory=dict)
    """Faces by their vertices; one that two blocks share stands twice."""

    def vertex(self, p: Iterable[float]) -> int:
        """Number of the vertex at ``p``; one at a place."""
        x, y, z = map(float, p)
        key = (round(x * 1e7), round(y * 1e7), round(z * 1e7))
        if key not in self.index:
            self.index[key] = len(self.vertices)
            self.vertices.append((x, y, z))
        return self.index[key]

    def curve(self, a: int, b: int, radius: ArrayLike, z: ArrayLike, angle: ArrayLike) -> None:
        """A curved edge from ``a`` to ``b`` through points in cylinder coordinates, (n,) each or one for all."""
        if a != b and (a, b) not in self.edges and (b, a) not in self.edges:
            x = radius * np.cos(angle)
            y = radius * np.sin(angle)
            points = _points(np.column_stack(np.broadcast_arrays(x, y, z)), " ")
            self.edges[a, b] = f"polyLine {a} {b} ({points})"

    def block(
        self, corners: Sequence[int], zone: str, cells: Sequence[int], grading: Sequence[str]
    ) -> None:
        """One hexahedron, corners in the mesher's order."""
        self.blocks.append(
            f"hex ({_join(corners)}) {zone} ({_join(cells)}) simpleGrading ({_join(grading)})"
        )

    def sides(self, corners: Sequence[int], sides: Iterable[Sequence[int]]) -> None:
        """The faces of a block, each as places in its ``corners``."""
        for side in sides:
            face = [corners[i] for i in side]
            self.faces.setdefault(frozenset(face), []).append(face)

    def text(self, patch_of: Callable[[Array], str], kinds: dict[str, str]) -> str:
        """The mesh dictionary's content. ``patch_of`` names the patch of an outer face by its points (4, 3).

        ``kinds`` gives each patch's type and what else it needs, in the order in which patches are written.
        """
        points = np.array(self.vertices)
        patches: dict[str, list[str]] = {name: [] for name in kinds}
        for same in self.faces.values():
            if len(same) == 1:
                face = same[0]
                patches[patch_of(points[face])].append(f"({_join(face)})")
        boundary = []
        for name, faces in patches.items():
            if faces:
                boundary.append(f"{name} {{ type {kinds[name]} faces ( {' '.join(faces)} ); }}")
        sections = {
            "vertices": _points(self.vertices, "\n"),
            "blocks": "\n".join(self.blocks),
            "edges": "\n".join(self.edges.values()),
            "boundary": "\n".join(boundary),
        }
        lists = [f"{name}\n(\n{content}\n);\n" for name, content in sections.items()]
        return f"scale 1;\n{''.join(lists)}mergePatchPairs ();\n"


def _points(points: Iterable[Iterable[float]], separator: str) -> str:
    texts = []
    for point in points:
        numbers = [f"{v:.8g}" for v in point]
        texts.append(f"({' '.join(numbers)})")
    return separator.join(texts)


def _join(items: Iterable[object]) -> str:
    return " ".join(str(i) for i in items)
