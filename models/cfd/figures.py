"""The figures of ``models cfd check``: the paper's figs 5-7, 9 and 10, the corner that it does not show, the meshes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from models.cfd.check import GROUND_LIMIT, WALL_LIMIT, Checked, text
from models.cfd.config import Setup
from models.cfd.fidelity import FREE

SAID = {
    "fig5_9_lift_ratio_ground.png": ("figs 5 and 9", "Zhou", "estimate for this fan", "section 2.2"),
    "fig6_10_lift_coefficient_wall.png": ("figs 6 and 10", "section 2.3"),
    "fig7_tilting_moment_wall.png": ("fig. 7", "lip suction"),
    "corner.png": ("section 2.4", "Vertex"),
}
"""Which statements, by a part of their source, stand beside which figure."""


def write_report(directory: Path, c: Checked, setup: Setup) -> None:
    """Write report.md and its figures into ``directory``: beside each figure what was published and what came out."""
    import matplotlib

    matplotlib.use("Agg")
    figures = {
        "fig5_9_lift_ratio_ground.png": _ground(c),
        "fig6_10_lift_coefficient_wall.png": _wall(c, 2, "C_T", c.force_unit),
        "fig7_tilting_moment_wall.png": _wall(c, 4, "C_My", c.moment_unit),
        "corner.png": _corner(c),
        "mesh.png": _mesh(c),
    }
    if c.wedges:
        figures["wedge.png"] = _wedges(c)
    for name, figure in figures.items():
        figure.savefig(directory / name, dpi=110)
        figure.clear()
    parts = [f"# Flow simulation of the {setup.fan.name}", f"```\n{text(c)}\n```"]
    for name in figures:
        title = name.removesuffix(".png").replace("_", " ")
        parts += [f"![{title}]({name})", *_beside(c, SAID.get(name, ()))]
    (directory / "report.md").write_text("\n\n".join(parts) + "\n", encoding="utf-8")


def _beside(c: Checked, sources: Sequence[str]) -> list[str]:
    """A table of the statements from these sources; none without any."""
    said = [s for s in c.statements if any(source in s.source for source in sources)]
    if not said:
        return []
    rows = [f"| {s.claim} ({s.source}) | {s.ours} | {s.verdict} |" for s in said]
    return ["\n".join(["| published | here | |", "|---|---|---|", *rows])]


def _wedges(c: Checked) -> Any:
    figure, (panel,) = _panels(1, (7, 4.5))
    for s in c.wedges:
        style = "o-" if s.level == c.wedges[0].level else ".--"
        panel.errorbar(s.heights, s.ratio, s.error, fmt=style, capsize=3, lw=1, label=f"{s.name}, mesh {s.level:g}")
    heights = sorted(h for h, d in c.labels if math.isinf(d) and math.isfinite(h))
    panel.plot(heights, [c.ratio(h) for h in heights], "k:", label="half models, no swirl")
    panel.set(xlabel="h / R", ylabel="T_IGE / T_OGE", title="Without a wall: what swirl and the fan's shape change")
    panel.legend(fontsize=7)
    return figure


def _panels(columns: int, size: tuple[float, float]) -> tuple[Any, Sequence[Any]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    return figure, list(figure.subplots(1, columns, squeeze=False)[0])


def _ground(c: Checked) -> Any:
    figure, (panel,) = _panels(1, (6, 4))
    heights = sorted(h for h, d in c.labels if math.isinf(d) and math.isfinite(h))
    error = [max(c.labels[h, math.inf].amplitude[2], c.study.increment[2]) / c.free for h in heights]
    panel.errorbar(
        heights, [c.ratio(h) for h in heights], error, fmt="o-", capsize=3, label="simulated, constant speed"
    )
    z = np.linspace(0.5, 5, 100)
    panel.plot(
        z, 1 / (1 - (1 / (4 * z)) ** 2), "--", color="0.5", label="Cheeseman-Bennett, open rotor, constant power"
    )
    panel.plot([2.1], [1.032], "s", color="C3", label="Zhou 2025, ducted fan")
    panel.axvline(GROUND_LIMIT, color="0.7", lw=0.8)
    panel.text(GROUND_LIMIT, panel.get_ylim()[1], " paper: fades by 4 R", va="top", fontsize=8)
    panel.set(xlabel="h / R", ylabel="T_IGE / T_OGE", title="Lift near the ground (paper's figs 5 and 9)")
    panel.legend(fontsize=8)
    return figure


def _wall(c: Checked, axis: int, name: str, unit: float) -> Any:
    figure, (panel,) = _panels(1, (6, 4))
    walls = sorted(d for h, d in c.labels if math.isinf(h) and math.isfinite(d))
    values = [c.labels[math.inf, d].wrench[axis] / unit for d in walls]
    panel.errorbar(walls, values, c.study.increment[axis] / unit, fmt="o-", capsize=3, label="simulated")
    panel.axhline(c.labels[FREE].wrench[axis] / unit, color="0.5", ls="--", label="free air")
    panel.axvline(WALL_LIMIT, color="0.7", lw=0.8)
    panel.text(WALL_LIMIT, panel.get_ylim()[1], " paper: fades by 3.8 R", va="top", fontsize=8)
    figures = "fig. 7" if axis == 4 else "figs 6 and 10"
    panel.set(xlabel="d / R", ylabel=name, title=f"{name} beside the wall, no ground (paper's {figures})")
    panel.legend(fontsize=8)
    return figure


def _corner(c: Checked) -> Any:
    figure, panels = _panels(3, (13, 4.2))
    heights = sorted({h for h, _ in c.labels})
    for panel, axis, name in zip(panels, (0, 2, 4), ("Fx [N]", "Fz [N]", "My [N m]"), strict=True):
        for k, h in enumerate(heights):
            row = sorted(d for hh, d in c.labels if hh == h and math.isfinite(d))
            if not row:
                continue
            values = [c.labels[h, d].wrench[axis] for d in row]
            error = [c.labels[h, d].amplitude[axis] for d in row]
            colour = f"C{k}" if math.isfinite(h) else "k"
            label = f"h = {h:g} R" if math.isfinite(h) else "no ground"
            panel.errorbar(row, values, error, fmt=".-", lw=1, capsize=2, color=colour, label=label)
        panel.set(xlabel="d / R", ylabel=name)
    panels[-1].legend(fontsize=7, ncols=2)
    figure.suptitle("Corner, bars: swing or half difference of two states")
    return figure


def _mesh(c: Checked) -> Any:
    figure, panels = _panels(3, (12, 3.6))
    for panel, axis, name in zip(panels, (0, 2, 4), ("Fx [N]", "Fz [N]", "My [N m]"), strict=True):
        for (h, d), by in c.study.wrench.items():
            levels = sorted(by)
            panel.plot(levels, [by[level][axis] for level in levels], "o-", label=f"h = {h:g} R, d = {d:g} R")
        panel.set(xlabel="cells along each direction, relative", ylabel=name)
    if c.study.wrench:
        panels[0].legend(fontsize=7)
    figure.suptitle("Mesh study")
    return figure
