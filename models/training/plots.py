"""The report of ``models compare``: figures 14 to 19 of the paper from our data."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from models.frames import AXES, Array
from models.training.compare import LIFT, RPM, Comparison
from models.training.train import PAPER_METHODS, r_squared

# Percentage errors are undefined where a component crosses zero: the divisor is never below this share of its range.
LEAST_SHARE = 0.02
DOTS_PER_INCH = 80
NAMES = {"bp": "BP", "ga-bp": "GA-BP", "adam-bp": "Adam-BP", "ga-adam-bp": "GA-Adam-BP"}


def write_figures(directory: Path, result: Comparison) -> None:
    """Write the figures into ``directory``."""
    import matplotlib

    matplotlib.use("Agg")
    figures = {
        "fig14_regression_train.png": _regression(result, held_out=False),
        "fig15_regression_test.png": _regression(result, held_out=True),
        "fig16_error_histograms.png": _histograms(result),
        "fig17_surface_kriging.png": _surface(result, "kriging"),
        "fig18_surface_ga_adam_bp.png": _surface(result, "ga-adam-bp"),
        "fig19_surface_polynomial.png": _surface(result, "polynomial"),
        "surface_ensemble.png": _surface(result, "ensemble"),
    }
    for name, figure in figures.items():
        figure.savefig(directory / name, dpi=DOTS_PER_INCH)
        figure.clear()


def percent_error(truth: Array, answer: Array) -> Array:
    """100 |error| / max(|truth|, 2 % of the range), per component of (n, 6)."""
    floor = LEAST_SHARE * np.maximum(np.ptp(truth, axis=0), 1e-12)
    return np.asarray(100.0 * np.abs(answer - truth) / np.maximum(np.abs(truth), floor))


def _figure(rows: int, columns: int, size: tuple[float, float]) -> tuple[Any, Any]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False)


def _regression(result: Comparison, held_out: bool) -> Any:
    """Answer against truth of the increments, first split: components across, the paper's four methods down."""
    figure, axes = _figure(len(PAPER_METHODS), 6, (15, 10))
    task = result.tasks[0]
    rows = task.test if held_out else task.train
    for i, method in enumerate(PAPER_METHODS):
        for c, axis in enumerate(AXES):
            truth, answer = task.problem.y[rows, c], result.answers[method][0][rows, c]
            r2 = f"R² {float(r_squared(truth, answer)):.3f}" if task.problem.live[c] else "constant"
            ends = [truth.min(), truth.max()]
            panel = axes[i, c]
            panel.set_title(f"{NAMES[method]} {axis}, {r2}", fontsize=8)
            panel.plot(ends, ends, "k-", lw=0.8)
            panel.plot(truth, answer, ".", ms=2)
            panel.tick_params(labelsize=6)
            panel.locator_params(nbins=3)
    figure.suptitle(f"Increments over free-air lift, {'held-out' if held_out else 'learnt'} rows: answer over truth")
    return figure


def _histograms(result: Comparison) -> Any:
    figure, axes = _figure(2, 3, (12, 6.5))
    task = result.tasks[0]
    edges = np.linspace(0, 100, 21)
    for panel, c in zip(axes.flat, range(6), strict=True):
        panel.set_title(AXES[c] if task.problem.live[c] else f"{AXES[c]}: constant")
        for method in PAPER_METHODS if task.problem.live[c] else ():
            error = percent_error(task.problem.y[task.train], result.answers[method][0][task.train])[:, c]
            panel.hist(np.minimum(error, 99.9), edges, histtype="step", label=NAMES[method])
            panel.legend(fontsize=7)
        panel.set_xlabel("error [%], last bin: and above")
    figure.suptitle("Percentage error of the increments on the learnt rows")
    return figure


def _surface(result: Comparison, method: str) -> Any:
    figure, axes = _figure(1, 1, (7, 5.2))
    h, d = result.grid_h, result.grid_d
    panel = axes[0, 0]
    filled = panel.contourf(d, h, result.surfaces[method], 24, cmap="viridis")
    panel.contour(d, h, result.surfaces[method], 24, colors="k", linewidths=0.3)
    figure.colorbar(filled, label=f"{AXES[LIFT]} [N]")
    panel.plot(result.places[:, 1], result.places[:, 0], "k.", ms=3)
    panel.set(xlim=(d.min(), d.max()), ylim=(h.min(), h.max()))
    panel.set_xlabel("lip to wall d [m]")
    panel.set_ylabel("height h [m]")
    panel.set_title(f"Lift at {RPM:g} rpm, {method}")
    return figure
