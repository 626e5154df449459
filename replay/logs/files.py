"""A log's file: its bytes, or one line that says why not."""

from __future__ import annotations

from pathlib import Path

from models.errors import LogError

PACKED = {
    b"\x1f\x8b": "gzip", b"\xfd7zXZ\x00": "xz", b"BZh": "bzip2", b"\x28\xb5\x2f\xfd": "zstd", b"PK\x03\x04": "zip",
    b"7z\xbc\xaf": "7z",
}  # fmt: skip
"""First bytes of compressed files, whatever their names are."""


def read_file(path: Path, head: bytes = b"", kind: str = "") -> bytes:
    """All bytes of a log. Raises LogError where it cannot be read, is empty or compressed, or is no ``kind``, which
    starts with ``head``."""
    try:
        data = path.read_bytes()
    except IsADirectoryError:
        raise LogError(f"{path}: is a directory, not a log") from None
    except OSError as error:
        raise LogError(f"{path}: cannot be read ({error.strerror or error})") from None
    if not data:
        raise LogError(f"{path}: is empty")
    packed = next((name for magic, name in PACKED.items() if data.startswith(magic)), None)
    if packed is not None:
        raise LogError(f"{path}: is compressed ({packed}): unpack it first")
    if not data.startswith(head):
        shown = head.decode() if head.isascii() else head.hex(" ").upper()
        raise LogError(f"{path}: is no {kind}: it does not start with {shown}")
    return data
