"""A wheel that a stranger installs: built, checked, and used in an empty environment for each extra.

    python tests/benchmarks documents.wheel [--extra NAME]... [--result FILE]

Builds the wheel and the source archive of the tracked files, has ``twine`` check both, installs the wheel beside
nothing but one extra, and runs what that extra is for, in a folder without the repository. Needs a package index.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import venv
from dataclasses import dataclass
from pathlib import Path

from result_file import add_option, counted, write_result

ROOT = Path(__file__).resolve().parents[3]
ALONE = "alone"
FLY = ("companion", "--connect", "sim:corner", "--duration", "20", "--record", "flight.tlog")
"""Every environment flies first: flight needs no extra, and the others need a log."""
COMMANDS: dict[str, tuple[tuple[str, ...], ...]] = {
    ALONE: (
        ("companion", "--version"),
        ("models", "query", "--h", "0.5", "--d", "0.6", "--rpm", "6000"),
    ),
    "replay": (("replay", "info", "flight.tlog"), ("replay", "run", "flight.tlog")),
    "train": (
        ("models", "train", "--data", "closed-form", "--method", "polynomial", "--out", "fan"),
    ),
    "export": (("replay", "export", "flight.tlog", "--to", "parquet", "--vehicle", "tandem"),),
    "serve": (("python", "-c", "import replay.desk.app"),),
    "cluster": (("python", "-c", "import distributed, replay.rerun"),),
    "design": (("python", "-c", "import companion.estimation.track_design"),),
}
"""What is run for each extra."""


@dataclass(frozen=True)
class Tried:
    """One environment, and the first command of it that failed with what it said."""

    extra: str
    failed: str = ""


def built(folder: Path, python: Path) -> Path:
    """The wheel of the tracked files, made and checked in an environment of its own."""
    sources = folder / "sources"
    sources.mkdir()
    archive = subprocess.run(["git", "archive", "HEAD"], cwd=ROOT, check=True, capture_output=True)
    subprocess.run(["tar", "x", "-C", sources], input=archive.stdout, check=True)
    subprocess.run([python, "-m", "pip", "install", "-q", "build", "twine"], check=True)
    subprocess.run([python, "-m", "build", sources], check=True, stdout=subprocess.DEVNULL)
    made = sorted((sources / "dist").iterdir())
    subprocess.run([python, "-m", "twine", "check", "--strict", *made], check=True)
    return next(path for path in made if path.suffix == ".whl")


def environment(folder: Path) -> Path:
    """A new environment, and the folder of its programs."""
    venv.create(folder, with_pip=True)
    return folder / "bin"


def tried(extra: str, wheel: Path, folder: Path) -> Tried:
    """Install the wheel with one extra, and run what it is for."""
    programs = environment(folder / "venv")
    if extra == ALONE:
        wanted = str(wheel)
    else:
        wanted = f"{wheel}[{extra}]"
    pip = [programs / "python", "-m", "pip", "install", "-q", "-c", ROOT / "constraints.txt"]
    for command in ([*pip, wanted], *_commands(extra, programs)):
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        if done.returncode:
            said = (done.stderr or done.stdout).strip().splitlines()[-1:]
            return Tried(extra, f"{Path(command[0]).name}: {' '.join(said)}")
    return Tried(extra)


def _commands(extra: str, programs: Path) -> list[list[str]]:
    """What is run, by the programs of that environment."""
    return [[str(programs / first), *rest] for first, *rest in (FLY, *COMMANDS[extra])]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--extra", action="append", choices=COMMANDS, metavar="NAME")
    add_option(parser)
    args = parser.parse_args()
    results = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        wheel = built(folder, environment(folder / "release") / "python")
        print(f"{wheel.name}: {wheel.stat().st_size / 1e6:.1f} MB")
        for extra in args.extra or COMMANDS:
            (folder / extra).mkdir()
            results.append(tried(extra, wheel, folder / extra))
            print(f"{extra:10s} {results[-1].failed or 'ok'}", flush=True)
    works = [not r.failed for r in results]
    if args.result is not None:
        what = "extras that install and run in an empty environment"
        write_result(args, [counted(what, works, least=1.0)], seeds="none")
    return int(not all(works))


if __name__ == "__main__":
    sys.exit(main())
