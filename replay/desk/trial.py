"""A log to try the desk with: the built-in vehicle flies into the corner by itself, in a process of its own."""

from __future__ import annotations

import asyncio
import sys
from asyncio.subprocess import DEVNULL, PIPE
from pathlib import Path

from models.common.errors import LogError
from replay.fleet.jobs import error_text

NAME = "simulated-flight.tlog"


async def make(folder: Path) -> Path:
    """Fly, and record it in ``folder``. Raises LogError where that fails."""
    path = folder / NAME
    command = (sys.executable, "-m", "replay.desk.trial", str(path))
    process = await asyncio.create_subprocess_exec(
        *command, stdin=DEVNULL, stdout=DEVNULL, stderr=PIPE
    )
    try:
        _, said = await process.communicate()
    except asyncio.CancelledError:
        process.terminate()
        raise
    if process.returncode:
        raise LogError(error_text(said.decode("utf-8", "replace"), process.returncode))
    return path


def main() -> None:
    """``python -m replay.desk.trial FILE.tlog``."""
    from companion.sim.compare import CompareSettings, fly
    from companion.sim.flown import Leg

    fly(CompareSettings(record=Path(sys.argv[1])), Leg.OFF, seed=0)


if __name__ == "__main__":
    main()
