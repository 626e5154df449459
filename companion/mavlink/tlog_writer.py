"""Writes a flight to .tlog files: 8-byte big-endian microseconds, then the frame, for both directions of the link.

Each frame goes to the system at once: a process that is killed loses nothing. No file is ever overwritten. A disk that
is full or read-only ends the recording, is reported once, and never ends the flight.
"""

from __future__ import annotations

import errno
import io
import logging
import shutil
import struct
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from models.common.errors import ConfigError

_STAMP = struct.Struct(">Q")
_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")
_DEFAULT_NAME = "{date}_boot-{boot}.tlog"
_OTHERS_FAULT = (errno.EROFS, errno.EACCES, errno.EPERM, errno.ENOSPC, errno.EDQUOT, errno.EIO)
"""What a disk may come to between two flights; a folder that does not exist is a wrong argument."""
_MOST_COPIES = 100_000
"""Files of one name: more is a mistake in the name."""
_MIB = 1 << 20
_LEFT_FREE_BYTES = 64 * _MIB
"""So much of the disk is left to others."""


class Records(Protocol):
    """Whatever takes the frames of both directions in order."""

    def write(self, arrival_us: int, raw: bytes) -> None:
        """Append one frame."""

    def flush(self) -> None:
        """Every half second."""


_LOG = logging.getLogger(__name__)


class Recorder:
    """An open recording.

    ``path``: a file, a folder, or a name with ``{date}`` and ``{boot}``. Where the file exists, -2, -3 ... is added to
    the name. ``say`` is called once when nothing more can be recorded; without it that is logged.

    Raises ConfigError where the folder does not exist or the name cannot be one.
    """

    def __init__(self, path: Path, say: Callable[[str], None] | None = None) -> None:
        self._pattern = path / _DEFAULT_NAME if path.is_dir() else path
        self._say = say or _LOG.warning
        self.bytes = 0
        self.files: list[Path] = []
        """The one that is written; none where it could not be opened."""
        self.stopped: str | None = None
        """Why nothing more is recorded."""
        self._file: io.FileIO | None = None
        try:
            self._file = _create(Path(_filled(str(self._pattern))))
            self.files.append(Path(self._file.name))
        except OSError as error:
            if error.errno not in _OTHERS_FAULT:
                raise ConfigError(
                    f"--record {path}: cannot be written ({error.strerror})"
                ) from None
            self._stop(error.strerror or str(error))

    def write(self, arrival_us: int, raw: bytes) -> None:
        """Append one frame; a frame that does not fit as a whole is not begun."""
        if self._file is None:
            return
        record = _STAMP.pack(arrival_us) + raw
        try:
            written = self._file.write(record)
        except OSError as error:
            self._stop(error.strerror or str(error))
            return
        if written != len(record):
            self._file.truncate(self.bytes)
            self._stop("the disk is full")
            return
        self.bytes += len(record)

    def flush(self) -> None:
        """Look after the disk: a record must not be what fills it."""
        if self._file is None:
            return
        try:
            left = shutil.disk_usage(self._pattern.parent).free
        except OSError:
            return
        if left < _LEFT_FREE_BYTES:
            self._stop(f"{left // _MIB} MiB are left on the disk")

    def as_json(self) -> dict[str, Any]:
        """What was recorded."""
        return {"files": [str(f) for f in self.files], "bytes": self.bytes, "stopped": self.stopped}

    def _stop(self, why: str) -> None:
        self.stopped = why
        self.close()
        self._say(
            f"companion: recording stopped: {self._pattern.parent}: {why}; the flight goes on "
            "unrecorded"
        )

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()
        self._file = None


def _filled(text: str) -> str:
    """The name with date (local time) and the first digits of the system's boot id."""
    try:
        boot = _BOOT_ID.read_text(encoding="ascii")[:8]
    except OSError:
        boot = "unknown"
    return text.replace("{date}", time.strftime("%Y-%m-%d_%H-%M-%S")).replace("{boot}", boot)


def _create(path: Path) -> io.FileIO:
    """A new file of this name, or of the first free one behind it."""
    for k in range(1, _MOST_COPIES):
        if k == 1:
            name = path
        else:
            name = path.with_name(f"{path.stem}-{k}{path.suffix}")
        try:
            return io.FileIO(str(name), "xb")
        except FileExistsError:
            continue
    raise OSError(errno.EEXIST, f"{_MOST_COPIES} files of this name exist", str(path))
