"""The answers of ``replay run`` and ``replay diagnose`` on every log of a folder, and whether they changed.

    python tests/benchmarks regression.same_answers FOLDER --out BEFORE            # one JSON file a log and command
    python tests/benchmarks regression.same_answers FOLDER --out AFTER --against BEFORE

A move of code must leave every byte as it was. The vehicle file of a log is
NAME.toml beside it, else the only file of the folder whose name starts the log's name, else the only one in the folder.
"""

from __future__ import annotations

import contextlib
import io
import json
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import command_line
from tqdm import tqdm

_SUFFIXES = {".tlog", ".bin", ".ulg"}
_OF_THE_MACHINE = {"seconds_of_machine", "wall_s", "speed"}


def vehicle_of(log: Path) -> Path | None:
    """The vehicle file that belongs to a log, if one does."""
    beside = log.with_suffix(".toml")
    if beside.exists():
        return beside
    files = sorted(log.parent.glob("*.toml"))
    starts = [f for f in files if log.stem.startswith(f.stem)]
    if starts:
        return max(starts, key=lambda f: len(f.stem))
    return files[0] if len(files) == 1 else None


def answer(log: Path, command: str, vehicle: Path | None) -> str:
    """Exit code, JSON and error line of one command on one log."""
    from replay.cli import main as replay

    arguments = [command, str(log), "--json", "-", "--quiet"]
    arguments += ["--vehicle", str(vehicle)] if vehicle is not None else []
    if command == "diagnose" and vehicle is not None:
        arguments += ["--model", "none"]
    out = io.StringIO()
    err = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = replay(arguments)
    body: Any = None
    with contextlib.suppress(ValueError):
        body = json.loads(out.getvalue())
    if isinstance(body, dict):
        body = {k: v for k, v in body.items() if k not in _OF_THE_MACHINE}
    # A warning names a file and a line, which a move changes; the error line of a failed command does not.
    error = err.getvalue() if code else ""
    return (
        json.dumps({"exit": code, "answer": body, "error": error}, indent=1, sort_keys=True) + "\n"
    )


def _job(job: tuple[Path, str, Path | None, Path]) -> Path:
    log, command, vehicle, target = job
    if not target.exists():
        target.write_text(answer(log, command, vehicle), encoding="utf-8")
    return target


def main() -> int:
    """Write all answers; with ``--against`` name those that differ and return how many."""
    p = command_line.parser(__doc__)
    p.add_argument("folder", type=Path)
    p.add_argument("--out", type=Path, required=True)
    p.add_argument("--against", type=Path)
    p.add_argument("--jobs", type=int, default=2)
    a = p.parse_args()
    a.out.mkdir(parents=True, exist_ok=True)
    logs = sorted(q for q in a.folder.rglob("*") if q.suffix.lower() in _SUFFIXES)
    jobs = []
    for log in logs:
        name = "__".join(log.relative_to(a.folder).parts)
        jobs += [(log, c, vehicle_of(log), a.out / f"{name}.{c}.json") for c in ("run", "diagnose")]
    with ProcessPoolExecutor(a.jobs) as pool:
        done = list(tqdm(pool.map(_job, jobs), total=len(jobs), disable=not sys.stderr.isatty()))
    if a.against is None:
        print(f"{len(done)} answers in {a.out}")
        return 0
    differ = [t.name for t in done if t.read_bytes() != (a.against / t.name).read_bytes()]
    print(f"{len(done) - len(differ)} of {len(done)} answers are the same")
    for name in differ:
        print(f"differs: {name}")
    return min(len(differ), 125)


if __name__ == "__main__":
    raise SystemExit(main())
