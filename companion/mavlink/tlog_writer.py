"""Writes a flight to .tlog files: 8-byte big-endian microseconds, then the frame, for both directions of the link.

Each frame goes to the system at once: a process that is killed loses nothing. No file is ever overwritten. A disk that
is full or read-only ends the recording, is reported once, and never ends the flight.
"""

from __future__ import annotations

import errno
import io
import logging
import os
import re
import shutil
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol

from models.errors import ConfigError

_STAMP = struct.Struct(">Q")
_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")
_PLACES = ("{date}", "{boot}")
_DEFAULT_NAME = "{date}_boot-{boot}.tlog"
_OTHERS_FAULT = (errno.EROFS, errno.EACCES, errno.EPERM, errno.ENOSPC, errno.EDQUOT, errno.EIO)
"""What a disk may come to between two flights; a folder that does not exist is a wrong argument."""
_MOST_COPIES = 100_000
"""Files of one name: more is a mistake in the name."""
_MIB = 1 << 20


class Records(Protocol):
    """Whatever takes the frames of both directions in order."""

    def write(self, arrival_us: int, raw: bytes) -> None:
        """Append one frame."""

    def flush(self) -> None:
        """Every half second."""


@dataclass(frozen=True)
class RecordLimits:
    """How much may be written. ``folder_bytes`` None: nothing is ever removed."""

    file_bytes: int = 512 * _MIB
    """A larger flight goes on in the next file."""
    folder_bytes: int | None = None
    """Older recordings that this program named by date and boot are removed until the folder holds less."""
    free_bytes: int = 64 * _MIB
    """So much of the disk is left to others."""


_LOG = logging.getLogger(__name__)


class Recorder:
    """An open recording.

    ``path``: a file, a folder, or a name with ``{date}`` and ``{boot}``. Where the file exists, -2, -3 ... is added to
    the name. ``say`` is called once when nothing more can be recorded; without it that is logged.

    Raises ConfigError where the folder does not exist or the name cannot be one.
    """

    def __init__(
        self, path: Path, limits: RecordLimits | None = None, say: Callable[[str], None] | None = None
    ) -> None:
        self._pattern = path / _DEFAULT_NAME if path.is_dir() else path
        self._limits = limits or RecordLimits()
        self._say = say or _LOG.warning
        self.frames = self.bytes = 0
        self.files: list[Path] = []
        """What has been written, in order."""
        self.stopped: str | None = None
        """Why nothing more is recorded."""
        self._file: io.FileIO | None = None
        self._size = 0
        if self._limits.folder_bytes is not None and not _is_template(self._pattern):
            raise ConfigError(
                f"--record {path}: a limit of the folder needs a folder or a name with {{date}}: older flights are "
                "removed by these names"
            )
        try:
            self._open()
        except OSError as error:
            if error.errno not in _OTHERS_FAULT:
                raise ConfigError(f"--record {path}: cannot be written ({error.strerror})") from None
            self._stop(error.strerror or str(error))

    def write(self, arrival_us: int, raw: bytes) -> None:
        """Append one frame; a frame that does not fit as a whole is not begun."""
        if self._file is None:
            return
        record = _STAMP.pack(arrival_us) + raw
        try:
            if self._size + len(record) > self._limits.file_bytes and self._size:
                self._file.close()
                self._open()
            written = self._file.write(record)
        except OSError as error:
            self._stop(error.strerror or str(error))
            return
        if written != len(record):
            self._file.truncate(self._size)
            self._stop("the disk is full")
            return
        self._size += len(record)
        self.bytes += len(record)
        self.frames += 1

    def flush(self) -> None:
        """Look after the disk: a record must not be what fills it."""
        if self._file is None:
            return
        try:
            left = shutil.disk_usage(self._pattern.parent).free
        except OSError:
            return
        if left < self._limits.free_bytes:
            self._stop(f"{left // _MIB} MiB are left on the disk")

    def as_json(self) -> dict[str, Any]:
        """What was recorded."""
        return {"files": [str(f) for f in self.files], "bytes": self.bytes, "stopped": self.stopped}

    def _open(self) -> None:
        self._remove_old()
        self._file, path = _create(Path(_filled(str(self._pattern))))
        self._size = 0
        self.files.append(path)

    def _remove_old(self) -> None:
        most = self._limits.folder_bytes
        if most is None:
            return
        named = _named_by(self._pattern)
        found = [p for p in self._pattern.parent.iterdir() if named.fullmatch(p.name) and p not in self.files]
        sizes = sorted((p.stat().st_mtime, p.stat().st_size, p) for p in found)
        room = most - self._limits.file_bytes - self.bytes
        total = sum(size for _, size, _ in sizes)
        for _, size, path in sizes:
            if total <= max(room, 0):
                return
            path.unlink()
            total -= size

    def _stop(self, why: str) -> None:
        self.stopped = why
        if self._file is not None:
            self._file.close()
        self._file = None
        self._say(f"companion: recording stopped: {self._pattern.parent}: {why}; the flight goes on unrecorded")

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()
        self._file = None

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        self.close()


def _is_template(path: Path) -> bool:
    return any(place in path.name for place in _PLACES)


def _filled(text: str) -> str:
    """The name with date (local time) and the first digits of the system's boot id."""
    try:
        boot = _BOOT_ID.read_text(encoding="ascii")[:8]
    except OSError:
        boot = "unknown"
    return text.replace("{date}", time.strftime("%Y-%m-%d_%H-%M-%S")).replace("{boot}", boot)


def _named_by(pattern: Path) -> re.Pattern[str]:
    """Names that the pattern makes, with or without -2, -3 ..."""
    stem = re.escape(pattern.stem)
    stem = stem.replace(r"\{date\}", r"\d{4}-\d\d-\d\d_\d\d-\d\d-\d\d").replace(r"\{boot\}", r"([0-9a-f]{8}|unknown)")
    return re.compile(stem + r"(-\d+)?" + re.escape(pattern.suffix))


def _create(path: Path) -> tuple[io.FileIO, Path]:
    """A new file of this name, or of the first free one behind it."""
    for k in range(1, _MOST_COPIES):
        name = path if k == 1 else path.with_name(f"{path.stem}-{k}{path.suffix}")
        try:
            return io.FileIO(os.open(name, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644), "wb"), name
        except FileExistsError:
            continue
    raise OSError(errno.EEXIST, f"{_MOST_COPIES} files of this name exist", str(path))
