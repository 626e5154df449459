"""A log's file: its bytes, or one line that says why not."""

from __future__ import annotations

from pathlib import Path

from models.errors import LogError


def read_bytes(path: Path) -> bytes:
    """Everything in the file. Raises LogError where it cannot be read or is empty."""
    return _read(path, -1)


def size_of(path: Path, head: bytes, kind: str) -> int:
    """Size in bytes of a file that starts with ``head``. Raises LogError where it cannot be read or is no ``kind``."""
    if _read(path, len(head)) != head:
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
    return data


def _shown(head: bytes) -> str:
    return head.decode() if head.isascii() else head.hex(" ").upper()
