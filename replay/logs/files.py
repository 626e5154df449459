"""A log's file: its bytes, or one line that says why not."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

from models.errors import LogError

PACKED = {
    b"\x1f\x8b": "gzip", b"\xfd7zXZ\x00": "xz", b"BZh": "bzip2", b"\x28\xb5\x2f\xfd": "zstd", b"PK\x03\x04": "zip",
    b"7z\xbc\xaf": "7z",
}  # fmt: skip
"""First bytes of compressed files, whatever their names are."""
_HEAD = 6
"""Bytes that tell a compressed file."""


def open_file(path: Path) -> BinaryIO:
    """The file, open at its begin. Raises LogError where it cannot be read, is empty or compressed."""
    _read(path, _HEAD)
    return path.open("rb")


def size_of(path: Path, head: bytes, kind: str) -> int:
    """Size in bytes of a file that starts with ``head``. Raises LogError where it cannot be read or is no ``kind``."""
    if not _read(path, max(len(head), _HEAD)).startswith(head):
        raise LogError(f"{path}: is no {kind}: it does not start with {_shown(head)}")
    return path.stat().st_size


def _read(path: Path, count: int) -> bytes:
    try:
        with path.open("rb") as file:
            data = file.read(count)
    except IsADirectoryError:
        raise LogError(f"{path}: is a directory, not a log") from None
    except OSError as error:
        raise LogError(f"{path}: cannot be read ({error.strerror or error})") from None
    if not data:
        raise LogError(f"{path}: is empty")
    packed = next((name for magic, name in PACKED.items() if data.startswith(magic)), None)
    if packed is not None:
        raise LogError(f"{path}: is compressed ({packed}): unpack it first")
    return data


def _shown(head: bytes) -> str:
    return head.decode() if head.isascii() else head.hex(" ").upper()
