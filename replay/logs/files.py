"""A log's file: its bytes, or one line that says why not."""

from __future__ import annotations

from pathlib import Path

from companion.mavlink.wire_frames import Content
from models.common.errors import LogError
from replay.logs.memory import free_bytes
from replay.spill import mapped

_MEMORY_PER_BYTE = 3.0
"""Measured peaks of the commands are 1 to 3.7 bytes a byte of a log of 200 MB, less of larger ones."""
_MAPPED_FROM = 16 * 2**20
"""Bytes of a file from which on it is mapped, not read."""
HEAD_BYTES = 8192
"""So many tell a format: firmware name and free memory stand before the first FMT line of old logs as text."""

PACKED = {
    b"\x1f\x8b": "gzip",
    b"\xfd7zXZ\x00": "xz",
    b"BZh": "bzip2",
    b"\x28\xb5\x2f\xfd": "zstd",
    b"PK\x03\x04": "zip",
    b"7z\xbc\xaf": "7z",
}
"""First bytes of compressed files, whatever their names are."""


def read_file(path: Path, head: bytes = b"", kind: str = "") -> Content:
    """All bytes of a log, mapped where it is large.

    Raises LogError where it cannot be read, is empty or compressed, or is no ``kind``, which starts with ``head``.
    """
    data: Content
    try:
        size = path.stat().st_size
        _check_memory(path, size)
        if size < _MAPPED_FROM:
            data = path.read_bytes()
        else:
            with path.open("rb") as file:
                data = mapped(file)
    except IsADirectoryError:
        raise LogError(f"{path}: is a directory, not a log") from None
    except OSError as error:
        raise LogError(f"{path}: cannot be read ({error.strerror or error})") from None
    if not data:
        raise LogError(f"{path}: is empty")
    start = data[:HEAD_BYTES]
    packed = next((name for magic, name in PACKED.items() if start.startswith(magic)), None)
    if packed is not None:
        raise LogError(f"{path}: is compressed ({packed}): unpack it first")
    check_head(path, start, head, kind)
    return data


def _check_memory(path: Path, size: int) -> None:
    """Raises LogError before a log is read for which there is not enough memory."""
    needed = _MEMORY_PER_BYTE * size
    free = free_bytes()
    if needed > free:
        sizes = (
            f"{size / 1e9:.2g} GB of log need some {needed / 1e9:.2g} GB of memory, "
            f"{free / 1e9:.2g} GB are free"
        )
        raise LogError(f"{path}: {sizes}: cut it into parts, or use a machine with more")


def check_head(path: Path, data: bytes, head: bytes, kind: str) -> None:
    """Raises LogError where the bytes are no ``kind``, which starts with ``head``."""
    if not data.startswith(head):
        if head.isascii():
            shown = head.decode()
        else:
            shown = head.hex(" ").upper()
        raise LogError(f"{path}: is no {kind}: it does not start with {shown}")


def is_text_dataflash(data: Content) -> bool:
    """Whether a file is a dataflash log as text: a FMT line is among its first, and no byte of binary data."""
    head = data[:HEAD_BYTES]
    lines = head.replace(b"\r", b"\n").removeprefix(b"\xef\xbb\xbf").split(b"\n")
    return b"\0" not in head and any(line.lstrip().startswith((b"FMT,", b"FMT;")) for line in lines)
