"""Reads an ArduPilot dataflash log (.BIN) into columns, stretch by stretch. Times: TimeUS, in old logs TimeMS."""

from __future__ import annotations

import itertools
import math
import mmap
from collections import Counter
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.frames import Array
from replay.logs import tlog_blocks
from replay.logs.bin_walk import Formats, Kind, Walked, records, walk
from replay.logs.columns import Messages, believable

IMUS = ("IMU", "IMU2", "IMU3")
EKF = ("XKF1", "NKF1", "EKF1")
"""Filter output, newest name first: EKF3, EKF2, and EKF1 of old logs."""
ESCS = ("ESC", *(f"ESC{i}" for i in range(1, 33)))
_SPARSE = {"MODE", "EV", "ARM"}
"""Written when something changes: what was said before a block holds in it."""
_KINDS = {
    "ATT", "XKQ", "NKQ", *IMUS, *EKF, "RCOU", "BAT", "CURR", "BARO", "RFND", "PRX", "PRXR", *ESCS, "RPM", *_SPARSE,
    "CTUN", "VIBE",
}  # fmt: skip
_TEXT, _NUMBER = ("S", "V"), ("f", "i", "u")
"""numpy's letters for a field that holds text, and for one that holds a number."""
_MIDDLE_OF = 101
"""Messages whose median time is the time of a place in the file: one damaged stamp does not move it."""


@dataclass(frozen=True)
class Dataflash:
    """What a boot, or a piece of it, held, by message name."""

    path: Path
    bytes: int
    boot: int
    kinds: Mapping[str, Messages]
    texts: tuple[tuple[float, str], ...]
    """MSG: time [s], text."""
    parameters: Mapping[str, float]
    whole: frozenset[tuple[str, str]]
    """(message, field) whose values are stored as whole numbers."""
    counts: Mapping[str, int]
    """Messages of every name, also of those that are not read."""
    damaged: int
    """Bytes that are no message."""
    cut: int
    """Bytes of a last message that is not complete."""

    def of(self, kind: str) -> Messages:
        """All messages of a name; none where there are none."""
        return self.kinds.get(kind) or Messages(kind, np.empty(0), {})


@dataclass(frozen=True)
class Part:
    """A stretch of a boot, with some of its neighbours; its own time is start <= t < end."""

    data: Dataflash
    start_s: float
    end_s: float
    origin_s: float
    share_read: float


@dataclass(frozen=True)
class _Rows:
    """Messages in file order: offsets (n,) in the file, and places (n,) of their kinds in ``formats``."""

    data: mmap.mmap
    formats: Formats
    offsets: NDArray[np.int64]
    kinds: NDArray[np.int16]

    def part(self, first: int, end: int) -> _Rows:
        """The messages ``first`` <= i < ``end``."""
        return replace(self, offsets=self.offsets[first:end], kinds=self.kinds[first:end])

    def of(self, names: Container[str]) -> Iterator[tuple[Kind, NDArray[np.int64]]]:
        """Every declared kind of these names, and the offsets of its messages."""
        for number in np.unique(self.kinds).tolist():
            kind = self.formats.kinds[number]
            if kind.dtype is not None and kind.name in names:
                yield kind, self.offsets[self.kinds == number]

    @cached_property
    def clock(self) -> tuple[NDArray[np.int64], Array]:
        """Stamps of the messages that are read, in file order: offsets (m,), times (m,) [s]."""
        stamped = [(at, _stamps(records(self.data, k, at), k)) for k, at in self.of(_KINDS) if _stamp_field(k)]
        if not stamped:
            return np.empty(0, np.int64), np.empty(0)
        place, t_s = (np.concatenate(column) for column in zip(*stamped, strict=True))
        order = np.argsort(place)
        return place[order], t_s[order]

    def times(self, content: NDArray[Any], kind: Kind, offsets: NDArray[np.int64]) -> Array:
        """Boot times [s]; a message without a stamp is as old as the message before it."""
        if _stamp_field(kind):
            return _stamps(content, kind)
        place, t_s = self.clock
        before = np.searchsorted(place, offsets)
        return np.concatenate([[np.nan], t_s])[before]

    def messages(self, names: Container[str]) -> dict[str, Messages]:
        """The messages of these names, by name."""
        found: dict[str, list[Messages]] = {}
        for kind, at in self.of(names):
            content = records(self.data, kind, at)
            t_s = believable(self.times(content, kind, at))
            found.setdefault(kind.name, []).append(Messages(kind.name, t_s, _fields(content, kind)))
        return {name: _joined(name, parts) for name, parts in found.items()}

    def texts(self) -> Iterator[tuple[float, str]]:
        """MSG: time [s], text."""
        for kind, at in self.of({"MSG"}):
            content = records(self.data, kind, at)
            if _kind_of(content, "Message") in _TEXT:
                yield from zip(self.times(content, kind, at).tolist(), map(_text, content["Message"]), strict=True)

    def parameters(self) -> dict[str, float]:
        """PARM: the last value of every name."""
        out: dict[str, float] = {}
        for kind, at in self.of({"PARM"}):
            content = records(self.data, kind, at)
            if _kind_of(content, "Name") in _TEXT and _kind_of(content, "Value") in _NUMBER:
                pairs = zip(map(_text, content["Name"]), content["Value"].tolist(), strict=True)
                out |= {name: float(value) for name, value in pairs if math.isfinite(value)}
        return out


def parts(path: Path, size: int, block_bytes: int) -> Iterator[Part]:
    """The boots in the file, in stretches of about so many bytes each."""
    formats = Formats()
    with path.open("rb") as file:
        data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    found = walk(data, formats)
    rows = _Rows(data, formats, found.offsets, found.kinds)
    bounds = sorted({0, *found.begins, len(found.offsets)})
    for number, (first, end) in enumerate(itertools.pairwise(bounds)):
        boot = rows.part(first, end)
        yield from _stretches(_boot(path, size, number, boot, found), boot, block_bytes)


def _boot(path: Path, size: int, boot: int, rows: _Rows, found: Walked) -> Dataflash:
    """What holds for all stretches of a boot."""
    integers = frozenset((kind.name, f) for kind in rows.formats.kinds for f in kind.whole)
    texts, parameters = tuple(rows.texts()), rows.parameters()
    kinds = rows.messages(_SPARSE)
    return Dataflash(path, size, boot, kinds, texts, parameters, integers, {}, found.skipped, size - found.rest)


def _stretches(whole: Dataflash, rows: _Rows, block_bytes: int) -> Iterator[Part]:
    """A boot in stretches, each with a margin of its neighbours."""
    offsets = rows.offsets
    margin = min(tlog_blocks.MARGIN_BYTES, block_bytes // 2)
    begins = range(int(offsets[0]), int(offsets[-1]) + 1, min(block_bytes, whole.bytes))
    cuts = sorted({*np.searchsorted(offsets, begins).tolist(), len(offsets)})
    until_s, origin_s = -math.inf, math.nan
    for first, end in itertools.pairwise(cuts):
        near = np.searchsorted(offsets, (offsets[first] - margin, offsets[end - 1] + margin)).tolist()
        part = rows.part(*near)
        place, t_s = part.clock
        start_s, until_s = until_s, math.inf
        if end < len(offsets):
            i = int(np.searchsorted(place, offsets[end]))
            until_s = float(np.median(t_s[max(i - _MIDDLE_OF, 0) : i])) if i else math.inf
        if math.isnan(origin_s) and len(t_s):
            origin_s = float(t_s[0])
        counts = Counter(rows.formats.kinds[k].name for k in rows.kinds[first:end].tolist())
        data = replace(whole, kinds={**whole.kinds, **part.messages(_KINDS - _SPARSE)}, counts=counts)
        yield Part(data, start_s, until_s, origin_s, int(offsets[end - 1]) / whole.bytes)


def _stamp_field(kind: Kind) -> str | None:
    """GPS messages reuse TimeMS for the time of week; none of them is read here."""
    names = () if kind.dtype is None else kind.dtype.names or ()
    return next((f for f in ("TimeUS", "TimeMS") if f in names), None)


def _stamps(content: NDArray[Any], kind: Kind) -> Array:
    name = _stamp_field(kind)
    assert name is not None
    return np.asarray(content[name], float) / (1e6 if name == "TimeUS" else 1e3)


def _fields(content: NDArray[Any], kind: Kind) -> dict[str, NDArray[Any]]:
    """Numbers as they are meant."""
    names = [n for n in content.dtype.names or () if n != "head" and n not in kind.text]
    return {
        name: content[name] / kind.divisors[name] if name in kind.divisors else content[name]
        for name in names
        if content.dtype[name].kind != "V"
    }


def _joined(name: str, parts: list[Messages]) -> Messages:
    """Messages of one name from several places, or of several declarations: a field that one lacks is NaN."""
    if len(parts) == 1:
        return parts[0]
    fields = dict.fromkeys(f for part in parts for f in part.data)
    t_s = np.concatenate([part.t_s for part in parts])
    return Messages(name, t_s, {f: np.concatenate([part.column(f) for part in parts]) for f in fields})


def _kind_of(content: NDArray[Any], field: str) -> str:
    """numpy's letter for what a field holds; "" where there is none of that name, as in a damaged declaration."""
    return content.dtype[field].kind if field in (content.dtype.names or ()) else ""


def _text(raw: bytes) -> str:
    return bytes(raw).split(b"\0")[0].decode("utf-8", "replace")
