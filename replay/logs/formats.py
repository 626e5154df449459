"""Log formats by suffix, or by content where the suffix says nothing.

A new one is a line here and a module with a function ``read(path, target_system) -> list[FlightLog]``; other packages
bring theirs by entry point (``plugins.py``).
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from companion.mavlink.file_frames import STAMP_BYTES, cut_file
from companion.mavlink.wire_frames import Counts
from models.common.errors import LogError
from replay.flightlog import FlightLog
from replay.logs.files import HEAD_BYTES, is_text_dataflash
from replay.logs.plugins import plugin_reader, plugin_suffixes
from replay.logs.rotor_speeds import with_believable_speeds
from replay.sources.choose import chosen

READERS = {
    ".tlog": "replay.logs.tlog_flightlog",
    ".bin": "replay.logs.bin_flightlog",
    ".ulg": "replay.logs.ulg",
}
"""Suffix (lower case) to the module that reads it; imported when needed. Other packages cannot replace these."""

_STARTS = {b"\xa3\x95\x80": ".bin", b"ULog\x01\x12\x35": ".ulg"}
"""First bytes of the formats that have such: a DataFlash log begins with a FMT message."""
_FRAMES = 3
"""So many frames with a right checksum in the first bytes are no accident."""
_PACKED = (".gz", ".xz", ".bz2", ".zst", ".zip", ".7z")


def known_suffixes() -> tuple[str, ...]:
    """All that can be read, those of other packages last."""
    return (*READERS, *(suffix for suffix in plugin_suffixes() if suffix not in READERS))


def suffix_of(path: Path) -> str:
    """The suffix that a log has, or should have by its content (tools name it .log, .raw, .dat); or LogError."""
    suffix = path.suffix.lower()
    if suffix not in READERS:
        known = _by_content(path)
        if known is not None:
            return known
        if suffix in plugin_suffixes():
            return suffix
        if suffix in _PACKED:
            advice = "; unpack it first"
        else:
            advice = _advice_on_text(path)
        if path.suffix:
            what = f"'{path.suffix}'"
        else:
            what = "no suffix"
        raise LogError(
            f"{path}: {what} is no known log format; known: {', '.join(known_suffixes())}{advice}"
        )
    return suffix


def _by_content(path: Path) -> str | None:
    head = _head(path)
    for start, suffix in _STARTS.items():
        if head.startswith(start):
            return suffix
    if is_text_dataflash(head):
        return ".bin"
    frames = cut_file(head, Counts(), STAMP_BYTES).start
    if len(frames) >= _FRAMES:
        return ".tlog"
    return None


def _head(path: Path) -> bytes:
    """The first bytes of a file; none where it cannot be read."""
    try:
        with path.open("rb") as file:
            return file.read(HEAD_BYTES)
    except OSError:
        return b""


def _advice_on_text(path: Path) -> str:
    """For a log that a program has written out as text, such as a table or MAVLink messages."""
    head = _head(path)
    if not head.strip() or b"\0" in head or not head.isascii():
        return ""
    return (
        "; it is text, but no dataflash log (no FMT line): give the .BIN, .tlog or .ulg that "
        "it was made from"
    )


def load(
    path: Path | str,
    target_system: int | None = None,
    settings: Mapping[str, str] | None = None,
) -> list[FlightLog]:
    """Read a log: every boot in it, in order.

    Parameters
    ----------
    path : path or str
        ``.tlog``, ``.BIN``, ``.ulg``, or a format that another package adds.
    target_system : int or None
        MAVLink system of the vehicle, where the log holds several.
    settings : mapping or None
        Quantity to the instance to take (docs/logs.md). None: the one that the autopilot used.

    Returns
    -------
    list of FlightLog
        SI, world NED, body FRD.

    Raises
    ------
    LogError
        It cannot be read.
    ConfigError
        It has no such instance.

    Examples
    --------
    >>> import replay
    >>> (flight,) = replay.load("flight.tlog")
    >>> flight.attitude.values.shape[1], flight.beam("up") is None
    (4, True)
    """
    path = Path(path)
    if path.is_dir():
        raise LogError(
            f"{path}: is a directory: name the logs in it; replay run, diagnose and info take "
            "directories"
        )
    if not path.exists():
        raise LogError(f"{path}: cannot be read (No such file or directory)")
    logs = _read(path, target_system)
    return [chosen(with_believable_speeds(log), settings) for log in logs]


def _read(path: Path, target_system: int | None) -> list[FlightLog]:
    suffix = suffix_of(path)
    if suffix in READERS:
        module: Any = import_module(READERS[suffix])
        logs: list[FlightLog] = module.read(path, target_system)
        return logs
    read = plugin_reader(suffix)
    assert read is not None, "the suffix is known"
    return read(path)
