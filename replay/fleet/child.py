"""``python -m replay.fleet.child``: does one task after another for the worker that started it (workers.py)."""

from __future__ import annotations

import ctypes
import os
import resource
import signal
import sys
from collections.abc import Sequence
from multiprocessing.connection import Connection

IDLE_S = 20.0
"""A cluster that has no work keeps no process of ours."""
MOST_TASKS = 50
"""Then the memory that tasks left behind goes back."""
_LARGE = 0.5
"""Of the limit: after a task that took more the memory goes back, too."""
_SET_DEATH_SIGNAL = 1
"""Of prctl(2)."""


def main(argv: Sequence[str]) -> None:
    """``argv``: the descriptor of the pipe, the process that started this one, and the most memory in bytes."""
    descriptor, parent, most_bytes = map(int, argv)
    if not _ends_with(parent):
        return
    # Ctrl-C is for the command, which ends its workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # MemoryError rather than the kernel's killer.
    resource.setrlimit(resource.RLIMIT_DATA, (most_bytes, most_bytes))
    pipe = Connection(descriptor)
    for _ in range(MOST_TASKS):
        if not pipe.poll(IDLE_S):
            return
        try:
            function, task = pipe.recv()
        except EOFError:
            return
        pipe.send(function(task))
        if _peak_bytes() > _LARGE * most_bytes:
            return


def _ends_with(parent: int) -> bool:
    """The kernel ends this process with the thread that started it, whatever is computed; False where that is gone."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_SET_DEATH_SIGNAL, signal.SIGKILL)
    return os.getppid() == parent


def _peak_bytes() -> float:
    """The most memory of this program: ``getrusage`` counts that of the one that started it, too (execve(2))."""
    if sys.platform != "linux":
        return 0.0
    with open("/proc/self/status", encoding="ascii") as status:
        (line,) = (line for line in status if line.startswith("VmHWM:"))
    return 1024.0 * float(line.split()[1])


if __name__ == "__main__":
    main(sys.argv[1:])
