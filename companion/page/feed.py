"""The flight program's end: snapshots into a pipe that never waits. What the page's process cannot take is dropped."""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

from companion.last_word import end
from models.common.errors import ConfigError, LinkError

PERIOD_S = 0.2
"""A browser asks as often."""
_ATOMIC = select.PIPE_BUF
"""A write of no more than this goes into a pipe whole or not at all."""
_START_S = 10.0
"""Python and a socket take 0.3 s on a desktop; a Raspberry Pi under load takes ten times as long."""


def read_address(text: str, option: str = "--page") -> tuple[str, int]:
    """Host and port of an option: ``:8080`` is this machine only, ``0.0.0.0:8080`` everybody on the network.

    Raises ConfigError.
    """
    host, colon, port = text.rpartition(":")
    if not colon or not port.isdigit() or not 0 <= int(port) <= 65535 or ":" in host:
        raise ConfigError(f"{option} {text}: must be [HOST]:PORT, such as :8080 or 0.0.0.0:8080")
    return host or "127.0.0.1", int(port)


class PageFeed:
    """Owns the page's process. ``offer`` costs what making one line costs, five times a second."""

    def __init__(self, host: str, port: int) -> None:
        self.dropped = self.sent = 0
        self._due_s = -1.0
        command = [sys.executable, "-m", "companion.page.server", host, str(port)]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        ready, _, _ = select.select([self._process.stdout], [], [], _START_S)
        if ready:
            line = self._process.stdout.readline().decode()
        else:
            line = ""
        if not line.startswith("http"):
            self._process.kill()
            self._process.wait()
            raise LinkError(f"--page {host}:{port}: {line.strip() or 'the page did not start'}")
        self.url = line.strip()
        self._pipe = self._process.stdin.fileno()
        os.set_blocking(self._pipe, False)

    def offer(self, make: Callable[[], dict[str, Any]]) -> None:
        """Send ``make()`` where a snapshot is due and the pipe takes it."""
        now = time.monotonic()
        if now < self._due_s:
            return
        self._due_s = now + PERIOD_S
        line = json.dumps(make(), separators=(",", ":"), allow_nan=False).encode() + b"\n"
        try:
            if len(line) > _ATOMIC:
                raise BlockingIOError
            os.write(self._pipe, line)
            self.sent += 1
        except OSError:  # full, or its reader is gone: the flight goes on
            self.dropped += 1

    def close(self) -> None:
        """End the page's process."""
        end(self._process)
        if self._process.stdout is not None:
            self._process.stdout.close()
