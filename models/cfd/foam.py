"""The flow solver's programs and files: run them, read loads and fields. Nothing else knows its formats."""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from models.common.errors import ConfigError, UserError
from models.common.frames import Array

PACKAGE = "openfoam"
PROGRAMS = (
    "blockMesh",
    "checkMesh",
    "topoSet",
    "postProcess",
    "mapFields",
    "simpleFoam",
    "pimpleFoam",
)
_DEBIAN_HOME = Path("/usr/share/openfoam")


class SolverError(UserError):
    """A program of the solver failed; the message names the case and the program's last words."""


class StoppedError(UserError):
    """A program of the solver was stopped from outside; the case can go on from its last chunk."""


# Of prctl(2).
_SET_DEATH_SIGNAL = 1
# Signals that somebody sends; others (a division by zero) are the solver's own end.
_FROM_OUTSIDE = {signal.SIGINT, signal.SIGTERM, signal.SIGKILL, signal.SIGHUP}


def require() -> None:
    """Raise ConfigError naming the package where a program is missing."""
    for name in PROGRAMS:
        if shutil.which(name) is None:
            raise ConfigError(
                f"models cfd: {name} not found; install the package {PACKAGE} (Debian: apt-get "
                f"install {PACKAGE})"
            )


def run(folder: Path, program: str, *arguments: str) -> str:
    """Run one program in a case folder, append its output to ``log``, return the output.

    Raises SolverError where it ends with an error, StoppedError where somebody stopped it.
    """
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    if "WM_PROJECT_DIR" not in environment and _DEBIAN_HOME.is_dir():
        environment["WM_PROJECT_DIR"] = str(_DEBIAN_HOME)
    done = subprocess.run(
        [program, *arguments],
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        check=False,
        preexec_fn=_die_with_parent if sys.platform == "linux" else None,
    )
    output = done.stdout.decode("utf-8", "replace")
    with (folder / "log").open("a", encoding="utf-8") as log:
        log.write(f"==== {program} {' '.join(arguments)}\n{output}")
    if -done.returncode in _FROM_OUTSIDE:
        raise StoppedError(
            f"case {folder.name}: {program} was stopped by signal {-done.returncode}"
        )
    if done.returncode != 0:
        fatal = re.search(r"FOAM FATAL.*?\n(.*?)\n\s*\n", output, re.S)
        if fatal:
            reason = " ".join(fatal[1].split())
        else:
            reason = f"exit code {done.returncode}"
        raise SolverError(
            f"case {folder.name}: {program} failed ({reason[:160]}); see {folder / 'log'}"
        )
    return output


def _die_with_parent() -> None:
    """Linux: end with the process that asked for it. A command that is killed must not leave a solver that writes into
    the case which the next run takes up."""
    ctypes.CDLL(None).prctl(_SET_DEATH_SIGNAL, signal.SIGKILL)


def times(folder: Path) -> list[str]:
    """Names of the states on disk after the start, in order."""
    found = [
        p.name for p in folder.iterdir() if p.is_dir() and re.fullmatch(r"\d+(\.\d+)?", p.name)
    ]
    return sorted((t for t in found if float(t) > 0), key=float)


def forget(folder: Path, names: Sequence[str]) -> None:
    """Delete states."""
    for name in names:
        shutil.rmtree(folder / name)


def surface_loads(folder: Path) -> dict[float, Array]:
    """Time or iteration -> force and moment (6,) of the air on duct and hub, about the reference point."""
    out: dict[float, Array] = {}
    for start in sorted((folder / "postProcessing/loads").iterdir(), key=lambda p: float(p.name)):
        force, moment = (_table(start / name) for name in ("force.dat", "moment.dat"))
        out |= {
            time: np.concatenate([force[time], moment[time]]) for time in force if time in moment
        }
    return out


def _table(path: Path) -> dict[float, Array]:
    """Time -> the first triple of each line."""
    lines = (
        re.sub("[()]", " ", line).split() for line in path.read_text(encoding="utf-8").splitlines()
    )
    return {
        float(f[0]): np.array(f[1:4], dtype=float)
        for f in lines
        if len(f) >= 4 and not f[0].startswith("#")
    }


def read_field(path: Path) -> Array:
    """Values of a binary field in the cells, shape (n,) or (n, 3); (1,) or (1, 3) where it is uniform."""
    raw = path.read_bytes()
    where = _cells(raw, path)
    if where is None:
        uniform = re.search(rb"internalField\s+uniform\s+\(?([^;)]*)\)?\s*;", raw)
        if uniform is None:
            raise SolverError(f"field {path}: no values in the cells")
        values = np.array([[float(v) for v in uniform[1].split()]])
        if values.shape[1] == 3:
            return values
        return values[:, 0]
    start, count, width = where
    values = np.frombuffer(raw, dtype="<f8", count=count * width, offset=start)
    if width > 1:
        return values.reshape(count, width)
    return values


def scale_field(path: Path, factor: float) -> None:
    """Multiply a binary field's values in the cells."""
    raw = bytearray(path.read_bytes())
    where = _cells(bytes(raw), path)
    if where is not None:
        start, count, width = where
        np.frombuffer(memoryview(raw)[start : start + 8 * count * width], dtype="<f8")[:] *= factor
        path.write_bytes(raw)


def _cells(raw: bytes, path: Path) -> tuple[int, int, int] | None:
    """(offset, count, width) of the list of cell values, or None where the field is uniform."""
    head = re.search(rb"internalField\s+nonuniform\s+List<(scalar|vector)>\s+(\d+)\s*\(", raw)
    if head is None:
        return None
    count = int(head[2])
    if head[1] == b"vector":
        width = 3
    else:
        width = 1
    if len(raw) < head.end() + 8 * count * width:
        raise SolverError(f"field {path}: is cut short")
    return head.end(), count, width
