"""From a data set to a surrogate that flies: frame the problem, train by any method, calibrate, measure."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.common.errors import ModelError
from models.common.frames import AXES, Array
from models.dataset import DataSet, held_out
from models.surrogate import coordinates, domain, free_air, kriging, polynomial
from models.surrogate.coordinates import Coordinates
from models.surrogate.fan_identity import identity
from models.surrogate.fan_surrogate import Calibration, FanSurrogate, Regressor
from models.surrogate.free_air import FreeAir
from models.surrogate.net_ensemble import NetEnsemble
from models.training import calibration, genetic, levenberg, live_components
from models.training.calibration import HeldOut

PAPER_METHODS = ("bp", "ga-bp", "adam-bp", "ga-adam-bp")
METHODS = (*PAPER_METHODS, "kriging", "polynomial", "ensemble")
# Nets of an ensemble, each without another fifth of the places: the paper's 8:2 split, five times.
MEMBERS = live_components.FOLDS
# Two places for each fold.
MIN_PLACES = 2 * MEMBERS
# The paper's number.
HIDDEN = 9
# Chosen: the paper prints neither.
EPOCHS = 3000
ADAM_RATE = 0.03
# Weight decays to choose from: one within the first factor of the least error on unseen places is as good, beyond the
# second weaker ones are not tried. The least keeps the normal equations regular, far below what smooths.
DECAYS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
NEARLY = 1.05
HOPELESS = 1.5
# Folds on which each decay is tried: enough to rank decays that lie a factor of ten apart.
TRIAL_FOLDS = 3
# Calibration leaves out whole blocks of a grid of this many by this many over the distances.
BLOCKS = 4
# Rows on which the nets of calibration are trained at most.
CALIBRATION_ROWS = 600
# Beyond this many rows a random part trains, and all of them measure; the genetic algorithm looks at fewer still.
MAX_ROWS = 3000
GA_ROWS = 400

Progress = Callable[[str, int, int], None]
"""Called with what is done, how many parts of it, and of how many."""
Index = NDArray[np.intp]


def silent(*_: object) -> None:
    """No progress is shown."""


@dataclass(frozen=True, kw_only=True)
class Problem:
    """A data set framed for regression: y = gate x net(x), with y the increments over the free-air lift.

    ``x`` (n, 3) in [-1, 1], ``gate`` and ``y`` (n, 6), ``scale`` (6,) the largest |y| (1 where y is nothing),
    ``locations`` (n,) one number per distinct (h, d), ``live`` (6,) the components that depend on the place; y of the
    others is zero, their constant is the free-air law's share. ``weight`` (n, 6), mean 1: how much a row counts.
    """

    free_air: FreeAir
    coordinates: Coordinates
    x: Array
    gate: Array
    y: Array
    scale: Array
    locations: Index
    live: NDArray[np.bool_]
    weight: Array

    def __len__(self) -> int:
        return len(self.x)

    def take(self, index: Index) -> Problem:
        """The rows ``index``."""
        rows = {
            name: getattr(self, name)[index] for name in ("x", "gate", "y", "locations", "weight")
        }
        return replace(self, **rows)


@dataclass(frozen=True)
class Trained:
    """A surrogate and its numbers as ``models train --json`` prints them."""

    model: FanSurrogate
    report: Mapping[str, Any]


def frame(data: DataSet, live: NDArray[np.bool_] | None = None) -> Problem:
    """Fit the free-air law and the coordinates, and divide the increments by the lift.

    ``live`` (6,) where it is known which components depend on the place; else the data decide. Raises ModelError where
    there are too few places for five folds.
    """
    locations = data.locations
    places = int(locations.max()) + 1
    if places < MIN_PLACES:
        raise ModelError(
            f"data set {data.source}: has {places} distinct places (h, d) to learn from; at least "
            f"{MIN_PLACES} are needed"
        )
    law = free_air.fit(data)
    y = increments(data.wrench, data.rpm, law)
    if live is None:
        x, gate = coordinates.fit(data, y, axisymmetric=False).inputs(data.h, data.d, data.rpm)
        live = live_components.live(x, y, gate, locations)
    law = _with_constants(law, data, live)
    y = np.where(live, increments(data.wrench, data.rpm, law), 0.0)
    coords = coordinates.fit(data, y, free_air.is_axisymmetric(law, live))
    x, gate = coords.inputs(data.h, data.d, data.rpm)
    size = np.abs(y).max(axis=0)
    return Problem(
        free_air=law,
        coordinates=coords,
        x=x,
        gate=gate,
        y=y,
        scale=np.where(size > 1e-9, size, 1.0),
        locations=locations,
        live=live,
        weight=weights(data, law),
    )


def weights(data: DataSet, law: FreeAir) -> Array:
    """Weight (n, 6) of each row in training, mean 1: 1 / (median^2 + sigma^2), sigma over the lift.

    The median keeps a few very sure rows from being all that counts: the nets' own error does not go below it.
    """
    if data.sigma is None:
        return np.ones_like(data.wrench)
    sigma = data.sigma / law.lift(data.rpm)[:, None]
    out = 1.0 / (np.median(sigma, axis=0) ** 2 + sigma**2 + 1e-12)
    return np.asarray(out / out.mean(axis=0))


def _with_constants(law: FreeAir, data: DataSet, live: NDArray[np.bool_]) -> FreeAir:
    """The law with the mean over all places as the share of components that do not depend on the place.

    A mean that is not significantly off zero is zero; the spread about it becomes the law's scatter. Fz keeps its 1.
    """
    if live.all():
        return law
    ratio = data.wrench / law.lift(data.rpm)[:, None]
    mean, error = free_air.mean_over_places(ratio, data.locations)
    constant = np.where(np.abs(mean) > free_air.SIGNIFICANT * error, mean, 0.0)
    constant[AXES.index("Fz")] = 1.0
    share = np.where(live, law.share, constant)
    scatter = np.where(live, law.scatter, np.sqrt(np.mean((ratio - share) ** 2, axis=0)))
    return replace(law, share=tuple(share.tolist()), scatter=tuple(scatter.tolist()))


def increments(wrench: Array, rpm: Array, law: FreeAir) -> Array:
    """Wrench (n, 6) over the free-air lift, less the free-air share: F/(rho A Omega^2 R^2) up to one constant."""
    out: Array = wrench / law.lift(rpm)[:, None] - np.asarray(law.share)
    return out


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
    where = domain.fit(problem.x, part.h, part.d, part.rpm)
    model = FanSurrogate(
        free_air_law=problem.free_air,
        coordinates=problem.coordinates,
        regressor=regressor,
        calibration=calibrated,
        domain=where,
        info=info,
    )
    found = {
        "train": measure(model, part, problem.live),
        "test": measure(model, data.take(test), problem.live),
    }
    metrics = {
        **{name: measured["wrench"] for name, measured in found.items()},
        **{
            key: {name: measured[key] for name, measured in found.items()}
            for key in ("increments", "coverage_95")
        },
    }
    model.info = {**info, "metrics": metrics}
    run = {
        "method": method,
        "seed": seed,
        "rows": len(data),
        "seconds": round(time.perf_counter() - start, 3),
    }
    return Trained(model, {**run, **metrics, **choices, "notes": notes})


def drawn(count: int, most: int, rng: np.random.Generator) -> Index:
    """Which of ``count`` rows: all, or ``most`` of them at random, in order."""
    if count <= most:
        return np.arange(count)
    return np.sort(rng.choice(count, most, replace=False))


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


def constant_notes(live: NDArray[np.bool_]) -> list[str]:
    """Words for components that were learnt as a constant."""
    return [
        f"{AXES[c]} does not vary with the place beyond the data's noise: learnt as a constant "
        "share of the lift, R2 of its increments undefined"
        for c in np.flatnonzero(~live)
    ]


def measure(model: FanSurrogate, data: DataSet, live: NDArray[np.bool_]) -> dict[str, Any]:
    """R^2 and MSE per component, of the wrench (N, N m) and of its increments (1, m), and share within 1.96 sigma."""
    answer = model.query(data.h, data.d, data.rpm)
    law = model.free_air_law
    inside = np.abs(answer.wrench - data.wrench) <= 1.96 * answer.sigma + 1e-12
    truth, answered = (increments(w, data.rpm, law) for w in (data.wrench, answer.wrench))
    return {
        "wrench": scores(data.wrench, answer.wrench, live | (np.ptp(answer.wrench, axis=0) > 1e-9)),
        "increments": scores(truth, answered, live),
        "coverage_95": dict(zip(AXES, np.round(inside.mean(axis=0), 4).tolist(), strict=True)),
    }


def scores(
    truth: Array, answer: Array, live: NDArray[np.bool_]
) -> dict[str, dict[str, float | None]]:
    """``{"Fx": {"r2", "mse"}, ...}`` of (n, 6) against (n, 6); r2 None where undefined or the component is not live."""
    r2 = np.where(live, r_squared(truth, answer), np.nan)
    mse = np.mean((truth - answer) ** 2, axis=0)
    return {axis: {"r2": defined(r2[c]), "mse": float(mse[c])} for c, axis in enumerate(AXES)}


def defined(value: float) -> float | None:
    """NaN as None, which is null in JSON."""
    if np.isnan(value):
        return None
    return float(value)


def r_squared(truth: Array, answer: Array) -> Array:
    """R^2 (eq. 17) over the first axis, (n, ...) -> (...), the mean being that of the evaluated set.

    NaN for a constant column: it has no variance to explain.
    """
    error = ((truth - answer) ** 2).sum(axis=0)
    variance = ((truth - truth.mean(axis=0)) ** 2).sum(axis=0)
    constant = variance <= 1e-18 * len(truth) * np.maximum(np.abs(truth).max(axis=0), 1e-9) ** 2
    out: Array = np.where(constant, np.nan, 1.0 - error / np.where(constant, 1.0, variance))
    return out


def folds(problem: Problem, count: int, rng: np.random.Generator) -> Index:
    """Fold 0...count-1 of each row, shape (n,); rows of one (h, d) stay together."""
    _, place = np.unique(problem.locations, return_inverse=True)
    out: Index = rng.permutation(np.arange(place.max() + 1) % count)[place]
    return out


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
        return nets, calibration.calibrate([_unseen_folds(problem, nets, fold)], problem.y)
    again = trainer(problem, method, rng, fold, progress, choices)
    regressor: Regressor
    if method == "ensemble":
        regressor = nets = levenberg_nets(
            problem, fold, rng, tuple(choices["decays"].values()), progress
        )
        scattered = _unseen_folds(problem, nets, fold)
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
        return lambda rows: kriging.fit(
            rows.x, rows.y, rows.gate, rows.locations, int(rng.integers(2**31))
        )
    if method == "polynomial":
        degree = choices["degree"] = best_degree(
            problem, folds(problem, MEMBERS, rng) if fold is None else fold
        )
        return lambda rows: polynomial.fit(rows.x, rows.y, rows.gate, degree)
    decays = choose_decays(problem, rng, progress)
    choices["decays"] = dict(zip(AXES, decays, strict=True))
    return lambda rows: levenberg_nets(rows, folds(rows, MEMBERS, rng), rng, decays)


def blocks(problem: Problem) -> Index:
    """Group 0...3 of each row, shape (n,): sixteenths of the (h, d) plane, those of one group apart from each other."""
    across, along = (
        np.minimum(BLOCKS * index // (index.max() + 1), BLOCKS - 1)
        for index in (np.unique(column, return_inverse=True)[1] for column in problem.x[:, :2].T)
    )
    out: Index = 2 * (across % 2) + along % 2
    return out


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
    for done, g in enumerate(groups if len(groups) > 1 else ()):
        unseen = group == g
        regressor = build(problem.take(np.flatnonzero(~unseen)))
        mean[unseen], spread[unseen] = regressor.predict(problem.x[unseen])
        progress("calibration", done + 1, len(groups))
    return _opened(problem, mean, spread)


def _unseen_folds(problem: Problem, nets: NetEnsemble, fold: Index) -> HeldOut:
    """Each member's errors on the fold it had not seen, with the spread of all of them there."""
    _, spread = nets.predict(problem.x)
    return _opened(problem, nets.outputs(problem.x)[fold, np.arange(len(problem))], spread)


def _opened(problem: Problem, mean: Array, spread: Array) -> HeldOut:
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


def choose_decays(
    problem: Problem, rng: np.random.Generator, progress: Progress = silent
) -> tuple[float, ...]:
    """Weight decay (6) of the nets of each component: the strongest that is nearly as good as any on unseen places.

    Few and noisy data want a strong one, or 46 weights make waves between them.
    """
    problem = problem.take(drawn(len(problem), CALIBRATION_ROWS, rng))
    fold = folds(problem, MEMBERS, rng)
    seed = int(rng.integers(2**31))
    out = [DECAYS[-1]] * 6
    for c in np.flatnonzero(problem.live).tolist():
        root = np.sqrt(problem.weight[:, c])
        target = root * problem.y[:, c] / problem.scale[c]
        gate = root * problem.gate[:, c]
        left = np.full(len(DECAYS), np.inf)
        for i, decay in enumerate(DECAYS):
            left[i] = 0.0
            start = np.random.default_rng(seed)
            for k in range(TRIAL_FOLDS):
                seen = fold != k
                unseen = fold == k
                w1, b1, w2, b2 = levenberg.train(
                    problem.x[seen], target[seen], gate[seen], HIDDEN, start, decay
                )
                answer = gate[unseen] * (np.tanh(problem.x[unseen] @ w1 + b1) @ w2 + b2)
                left[i] += float(np.sum((answer - target[unseen]) ** 2))
            progress("weight decay", len(DECAYS) * c + i + 1, 6 * len(DECAYS))
            if left[i] > HOPELESS * left.min():
                break
        out[c] = DECAYS[int(np.flatnonzero(left <= NEARLY * left.min())[0])]
    return tuple(out)


def levenberg_nets(
    problem: Problem,
    fold: Index,
    rng: np.random.Generator,
    decays: Sequence[float],
    progress: Progress = silent,
) -> NetEnsemble:
    """Nets by Levenberg-Marquardt with weight decay (6); member k has not seen fold k."""
    w1 = np.zeros((MEMBERS, 6, 3, HIDDEN))
    b1 = np.zeros((MEMBERS, 6, HIDDEN))
    w2 = np.zeros((MEMBERS, 6, HIDDEN))
    b2 = np.zeros((MEMBERS, 6))
    for k in range(MEMBERS):
        rows = fold != k
        x = problem.x[rows]
        for c in np.flatnonzero(problem.live).tolist():
            root = np.sqrt(problem.weight[rows, c])
            target = root * problem.y[rows, c] / problem.scale[c]
            gate = root * problem.gate[rows, c]
            w1[k, c], b1[k, c], w2[k, c], b2[k, c] = levenberg.train(
                x, target, gate, HIDDEN, rng, decays[c]
            )
            progress("nets", 6 * k + c + 1, 6 * MEMBERS)
    return NetEnsemble(w1, b1, w2 * problem.scale[:, None], b2 * problem.scale)


def paper_nets(
    problem: Problem,
    rows: Array,
    method: str,
    rng: np.random.Generator,
    epochs: int,
    rate: float = ADAM_RATE,
    progress: Progress = silent,
) -> NetEnsemble:
    """Nets by one of the paper's methods, members and components in one batch; member k learns ``rows[k]`` (n,)."""
    from models.training import network

    members = len(rows)
    live = np.flatnonzero(problem.live)
    gate, y = (np.tile(a.T[live], (members, 1)) for a in (problem.gate, problem.y / problem.scale))
    weight = np.repeat(rows.astype(float), len(live), axis=0)
    nets = len(y)
    size = network.genes(HIDDEN)
    if method.startswith("ga-"):
        seen = np.sort(rng.choice(len(problem), min(len(problem), GA_ROWS), replace=False))
        small = network.Batch.of(problem.x[None, seen], gate[:, seen], y[:, seen], weight[:, seen])
        evaluate = partial(network.population_errors, batch=small, hidden=HIDDEN)
        start, _ = genetic.evolve(
            evaluate, nets, size, rng, tick=partial(progress, "genetic algorithm")
        )
    else:
        start = rng.uniform(-1.0, 1.0, (nets, size))
    batch = network.Batch.of(problem.x[None], gate, y, weight)
    if "adam" in method:
        adam_rate = rate
    else:
        adam_rate = None
    theta = np.zeros((members, 6, size))
    theta[:, live] = network.descend(
        start, batch, HIDDEN, epochs, adam_rate=adam_rate, tick=partial(progress, "descent")
    ).reshape(members, len(live), size)
    w1, b1, w2, b2 = network.unpack(theta, HIDDEN)
    return NetEnsemble(w1, b1, w2 * problem.scale[:, None], b2 * problem.scale)
