"""Learn on one real flight, predict another: ours against black boxes, on the same residual, features and time.

``python tests/benchmarks measured.transfer --data ../shared/data/measured --cache DIR --json FILE``. Every pair of
flights of one vehicle: the error of B (RMS of the residual, forces) with a model learnt on A over that with nothing
added, as the geometric mean over the axes. Two protocols: *frozen* fits nothing on B; *twenty seconds* learns what
belongs to the day from B's first 20 s (black boxes: the mean of what they leave there) and judges the rest. ``--table
TABLE DIR`` adds the flights of a table in ``measured/``, whose logs are in DIR; flights with the same vehicle file are
of one vehicle.

Diagnoses stay in the cache: take a new one where the search changed. Pairs that FILE holds are not measured again.
"""

from __future__ import annotations

import json
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import permutations
from pathlib import Path

import command_line
import numpy as np
from result_file import add_option, counted, figure, write_result
from sklearn.compose import TransformedTargetRegressor
from sklearn.ensemble import HistGradientBoostingRegressor
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
from sklearn.linear_model import RidgeCV
from sklearn.multioutput import MultiOutputRegressor
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler

from measured import sparse_peer
from measured.known import read
from models.common.errors import LogError
from models.common.frames import Array
from models.effects import AdoptedEffect, adopted_wrench
from models.surrogate.fan_surrogate import FanSurrogate
from models.vehicle import load_vehicle
from replay.diagnosis.amended_model import amended
from replay.diagnosis.diagnose import conclude, read_records
from replay.predict.day import learning_time
from replay.predict.predict import LEAST_S, predicted
from replay.residual.record import Record

OURS = "ours"
MEAN = "mean"
FROZEN = "frozen"
TWENTY = "twenty_seconds"
GOALS = {FROZEN: 0.45, TWENTY: 0.30}
SPACING_S = 0.2
"""Of the samples that black boxes learn from: the residual holds nothing above 2 Hz."""
GP_POINTS = 400
"""A Gaussian process learns from so many samples at most."""
DRAWS = 2000
"""Of the bootstrap over pairs."""
SOURCES = {
    "neural-fly": ("neural-fly.toml", ("nf_*.tlog", "more/nf_*.tlog")),
    "crazyflie large": ("crazyflie-large.toml", ("ns_*L_ground*.tlog",)),
    "crazyflie small": ("crazyflie-small.toml", ("ns_*S_ground*.tlog", "more/ns_*S_ground*.tlog")),
    "brushless": ("imrc/BL.toml", ("imrc/BL_*.tlog",)),
    "slung load": ("imrc/PL.toml", ("imrc/PL_*.tlog",)),
    "nanobench": ("nanobench/nb.toml", ("nanobench/nb_*.tlog",)),
    "crazypad": ("crazypad/E8.toml", ("crazypad/E8_normal_*.tlog",)),
    "appius": ("appius/appius.toml", ("appius/*.tlog",)),
}
"""Vehicle file and flights of one vehicle; the other half of each source is kept for acceptance."""


@dataclass(frozen=True)
class Group:
    """Logs of one vehicle."""

    source: str
    vehicle: Path
    logs: tuple[Path, ...]


@dataclass(frozen=True)
class Flight:
    """One flight, and the model that our diagnosis of it alone makes."""

    record: Record
    model: FanSurrogate


class Averaged:
    """The mean residual, whatever the features."""

    def fit(self, _: Array, y: Array) -> Averaged:
        self.mean = y.mean(axis=0)
        return self

    def predict(self, x: Array) -> Array:
        return np.tile(self.mean, (len(x), 1))


def black_boxes() -> dict[str, Callable[[], object]]:
    """Regressors with the settings that are usual for a few hundred samples."""
    ridge = RidgeCV(np.logspace(-2, 5, 15))
    kernel = ConstantKernel(1.0, (1e-2, 1e2)) * RBF(5.0, (0.5, 50.0)) + WhiteKernel(
        0.1, (1e-3, 1e1)
    )
    boosted = HistGradientBoostingRegressor(
        max_iter=100, min_samples_leaf=10, early_stopping=False, random_state=0
    )
    network = MLPRegressor(hidden_layer_sizes=(16, 16), alpha=0.1, max_iter=800, random_state=0)

    def scaled(regressor: object) -> object:
        steps = make_pipeline(StandardScaler(), regressor)
        return TransformedTargetRegressor(steps, transformer=StandardScaler())

    boxes: dict[str, Callable[[], object]] = {
        MEAN: Averaged,
        "ridge": lambda: scaled(make_pipeline(PolynomialFeatures(2), StandardScaler(), ridge)),
        "network": lambda: scaled(network),
        "trees": lambda: MultiOutputRegressor(boosted),
        "gaussian process": lambda: scaled(GaussianProcessRegressor(kernel)),
    }
    return boxes | (
        {} if sparse_peer.pysindy is None else {"sparse regression": sparse_peer.SparseRegression}
    )


def features(record: Record) -> Array:
    """(n, k): velocity, rates and the vertical in the body, thrust of every fan, its square, height, voltage."""
    ctx = record.context
    state = record.context.state
    thrust = ctx.thrust / ctx.weight
    height = np.nan_to_num(
        np.minimum(np.nanmin(np.where(np.isnan(state.h_m), np.inf, state.h_m), axis=1), 3.0),
        nan=3.0,
    )
    volts = state.battery_voltage_v
    parts = [
        ctx.velocity, state.rates, state.rotation[..., 2, :], thrust, thrust.sum(axis=1)[:, None] ** 2,
        np.exp(-height / ctx.vehicle.rotor_radius_m)[:, None], volts[:, None],
    ]  # fmt: skip
    return np.nan_to_num(np.concatenate(parts, axis=1))


def named_groups(data: Path, wanted: Sequence[str]) -> Iterator[Group]:
    """The vehicles of ``SOURCES`` whose files are below ``data``."""
    for source in wanted:
        file, patterns = SOURCES[source]
        yield Group(
            source,
            data / file,
            tuple(sorted(path for pattern in patterns for path in data.glob(pattern))),
        )


def groups_of(table: Path, data: Path) -> Iterator[Group]:
    """The vehicles of a table; a log that is not in ``data`` is left out by name."""
    logs: dict[tuple[str, str], list[Path]] = {}
    for flight in read(table).flights:
        missing = flight.missing(data)
        if missing:
            print(f"left out: not in {data}: {', '.join(missing)}", file=sys.stderr)
        elif not flight.again:
            logs.setdefault((flight.source, flight.vehicle), []).append(data / flight.log)
    for (source, vehicle), paths in logs.items():
        yield Group(source, data / vehicle, tuple(paths))


def flights(group: Group, cache: Path) -> list[Flight]:
    """The flights of a vehicle with the model that one diagnosis of each makes; refused logs are left out by name."""
    vehicle = load_vehicle(group.vehicle)
    out = []
    for log in group.logs:
        try:
            records, notes = read_records([log], vehicle, None, None)
        except LogError as error:
            print(f"left out: {error}", file=sys.stderr)
            continue
        kept = cache / f"{log.parent.name}-{log.stem}.json"
        if not kept.is_file():
            found = [asdict(e) for e in conclude(records, notes).adopted]
            kept.write_text(json.dumps(found, indent=1))
            print(f"diagnosed {log.name}", file=sys.stderr)
        effects = [
            AdoptedEffect(e["name"], e["parameters"], tuple(e["without"]))
            for e in json.loads(kept.read_text())
        ]
        out.append(Flight(records[0], amended(None, vehicle, effects)))
    return out


def spread(count: int, most: int | None) -> set[int]:
    """Places of at most ``most`` of ``count`` pairs, evenly over them."""
    if most is None or count <= most:
        return set(range(count))
    return {i * count // most for i in range(most)}


def ratio(residual: Array, before: Array, rows: Array, axes: Sequence[int]) -> float:
    """Geometric mean over axes of RMS after over RMS before."""
    after, bare = (np.sqrt((r[rows][:, list(axes)] ** 2).mean(axis=0)) for r in (residual, before))
    return float(np.exp(np.log(np.maximum(after, 1e-9) / np.maximum(bare, 1e-9)).mean()))


def pair(a: Flight, b: Flight, learnt: dict[str, object]) -> dict[str, dict[str, float]]:
    """By protocol and method, the error of B with what was learnt on A over that with nothing."""
    axes = [x for x in b.record.axes if x < 3]
    before = np.nan_to_num(b.record.residual)
    told = adopted_wrench(a.model.effects, b.record.context)
    ours = Record(**{**b.record.__dict__, "residual": b.record.residual - told})
    rows = b.record.valid
    start = learning_time(b.record)
    rest = rows & ~start
    x = features(b.record)
    out: dict[str, dict[str, float]] = {FROZEN: {}, TWENTY: {}}
    for frozen, name, time in ((True, FROZEN, rows), (False, TWENTY, rest)):
        if time.sum() * b.record.step_s < LEAST_S:
            continue
        flight = predicted(ours, b.record, a.model, frozen=frozen)
        out[name][OURS] = ratio(flight.with_effects, before, time, axes)
        for method, regressor in learnt.items():
            left = before.copy()
            left[:, axes] -= regressor.predict(x)[
                :, [i for i, k in enumerate(range(3)) if k in axes]
            ]
            if not frozen:
                left -= left[start].mean(axis=0)
            out[name][method] = ratio(left, before, time, axes)
    return out


def learn(a: Flight) -> dict[str, object]:
    """Every black box on one flight: residual of three forces by the features."""
    every = max(round(SPACING_S / a.record.step_s), 1)
    rows = np.flatnonzero(a.record.valid)[::every]
    x = features(a.record)[rows]
    y = np.nan_to_num(a.record.residual)[rows, :3]
    out = {}
    for name, make in black_boxes().items():
        step = max(len(rows) // GP_POINTS, 1) if name == "gaussian process" else 1
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            out[name] = make().fit(x[::step], y[::step])
    return out


def measure(
    group: Group, cache: Path, most: int | None, known: Sequence[dict]
) -> Iterator[list[dict]]:
    """Pairs of one vehicle that are not ``known``, all that were learnt on one flight at a time."""
    seen = {(r["source"], r["learnt_on"], r["predicted"]) for r in known}
    found = flights(group, cache)
    pairs = list(permutations(found, 2))
    for i, one in enumerate(found):
        names = {"source": group.source, "learnt_on": one.record.name}
        todo = [
            other
            for k in sorted(spread(len(pairs), most))
            for start, other in [pairs[k]]
            if start is one and (group.source, one.record.name, other.record.name) not in seen
        ]
        if todo:
            boxes = learn(one)
            yield [
                names | {"predicted": other.record.name} | pair(one, other, boxes) for other in todo
            ]
            print(f"{group.source}: {i + 1} of {len(found)} flights learnt", file=sys.stderr)


def interval(
    values: Sequence[float], pairs: Sequence[tuple[str, str]] | None = None
) -> tuple[float, float, float]:
    """Geometric mean with its 95 % interval. ``pairs``: the two flights of each value, which are drawn, not pairs.

    A pair counts as often as the product of how often its flights are drawn (Owen 2007, Annals of Applied Statistics 1,
    386): pairs that share a flight are no independent evidence. Two flights give no interval but the values.
    """
    logs = np.log(np.asarray(values))
    rng = np.random.default_rng(0)
    if pairs is None:
        weights = rng.multinomial(len(logs), np.full(len(logs), 1.0 / len(logs)), DRAWS)
    else:
        names = sorted({name for pair in pairs for name in pair})
        drawn = rng.multinomial(len(names), np.full(len(names), 1.0 / len(names)), DRAWS)
        one, other = (drawn[:, [names.index(pair[k]) for pair in pairs]] for k in (0, 1))
        weights = one * other
    weights = weights[weights.sum(axis=1) > 0]
    low, high = np.exp(np.percentile(weights @ logs / weights.sum(axis=1), [2.5, 97.5]))
    return float(np.exp(logs.mean())), float(low), float(high)


def flights_of(row: dict) -> tuple[str, str]:
    """Names of both flights of a pair, with their source."""
    return f"{row['source']} {row['learnt_on']}", f"{row['source']} {row['predicted']}"


def shown(rows: Sequence[dict], protocol: str, method: str) -> str:
    """Geometric mean and interval of a method."""
    return "{:.2f} [{:.2f}, {:.2f}]".format(
        *interval([r[protocol][method] for r in rows], [*map(flights_of, rows)])
    )


def is_best(row: dict[str, float]) -> bool:
    """Whether ours is at least as good as every other on a pair."""
    return row[OURS] <= min(v for k, v in row.items() if k != OURS)


def table(rows: Sequence[dict], protocol: str) -> str:
    """Geometric means by source and method; how often ours is best, and how often worse than nothing."""
    rows = [r for r in rows if r[protocol]]
    if not rows:
        return f"{protocol}: no pair is long enough"
    methods = [m for m in rows[0][protocol] if all(m in r[protocol] for r in rows)]
    lines = [
        f"{protocol}: {'source':16s} pairs "
        + " ".join(f"{m:>18s}" for m in methods)
        + "  best  worse"
    ]
    sources = tuple(dict.fromkeys(r["source"] for r in rows))
    for source in (*sources, "all"):
        part = [r for r in rows if source in (r["source"], "all")]
        cells = [shown(part, protocol, m) for m in methods]
        best, worse = (
            sum(f(r[protocol]) for r in part) for f in (is_best, lambda r: r[OURS] > 1.0)
        )
        lines.append(
            f"  {source:24s} {len(part):5d} "
            + " ".join(f"{c:>18s}" for c in cells)
            + f"  {best:4d}  {worse:5d}"
        )
    means = [
        [
            np.exp(np.mean([np.log(r[protocol][m]) for r in rows if r["source"] == s]))
            for s in sources
        ]
        for m in methods
    ]
    alike = ["{:.2f} [{:.2f}, {:.2f}]".format(*interval(m)) for m in means]
    lines.append(
        f"  {'sources weighed alike':24s} {len(sources):5d} " + " ".join(f"{c:>18s}" for c in alike)
    )
    return "\n".join(lines)


def figures(rows: Sequence[dict]) -> list[dict]:
    """For the page of results: the vehicles of ``SOURCES``, and those of tables."""
    out = []
    for place, wanted in (("", True), (", other sources", False)):
        for protocol, goal in GOALS.items():
            name = protocol.replace("_", " ") + place
            part = [r for r in rows if r[protocol] and (r["source"] in SOURCES) == wanted]
            if not part:
                continue
            ours, low, high = interval([r[protocol][OURS] for r in part], [*map(flights_of, part)])
            others = {
                m: interval([r[protocol][m] for r in part])[0]
                for m in part[0][protocol]
                if m != OURS
            }
            worse = sum(r[protocol][OURS] > 1.0 for r in part)
            out += [
                figure(
                    f"{name}: ours",
                    f"{ours:.2f}",
                    f"[{low:.2f}, {high:.2f}]",
                    f"{goal:.2f}",
                    round(ours, 2) <= goal,
                ),
                figure(
                    f"{name}: {', '.join(others)}", ", ".join(f"{v:.2f}" for v in others.values())
                ),
                counted(
                    f"{name}: ours better than the best black box",
                    [is_best(r[protocol]) for r in part],
                    least=0.8,
                ),
                figure(
                    f"{name}: worse than nothing", str(worse), f"of {len(part)}", "0", worse == 0
                ),
            ]
    return out


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark."""
    p = command_line.parser(__doc__)
    p.add_argument("--data", type=Path, default=Path("../shared/data/measured"))
    p.add_argument("--table", type=Path, nargs=2, metavar=("TABLE", "DIR"), action="append", default=[],
                   help="also flights of a table, with the folder of their logs; may be repeated")  # fmt: skip
    p.add_argument("--cache", type=Path, required=True, help="folder for diagnoses, one JSON a log")
    p.add_argument(
        "--source",
        choices=SOURCES,
        nargs="*",
        default=SOURCES,
        help="only these of --data, or none",
    )
    p.add_argument(
        "--most", type=int, metavar="N", help="at most so many pairs a vehicle, evenly over them"
    )
    p.add_argument("--json", type=Path)
    add_option(p)
    a = p.parse_args(argv)
    folders = [a.data] * bool(a.source) + [folder for _, folder in a.table]
    absent = [folder for folder in folders if not folder.is_dir()]
    if absent:
        print(f"transfer: no flights at {absent[0]}", file=sys.stderr)
        return 2
    if sparse_peer.pysindy is None:
        print(sparse_peer.MISSING, file=sys.stderr)
    a.cache.mkdir(parents=True, exist_ok=True)
    rows = json.loads(a.json.read_text()) if a.json is not None and a.json.is_file() else []
    groups = [
        *named_groups(a.data, a.source),
        *(group for table, folder in a.table for group in groups_of(table, folder)),
    ]
    for group in groups:
        for new in measure(group, a.cache, a.most, rows):
            rows += new
            if a.json is not None:
                a.json.write_text(json.dumps(rows, indent=1) + "\n")
    for protocol in (FROZEN, TWENTY):
        print(table(rows, protocol))
    for r in rows:
        if max(r[FROZEN].get(OURS, 0.0), r[TWENTY].get(OURS, 0.0)) > 1.0:
            ratios = {k: round(r[k].get(OURS, np.nan), 2) for k in (FROZEN, TWENTY)}
            print(f"worse than nothing: {r['learnt_on']} -> {r['predicted']} {ratios}")
    count = len({flights_of(r)[0] for r in rows})
    long = sum(bool(r[TWENTY]) for r in rows)
    seeds = f"{len(rows)} pairs of {count} flights, {long} with twenty seconds"
    write_result(a, figures(rows), seeds=seeds, simulated=False)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
