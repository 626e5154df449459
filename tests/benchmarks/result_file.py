"""``--result FILE`` of commands that measure: their figures as a file of ``results/``, for ``results_page.py``.

Commit, date, machine and command are filled in. Of a file that is there already, title, notes and places in the
README stay; so do figures that were not measured this time, with the commit that measured them.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shlex
import subprocess
import sys
from collections.abc import Iterable, Sequence
from datetime import date
from pathlib import Path
from typing import Any

from shares import wilson

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
ANY_MACHINE = "any: the same numbers everywhere"
NOT_CODE = (":!tests/benchmarks/results", ":!docs", ":!README.md")


def add_option(parser: argparse.ArgumentParser) -> None:
    """The options ``--result`` and ``--first-seen``."""
    parser.add_argument(
        "--result", type=Path, metavar="FILE",
        help="write the figures for docs/results.md, as in tests/benchmarks/results",
    )  # fmt: skip
    parser.add_argument(
        "--first-seen",
        action="store_true",
        help="with --result: nobody had looked at these flights or seeds before",
    )


def figure(
    what: str, value: str, detail: str = "", goal: str = "", met: bool | None = None
) -> dict[str, Any]:
    """One figure; ``detail``: counts or an interval, ``met``: whether it reaches the goal."""
    known = {
        "what": what,
        "value": value,
        "detail": detail,
        "goal": goal,
        "met": None if met is None else bool(met),
    }
    return {key: v for key, v in known.items() if v not in ("", None)}


def counted(
    what: str, flags: Iterable[bool], *, least: float | None = None, most: float | None = None
) -> dict[str, Any]:
    """A share with its counts and its 95 % interval (Wilson); goals ``least`` or ``most`` are shares, too."""
    values = list(flags)
    if not values:
        return figure(what, "none")
    share = sum(values) / len(values)
    low, high = wilson(sum(values), len(values))
    detail = f"{sum(values)} of {len(values)}, [{100 * low:.0f}, {100 * high:.0f}]"
    goal = least if least is not None else most
    met = None if goal is None else share >= goal if least is not None else share <= goal
    return figure(
        what, f"{100 * share:.0f} %", detail, "" if goal is None else f"{100 * goal:.0f} %", met
    )


def write_result(
    a: argparse.Namespace, figures: Sequence[dict[str, Any]], *, seeds: str, simulated: bool | None = None,
    repeatable: bool = False,
) -> None:  # fmt: skip
    """Write what ``--result`` asks for. ``a``: the arguments of the command.

    ``simulated``: None where nothing flies. ``repeatable``: the numbers do not depend on the machine.
    """
    path: Path | None = a.result
    if path is None:
        return
    old: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    before = {f["what"]: f for f in old.get("figures", ())}
    new = [_kept(before.get(f["what"], {})) | f for f in figures]
    now = {f["what"] for f in figures}
    rest = [_of_commit(f, old["commit"]) for what, f in before.items() if what not in now]
    content = {
        "title": old.get("title", path.stem),
        "command": _command(),
        "commit": _commit(),
        "date": date.today().isoformat(),
        "machine": ANY_MACHINE if repeatable else _machine(),
        "seeds": seeds,
        "simulated": simulated,
        "seen": None
        if simulated is None
        else "first seen"
        if a.first_seen
        else "looked at in development",
        "older": False,
        "notes": old.get("notes", []),
        "figures": [*new, *rest],
    }
    path.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def _kept(old: dict[str, Any]) -> dict[str, Any]:
    return {key: old[key] for key in ("readme",) if key in old}


def _of_commit(old: dict[str, Any], commit: str) -> dict[str, Any]:
    known = "commit " in old["what"]
    return old if known else old | {"what": f"{old['what']} (commit {commit})"}


def _command() -> str:
    """What was typed, without ``--result`` and ``--first-seen``."""
    arguments = [word for word in sys.argv[1:] if word != "--first-seen"]
    if "--result" in arguments:
        at = arguments.index("--result")
        arguments = arguments[:at] + arguments[at + 2 :]
    program = Path(sys.argv[0]).resolve().relative_to(HERE).with_suffix("")
    name = ".".join(program.parts).removesuffix(".__main__")
    start = f"python tests/benchmarks {name}"
    return " ".join([start, *map(shlex.quote, arguments)])


def _commit() -> str:
    """Of the tree that was measured; changes that are not committed are said."""

    def git(*words: str) -> str:
        return subprocess.run(
            ["git", *words], cwd=ROOT, capture_output=True, text=True, check=False
        ).stdout.strip()

    commit = git("rev-parse", "--short=7", "HEAD") or "unknown"
    return (
        f"{commit} with changes"
        if git("status", "--porcelain", "-uno", "--", ".", *NOT_CODE)
        else commit
    )


def _machine() -> str:
    cores = os.cpu_count()
    load = os.getloadavg()[0]
    return f"{cores} cores ({platform.machine()}), load {load:.0f} at the end"
