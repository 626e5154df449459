"""From a data set to a surrogate that flies: frame the problem, train by any method, calibrate, measure."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from models.common.errors import ModelError
from models.common.frames import AXES, Array
from models.dataset import DataSet, held_out
from models.surrogate import domain, free_air, kriging, polynomial
from models.surrogate.fan_identity import identity
from models.surrogate.fan_surrogate import Calibration, FanSurrogate, Regressor
from models.surrogate.net_ensemble import NetEnsemble
from models.training import calibration, live_components
from models.training.calibration import HeldOut
from models.training.nets import (
    HIDDEN,
    MEMBERS,
    Progress,
    choose_decays,
    levenberg_nets,
    paper_nets,
    silent,
)
from models.training.problem import Index, Problem, blocks, constant_notes, drawn, folds, frame
from models.training.scores import measure

PAPER_METHODS = ("bp", "ga-bp", "adam-bp", "ga-adam-bp")
METHODS = (*PAPER_METHODS, "kriging", "polynomial", "ensemble")
# Chosen: the paper does not print it.
EPOCHS = 3000
# Rows on which the nets of calibration are trained at most.
CALIBRATION_ROWS = 600
# Beyond this many rows a random part trains, and all of them measure.
MAX_ROWS = 3000


@dataclass(frozen=True)
class Trained:
    """A surrogate and its numbers as ``models train --json`` prints them."""

    model: FanSurrogate
    report: Mapping[str, Any]


def train(
    data: DataSet,
    method: str,
    seed: int = 0,
    *,
    epochs: int = EPOCHS,
    fidelity: Mapping[str, Any] | None = None,
    fan_radii_m: tuple[float, float] | None = None,
    progress: Progress = silent,
) -> Trained:
    """Train ``method`` at 80 % of the places, measure at the rest.

    Nets are an ensemble of five, each without one fifth of the places; the spread of all methods is calibrated on
    places that were not trained on. The test rows choose nothing. ``fan_radii_m``: rotor and outer lip radius of the
    fan that the data are of, kept in the model so that it is not flown on another one.
    """
    if method not in METHODS:
        raise ModelError(f"method {method!r} is not known; give one of {', '.join(METHODS)}")
    start = time.perf_counter()
    data = free_air.level(data)
    test = held_out(data, np.random.default_rng(seed))
    part = data.take(~test)
    problem = frame(part)
    rng = np.random.default_rng(seed)
    learnt = problem.take(drawn(len(problem), MAX_ROWS, rng))
    choices: dict[str, Any] = {}
    if method in PAPER_METHODS or method == "ensemble":
        choices["hidden"] = HIDDEN
    regressor, calibrated = _fit(learnt, method, rng, epochs, progress, choices)
    notes = _notes(data, problem, learnt)
    info = {
        "method": method,
        "seed": seed,
        "fidelity": dict(fidelity or {"level": None, "label": "not stated"}),
        "data": {"file": data.source, "sha256": data.sha256, "rows": len(data)},
        "choices": choices,
        "notes": notes,
    }
    if fan_radii_m is not None:
        info["fan"] = identity(problem.free_air, *fan_radii_m).as_info()
    model = FanSurrogate(
        free_air_law=problem.free_air,
        coordinates=problem.coordinates,
        regressor=regressor,
        calibration=calibrated,
        domain=domain.fit(problem.x, part.h, part.d, part.rpm),
        info=info,
    )
    on_learnt = measure(model, part, problem.live)
    on_tested = measure(model, data.take(test), problem.live)
    metrics = _metrics(on_learnt, on_tested)
    model.info = {**info, "metrics": metrics}
    run = {"method": method, "seed": seed, "rows": len(data)}
    seconds = round(time.perf_counter() - start, 3)
    return Trained(model, {**run, "seconds": seconds, **metrics, **choices, "notes": notes})


def _metrics(learnt: Mapping[str, Any], tested: Mapping[str, Any]) -> dict[str, Any]:
    """The numbers of learnt and of tested rows, as the model keeps them."""
    metrics = {"train": learnt["wrench"], "test": tested["wrench"]}
    for name in ("increments", "coverage_95"):
        metrics[name] = {"train": learnt[name], "test": tested[name]}
    return metrics


def _notes(data: DataSet, problem: Problem, learnt: Problem) -> list[str]:
    """What a user should know of the data and of what was made of them."""
    notes = list(data.notes)
    if len(learnt) < len(problem):
        notes.append(f"{len(learnt)} of {len(problem)} training rows, drawn at random, were learnt")
    if data.sigma is not None:
        notes.append("rows are weighted by their sigma")
    if problem.free_air.origin != "free-air rows":
        notes.append(
            "no free-air rows (h and d both inf): the outermost rows are taken for free air"
        )
    return notes + constant_notes(problem.live)


def _fit(
    problem: Problem,
    method: str,
    rng: np.random.Generator,
    epochs: int,
    progress: Progress,
    choices: dict[str, Any],
) -> tuple[Regressor, Calibration]:
    """Regressor and calibrated spread; what was chosen on the way goes into ``choices``."""
    fold = folds(problem, MEMBERS, rng)
    if method in PAPER_METHODS:
        members = fold != np.arange(MEMBERS)[:, None]
        nets = paper_nets(problem, members, method, rng, epochs, progress=progress)
        unseen = _unseen_folds(problem, nets, fold)
        return nets, calibration.calibrate([unseen], problem.y)
    again = trainer(problem, method, rng, fold, progress, choices)
    regressor: Regressor
    if method == "ensemble":
        decays = tuple(choices["decays"].values())
        nets = levenberg_nets(problem, fold, rng, decays, progress)
        scattered = _unseen_folds(problem, nets, fold)
        regressor = nets
    else:
        scattered = _unseen(problem, again, fold, rng, progress)
        regressor = again(problem)
    in_blocks = _unseen(problem, again, blocks(problem), rng, progress)
    return regressor, calibration.calibrate([scattered, in_blocks], problem.y)


def trainer(
    problem: Problem,
    method: str,
    rng: np.random.Generator,
    fold: Index | None = None,
    progress: Progress = silent,
    choices: dict[str, Any] | None = None,
) -> Callable[[Problem], Regressor]:
    """What trains kriging, polynomial or ensemble on any rows, with what ``problem`` chooses for it.

    The choice goes into ``choices``; it is made on the folds ``fold``, or on folds of its own.
    """
    if choices is None:
        choices = {}
    if method == "kriging":

        def fit_kriging(rows: Problem) -> Regressor:
            start = int(rng.integers(2**31))
            return kriging.fit(rows.x, rows.y, rows.gate, rows.locations, start)

        return fit_kriging
    if method == "polynomial":
        if fold is None:
            fold = folds(problem, MEMBERS, rng)
        degree = best_degree(problem, fold)
        choices["degree"] = degree
        return lambda rows: polynomial.fit(rows.x, rows.y, rows.gate, degree)
    decays = choose_decays(problem, rng, progress)
    choices["decays"] = dict(zip(AXES, decays, strict=True))
    return lambda rows: levenberg_nets(rows, folds(rows, MEMBERS, rng), rng, decays)


def _unseen(
    problem: Problem,
    build: Callable[[Problem], Regressor],
    group: Index,
    rng: np.random.Generator,
    progress: Progress,
) -> HeldOut:
    """Errors and spread on each group of rows of regressors that learnt the other groups."""
    rows = drawn(len(problem), CALIBRATION_ROWS, rng)
    problem = problem.take(rows)
    group = group[rows]
    mean = np.zeros((len(problem), 6))
    spread = np.zeros((len(problem), 6))
    groups = np.unique(group)
    if len(groups) > 1:
        for done, one in enumerate(groups):
            unseen = group == one
            regressor = build(problem.take(np.flatnonzero(~unseen)))
            mean[unseen], spread[unseen] = regressor.predict(problem.x[unseen])
            progress("calibration", done + 1, len(groups))
    return _of_open_gates(problem, mean, spread)


def _unseen_folds(problem: Problem, nets: NetEnsemble, fold: Index) -> HeldOut:
    """Each member's errors on the fold it had not seen, with the spread of all of them there."""
    _, spread = nets.predict(problem.x)
    outputs = nets.outputs(problem.x)
    own = outputs[fold, np.arange(len(problem))]
    return _of_open_gates(problem, own, spread)


def _of_open_gates(problem: Problem, mean: Array, spread: Array) -> HeldOut:
    """``HeldOut`` of the rows whose gates are not closed: free air is met by construction and shows nothing."""
    rows = problem.gate.max(axis=1) > 0.0
    gate = problem.gate[rows]
    y = problem.y[rows]
    return HeldOut(gate * mean[rows] - y, gate * spread[rows], problem.locations[rows])


def best_degree(problem: Problem, fold: Index) -> int:
    """The polynomial's degree with the least share of the increments left unexplained on folds not fitted on."""

    def left(degree: int) -> float:
        squares = live_components.unexplained(problem.x, problem.y, problem.gate, fold, degree)
        return float(np.sum(squares / problem.scale**2))

    return min(polynomial.DEGREES, key=left)
