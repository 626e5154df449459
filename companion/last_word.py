"""A second, small process that speaks once the first one is dead or silent: it says to the autopilot where to stay.

Killed outright (``kill -9``, out of memory) or not scheduled (swap, a slow SD card) a companion leaves its last tilt
behind, for all of GUID_TIMEOUT on ArduPilot, which then levels and drifts. The child inherits the link and holds one
finished frame, a position target at the hold point, renewed ten times a second. When no renewal comes for 0.3
seconds it sends that frame for a second, or until the parent is back; when the pipe breaks, likewise, and it ends.

The child runs this file by itself: nothing but the standard library, some 10 MB. It does not help where the whole
computer stops, nor on a signed link, where a frame made earlier counts as a replay and is refused.
"""

from __future__ import annotations

import os
import select
import socket
import subprocess
import sys
import time
from collections.abc import Sequence

TIMES = 10
PERIOD_S = 0.1
"""A lost datagram must not be the end; the autopilot takes a repeated target as the same."""
SILENCE_S = 0.3
"""Without a renewal this long the parent stands still: three missed. A tilt left behind for 0.5 s moves the vehicle
three times as far."""


class LastWord:
    """The parent's end. ``renew`` never waits: a child that does not read costs no setpoint."""

    def __init__(self, fd: int) -> None:
        self._child = subprocess.Popen(
            [sys.executable, "-I", "-S", os.path.abspath(__file__), str(fd)],
            stdin=subprocess.PIPE,
            pass_fds=(fd,),
            start_new_session=True,  # Ctrl-C in the terminal is for the parent
        )
        assert self._child.stdin is not None
        self._pipe = self._child.stdin.fileno()
        os.set_blocking(self._pipe, False)

    @property
    def pid(self) -> int:
        """Process id of the child."""
        return self._child.pid

    def renew(self, frame: bytes, addresses: Sequence[tuple[str, int]] = ()) -> None:
        """What to say from now on, to these UDP peers or, without any, into a stream; b"" for nothing."""
        words = [frame.hex(), *(f"{host} {port}" for host, port in addresses)]
        try:
            os.write(self._pipe, " ".join(words).encode() + b"\n")
        except (BlockingIOError, BrokenPipeError):
            return

    def close(self) -> None:
        """End the child without a word."""
        self.renew(b"")
        end(self._child)


def end(child: subprocess.Popen[bytes]) -> None:
    """Close a child's standard input, at which it ends; kill it where it does not."""
    try:
        if child.stdin is not None:
            child.stdin.close()
        child.wait(2.0)
    except (OSError, subprocess.TimeoutExpired):
        child.kill()
        child.wait()


def _say(fd: int, frame: bytes, peers: list[str]) -> None:
    """Once, to every peer: host, port, host, port."""
    try:
        if not peers:
            os.write(fd, frame)
        for host, port in zip(peers[::2], peers[1::2], strict=True):
            with socket.socket(fileno=os.dup(fd)) as link:
                link.sendto(frame, (host, int(port)))
    except OSError:
        pass  # the link may be gone as well; the next try costs nothing


def main(fd: int) -> None:
    """The child: read what the parent renews, say the last word when that stops, end when the parent has ended."""
    rest = b""
    frame = b""
    peers = list[str]()
    left = 0
    while True:
        if left:
            patience_s = PERIOD_S
        elif frame:
            patience_s = SILENCE_S
        else:
            patience_s = None
        if select.select([0], [], [], patience_s)[0]:
            more = os.read(0, 65536)
            if not more:
                break
            *lines, rest = (rest + more).split(b"\n")
            if lines:
                said, *peers = lines[-1].decode().split(" ")
                frame = bytes.fromhex(said)
            left = 0
            continue
        left = (left or TIMES) - 1
        _say(fd, frame, peers)
        if not left:
            frame = b""  # enough, until the parent is back
    for _ in range(TIMES if frame else 0):
        _say(fd, frame, peers)
        time.sleep(PERIOD_S)


if __name__ == "__main__":
    main(int(sys.argv[1]))
