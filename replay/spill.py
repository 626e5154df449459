"""Large arrays on disk: memory holds the parts of a log that are worked on, whatever its size.

An array above ``_LARGE`` bytes is written to a temporary file without a name, and read through a memory map. The folder
is ``TMPDIR`` or ``/var/tmp``, as ``/tmp`` is often memory. Without room there it stays in memory.
"""

from __future__ import annotations

import itertools
import mmap
import os
import tempfile
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

_LARGE = 4 * 2**20
"""Bytes of an array that is written to disk. A log below some ten MB has none."""
BLOCK = 1 << 17
"""Rows that are worked on at a time: a few MB."""
AT_ONCE = 4 * 2**20
"""Bytes of a file that are looked at before their memory is given back."""
_MOST = 300
"""Arrays on disk at a time: each holds a file open, and a process may open about a thousand."""
_FOLDER = Path("/var/tmp")

_maps: weakref.WeakSet[mmap.mmap] = weakref.WeakSet()
"""All that is mapped now."""


def mapped(file: IO[bytes]) -> mmap.mmap:
    """The content of a file, read when it is looked at. Raises OSError or ValueError where that cannot be."""
    content = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    _maps.add(content)
    return content


def release() -> None:
    """Give back the memory of all that is mapped: it is read again when it is looked at."""
    if hasattr(mmap, "MADV_DONTNEED"):
        for content in list(_maps):
            content.madvise(mmap.MADV_DONTNEED)


def blocks(length: int, size: int = BLOCK) -> Iterator[slice]:
    """So many rows at a time, in order; what was mapped for them is given back after each."""
    for first in range(0, length, size):
        yield slice(first, min(first + size, length))
        release()


def spans(places: NDArray[np.int64], width: int = 4 * BLOCK) -> Iterator[slice]:
    """Places (n,) that lie within one window of so many, window by window, as ``blocks``."""
    ends = np.flatnonzero(np.diff(places // width)) + 1
    for first, end in itertools.pairwise([0, *ends.tolist(), len(places)]):
        yield slice(first, end)
        release()


def spilled(array: NDArray[Any]) -> NDArray[Any]:
    """The same array, on disk and read-only where it is large."""
    if array.nbytes < _LARGE or _on_disk(array):
        return array
    grown = Spool(array.dtype, array.shape[1:])
    for rows in blocks(len(array)):
        grown.append(array[rows])
    return grown.array()


def picked(array: NDArray[Any], rows: NDArray[Any]) -> NDArray[Any]:
    """Some rows of an array, by a mask (n,) or by their places; on disk where they are large."""
    if array.nbytes < _LARGE:
        return np.asarray(array[rows])
    grown = Spool(array.dtype, array.shape[1:])
    for part in blocks(len(rows)):
        if rows.dtype == bool:
            grown.append(array[part][rows[part]])
        else:
            grown.append(array[rows[part]])
    return grown.array()


def _on_disk(array: NDArray[Any]) -> bool:
    base: Any = array
    while isinstance(base, np.ndarray):
        base = base.base
    return isinstance(base, memoryview) and isinstance(base.obj, mmap.mmap)


class Spool:
    """An array that grows at its end; on disk as soon as it is large."""

    def __init__(self, dtype: DTypeLike, row: tuple[int, ...] = ()) -> None:
        """``row``: shape of one row; () for numbers."""
        self._dtype = np.dtype(dtype)
        self._row = row
        self._parts: list[NDArray[Any]] = []
        self._bytes = 0
        self._on_disk = 0
        self._file: IO[bytes] | None = None
        self._in_memory = len(_maps) >= _MOST

    def append(self, rows: NDArray[Any]) -> None:
        """More rows (n, ...) at the end."""
        if not rows.size:
            return
        self._parts.append(np.ascontiguousarray(rows, self._dtype))
        self._bytes += self._parts[-1].nbytes
        if self._bytes >= _LARGE and not self._in_memory:
            self._write()

    def array(self) -> NDArray[Any]:
        """All rows; read-only where they are on disk. Nothing can be appended afterwards."""
        if self._file is not None and self._parts:
            self._write()
        if self._file is None:
            if not self._parts:
                return np.empty((0, *self._row), self._dtype)
            return np.concatenate(self._parts)
        with self._file as file:
            content = mapped(file)
        return np.frombuffer(content, self._dtype).reshape(-1, *self._row)

    def _write(self) -> None:
        """Move to disk what is in memory; where there is no room, back into memory what is on disk."""
        try:
            if self._file is None:
                # Closed when it is mapped, or dropped.
                self._file = tempfile.TemporaryFile(buffering=0, dir=_folder())  # noqa: SIM115
            for part in self._parts:
                left = part.reshape(-1).view(np.uint8)
                while left.size:
                    left = left[self._file.write(left.data) :]
        except OSError:
            self._in_memory = True
            self._parts.insert(0, self._from_disk())
            self._file = None
            return
        self._on_disk += sum(part.nbytes for part in self._parts)
        self._parts = []

    def _from_disk(self) -> NDArray[Any]:
        """All rows of the appends that are on disk whole."""
        content = b""
        if self._file is not None:
            self._file.seek(0)
            content = self._file.read(self._on_disk)
        return np.frombuffer(content, self._dtype).reshape(-1, *self._row)


def _folder() -> str | None:
    """Where temporary files go: None for the system's choice."""
    if os.environ.get("TMPDIR") or not os.access(_FOLDER, os.W_OK):
        return None
    return str(_FOLDER)
