"""All methods on one data set, judged on places and regions held out; which one to use."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from models.common.errors import ModelError
from models.common.frames import AXES, Array, Mask
from models.common.pages.document import document, verdict, write_document
from models.common.pages.svg import Line, figure
from models.dataset import DataSet, held_out
from models.surrogate import free_air
from models.surrogate.fan_surrogate import Regressor
from models.training.nets import Progress, paper_nets, silent
from models.training.problem import Problem, constant_notes, drawn, frame, in_frame
from models.training.scores import defined, r_squared
from models.training.train import METHODS, PAPER_METHODS, trainer

# More rows are sampled: kriging's cost grows with their cube.
MAX_ROWS = 2500
ADAM_RATE = 0.01
"""The paper gives no rate: a usual one for small nets. ``models train`` takes a larger one and more epochs."""
COLOURS = ("before", "a", "after", "b", "fit", "c")
"""Of the components on the page, in the order of AXES."""


@dataclass(frozen=True)
class Task:
    """Rows to learn and rows to be judged on, framed by the learnt rows alone; ``kind`` is ``split`` or ``region``."""

    name: str
    kind: str
    test: Mask
    problem: Problem
    """All rows, in the frame of the learnt ones."""


@dataclass(frozen=True)
class Comparison:
    """``numbers`` for JSON; the ``tasks`` and the ``answers`` behind them: method -> one (n, 6) per task."""

    numbers: Mapping[str, Any]
    tasks: tuple[Task, ...]
    answers: Mapping[str, list[Array]]
    first: Mapping[str, Regressor]
    """Of each method the one that was trained on the first task."""


def compare(
    data: DataSet,
    seed: int = 0,
    *,
    splits: int = 20,
    epochs: int = 1000,
    progress: Progress = silent,
) -> Comparison:
    """Train every method on ``splits`` random 8:2 splits and with regions left out.

    Every split is by place (h, d), all rotor speeds of it together.
    """
    start = time.perf_counter()
    rng = np.random.default_rng(seed)
    data = free_air.level(data)
    notes = list(data.notes)
    if len(data) > MAX_ROWS:
        notes.append(f"{MAX_ROWS} of {len(data)} rows, drawn at random, were compared on")
    data = data.take(drawn(len(data), MAX_ROWS, rng))
    live = frame(data).live
    if not live.any():
        raise ModelError(
            f"data set {data.source}: no component depends on the place beyond noise; nothing to "
            "compare"
        )
    notes += constant_notes(live)
    tasks = _tasks(data, live, splits, rng)
    answers: dict[str, list[Array]] = {}
    first: dict[str, Regressor] = {}
    for method in METHODS:
        answers[method] = []
        for k, task in enumerate(tasks):
            regressor = _fit(method, task, epochs, rng)
            first.setdefault(method, regressor)
            answer, _ = regressor.predict(task.problem.x)
            answers[method].append(task.problem.gate * answer)
            progress(method, k + 1, len(tasks))
    numbers = {
        "rows": len(data),
        "data": data.source,
        "sha256": data.sha256,
        "seed": seed,
        "places": int(data.locations.max()) + 1,
        "splits": splits,
        "live": [axis for axis, varies in zip(AXES, live, strict=True) if varies],
        "epochs": epochs,
        "r2": _r2(tasks, answers),
        "regions": _regions(tasks, answers),
        "notes": notes,
    }
    numbers["use"] = recommend(numbers)
    numbers["seconds"] = round(time.perf_counter() - start, 1)
    return Comparison(numbers, tuple(tasks), answers, first)


def _tasks(data: DataSet, live: Mask, splits: int, rng: np.random.Generator) -> list[Task]:
    tasks = []
    for k in range(splits):
        test = held_out(data, rng)
        tasks.append(_task(data, live, f"split {k}", "split", test))
    for name, test in regions(data).items():
        tasks.append(_task(data, live, name, "region", test))
    return tasks


def _task(data: DataSet, live: Mask, name: str, kind: str, test: Mask) -> Task:
    learnt = frame(data.take(~test), live)
    problem = in_frame(data, learnt.free_air, learnt.coordinates, live)
    return Task(name, kind, test, replace(problem, scale=learnt.scale))


def regions(data: DataSet) -> dict[str, Mask]:
    """Rows left out together: edges to extrapolate to, and a block to bridge; only those that leave enough to learn."""
    h = data.h
    d = data.d
    fh = h[np.isfinite(h)]
    fd = d[np.isfinite(d)]
    out: dict[str, Mask] = {}
    if fh.size:
        out["nearest heights"] = h <= np.quantile(fh, 0.12)
    if fd.size:
        out["nearest walls"] = d <= np.quantile(fd, 0.12)
    if fh.size and fd.size:
        low, high = np.quantile(fh, (0.35, 0.6))
        near, far = np.quantile(fd, (0.35, 0.6))
        at_height = (h >= low) & (h <= high)
        at_distance = (d >= near) & (d <= far)
        out["block in the corner"] = at_height & at_distance
    out["fastest rotor"] = data.rpm >= np.quantile(data.rpm, 0.9)
    return {name: mask for name, mask in out.items() if 3 <= mask.sum() <= 0.5 * len(data)}


def _fit(method: str, task: Task, epochs: int, rng: np.random.Generator) -> Regressor:
    """Trained on the task's learnt rows; of the paper's methods one net for each component."""
    learnt = task.problem.take(np.flatnonzero(~task.test))
    if method in PAPER_METHODS:
        rows = np.ones((1, len(learnt)), dtype=bool)
        return paper_nets(learnt, rows, method, rng, epochs, ADAM_RATE)
    return trainer(learnt, method, rng)(learnt)


def _r2(tasks: list[Task], answers: Mapping[str, list[Array]]) -> dict[str, Any]:
    """R^2 by method and component, mean and standard deviation over the splits; None where a component is constant."""
    out: dict[str, dict[str, dict[str, float | None]]] = {}
    for method in METHODS:
        out[method] = {axis: {} for axis in AXES}
        for part, tested in (("train", False), ("test", True)):
            scores = []
            for task, answer in zip(tasks, answers[method], strict=True):
                if task.kind == "split":
                    rows = task.test == tested
                    scores.append(r_squared(task.problem.y[rows], answer[rows]))
            mean = np.mean(scores, axis=0)
            sd = spread(np.array(scores))
            for c, axis in enumerate(AXES):
                out[method][axis][part] = defined(mean[c])
                out[method][axis][f"{part}_sd"] = defined(sd[c])
    return out


def spread(scores: Array) -> Array:
    """Standard deviation over splits (n, ...) -> (...); one split has none: NaN."""
    if len(scores) > 1:
        return np.asarray(scores.std(axis=0, ddof=1))
    return np.full(scores.shape[1:], np.nan)


def _regions(tasks: list[Task], answers: Mapping[str, list[Array]]) -> dict[str, Any]:
    """Error on each region left out over the increments' own RMS there, mean over components that have any."""
    out: dict[str, Any] = {}
    for k, task in enumerate(tasks):
        if task.kind != "region":
            continue
        y = task.problem.y[task.test]
        size = np.sqrt(np.mean(y**2, axis=0))
        live = size > 1e-9
        relative = {}
        for method in METHODS:
            answer = answers[method][k][task.test]
            error = np.sqrt(np.mean((answer - y) ** 2, axis=0))
            relative[method] = float(np.mean(error[live] / size[live]))
        out[task.name] = {"rows": int(task.test.sum()), "relative_error": relative}
    return out


def recommend(numbers: Mapping[str, Any]) -> dict[str, str]:
    """``method`` to use, and ``why``: the best on rows that no method learnt.

    Among equals (within one standard deviation over the splits) it is the one with the smallest error where whole
    regions were left out, because a vehicle flies between and beyond the data.
    """
    scores = numbers["r2"]
    regions = numbers["regions"].values()
    live = [axis for axis in AXES if next(iter(scores.values()))[axis]["test"] is not None]
    mean = {}
    for method, row in scores.items():
        mean[method] = float(np.mean([row[axis]["test"] for axis in live]))
    best = max(mean, key=mean.__getitem__)
    sd = float(np.mean([scores[best][axis]["test_sd"] or 0.0 for axis in live]))
    outside = {}
    for method in mean:
        if mean[method] >= mean[best] - sd:
            errors = [region["relative_error"][method] for region in regions]
            outside[method] = float(np.mean(errors or [0.0]))
    chosen = min(outside, key=outside.__getitem__)
    why = (
        f"held-out R^2 {mean[chosen]:.3f} (best: {best} {mean[best]:.3f}); error over the "
        f"increments' RMS in regions left out whole {outside[chosen]:.2f}"
    )
    return {"method": chosen, "why": why}


def text(numbers: Mapping[str, Any]) -> str:
    """The tables in Markdown."""
    scores = numbers["r2"]
    by_axis = {}
    for axis in AXES:
        by_axis[axis] = [_mean_sd(row[axis]) for row in scores.values()]
    by_region = {}
    for name, region in numbers["regions"].items():
        errors = [f"{region['relative_error'][method]:.3f}" for method in scores]
        by_region[name] = [str(region["rows"]), *errors]
    lines = [
        f"{numbers['rows']} rows at {numbers['places']} places (h, d) of {numbers['data']}, seed "
        f"{numbers['seed']}, {numbers['splits']} splits by place, {numbers['epochs']} epochs, "
        f"{numbers['seconds']} s",
        *(f"Note: {note}" for note in numbers["notes"]),
        "",
        f"Use this one: {numbers['use']['method']}. {numbers['use']['why']}.",
        "",
        "Held-out R^2 of the increments, mean +- sd over splits, nothing chosen on test rows.",
        "",
        *_rows(tuple(scores), by_axis),
        "",
        "Regions left out whole: error over the increments' RMS there (1 = as bad as no model).",
        "",
        *_rows(("rows", *scores), by_region),
    ]
    return "\n".join(lines)


def _mean_sd(cell: Mapping[str, Any]) -> str:
    if cell["test"] is None:
        return "constant"
    mean = f"{cell['test']:.4f}"
    if cell["test_sd"] is None:
        return mean
    return f"{mean} +- {cell['test_sd']:.4f}"


def _rows(head: Sequence[str], rows: Mapping[str, Sequence[str]]) -> list[str]:
    lines = [("", *head), ("---",) * (len(head) + 1)]
    for name, cells in rows.items():
        lines.append((name, *cells))
    return ["| " + " | ".join(line) + " |" for line in lines]


def write_page(directory: Path, result: Comparison, command: str) -> Path:
    """Write ``report.html``: which method to use and why, the tables, held-out rows; ``command``: what to type next."""
    use = result.numbers["use"]
    head = f"Best surrogate of this data set: {use['method']}"
    plots = "".join([regression(result, method) for method in METHODS])
    parts = [
        f"<h1>{escape(head)}</h1>",
        verdict(f"Use {use['method']}.", [f"Next: {command}", f"Why: {use['why']}."]),
        f'<pre tabindex="0">{escape(text(result.numbers))}</pre>',
        f'<div class="plots">{plots}</div>',
    ]
    return write_document("--report", directory / "report.html", document(head, parts))


def regression(result: Comparison, method: str, *, tested: bool = True) -> str:
    """Increments of a method over those of the data, on the held-out or the learnt rows of the first split.

    Equal ones are on the line.
    """
    task = result.tasks[0]
    rows = task.test == tested
    answer = result.answers[method][0][rows]
    data = task.problem.y[rows]
    lines = []
    for k, axis in enumerate(AXES):
        if axis in result.numbers["live"]:
            points = Line(data[:, k], answer[:, k], COLOURS[k], axis, points=True)
            lines.append(points)
    shown = np.array([data.min(), data.max()])
    lines.append(Line(shown, shown, "d"))
    title = f"{method}, {'held out' if tested else 'learnt'}"
    return figure(title, lines, "increment, data", "increment, surrogate")
