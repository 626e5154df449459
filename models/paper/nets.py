"""Tables 2 and 3 and figures 14 to 19 of the paper: its four nets and their rivals, trained on this project's data."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from models.common.frames import AXES, Array
from models.common.pages.svg import Line, figure
from models.dataset import DataSet
from models.paper.exhibit import Exhibit, judged
from models.training.compare import Comparison, regression
from models.training.train import METHODS, PAPER_METHODS

LIFT = AXES.index("Fz")
RPM = 4000.0
"""Of the paper's surfaces (figs 17 to 19)."""
GRID = 61
"""Points along h and d of a surface."""
DENSER = 1.5
"""Power by which a grid is denser close by."""
SHOWN = ("before", "after", "fit", "a")
"""Colours of the four methods, and of the wall distances of a surface."""
LEAST_SHARE = 0.02
"""A percentage is of no less than this share of the range: an increment may be zero."""
CLOSE_PERCENT = 10.0
MOST_PERCENT = 100.0
BIN_PERCENT = 5.0
MOST = 0.5
"""Share of the rows that is most of them."""

_TABLE_2 = """
bp         .7351/.7537 .7845/.7668 .8322/.8097 .8433/.8482 .8256/.8292 .7468/.7504
ga-bp      .8976/.9019 .9235/.9071 .9547/.9404 .9614/.9601 .9511/.9552 .9038/.8947
adam-bp    .9256/.9297 .9527/.9403 .9706/.9607 .9712/.9722 .9680/.9741 .9314/.9325
ga-adam-bp .9378/.9411 .9701/.9613 .9847/.9802 .9885/.9840 .9788/.9855 .9408/.9354
"""
"""The paper's R^2 on learnt and test rows, Fx to Mz."""
TABLE_3 = {"polynomial": 2.399e-1, "kriging": 1.256e-4, "ga-adam-bp": 4.267e-3}
"""Its mean squared errors of the lift; that they are on learnt rows at 4000 rpm is assumed."""
_FIGURES = {"kriging": "fig. 17", "ga-adam-bp": "fig. 18", "polynomial": "fig. 19"}


def paper_r2() -> dict[str, dict[str, tuple[float, float]]]:
    """Table 2 of the paper: method, component, R^2 on learnt and on test rows."""
    out: dict[str, dict[str, tuple[float, float]]] = {}
    for line in _TABLE_2.split("\n")[1:-1]:
        method, *cells = line.split()
        out[method] = {}
        for axis, cell in zip(AXES, cells, strict=True):
            learnt, tested = cell.split("/")
            out[method][axis] = (float(learnt), float(tested))
    return out


def net_exhibits(data: DataSet, result: Comparison) -> Iterator[Exhibit]:
    """In the order of the paper."""
    yield _table_2(result)
    yield _regressions(result, tested=False)
    yield _regressions(result, tested=True)
    yield _errors(result)
    errors = {method: _lift_errors(result, method) for method in METHODS}
    surfaces = {}
    for method in METHODS:
        surfaces[method] = _surface(data, result, method)
    rough = {method: roughness(surface) for method, surface in surfaces.items()}
    yield _table_3(errors, rough)
    for method, name in _FIGURES.items():
        yield _surface_exhibit(data, name, method, surfaces[method], rough)


def _table_2(result: Comparison) -> Exhibit:
    scores = result.numbers["r2"]
    live = result.numbers["live"]
    published = paper_r2()
    rows = []
    for method in PAPER_METHODS:
        for axis in AXES:
            cell = scores[method][axis]
            ours = (_number(cell["train"]), _number(cell["test"]))
            theirs = [f"{value:.3f}" for value in published[method][axis]]
            rows.append((method, axis, *ours, *theirs))
    mean = {}
    for method in PAPER_METHODS:
        tested = [scores[method][axis]["test"] for axis in live]
        mean[method] = float(np.mean(tested))
    bp, ga, adam, both = (mean[method] for method in PAPER_METHODS)
    listed = ", ".join(f"{method} {value:.3f}" for method, value in mean.items())
    return Exhibit(
        title="table 2",
        paper="GA-Adam-BP is no worse than Adam-BP, that better than GA-BP, that than BP",
        here=f"mean held-out R² over {', '.join(live)}: {listed}",
        verdict=judged(both >= adam > ga > bp),
        head=("method", "component", "learnt", "held out", "paper, learnt", "paper, test"),
        rows=tuple(rows),
    )


def _number(value: float | None) -> str:
    if value is None:
        return "constant"
    return f"{value:.3f}"


def _regressions(result: Comparison, *, tested: bool) -> Exhibit:
    if tested:
        part = "test"
        title = "fig. 15: answers over truth, held-out rows"
    else:
        part = "train"
        title = "fig. 14: answers over truth, learnt rows"
    scores = result.numbers["r2"]
    lift = {method: scores[method]["Fz"][part] for method in PAPER_METHODS}
    published = paper_r2()
    said = ", ".join(f"{published[method]['Fz'][tested]:.3f}" for method in PAPER_METHODS)
    ours = [value for value in lift.values() if value is not None]
    listed = [f"{method} {_number(value)}" for method, value in lift.items()]
    return Exhibit(
        title=title,
        paper=f"R² of the lift {said} for {', '.join(PAPER_METHODS)}: each better than the last",
        here=f"R² of the lift's increment: {', '.join(listed)}",
        verdict=judged(len(ours) == len(lift) and ours == sorted(ours)),
        plots=tuple(regression(result, method, tested=tested) for method in PAPER_METHODS),
    )


def percent_error(truth: Array, answer: Array) -> Array:
    """100 |error| / max(|truth|, 2 % of the range) of (n,)."""
    floor = LEAST_SHARE * max(float(np.ptp(truth)), 1e-12)
    return np.asarray(100.0 * np.abs(answer - truth) / np.maximum(np.abs(truth), floor))


def _errors(result: Comparison) -> Exhibit:
    task = result.tasks[0]
    learnt = ~task.test
    edges = np.arange(0.0, MOST_PERCENT + BIN_PERCENT, BIN_PERCENT)
    lines = []
    close = {}
    for method, colour in zip(PAPER_METHODS, SHOWN, strict=True):
        answer = result.answers[method][0][learnt, LIFT]
        error = percent_error(task.problem.y[learnt, LIFT], answer)
        close[method] = float(np.mean(error <= CLOSE_PERCENT))
        count, _ = np.histogram(np.minimum(error, MOST_PERCENT - 1e-9), edges)
        share = 100.0 * count / len(error)
        lines.append(Line(edges[:-1] + BIN_PERCENT / 2.0, share, colour, method))
    listed = ", ".join(f"{method} {100.0 * share:.0f} %" for method, share in close.items())
    plot = figure("Error of the lift's increment, learnt rows", lines, "error [%]", "rows [%]")
    return Exhibit(
        title="fig. 16: percentage error on the learnt rows",
        paper="most rows of all four are within 10 %",
        here=f"rows within 10 %: {listed}",
        verdict=judged(min(close.values()) > MOST),
        plots=(plot,),
    )


def _lift_errors(result: Comparison, method: str) -> tuple[float, float]:
    """Mean squared error [N^2] of the lift at 4000 rpm, learnt and held out, mean over the splits."""
    learnt = []
    tested = []
    for task, answer in zip(result.tasks, result.answers[method], strict=True):
        if task.kind == "split":
            off = answer[:, LIFT] - task.problem.y[:, LIFT]
            square = (off * float(task.problem.free_air.lift(RPM))) ** 2
            learnt.append(square[~task.test].mean())
            tested.append(square[task.test].mean())
    return float(np.mean(learnt)), float(np.mean(tested))


def roughness(surface: Array) -> float:
    """RMS second difference [N] over a grid: waviness between samples."""
    along_h = np.diff(surface, 2, axis=0)
    along_d = np.diff(surface, 2, axis=1)
    return float(np.sqrt(np.mean(along_h**2) + np.mean(along_d**2)))


def _grid(distance: Array) -> Array:
    """Distances (GRID,) [m] over the finite ones of the data, denser close by."""
    finite = distance[np.isfinite(distance)]
    share = np.linspace(0.0, 1.0, GRID) ** DENSER
    return np.asarray(finite.min() + (finite.max() - finite.min()) * share)


def _surface(data: DataSet, result: Comparison, method: str) -> Array:
    """Lift [N] at 4000 rpm over the grid of h and d, (GRID, GRID), as learnt on the first split."""
    problem = result.tasks[0].problem
    h, d = np.meshgrid(_grid(data.h), _grid(data.d), indexing="ij")
    x, gate = problem.coordinates.inputs(h.ravel(), d.ravel(), np.full(h.size, RPM))
    answer, _ = result.first[method].predict(x)
    increment = gate[:, LIFT] * answer[:, LIFT]
    lift = (1.0 + increment) * problem.free_air.lift(RPM)
    return np.asarray(lift).reshape(GRID, GRID)


def _table_3(errors: Mapping[str, tuple[float, float]], rough: Mapping[str, float]) -> Exhibit:
    rows = []
    for method in METHODS:
        learnt, tested = errors[method]
        said = f"{TABLE_3[method]:.2e}" if method in TABLE_3 else ""
        rows.append((method, f"{learnt:.3f}", f"{tested:.3f}", f"{1e3 * rough[method]:.1f}", said))
    of_rows = {method: errors[method][0] for method in TABLE_3}
    listed = ", ".join(f"{method} {value:.3f}" for method, value in of_rows.items())
    order = sorted(TABLE_3, key=TABLE_3.__getitem__)
    return Exhibit(
        title="table 3",
        paper=f"mean squared error of the lift grows in the order {', '.join(order)}",
        here=f"learnt rows, N²: {listed}",
        verdict=judged(sorted(of_rows, key=of_rows.__getitem__) == order),
        head=("method", "learnt [N²]", "held out [N²]", "roughness [mN]", "paper"),
        rows=tuple(rows),
    )


def _surface_exhibit(
    data: DataSet, name: str, method: str, surface: Array, rough: Mapping[str, float]
) -> Exhibit:
    h = _grid(data.h)
    d = _grid(data.d)
    lines = []
    columns = np.linspace(0, GRID - 1, len(SHOWN)).astype(int)
    for column, colour in zip(columns, SHOWN, strict=True):
        lines.append(Line(h, surface[:, column], colour, f"d = {d[column]:.2f} m"))
    wavy = method == "kriging"
    rougher = rough["kriging"] > rough["ga-adam-bp"]
    return Exhibit(
        title=f"{name}: lift at 4000 rpm by {method}",
        paper="waves between the points" if wavy else "a smooth surface",
        here=f"roughness {1e3 * rough[method]:.1f} mN, kriging {1e3 * rough['kriging']:.1f} mN",
        verdict=judged(rougher if wavy else rough[method] < rough["kriging"]),
        plots=(figure(f"Lift by {method}", lines, "height [m]", "Fz [N]"),),
    )
