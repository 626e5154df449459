"""Writes a .tlog: 8-byte big-endian microseconds, then the frame, for both directions of the link."""

from __future__ import annotations

import struct
from pathlib import Path
from types import TracebackType

from models.errors import ConfigError

_STAMP = struct.Struct(">Q")


class Recorder:
    """An open .tlog. Written through at every flush, so that a cut flight loses at most the last half second."""

    def __init__(self, path: Path) -> None:
        try:
            self._file = path.open("wb")
        except OSError as error:
            raise ConfigError(f"--record {path}: cannot be written ({error.strerror})") from None
        self._path = path
        self.frames = 0

    def write(self, arrival_us: int, raw: bytes) -> None:
        """Append one frame."""
        self._file.write(_STAMP.pack(arrival_us) + raw)
        self.frames += 1

    def flush(self) -> None:
        """Hand what was written to the system."""
        self._file.flush()

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        self._file.close()
