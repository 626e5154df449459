"""Numbers of the search, chosen without the source that they are judged on.

``python tests/benchmarks/leave_one_source_out.py --answers DIR [--jobs N]`` answers every measured flight with every
setting below (answers are kept in DIR: it can be stopped and started again). For each source the setting that is best
on all *other* measured sources, and on nothing else, is judged on this one; the sums over all sources say how the
search does where its numbers were not chosen. The structure of the rules is that of the search in every setting, so
this says nothing of rules that were made by looking at a source.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from flights.judge import share
from measured.answers import DATA
from measured.judge import Judgement
from measured.known import read
from measured_flights import judged
from tqdm import tqdm

SETTINGS = (
    "", "TRUST=0.25", "TRUST=0.35", "TRUST=0.7", "TRUST=1.0", "FLOOR=0.1", "FLOOR=0.4", "OWN=0.5", "OWN=1.0",
    "FORM_LEFT=0.03", "FORM_LEFT=0.12",
)  # fmt: skip
"""What is tried: the search as it is first, then one number changed at a time."""
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
    return Sum(sum(j.right for j in rows), sum(bool(j.wrong) for j in rows), sum(bool(j.overclaim) for j in rows))


def origin(j: Judgement) -> str:
    """Whose flight it is."""
    return SAME_SOURCE.get(j.source, j.source)


def chosen(by_setting: dict[str, list[Judgement]], source: str) -> str:
    """The setting that is best without ``source``; the first of equals."""
    return max(by_setting, key=lambda s: total([j for j in by_setting[s] if origin(j) != source]).rank)


def main(argv: Sequence[str] | None = None) -> int:
    """Answer, judge, print."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--answers", type=Path, required=True, metavar="DIR", help="where answers are kept")
    p.add_argument("--data", type=Path, default=DATA, metavar="DIR", help=f"folder of the flights (default: {DATA})")
    p.add_argument("--jobs", type=int, default=1, metavar="N", help="diagnoses at a time")
    p.add_argument("--timeout", type=float, default=300.0, metavar="S", help="of one diagnosis")
    p.add_argument("--settings", nargs="*", default=list(SETTINGS), metavar="NAME=VALUE", help="what is tried")
    args = p.parse_args(argv)
    known = read()
    flights = [f for f in known.flights if f.kind == "measured" and not f.again and not f.missing(args.data)]
    if not flights:
        print(f"none of the flights is in {args.data} (they are not part of the project)", file=sys.stderr)
        return 0
    work = [(setting, f) for setting in args.settings for f in flights]
    with ThreadPoolExecutor(args.jobs) as pool:

        def one(setting: str, index: int) -> Judgement:
            own = argparse.Namespace(**vars(args) | {"answers": args.answers / (setting or "own")})
            own.setting = setting.split() if setting else []
            return judged(flights[index], known, own)

        futures = [pool.submit(one, setting, flights.index(f)) for setting, f in work]
        rows = [f.result() for f in tqdm(futures, unit="flight", file=sys.stderr, disable=not sys.stderr.isatty())]
    by_setting: dict[str, list[Judgement]] = {s: [] for s in args.settings}
    for (setting, _), row in zip(work, rows, strict=True):
        if not row.excused:
            by_setting[setting].append(row)
    print(report(by_setting))
    return 0


def report(by_setting: dict[str, list[Judgement]]) -> str:
    """Every setting on all flights, then every source by the setting that was chosen without it."""
    head = f"{'':28s}{'right':>24s}{'wrong name':>24s}{'overclaimed':>24s}"
    lines = [head, *(_line(setting or "as it is", rows) for setting, rows in by_setting.items()), "", head]
    held: list[Judgement] = []
    for source in dict.fromkeys(origin(j) for rows in by_setting.values() for j in rows):
        setting = chosen(by_setting, source)
        rows = [j for j in by_setting[setting] if origin(j) == source]
        held += rows
        lines.append(_line(f"{source} ({setting or 'as it is'})", rows))
    return "\n".join([*lines, _line("all, each left out", held)])


def _line(name: str, rows: Sequence[Judgement]) -> str:
    flags = ((j.right for j in rows), (bool(j.wrong) for j in rows), (bool(j.overclaim) for j in rows))
    return f"{name:28s}" + "".join(f"{share(f):>24s}" for f in flags)


if __name__ == "__main__":
    sys.exit(main())
