"""The figures of ``models cfd check``: the paper's figs 5-7, 9 and 10, the corner that it does not show, the meshes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from models.cfd.check import GROUND_LIMIT, WALL_LIMIT, Checked
from models.cfd.fidelity import FREE
from models.cfd.labels import Label
from models.cfd.position import Place

DOTS_PER_INCH = 80


def write_figures(directory: Path, c: Checked) -> None:
    """Write the figures into ``directory``."""
    import matplotlib

    matplotlib.use("Agg")
    figures = {
        "fig5_9_lift_ratio_ground.png": _ground(c),
        "fig6_10_lift_coefficient_wall.png": _wall(c, 2, "C_T", c.force_unit),
        "fig7_tilting_moment_wall.png": _wall(c, 4, "C_My", c.moment_unit),
        "corner.png": _corner(c),
        "fidelity.png": _fidelity(c),
    }
    for name, figure in figures.items():
        figure.savefig(directory / name, dpi=DOTS_PER_INCH)
        figure.clear()


def _ground_column(panel: Any, c: Checked, labels: Mapping[Place, Label], style: str, name: str) -> None:
    """Lift over the same model's free lift at the heights without a wall."""
    heights = sorted(h for h, d in labels if math.isinf(d) and math.isfinite(h))
    if FREE not in labels or not heights:
        return
    free = labels[FREE].wrench[2]
    found = [labels[h, math.inf] for h in heights]
    ratio, error = [x.wrench[2] / free for x in found], [x.error[2] / free for x in found]
    panel.errorbar(heights, ratio, error, fmt=style, capsize=3, lw=1, ms=4, label=name)


def _fidelity(c: Checked) -> Any:
    """Increments of full models over those of half models, and what the correction gives without that place."""
    figure, panels = _panels(3, (12, 4))
    for panel, axis, name in zip(panels, (0, 2, 4), ("Fx [N]", "Fz [N]", "My [N m]"), strict=True):
        places = c.correction.places
        half = np.array([(c.half[p].wrench - c.half[FREE].wrench)[axis] for p in places])
        full = np.array([(c.full[p].wrench - c.full[FREE].wrench)[axis] for p in places])
        left_out = half + np.array([c.correction.left_out(p)[axis] for p in places])
        ends = [min([0.0, *full, *half]), max([0.0, *full, *half])]
        panel.plot(ends, ends, "k-", lw=0.8)
        bars = [c.full[p].error[axis] for p in places]
        panel.errorbar(half, full, bars, fmt="o", mfc="none", lw=0.7, label="half model alone")
        panel.plot(left_out, full, "C3.", label="corrected, learnt elsewhere")
        panel.set(xlabel=f"{name} predicted", ylabel=f"{name} of the full model")
    panels[0].legend(fontsize=8)
    figure.suptitle("Increments over free air: full models against what half models give")
    return figure


def _panels(columns: int, size: tuple[float, float]) -> tuple[Any, Sequence[Any]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    return figure, list(figure.subplots(1, columns, squeeze=False)[0])


def _ground(c: Checked) -> Any:
    figure, (panel,) = _panels(1, (7, 4.5))
    _ground_column(panel, c, c.labels, "o-", "the set, constant speed")
    _ground_column(panel, c, c.half, "k:", "half models, no swirl")
    z = np.linspace(0.5, 5, 100)
    panel.plot(
        z, 1 / (1 - (1 / (4 * z)) ** 2), "--", color="0.5", label="Cheeseman-Bennett, open rotor, constant power"
    )
    panel.plot([2.1], [1.032], "s", color="C3", label="Zhou 2025, ducted fan, measured")
    panel.axvline(GROUND_LIMIT, color="0.7", lw=0.8)
    panel.text(GROUND_LIMIT, panel.get_ylim()[1], " paper: fades by 4 R", va="top", fontsize=8)
    panel.set(xlabel="h / R", ylabel="T_IGE / T_OGE", title="Lift near the ground (paper's figs 5 and 9)")
    panel.legend(fontsize=8)
    return figure


def _wall(c: Checked, axis: int, name: str, unit: float) -> Any:
    figure, (panel,) = _panels(1, (7, 4.5))
    walls = sorted(d for h, d in c.labels if math.isinf(h) and math.isfinite(d))
    found = [c.labels[math.inf, d] for d in walls]
    panel.errorbar(
        walls, [x.wrench[axis] / unit for x in found], [x.error[axis] / unit for x in found],
        fmt="o-", capsize=3, label="the set",
    )  # fmt: skip
    panel.axhline(c.labels[FREE].wrench[axis] / unit, color="0.5", ls="--", label="free air")
    panel.axvline(WALL_LIMIT, color="0.7", lw=0.8)
    panel.text(WALL_LIMIT, panel.get_ylim()[1], " paper: fades by 3.8 R", va="top", fontsize=8)
    figures = "fig. 7" if axis == 4 else "figs 6 and 10"
    panel.set(xlabel="d / R", ylabel=name, title=f"{name} beside the wall, no ground (paper's {figures})")
    panel.legend(fontsize=8)
    return figure


def _corner(c: Checked) -> Any:
    figure, panels = _panels(3, (14, 4.6))
    heights = sorted({h for h, _ in c.labels})
    for panel, axis, name in zip(panels, (0, 2, 4), ("Fx [N]", "Fz [N]", "My [N m]"), strict=True):
        for k, h in enumerate(heights):
            row = sorted(d for hh, d in c.labels if hh == h and math.isfinite(d))
            if not row:
                continue
            colour = f"C{k}" if math.isfinite(h) else "k"
            label = f"h = {h:g} R" if math.isfinite(h) else "no ground"
            panel.plot(row, [c.labels[h, d].wrench[axis] for d in row], "-", lw=1, color=colour, label=label)
            for d in row:
                point = c.labels[h, d]
                solved = c.made[h, d].startswith("solved") and c.correction.learnt[axis]
                panel.errorbar(
                    [d], [point.wrench[axis]], [point.error[axis]],
                    fmt="s" if solved else ".", ms=5, lw=0.5, mfc=colour if solved else "none", color=colour,
                )  # fmt: skip
        panel.set(xlabel="d / R", ylabel=name)
    panels[-1].legend(fontsize=7, ncols=2)
    figure.suptitle("Corner: squares solved in full models, dots from half models; bars: sigma of the row")
    return figure
