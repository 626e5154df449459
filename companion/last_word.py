"""A second, small process that speaks once the first one is dead or silent: it says to the autopilot where to stay.

Killed outright (``kill -9``, out of memory) or not scheduled (swap, a slow SD card) a companion leaves its last tilt
behind, for all of GUID_TIMEOUT on ArduPilot, which then levels and drifts. The child inherits the link and holds one
finished frame, a position target at the hold point, renewed ten times a second. When no renewal comes for 0.3
seconds it sends that frame as often as it was told, or until the parent is back. When the pipe breaks it does
likewise and ends, sooner where a new companion relieves it.

The child runs this file by itself: nothing but the standard library, some 10 MB. It does not help where the whole
computer stops, nor on a signed link, where a frame made earlier counts as a replay and is refused.
"""

from __future__ import annotations

import os
import select
import socket
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

PERIOD_S = 0.1
"""A lost datagram must not be the end; the autopilot takes a repeated target as the same."""
SILENCE_S = 0.3
"""Without a renewal this long the parent stands still: three missed. A tilt left behind for 0.5 s moves the vehicle
three times as far."""


class Word(NamedTuple):
    """What the second process says: a finished frame, b"" for nothing, and how often."""

    frame: bytes
    times: int


SILENT = Word(b"", 0)


class LastWord:
    """The parent's end. ``renew`` never waits: a child that does not read costs no setpoint."""

    def __init__(self, fd: int, endpoint: str = "") -> None:
        self._child = subprocess.Popen(
            [sys.executable, "-I", "-S", os.path.abspath(__file__), str(fd), endpoint],
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

    def renew(self, word: Word, addresses: Sequence[tuple[str, int]] = ()) -> None:
        """What to say from now on, to these UDP peers or, without any, into a stream."""
        peers = [f"{host} {port}" for host, port in addresses]
        words = [word.frame.hex(), str(word.times), *peers]
        try:
            os.write(self._pipe, " ".join(words).encode() + b"\n")
        except (BlockingIOError, BrokenPipeError):
            return

    def close(self) -> None:
        """End the child without a word."""
        self.renew(SILENT)
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


def relieve(endpoint: str) -> None:
    """Ask the second process of a companion that was killed on ``endpoint`` to end now: a new one takes over."""
    with suppress(OSError, AttributeError):  # nobody there; no such sockets on this system
        caller = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        with caller:
            caller.setblocking(False)
            caller.sendto(b"relieved", _address(endpoint))


def _address(endpoint: str) -> str:
    """Of an abstract Unix socket, which leaves no file: by the endpoint without its scheme, of at most 107 bytes."""
    return "\0companion.last_word." + endpoint.split(":", 1)[-1][-80:]


def _successor(endpoint: str) -> list[socket.socket]:
    """Where a new companion is heard; nothing on a system without such sockets."""
    with suppress(OSError, AttributeError):
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        listener.bind(_address(endpoint))
        return [listener]
    return []


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


def main(fd: int, endpoint: str) -> None:
    """The child: read what the parent renews, say the last word when that stops, end when the parent has ended."""
    rest = b""
    frame = b""
    times = 0
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
                said, often, *peers = lines[-1].decode().split(" ")
                frame = bytes.fromhex(said)
                times = int(often)
            left = 0
            continue
        left = (left or times) - 1
        _say(fd, frame, peers)
        if not left:
            frame = b""  # enough, until the parent is back
    successor = _successor(endpoint)
    for _ in range(times if frame else 0):
        _say(fd, frame, peers)
        if select.select(successor, [], [], PERIOD_S)[0]:
            return


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2])
