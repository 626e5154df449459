"""From a data set to a surrogate that flies: frame the problem, train by any method, calibrate, measure."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models import calibration, coordinates, domain, free_air, levenberg
from models.coordinates import Coordinates
from models.dataset import DataSet
from models.ensemble import NetEnsemble
from models.free_air import FreeAir
from models.surrogate import Calibration, FanSurrogate, Regressor
from models.wrench import Array

MEMBERS = 5
HIDDEN = 9
METHODS = ("bp", "ga-bp", "adam-bp", "ga-adam-bp", "kriging", "polynomial", "ensemble")
# Beyond this many rows a random part trains, and all of them measure.
MAX_ROWS = 20_000

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Problem:
    """A data set framed for regression: y = gate x net(x), with y the increments over the free-air lift.

    ``x`` (n, 3) in [-1, 1], ``gate`` and ``y`` (n, 6), ``scale`` (6,) the RMS of y (1 where y is nothing),
    ``locations`` (n,) one number per distinct (h, d).
    """

    free_air: FreeAir
    coordinates: Coordinates
    x: Array
    gate: Array
    y: Array
    scale: Array
    locations: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.x)


def frame(data: DataSet) -> Problem:
    """Fit the free-air law and the coordinates, and divide the increments by the lift."""
    symmetric = free_air.is_axisymmetric(data)
    law = free_air.fit(data, symmetric)
    coords = coordinates.fit(data, law, symmetric)
    x, gate = coords.inputs(data.h, data.d, data.rpm)
    y = data.wrench / law.lift(data.rpm)[:, None] - np.asarray(law.share)
    size = np.sqrt(np.mean(y**2, axis=0))
    scale = np.where(size > 1e-9, size, 1.0)
    return Problem(law, coords, x, gate, y, scale, data.locations)


def folds(problem: Problem, count: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Fold 0...count-1 of each row, shape (n,); rows of one (h, d) stay together."""
    places = int(problem.locations.max()) + 1
    fold_of_place = rng.permutation(np.arange(places) % count)
    out: NDArray[np.intp] = fold_of_place[problem.locations]
    return out


def train_ensemble(
    problem: Problem, seed: int, hidden: int, progress: Progress | None
) -> tuple[NetEnsemble, Calibration]:
    """The nets that fly: member k has not seen fold k, so its errors there calibrate the spread."""
    rng = np.random.default_rng(seed)
    fold = folds(problem, MEMBERS, rng)
    w1 = np.zeros((MEMBERS, 6, 3, hidden))
    b1, w2, b2 = np.zeros((MEMBERS, 6, hidden)), np.zeros((MEMBERS, 6, hidden)), np.zeros((MEMBERS, 6))
    for k in range(MEMBERS):
        rows = fold != k
        for c in range(6):
            target, gate = problem.y[rows, c] / problem.scale[c], problem.gate[rows, c]
            if np.any(target):
                w1[k, c], b1[k, c], w2[k, c], b2[k, c] = levenberg.train(problem.x[rows], target, gate, hidden, rng)
            if progress:
                progress("nets", 6 * k + c + 1, 6 * MEMBERS)
    nets = NetEnsemble(w1, b1, w2 * problem.scale[:, None], b2 * problem.scale)
    return nets, calibrate_on_folds(problem, nets, fold)


def calibrate_on_folds(problem: Problem, nets: NetEnsemble, fold: NDArray[np.intp]) -> Calibration:
    """Calibrate with each member's errors on the fold it had not seen."""
    _, spread = nets.predict(problem.x)
    outputs = nets.outputs(problem.x)
    unseen = outputs[fold, np.arange(len(problem))]
    return calibration.calibrate(problem.gate * unseen - problem.y, problem.gate * spread, problem.y)


def assemble(
    data: DataSet, problem: Problem, regressor: Regressor, calibrated: Calibration, info: Mapping[str, Any]
) -> FanSurrogate:
    """Put the parts together; the domain is where the training rows are."""
    where = domain.fit(problem.x, data.h, data.d, data.rpm)
    return FanSurrogate(problem.free_air, problem.coordinates, regressor, calibrated, where, info=info)
