"""A whole .tlog at once: memory is about twice the file's size."""

from __future__ import annotations

from pathlib import Path

from companion.mavlink.frames import Counts, walk
from replay.logs.files import open_file
from replay.logs.tlog import STAMP, Report, Tlog, no_frame, tlog_of


def read_tlog(path: Path | str) -> Tlog:
    """Every frame of a file. Raises LogError where it cannot be read, is empty, or holds no MAVLink frame."""
    path = Path(path)
    with open_file(path) as file:
        data = file.read()
    counts = Counts()
    starts, rest = walk(data, counts, STAMP)
    if not starts:
        raise no_frame(path)
    return tlog_of(path, data, starts, Report.of(counts, len(data), len(data) - rest))
