"""R2 of the flying ensemble on places held out, beside what the rows' own errors allow at most.

    python tests/benchmarks surrogates.surrogate_ceiling [--data CSV --rows CSV] [--splits 20] [--seed N] [--json FILE]

Random 8:2 splits by place (h, d). R2 of the increments over free air, per component, mean and standard deviation over
the splits; nets learnt with every row alike and weighted by sigma, and as a reference a Gaussian process for each
component that knows each row's scatter (its other parameters by maximum likelihood on the learnt rows). A perfect
surrogate reaches 1 - mean(e^2) / variance, with e the rows' scatter (error of the mean and of the mesh) or their sigma
(with it, what half models miss of full ones). No split chooses anything.
"""

from __future__ import annotations

import csv
import json
import warnings
from pathlib import Path

import command_line
import numpy as np
from result_file import add_option, figure, write_result

import models
from models import dataset
from models.common.frames import AXES, Array
from models.dataset import DataSet
from models.surrogate import free_air
from models.training.nets import MEMBERS, choose_decays, levenberg_nets
from models.training.problem import folds, frame, increments
from models.training.scores import defined, r_squared

# Rows whose gate is nearly closed say nothing about the process behind it.
LEAST_GATE = 0.02
SHIPPED = Path(models.__file__).parent / "data"


def scatter_of(path: Path, count: int) -> Array:
    """The rows' scatter (n, 6), in the order of the set."""
    with path.open(encoding="utf-8", newline="") as file:
        lines = list(csv.DictReader(file))
    out = np.array(
        [[float(line[f"scatter_{name}"]) for name in dataset.COLUMNS[3:]] for line in lines]
    )
    assert len(out) == count, "the table belongs to another set"
    return out


def held_out_r2(data: DataSet, seed: int) -> tuple[Array, Array]:
    """R2 (6,) of the increments on held-out places, and the mask (n,) of their rows; nan for what is not live."""
    mask = dataset.held_out(data, np.random.default_rng(seed))
    problem = frame(data.take(~mask))
    rng = np.random.default_rng(seed)
    decays = choose_decays(problem, rng)
    nets = levenberg_nets(problem, folds(problem, MEMBERS, rng), rng, decays)
    test = data.take(mask)
    x, gate = problem.coordinates.inputs(test.h, test.d, test.rpm)
    truth = increments(test.wrench, test.rpm, problem.free_air)
    r2 = r_squared(truth, gate * nets.predict(x)[0])
    return np.where(problem.live, r2, np.nan), mask


def process_r2(data: DataSet, scatter: Array, seed: int) -> Array:
    """The same R2 (6,) of Gaussian processes on the rows of one rotor speed, with each row's scatter as its noise."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    # A length at its bound says that a coordinate does not matter.
    warnings.simplefilter("ignore", ConvergenceWarning)
    held_out = dataset.held_out(data, np.random.default_rng(seed))
    learnt = data.take(~held_out)
    test = data.take(held_out)
    problem = frame(learnt)
    noise = scatter[~held_out] / problem.free_air.lift(learnt.rpm)[:, None]
    middle = learnt.rpm == np.sort(np.unique(learnt.rpm))[len(np.unique(learnt.rpm)) // 2]
    x, gate = problem.coordinates.inputs(test.h, test.d, test.rpm)
    truth = increments(test.wrench, test.rpm, problem.free_air)
    answer = np.zeros_like(truth)
    for c in np.flatnonzero(problem.live):
        rows = middle & (problem.gate[:, c] > LEAST_GATE)
        opening = problem.gate[rows, c]
        size = problem.scale[c]
        kernel = ConstantKernel(1.0, (1e-3, 1e3)) * RBF([0.5, 0.5], (0.05, 20.0)) + WhiteKernel(
            1e-3, (1e-7, 1.0)
        )
        alpha = (noise[rows, c] / (size * opening)) ** 2
        fitted = GaussianProcessRegressor(
            kernel, alpha=alpha + 1e-9, n_restarts_optimizer=2, random_state=0
        )
        fitted.fit(problem.x[rows, :2], problem.y[rows, c] / (size * opening))
        answer[:, c] = gate[:, c] * size * fitted.predict(x[:, :2])
    return np.where(problem.live, r_squared(truth, answer), np.nan)


def ceiling(data: DataSet, error: Array, rows: Array) -> Array:
    """R2 (6,) of a perfect surrogate on ``rows``; nan where the component does not vary."""
    law = free_air.fit(data)
    truth = increments(data.wrench, data.rpm, law)[rows]
    lift = law.lift(data.rpm)[rows, None]
    variance = truth.var(axis=0)
    known = variance > 1e-12
    return np.where(
        known,
        1.0 - np.mean((error[rows] / lift) ** 2, axis=0) / np.where(known, variance, 1.0),
        np.nan,
    )


def _mean_sd(values: Array) -> tuple[Array, Array]:
    """Mean and standard deviation (6,) over the splits (n, 6); nan for a component that is not live in all of them."""
    return values.mean(axis=0), values.std(axis=0)


def main() -> None:
    """Train on every split and print one table."""
    parser = command_line.parser(__doc__)
    parser.add_argument("--data", type=Path, default=SHIPPED / "corner_cfd.csv")
    parser.add_argument("--rows", type=Path, default=SHIPPED / "corner_cfd_rows.csv")
    parser.add_argument("--splits", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    add_option(parser)
    args = parser.parse_args()
    plain = dataset.read(args.data)
    scatter = scatter_of(args.rows, len(plain))
    weighted = dataset.with_sigma(plain, args.rows)
    assert weighted.sigma is not None
    found: dict[str, list[Array]] = {
        "rows alike": [],
        "weighted by sigma": [],
        "Gaussian process": [],
        "ceiling, scatter": [],
        "ceiling, sigma": [],
    }
    for split in range(args.splits):
        for name, data in (("rows alike", plain), ("weighted by sigma", weighted)):
            r2, test = held_out_r2(free_air.level(data), args.seed + split)
            found[name].append(r2)
        found["Gaussian process"].append(
            process_r2(free_air.level(plain), scatter, args.seed + split)
        )
        found["ceiling, scatter"].append(ceiling(plain, scatter, test))
        found["ceiling, sigma"].append(ceiling(plain, weighted.sigma, test))
    known = {name: _mean_sd(np.array(values)) for name, values in found.items()}
    print(
        f"{args.splits} splits by place, {len(plain)} rows of {args.data.name}; R2 of increments on held-out places"
    )
    print(f"{'':20}" + "".join(f"{axis:>16}" for axis in AXES))
    for name, (mean, sd) in known.items():
        print(f"{name:20}" + "".join(f"{m:9.3f} +-{s:5.3f}" for m, s in zip(mean, sd, strict=True)))
    most = known["ceiling, scatter"][0]
    print("share of the scatter ceiling")
    for name in ("rows alike", "weighted by sigma", "Gaussian process"):
        print(
            f"{name:20}"
            + "".join(f"{b / m:16.3f}" for b, m in zip(known[name][0], most, strict=True))
        )
    reached = zip(AXES, known["weighted by sigma"][0], most, strict=True)
    figures = [
        figure(f"held-out R², {axis}, of what the rows allow", f"{r2:.3f} of {top:.3f} = {r2 / top:.3f}", goal="0.99",
               met=r2 >= 0.99 * top)
        for axis, r2, top in reached
        if axis not in ("Fy", "Mx")
    ]  # fmt: skip
    write_result(args, figures, seeds=f"{args.splits} random splits by place")
    if args.json:
        content = {
            name: {
                key: dict(zip(AXES, map(defined, v), strict=True))
                for key, v in (("mean", m), ("sd", s))
            }
            for name, (m, s) in known.items()
        }
        args.json.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
