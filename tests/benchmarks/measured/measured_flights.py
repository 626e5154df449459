"""Run ``replay diagnose`` on every measured flight, and judge its answers by a table of what is known.

``python tests/benchmarks measured.measured_flights [--source NAME...] [--flight NAME...] [--jobs N] [--json FILE]``.
The table, ``measured/flights.toml``, says what each flight must, may and cannot have, and where that stands. The
flights are not part of the project: they are looked for in ``../shared/data`` (or ``$CORNER_SHARED/data``, or
``--data``) and left out, by name, where they are not there. ``--plot FILE`` draws how often what is stated so surely is
right.

``--change NAME`` declares the vehicle wrong on purpose (``measured/changes.py``): what is hidden is then known exactly.
``--drafted`` asks a second time without a vehicle file, with the mass alone, and says which first names become wrong.
``--table FILE`` judges by another table: ``measured/nanodrone.toml`` is one of a source that no rule was made on.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

import command_line
from diagnosis.one_answer import Asked
from diagnosis.reliability import plot, statements, table
from result_file import add_option, counted, write_result
from shares import share
from tqdm import tqdm

from measured.answers import DATA, ask, declared, weight_n
from measured.changes import CHANGES, changed
from measured.judge import BEST_FACTOR, Judgement, judge, judge_refusal
from measured.known import FORCES, KINDS, TABLE, Flight, Known, read, together


def main(argv: Sequence[str] | None = None) -> int:
    args = _parser().parse_args(argv)
    known = read(args.table)
    wanted = [f for f in known.flights if _chosen(f, args)]
    if not wanted:
        print(
            f"no such source or flight; sources: {', '.join(_sources(known.flights))}",
            file=sys.stderr,
        )
        return 2
    here = [f for f in wanted if not f.missing(args.data)]
    for f in wanted:
        if f not in here:
            print(
                f"left out {f.source}: {f.name}: not there: {', '.join(f.missing(args.data))}",
                file=sys.stderr,
            )
    if not here:
        print(
            f"none of the flights is in {args.data} (they are not part of the project)",
            file=sys.stderr,
        )
        return 0
    with tempfile.TemporaryDirectory() as folder:
        if args.change:
            wrong = (
                changed(f, name, args.data, Path(folder))
                for name in args.change
                for f in here
                if not f.again
            )
            here = [f for f in wrong if f is not None]
        judgements = _run(together(here) if args.together else here, known, args)
    print(_report(judgements))
    if args.drafted:
        args.again = True
        print(f"\n{_compared(judgements, _run(here, known, args))}")
    said = [s for j in judgements if not j.again for s in statements(as_json(j))]
    print(f"\n{table(said)}")
    if args.json:
        args.json.write_text(
            json.dumps({"flights": [as_json(j) for j in judgements]}, indent=1) + "\n"
        )
    once = [j for j in judgements if not j.again and not j.excused]
    figures = [
        counted("right", (j.right for j in once), least=0.9),
        counted("a wrong name", (bool(j.wrong) for j in once), most=0.03),
        counted("too sure", (bool(j.overclaim) for j in once), most=0.0),
        counted("known sizes right", (s.right for j in once for s in j.sizes)),
    ]
    write_result(args, figures, seeds=f"{len(once)} flights of {args.table.name}", simulated=False)
    if args.plot:
        plot(args.plot, {kind: [s for s in said if s.kind == kind] for kind in KINDS})
    return 0


def _parser() -> argparse.ArgumentParser:
    p = command_line.parser(__doc__)
    p.add_argument(
        "--data",
        type=Path,
        default=DATA,
        metavar="DIR",
        help=f"folder of the flights (default: {DATA})",
    )
    p.add_argument(
        "--table", type=Path, default=TABLE, metavar="FILE", help="what is known of the flights"
    )
    p.add_argument(
        "--change",
        nargs="*",
        default=[],
        choices=CHANGES,
        help="declare the vehicle wrong on purpose",
    )
    p.add_argument(
        "--source", nargs="*", default=[], metavar="NAME", help="only flights of these sources"
    )
    p.add_argument(
        "--flight",
        nargs="*",
        default=[],
        metavar="NAME",
        help="only these flights (the log's name)",
    )
    p.add_argument(
        "--answers",
        type=Path,
        metavar="DIR",
        help="keep answers here, and judge those that are kept already",
    )
    p.add_argument(
        "--drafted",
        action="store_true",
        help="ask again with the mass in place of the vehicle file",
    )
    p.add_argument(
        "--together", action="store_true", help="all flights of a vehicle file as one data set"
    )
    p.add_argument(
        "--setting",
        nargs="*",
        default=[],
        metavar="NAME=VALUE",
        help="another number in the search (replay.search)",
    )
    p.add_argument("--jobs", type=int, default=1, metavar="N", help="diagnoses at a time")
    p.add_argument("--timeout", type=float, default=300.0, metavar="S", help="of one diagnosis")
    p.add_argument("--json", type=Path, metavar="FILE", help="write every judgement")
    p.add_argument(
        "--plot", type=Path, metavar="FILE.png", help="reliability: stated against right"
    )
    add_option(p)
    return p


def _chosen(flight: Flight, args: argparse.Namespace) -> bool:
    return (not args.source or flight.source in args.source) and (
        not args.flight or flight.name in args.flight or Path(flight.log).stem in args.flight
    )


def _run(flights: Sequence[Flight], known: Known, args: argparse.Namespace) -> list[Judgement]:
    for name in {f.table for f in flights if f.table}:
        _model(args.data / name)  # before the threads: trained once
    with ThreadPoolExecutor(args.jobs) as pool:
        futures = [pool.submit(judged, f, known, args) for f in flights]
        shown = tqdm(futures, unit="flight", file=sys.stderr, disable=not sys.stderr.isatty())
        return [future.result() for future in shown]


def judged(flight: Flight, known: Known, args: argparse.Namespace) -> Judgement:
    """The judgement of one flight's answer, asked for or kept."""
    asked = _answer(flight, args)
    if asked.answer is None:
        return judge_refusal(flight, asked.exit_code, asked.last_words, asked.seconds)
    return judge(flight, known, asked.answer, weight_n(args.data / flight.vehicle), asked.seconds)


def _answer(flight: Flight, args: argparse.Namespace) -> Asked:
    again = getattr(args, "again", False)
    name = f"{flight.source}.{flight.name.replace(' ', '_')}{'.drafted' if again else ''}.json"
    kept = args.answers / name if args.answers else None
    if kept is not None and kept.is_file():
        return Asked(**json.loads(kept.read_text()))
    model = str(_model(args.data / flight.table)) if flight.table else flight.model
    logs = [args.data / log for log in flight.logs]
    asked = ask(
        logs, args.data / flight.vehicle, model, args.timeout, settings=args.setting, drafted=again
    )
    if kept is not None:
        kept.parent.mkdir(parents=True, exist_ok=True)
        kept.write_text(json.dumps(asdict(asked)))
    return asked


_model = cache(declared)


def as_json(j: Judgement) -> dict[str, Any]:
    """A judgement with what follows from it."""
    return asdict(j) | {"right": j.right, "wrong": list(j.wrong), "unknown": list(j.unknown)}


def _sources(flights: Iterable[Flight | Judgement]) -> list[str]:
    return list(dict.fromkeys(f.source for f in flights))


def _report(judgements: Sequence[Judgement]) -> str:
    lines = []
    for source in _sources(judgements):
        rows = [j for j in judgements if j.source == source]
        lines += [
            f"== {source} ({rows[0].kind}{', again' if rows[0].again else ''})",
            *(_line(j) for j in rows),
        ]
    lines += [
        "",
        *_counts(
            "source", {s: [j for j in judgements if j.source == s] for s in _sources(judgements)}
        ),
    ]
    once = [j for j in judgements if not j.again]
    sums = {kind: [j for j in once if j.kind == kind] for kind in KINDS}
    sums["measured + autopilot"] = sums["measured"] + sums["autopilot"]
    return "\n".join([*lines, "", *_counts("kind", sums), "", *_details(once)])


def _compared(given: Sequence[Judgement], drafted: Sequence[Judgement]) -> str:
    """First names with the vehicle file and with the draft."""
    rows = [(g, d, _first(g), _first(d)) for g, d in zip(given, drafted, strict=True)]
    lines = [
        f"{g.flight:40s} {name:20s} {_WORDS[right]:8s} -> {other:20s} {_WORDS[still]:8s} {d.seconds:5.1f} s"
        + (f"  {d.note[:120]}" if d.verdict in ("refused", "failed") else "")
        for g, d, (name, right), (other, still) in rows
    ]
    lost = share(b[1] is False for _, _, a, b in rows if a[1] is True)
    won = share(b[1] is True for _, _, a, b in rows if a[1] is False)
    return "\n".join([*lines, f"right -> wrong {lost}; wrong -> right {won}"])


_WORDS = {True: "right", False: "wrong", None: "unknown"}


def _first(j: Judgement) -> tuple[str, bool | None]:
    """The name that stands first and whether it is right; no name is right where none was needed."""
    named = [s for s in j.statements if s.named]
    if named:
        return named[0].effect, named[0].right
    return j.verdict, None if j.excused else not (j.missed or j.refused)


def _line(j: Judgement) -> str:
    marks = [
        *(["excused"] if j.excused else ["refused"] if j.refused else []),
        *(["WRONG " + ",".join(j.wrong)] if j.wrong else []),
        *(["missed " + ",".join(j.missed)] if j.missed else []),
        *([f"OVERCLAIM ({j.overclaim})"] if j.overclaim else []),
        *([f"verdict {j.verdict}"] if j.verdict_wrong else []),
        *(["unknown " + ",".join(j.unknown)] if j.unknown else []),
        *(
            f"size {s.effect}.{s.parameter} {s.value:.3g} not {s.low:g}..{s.high:g}"
            for s in j.sizes
            if not s.right
        ),
    ]
    axes = "  ".join(
        f"{a.axis} {a.before:.3g}->{a.after:.3g}" + (f" (best {a.best:.3g})" if a.best else "")
        for a in j.axes
        if a.axis in FORCES or j.kind == "simulated"
    )
    head = f"{'ok' if j.right else '--'}  {j.flight:36s} {j.seconds:5.1f} s  {'; '.join(marks)}"
    return f"{head}\n      {j.note}\n      {axes}"


def _counts(what: str, groups: dict[str, list[Judgement]]) -> list[str]:
    head = ("right", "wrong", "missed", "refused", "overclaimed")
    out = [f"{what:22s}" + "".join(f"{h:>24s}" for h in head)]
    for name, rows in groups.items():
        kept = [j for j in rows if not j.excused]
        if kept:
            flags = [
                [j.right, bool(j.wrong), bool(j.missed), j.refused, bool(j.overclaim)] for j in kept
            ]
            cells = [share(bool(f[k]) for f in flags) for k in range(5)]
            out.append(f"{name:22s}" + "".join(f"{c:>24s}" for c in cells))
    return out


def _details(judgements: Sequence[Judgement]) -> list[str]:
    real = [j for j in judgements if j.kind != "simulated" and not j.excused]
    names = [s for j in real for s in j.statements if s.named]
    best = [(a.after / a.best) for j in real for a in j.axes if a.best]
    sizes = [s.right for j in real for s in j.sizes]
    return [
        f"names stated (measured + autopilot)      right {share(s.right is True for s in names)}",
        f"                                         wrong {share(s.right is False for s in names)}",
        f"                                         nothing known {share(s.right is None for s in names)}",
        f"flights right if those were wrong, too   {share(j.right and not j.unknown for j in real)}",
        f"known sizes right                        {share(sizes)}",
        f"RMS after <= {BEST_FACTOR} x the best fit's       {share(r <= BEST_FACTOR for r in best)}",
    ]


if __name__ == "__main__":
    sys.exit(main())
