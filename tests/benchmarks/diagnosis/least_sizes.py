"""Are effects seen from the size on that ``could_have_seen`` says?

``python tests/benchmarks diagnosis.least_sizes [--round N...] [--seed N...] [--flight LOG VEHICLE]...``. Of simulated
flights that lack nothing (``null_*``: rounds of the first simulator, seeds of the second) and of real logs every
effect that was not named is added to the residual with its least size, one at a time, and the flight is judged again.
What is added is the catalogue's own law: this asks for the size, not for the physics.

``named``: the effect, or one that the answer cannot tell from it. ``seen``: the answer is another one than without it.
``quiet``: it is the same one.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

import command_line
import numpy as np
from flights.make import make_round
from flights.scenarios import scenarios
from independent.make import make, read_truth, stem
from result_file import counted, write_result

import replay
from diagnosis.declared import train
from diagnosis.one_answer import add_options, write_rows
from models.effects import catalogue
from replay.diagnosis.answer import Diagnosis
from replay.diagnosis.diagnose import conclude
from replay.residual.record import Record
from replay.search.least_visible import LeastSize, least_sizes
from replay.search.posterior import Walked
from replay.search.walk import walk


@dataclass(frozen=True)
class Flight:
    """A log, its vehicle file, and its declared model."""

    name: str
    log: Path
    vehicle: Path
    model: str | None = None


@dataclass(frozen=True)
class Row:
    """One effect on one flight."""

    flight: str
    effect: str
    coefficient: str
    size: float
    named: bool
    seen: bool
    answer: str


def main() -> int:
    args = _parser().parse_args()
    folder = args.keep or Path(tempfile.gettempdir()) / "least-sizes"
    rows: list[Row] = []
    real = [Flight(Path(log).stem, Path(log), Path(vehicle)) for log, vehicle in args.flight]
    for flight in chain(_first(folder, args), _second(folder, args), real):
        for row in rows_of(flight):
            rows.append(row)
            print(line(row), flush=True)
    figures = [
        counted("named from the least size on", [r.named for r in rows], least=0.8),
        counted("seen from the least size on", [r.named or r.seen for r in rows], least=0.95),
    ]
    print()
    for figure in figures:
        print(f"{figure['what']:32s} {figure['value']:>6s}  ({figure['detail']})")
    flown = f"rounds {args.round}, seeds {args.seed}, flights {[f.name for f in real]}"
    write_result(args, figures, seeds=flown, simulated=not real)
    write_rows(args.json, rows)
    return 0


def _parser() -> argparse.ArgumentParser:
    p = command_line.parser(__doc__)
    p.add_argument("--round", type=int, nargs="*", default=[], help="of the first simulator")
    p.add_argument("--seed", type=int, nargs="*", default=[], help="of the second one")
    p.add_argument(
        "--flight",
        nargs=2,
        action="append",
        default=[],
        metavar=("LOG", "VEHICLE"),
        help="a real log and its vehicle file, judged without a model",
    )
    add_options(p, timeout_s=300.0)
    return p


def _first(folder: Path, args: argparse.Namespace) -> Iterator[Flight]:
    for number in args.round:
        place = folder / f"round{number}"
        nulls = [s.name for s in scenarios(number) if s.group == "null"]
        truth = make_round(place, number, nulls)
        model = train(place / "table.csv", args.method, folder)
        for name in nulls:
            declared = str(model) if truth[name]["model"] == "table" else None
            base = str(place / name)
            yield Flight(f"{number}/{name}", Path(f"{base}.tlog"), Path(f"{base}.toml"), declared)


def _second(folder: Path, args: argparse.Namespace) -> Iterator[Flight]:
    for case in make(folder, args.seed, ["null"], lambda text: print(text, file=sys.stderr)):
        declared = None
        if read_truth(folder, case)["model"] == "table":
            declared = str(train(folder / "guarded.csv", args.method, folder))
        base = str(stem(folder, case))
        name = f"{case.seed}/{case.name}"
        yield Flight(name, Path(f"{base}.tlog"), Path(f"{base}.toml"), declared)


def rows_of(flight: Flight) -> Iterator[Row]:
    """Every effect that the flight would have shown, from the size on that is said."""
    answer = replay.diagnose(flight.log, flight.vehicle, flight.model)
    (record,) = answer.records
    walked = walk([record], catalogue())
    for least in least_sizes(walked):
        size = least.size
        if least.coefficient.most(record.context) < size:
            size = -size
        again = conclude([with_effect(walked, record, least, size)])
        yield Row(
            flight=flight.name,
            effect=least.term.name,
            coefficient=least.coefficient.name,
            size=size,
            named=_named(again, least.term.name),
            seen=_said(again) != _said(answer),
            answer=" ".join(_said(again)) or "nothing",
        )


def with_effect(walked: Walked, record: Record, least: LeastSize, size: float) -> Record:
    """The record with one column of an effect in its residual."""
    x, _ = walked.evidence.library.wrenches(least.term, least.flight)
    wrench = size * np.nan_to_num(x[:, :, least.number])
    return replace(record, residual=record.residual + wrench)


def _named(answer: Diagnosis, name: str) -> bool:
    return any(name in (f.effect.name, *f.aliases) for f in answer.found)


def _said(answer: Diagnosis) -> tuple[str, ...]:
    """What a reader is told: effects, channels that carry a force, axes on which something acts."""
    effects = [f.effect.name for f in answer.found]
    channels = [f"{c.axis}({c.name})" for c in answer.channels]
    outside = [f"{o.axis}(outside)" for trace in answer.traces for o in trace.outside]
    return tuple(sorted({*effects, *channels, *outside}))


def line(row: Row) -> str:
    """One line of the table."""
    mark = "named" if row.named else "seen " if row.seen else "QUIET"
    effect = f"{row.effect} {row.coefficient} {row.size:.3g}"
    return f"{mark} {row.flight:20s} {effect:36s} {row.answer}"


if __name__ == "__main__":
    sys.exit(main())
