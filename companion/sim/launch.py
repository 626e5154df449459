"""Starts the built-in vehicle in its own process and says where to listen for it."""

from __future__ import annotations

import contextlib
import json
import select
import socket
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from models.errors import LinkError


@dataclass(frozen=True)
class SimProcess:
    """A running simulator. ``endpoint`` is a pymavlink string to listen at; ``announcement`` its first line."""

    endpoint: str
    process: subprocess.Popen[str]
    announcement: dict[str, Any]

    def stop(self) -> None:
        """End it: its standard input closes, and it leaves; insisted upon after two seconds."""
        if self.process.stdin is not None:
            with contextlib.suppress(OSError):
                self.process.stdin.close()
        try:
            self.process.wait(2.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        if self.process.stdout is not None:
            self.process.stdout.close()


def free_port() -> int:
    """A UDP port on loopback that nobody holds now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        return int(sock.getsockname()[1])


@contextlib.contextmanager
def launch(
    scenario: str = "corner",
    *,
    seed: int = 0,
    speed: float = 1.0,
    pilot: str = "companion",
    truth: Path | None = None,
    duration_s: float | None = None,
    vehicle: Path | None = None,
    px4: bool = False,
    vision: bool = False,
    port: int | None = None,
    narrate: bool = False,
    timeout_s: float = 20.0,
) -> Iterator[SimProcess]:
    """Run ``python -m companion.sim`` for the length of a ``with`` block.

    With ``narrate`` its standard output must be read (``companion.sim.narrator.follow``).

    Raises LinkError with the simulator's own words when it does not start.
    """
    port = free_port() if port is None else port
    command = [sys.executable, "-m", "companion.sim", "--until-stdin-closes", "--scenario", scenario]
    command += ["--port", str(port), "--seed", str(seed), "--speed", str(speed), "--pilot", pilot]
    for flag, value in (("--truth", truth), ("--duration", duration_s), ("--vehicle", vehicle)):
        if value is not None:
            command += [flag, str(value)]
    command += [flag for flag, wanted in (("--px4", px4), ("--vision", vision), ("--narrate", narrate)) if wanted]
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, bufsize=1
    )
    assert process.stdout is not None
    assert process.stderr is not None
    ready, _, _ = select.select([process.stdout], [], [], timeout_s)
    line = process.stdout.readline() if ready else ""
    if not line:
        process.kill()
        words = process.stderr.read().strip().splitlines()
        process.wait()
        reason = words[-1] if words else "it said nothing"
        raise LinkError(f"sim:{scenario}: the built-in vehicle did not start: {reason}")
    announcement = json.loads(line)
    sim = SimProcess(announcement["endpoint"], process, announcement)
    try:
        yield sim
    finally:
        sim.stop()
        process.stderr.close()
