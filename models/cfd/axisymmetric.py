"""What the wedges say: lift near the ground over free lift, by swirl, mesh, variant of the fan and start."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from models.cfd.campaign import Row


@dataclass(frozen=True)
class Series:
    """One fan on one mesh: ``heights`` over R, ``ratio`` of the lift to its own free lift, ``error`` of that ratio.

    ``free_n``: free lift [N]; ``status`` of each height. ``error`` is that of the mean where the flow swings, nan where
    the mean is not known.
    """

    name: str
    level: float
    free_n: float
    heights: tuple[float, ...]
    ratio: tuple[float, ...]
    error: tuple[float, ...]
    status: tuple[str, ...]


def series(rows: Sequence[Row]) -> list[Series]:
    """All series of wedges that have free air, in the order in which they are first met."""
    found: dict[tuple[str, str, float, str], list[Row]] = {}
    for row in rows:
        p = row.position
        if p.wedge and math.isfinite(row.result.wrench[2]):
            found.setdefault((p.model, p.variant, p.level, p.approach), []).append(row)
    out = []
    for (model, variant, level, approach), cases in found.items():
        near = found.get((model, variant, level, "near"), [])
        free = next((r.result.wrench[2] for r in near if math.isinf(r.position.h)), None)
        low = sorted((r for r in cases if math.isfinite(r.position.h)), key=lambda r: r.position.h)
        if free is None or not low:
            continue
        words = ["no swirl" if model == "wedge_no_swirl" else "swirl", variant, f"from {approach}"]
        out.append(
            Series(
                name=", ".join(w for w in words if w and w != "from near"),
                level=level,
                free_n=free,
                heights=tuple(r.position.h for r in low),
                ratio=tuple(r.result.wrench[2] / free for r in low),
                error=tuple(mean_error(r) / free for r in low),
                status=tuple(r.result.status for r in low),
            )
        )
    return out


def mean_error(row: Row) -> float:
    """Error of the mean lift [N]."""
    result = row.result
    return max(result.swing[2], result.drift[2]) if result.status in ("steady", "marched") else result.error[2]


def text(found: Sequence[Series]) -> list[str]:
    """One line a series."""
    return [
        f"wedge, {s.name}, mesh {s.level:g}: free {s.free_n:.2f} N, lift x "
        + ", ".join(
            f"{r:.3f}" + ("" if math.isnan(e) else f" +- {e:.3f}") + f" at {h:g}"
            for h, r, e in zip(s.heights, s.ratio, s.error, strict=True)
        )
        + " R"
        for s in found
    ]
