"""Walks an ArduPilot dataflash log: A3 95, the type of the message, and its fields as a FMT message declares them.

There is no checksum: a message is one where its first bytes and its type are right. Formats of fields: pymavlink's
DFReader.
"""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from dataclasses import dataclass, field
from mmap import mmap
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from pymavlink.DFReader import FORMAT_TO_STRUCT

HEAD = b"\xa3\x95"
_FMT, _FMT_BYTES = 128, 89
_FMT_TYPE = np.dtype(
    [("head", "V3"), ("type", "u1"), ("length", "u1"), ("name", "S4"), ("format", "S16"), ("columns", "S64")]
)
_WHOLE = frozenset("bBhHiIqQM")
"""Formats of whole numbers that are meant as they stand."""
_TEXT = frozenset("nNZ")


@dataclass(frozen=True)
class Kind:
    """One declared message: its name, its bytes, and its fields with what they are divided by and meant as."""

    name: str
    length: int
    dtype: np.dtype[Any] | None
    """None where the declared fields do not make up the declared length."""
    divisors: Mapping[str, float]
    whole: frozenset[str]
    """Fields that are stored as whole numbers."""
    text: frozenset[str]


def kind_of(message: bytes) -> tuple[int, Kind]:
    """Type and declaration in a FMT message."""
    declared = np.frombuffer(message, _FMT_TYPE)[0]
    name, formats, columns = (declared[k].decode("ascii", "replace") for k in ("name", "format", "columns"))
    pairs = list(zip(columns.split(","), formats, strict=False))
    length = int(declared["length"])
    known = all(c in FORMAT_TO_STRUCT for _, c in pairs) and len({f for f, _ in pairs}) == len(pairs)
    dtype = np.dtype([("head", "V3"), *((f, _numpy(c)) for f, c in pairs)]) if known else None
    return int(declared["type"]), Kind(
        name,
        length,
        dtype if dtype is not None and dtype.itemsize == length else None,
        {f: 1.0 / FORMAT_TO_STRUCT[c][1] for f, c in pairs if known and FORMAT_TO_STRUCT[c][1] is not None},
        frozenset(f for f, c in pairs if c in _WHOLE),
        frozenset(f for f, c in pairs if c in _TEXT),
    )


def _numpy(format_: str) -> str:
    code: str = FORMAT_TO_STRUCT[format_][0]
    if code.endswith("s"):
        return ("S" if format_ in _TEXT else "V") + code[:-1]
    return f"<{np.dtype(code).str[1:]}"


_DECLARATION = Kind("FMT", _FMT_BYTES, _FMT_TYPE, {}, frozenset(), frozenset())


@dataclass
class Formats:
    """What has been declared so far. A type may be declared anew: messages keep the declaration before them."""

    kinds: list[Kind] = field(default_factory=lambda: [_DECLARATION])
    current: list[int] = field(default_factory=lambda: [-1] * _FMT + [0] + [-1] * (255 - _FMT))
    """By type: place in ``kinds``, -1 where it is not declared."""

    def declare(self, message: bytes) -> bool:
        """Take in a FMT message; True where it declares itself, which is how a log begins."""
        number, kind = kind_of(message)
        if number == _FMT:
            return True
        known = self.current[number]
        if kind.length > len(HEAD) and (known < 0 or self.kinds[known] != kind):
            self.current[number] = len(self.kinds)
            self.kinds.append(kind)
        return False


@dataclass
class Walked:
    """Messages of a stretch: offsets (n,), places (n,) in ``Formats.kinds``."""

    offsets: NDArray[np.int64]
    kinds: NDArray[np.int16]
    rest: int
    """Where a last message begins that is not complete; the length of the data without one."""
    skipped: int
    """Bytes between messages."""
    begins: tuple[int, ...]
    """Numbers of the messages with which a log begins."""


def walk(data: bytes | mmap, formats: Formats) -> Walked:
    """All messages of a log. Declarations are added to ``formats``."""
    offsets, kinds = array("q"), array("h")
    begins: list[int] = []
    current, n, i, skipped = formats.current, len(data), 0, 0
    lengths = _lengths(formats)
    while i + 3 <= n:
        number = data[i + 2]
        length = lengths[number] if data[i] == HEAD[0] and data[i + 1] == HEAD[1] else 0
        if length == 0:
            found = _next(data, i + 1, lengths)
            skipped += (n if found < 0 else found) - i
            i = n if found < 0 else found
            continue
        if i + length > n:
            break
        if number == _FMT:
            if formats.declare(data[i : i + length]):
                begins.append(len(offsets))
            lengths = _lengths(formats)
        offsets.append(i)
        kinds.append(current[number])
        i += length
    return Walked(np.array(offsets, np.int64), np.array(kinds, np.int16), i, skipped, tuple(begins))


def _lengths(formats: Formats) -> list[int]:
    """Bytes of a message by its type; 0 where the type is not declared."""
    return [formats.kinds[k].length if k >= 0 else 0 for k in formats.current]


def _next(data: bytes | mmap, i: int, lengths: list[int]) -> int:
    """Place of the next first bytes of a declared message, or -1."""
    while (i := data.find(HEAD, i)) >= 0:
        if i + 2 >= len(data) or lengths[data[i + 2]]:
            return i if i + 2 < len(data) else -1
        i += 1
    return -1


def records(data: bytes | mmap, kind: Kind, offsets: NDArray[np.int64]) -> NDArray[Any]:
    """The messages of one kind at ``offsets`` (n,) as a structured array (n,)."""
    assert kind.dtype is not None
    raw = sliding_window_view(np.frombuffer(data, np.uint8), kind.length)[offsets]
    return np.ascontiguousarray(raw).view(kind.dtype).reshape(-1)
