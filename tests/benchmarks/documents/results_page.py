"""Write docs/results.md and the table of README.md from ``tests/benchmarks/results/*.json``.

    python tests/benchmarks documents.results_page            # write both
    python tests/benchmarks documents.results_page --check    # exit code 1 where one of them is not up to date

One file is one benchmark. Its keys: ``title``, ``command``, ``commit`` (the one that recorded the figures), ``date``,
``machine``, ``seeds``, ``simulated`` (true, false; null: no flight), ``seen`` (one of ``SEEN``; null: no flight),
``older`` (true: measured with an earlier version of the program), ``notes`` and ``figures``. A figure has ``what``,
``value``, ``detail`` (counts, an interval), ``goal``, ``met`` (true, false; null without a goal) and ``readme`` (place,
text: it is in README's table).
"""

from __future__ import annotations

import json
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import command_line

ROOT = Path(__file__).resolve().parents[3]
RESULTS = ROOT / "tests" / "benchmarks" / "results"
PAGE = ROOT / "docs" / "results.md"
README = ROOT / "README.md"
START = "<!-- results: start -->"
END = "<!-- results: end -->"
SEEN = ("first seen", "looked at in development")
_MET = {True: "yes", False: "**missed**", None: ""}
_HEAD = """# Results

This page holds the figures of the project. `python tests/benchmarks documents.results_page` writes it from the files in
`tests/benchmarks/results/`, one for each benchmark. To add a figure, write such a file and run the command.

- *Simulated*: the vehicle and its air were computed. *Real*: somebody flew.
- *First seen*: nobody had looked at these flights before they were judged. *Looked at in development*: rules or numbers
  may have been chosen with them.
- *Older version*: measured with an earlier version of the program. Measure it again before you rely on it.
- The commit is the one that recorded the figures. A goal that was missed stays with its figure.
- Square brackets are 95 % intervals.
"""


@dataclass(frozen=True)
class Figure:
    """One number, its goal, and its line in the README: (place, text) or None."""

    what: str
    value: str
    detail: str
    goal: str
    met: bool | None
    readme: tuple[int, str] | None


@dataclass(frozen=True)
class Result:
    """The figures of one benchmark, and how they were measured."""

    title: str
    command: str
    commit: str
    date: str
    machine: str
    seeds: str
    simulated: bool | None
    seen: str | None
    older: bool
    notes: tuple[str, ...]
    figures: tuple[Figure, ...]

    @property
    def anchor(self) -> str:
        """The heading's address, as GitHub makes it."""
        return re.sub(r"[^\w\- ]", "", self.title.lower()).replace(" ", "-")

    @property
    def how(self) -> str:
        """Simulated or real, seen before or not, of an older version or not."""
        kind = {True: "simulated", False: "real", None: "no flight"}[self.simulated]
        return ", ".join(
            [kind, *([self.seen] if self.seen else []), *(["older version"] * self.older)]
        )

    @property
    def how_short(self) -> str:
        """The same in a cell of the README."""
        return self.how.replace("looked at in development", "seen before").replace(" version", "")


def load(path: Path) -> Result:
    """One file; ValueError names it where a key is missing, unknown or of a wrong kind."""
    try:
        raw: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        figures = tuple(_figure(f) for f in raw.pop("figures"))
        result = Result(
            notes=tuple(raw.pop("notes", ())), figures=figures, older=raw.pop("older", False), **raw
        )
        if (
            result.simulated not in (True, False, None)
            or result.seen not in (*SEEN, None)
            or not figures
        ):
            raise ValueError(
                f"seen must be one of {SEEN} or null, simulated true, false or null, with figures"
            )
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path.name}: {error}") from None
    return result


def _figure(raw: dict[str, Any]) -> Figure:
    readme = raw.get("readme")
    line = None if readme is None else (int(readme[0]), str(readme[1]))
    return Figure(
        raw["what"], raw["value"], raw.get("detail", ""), raw.get("goal", ""), raw.get("met"), line
    )


def results() -> list[Result]:
    """Every file, in order of its name."""
    return [load(path) for path in sorted(RESULTS.glob("*.json"))]


def page(found: list[Result]) -> str:
    """docs/results.md."""
    index = "\n".join(f"- [{r.title}](#{r.anchor})" for r in found)
    return "\n".join([_HEAD, index, *(_section(r) for r in found), ""])


def _section(r: Result) -> str:
    rows = [
        f"| {f.what} | {f.value}{f' ({f.detail})' if f.detail else ''} | {f.goal} | {_MET[f.met]} |"
        for f in r.figures
    ]
    lines = [
        f"\n## {r.title}\n",
        f"How: {r.how}. Commit: `{r.commit}`, {r.date}. Seeds or flights: {r.seeds}. Machine: {r.machine}.\n",
        f"Command: `{r.command}`\n",
        "| what | figure | goal | met |",
        "|---|---|---|---|",
        *rows,
    ]
    return "\n".join([*lines, *(f"\n{note}" for note in r.notes)])


def table(found: list[Result]) -> str:
    """The README's table: one number a cell."""
    chosen = [(*f.readme, f, r) for r in found for f in r.figures if f.readme is not None]
    rows = [
        f"| {text} | [{f.value}](docs/results.md#{r.anchor}) | {f.goal} | {_MET[f.met]} | {r.how_short} |"
        for _, text, f, r in sorted(chosen, key=lambda row: row[0])
    ]
    return "\n".join(["| what | figure | goal | met | how |", "|---|---|---|---|---|", *rows])


def readme(text: str, found: list[Result]) -> str:
    """README.md with its table between the two marks."""
    before, rest = text.split(START)
    return f"{before}{START}\n{table(found)}\n{END}{rest.split(END)[1]}"


def main() -> int:
    """Write both files, or compare them."""
    parser = command_line.parser(__doc__)
    parser.add_argument(
        "--check",
        action="store_true",
        help="write nothing; exit code 1 where a file is out of date",
    )
    check = parser.parse_args().check
    found = results()
    made = {PAGE: page(found), README: readme(README.read_text(encoding="utf-8"), found)}
    old = [
        path
        for path, text in made.items()
        if not path.exists() or path.read_text(encoding="utf-8") != text
    ]
    for path in old:
        if check:
            print(
                f"{path.relative_to(ROOT)}: not up to date: run python tests/benchmarks documents.results_page"
            )
        else:
            path.write_text(made[path], encoding="utf-8")
    return 1 if check and old else 0


if __name__ == "__main__":
    sys.exit(main())
