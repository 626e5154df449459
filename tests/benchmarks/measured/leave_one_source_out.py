"""Numbers and rules of the search, judged on sources that they were not made from.

``python tests/benchmarks measured.leave_one_source_out --answers DIR`` answers every measured flight with every setting
below (answers are kept in DIR: it can be stopped and started again). For each source the setting that is best on all
*other* measured sources, and on nothing else, is judged on this one; the sums over all sources say how the search does
where its numbers were not chosen.

``--rules`` switches one rule of docs/lab/rules.md off at a time: what each source loses and gains by it.
``--also TABLE=DIR`` adds the flights of another table of ``measured/``, whose logs lie in DIR.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import command_line
from diagnosis.one_answer import Asked
from shares import share
from tqdm import tqdm

from measured.answers import DATA, weight_n
from measured.judge import Judgement, judge, judge_refusal
from measured.known import TABLE, Flight, Known, read
from measured.settings import parse, used
from models.common.errors import LogError
from replay.command import declared
from replay.diagnosis.diagnose import conclude, read_records
from replay.diagnosis.model_faults import model_faults

SETTINGS = (
    "", "TRUST=0.25", "TRUST=0.35", "TRUST=0.7", "TRUST=1.0", "FLOOR=0.1", "FLOOR=0.4", "CANCEL=2.0", "CANCEL=4.0",
    "FORM_LEFT=0.03", "FORM_LEFT=0.12",
)  # fmt: skip
"""What is tried: the search as it is first, then one number changed at a time."""
RULES = (
    "", "CANCEL_COST=0", "CURVE_FORM=0", "MARGIN=0", "NAMED=1e9", "predictive=off", "WORSE_SHARE=1e9",
    "with_surface_law=off", "FORM_LEFT=0", "LOUDEST=1e9", "FITTED_SHARE=1", "KNOWN=1", "REACTION_ODDS=2e-4",
)  # fmt: skip
"""The search as it is, then without one rule at a time (docs/lab/rules.md)."""
SAME_SOURCE = {"neighbour": "neural-swarm"}
"""Flights of the same people and vehicles under another name are left out with them."""


@dataclass(frozen=True)
class Sum:
    """What a setting got right on some flights."""

    right: int
    wrong: int
    overclaimed: int

    @property
    def rank(self) -> tuple[int, int]:
        """Right answers count, then names that are wrong and claims too large."""
        return self.right, -self.wrong - self.overclaimed


def total(rows: Sequence[Judgement]) -> Sum:
    """Count a setting's judgements."""
    return Sum(
        sum(j.right for j in rows),
        sum(bool(j.wrong) for j in rows),
        sum(bool(j.overclaim) for j in rows),
    )


def origin(j: Judgement) -> str:
    """Whose flight it is."""
    return SAME_SOURCE.get(j.source, j.source)


def chosen(by_setting: dict[str, list[Judgement]], source: str) -> str:
    """The setting that is best without ``source``; the first of equals."""
    return max(
        by_setting, key=lambda s: total([j for j in by_setting[s] if origin(j) != source]).rank
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Answer, judge, print."""
    p = command_line.parser(__doc__)
    p.add_argument(
        "--answers", type=Path, required=True, metavar="DIR", help="where answers are kept"
    )
    p.add_argument(
        "--data",
        type=Path,
        default=DATA,
        metavar="DIR",
        help=f"folder of the flights (default: {DATA})",
    )
    p.add_argument(
        "--also",
        nargs="*",
        default=[],
        metavar="TABLE=DIR",
        help="other tables, and where their logs lie",
    )
    p.add_argument("--rules", action="store_true", help="one rule off at a time")
    p.add_argument("--settings", nargs="*", metavar="NAME=VALUE", help="what is tried")
    args = p.parse_args(argv)
    settings = args.settings or list(RULES if args.rules else SETTINGS)
    tables = {TABLE: args.data} | {
        Path(t): Path(d) for t, d in (words.split("=") for words in args.also)
    }
    work = [
        (f, known, data)
        for table, data in tables.items()
        for known in [read(table)]
        for f in _here(known, data)
    ]
    if not work:
        print(
            f"none of the flights is in {args.data} (they are not part of the project)",
            file=sys.stderr,
        )
        return 0
    by_setting: dict[str, list[Judgement]] = {s: [] for s in settings}
    for flight, known, data in tqdm(
        work, unit="flight", file=sys.stderr, disable=not sys.stderr.isatty()
    ):
        for setting, asked in zip(
            settings, _answers(flight, data, settings, args.answers), strict=True
        ):
            judged = _judged(flight, known, data, asked)
            if not judged.excused:
                by_setting[setting].append(judged)
    print(rules(by_setting) if args.rules else report(by_setting))
    return 0


def _here(known: Known, data: Path) -> list[Flight]:
    return [
        f for f in known.flights if f.kind == "measured" and not f.again and not f.missing(data)
    ]


def _answers(flight: Flight, data: Path, settings: Sequence[str], kept: Path) -> Iterator[Asked]:
    """A flight's answer with every setting, asked for or kept; the log is read once."""
    records = None
    for setting in settings:
        file = kept / (setting or "own") / f"{flight.source}.{flight.name.replace(' ', '_')}.json"
        if not file.is_file():
            file.parent.mkdir(parents=True, exist_ok=True)
            vehicle, choice = declared(str(data / flight.vehicle), flight.model)
            try:
                records = records or read_records(
                    [data / log for log in flight.logs], vehicle, choice.judged, None
                )
                with used(parse(setting.split())):
                    answer = conclude(*records).as_json(None)
                answer["log_faults"] = [*model_faults(records[0], choice), *answer["log_faults"]]
                asked = Asked(answer, 0, "", 0.0)
            except LogError as error:
                asked = Asked(None, error.exit_code, str(error), 0.0)
            file.write_text(json.dumps(asdict(asked)))
        yield Asked(**json.loads(file.read_text()))


def _judged(flight: Flight, known: Known, data: Path, asked: Asked) -> Judgement:
    if asked.answer is None:
        return judge_refusal(flight, asked.exit_code, asked.last_words)
    return judge(flight, known, asked.answer, weight_n(data / flight.vehicle))


def rules(by_setting: dict[str, list[Judgement]]) -> str:
    """Right and wrong of every source with all rules, and what is lost and gained without each."""
    own = {(j.source, j.flight): j for j in by_setting[""]}
    sources = list(dict.fromkeys(origin(j) for j in own.values()))
    lines = [f"{'':28s}" + "".join(f"{s[:14]:>16s}" for s in sources)]
    for setting, rows in by_setting.items():
        cells = []
        for source in sources:
            mine = [j for j in rows if origin(j) == source]
            before = total([own[j.source, j.flight] for j in mine])
            now = total(mine)
            right = now.right - before.right
            wrong = now.wrong - before.wrong
            overclaimed = now.overclaimed - before.overclaimed
            change = f"{right:+d} {wrong:+d} {overclaimed:+d}"
            cells.append(
                f"{now.right}/{len(mine)} {now.wrong} {now.overclaimed}" if not setting else change
            )
        lines.append(
            f"{setting or 'right, wrong, overclaimed':28s}" + "".join(f"{c:>16s}" for c in cells)
        )
    return "\n".join(lines)


def report(by_setting: dict[str, list[Judgement]]) -> str:
    """Every setting on all flights, then every source by the setting that was chosen without it."""
    head = f"{'':28s}{'right':>24s}{'wrong name':>24s}{'overclaimed':>24s}"
    lines = [
        head,
        *(_line(setting or "as it is", rows) for setting, rows in by_setting.items()),
        "",
        head,
    ]
    held: list[Judgement] = []
    for source in dict.fromkeys(origin(j) for rows in by_setting.values() for j in rows):
        setting = chosen(by_setting, source)
        rows = [j for j in by_setting[setting] if origin(j) == source]
        held += rows
        lines.append(_line(f"{source} ({setting or 'as it is'})", rows))
    return "\n".join([*lines, _line("all, each left out", held)])


def _line(name: str, rows: Sequence[Judgement]) -> str:
    flags = (
        (j.right for j in rows),
        (bool(j.wrong) for j in rows),
        (bool(j.overclaim) for j in rows),
    )
    return f"{name:28s}" + "".join(f"{share(f):>24s}" for f in flags)


if __name__ == "__main__":
    sys.exit(main())
