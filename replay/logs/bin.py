"""Reads an ArduPilot dataflash log (.BIN) into columns, block by block. Times: TimeUS, in old logs TimeMS."""

from __future__ import annotations

import itertools
import math
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
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
    "ATT", "XKQ", "NKQ", *IMUS, *EKF, "RCOU", "BAT", "CURR", "BARO", "RFND", *ESCS, "RPM", *_SPARSE, "CTUN", "VIBE",
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


@dataclass
class _Boot:
    """What is carried from block to block."""

    number: int
    until_s: float = -math.inf
    origin_s: float = math.nan
    sparse: dict[str, list[Messages]] = field(default_factory=lambda: defaultdict(list))
    parameters: dict[str, float] = field(default_factory=dict)
    texts: list[tuple[float, str]] = field(default_factory=list)


def parts(path: Path, size: int, block_bytes: int) -> Iterator[Part]:
    """The boots in the file, in stretches of about so many bytes each."""
    formats, boots = Formats(), list[_Boot]()
    margin = min(tlog_blocks.MARGIN_BYTES, block_bytes // 2)
    begin = tail = 0
    damaged = 0
    with path.open("rb") as file:
        while begin < size:
            file.seek(tail)
            data = file.read(min(size, begin + block_bytes + margin) - tail)
            last = tail + len(data) >= size
            found = walk(data, formats, whole=last)
            damaged += found.skipped
            at = found.offsets + tail
            first = int(np.searchsorted(at, begin))
            end = len(at) if last else int(np.searchsorted(at, begin + block_bytes))
            share = 1.0 if last or end >= len(at) else int(at[end]) / size
            yield from _boots(_Block(path, size, data, formats, found, first, end, last, damaged, share), boots)
            if last or end >= len(at):
                return
            begin = int(at[end])
            tail = int(at[np.searchsorted(at, begin - margin)])


@dataclass(frozen=True)
class _Block:
    """Messages ``first`` <= i < ``end`` are the block's own; those around them are of its neighbours."""

    path: Path
    size: int
    data: bytes
    formats: Formats
    found: Walked
    first: int
    end: int
    is_last: bool
    damaged: int
    share_read: float
    """Of the file, up to the end of this block."""


def _boots(block: _Block, boots: list[_Boot]) -> Iterator[Part]:
    """The parts of a block; ``boots`` holds the one that goes on from the block before, if there is one."""
    bounds = [0, *(b for b in block.found.begins if b > 0), len(block.found.offsets)]
    for first, end in itertools.pairwise(bounds):
        if end <= block.first or first >= block.end:
            continue
        if not boots or (first > 0 and first >= block.first):
            boots[:] = [_Boot(boots[-1].number + 1 if boots else 0)]
        yield _part(block, first, end, boots[-1])


def _part(block: _Block, first: int, end: int, boot: _Boot) -> Part:
    """The part of a block that is of one boot: messages ``first`` <= i < ``end``."""
    offsets, numbers = block.found.offsets[first:end], block.found.kinds[first:end]
    own = (offsets >= _offset(block, block.first)) & (offsets < _offset(block, block.end))
    clock = _clock(block, offsets, numbers)
    named: dict[str, list[Messages]] = {}
    whole: set[tuple[str, str]] = set()
    for number in np.unique(numbers).tolist():
        kind = block.formats.kinds[number]
        if kind.dtype is None or kind.name not in _KINDS | {"PARM", "MSG"}:
            continue
        rows = numbers == number
        if kind.name not in _KINDS or kind.name in _SPARSE:
            rows &= own  # kept from block to block
        if not rows.any():
            continue
        content = records(block.data, kind, offsets[rows])
        t_s = _times(content, kind, offsets[rows], clock)
        if kind.name == "PARM":
            _add_parameters(boot.parameters, content)
        elif kind.name == "MSG" and _kind_of(content, "Message") in _TEXT:
            boot.texts += zip(t_s.tolist(), map(_text, content["Message"]), strict=True)
        elif kind.name != "MSG":
            target = boot.sparse if kind.name in _SPARSE else named
            target.setdefault(kind.name, []).append(Messages(kind.name, believable(t_s), _fields(content, kind)))
            whole |= {(kind.name, f) for f in kind.whole}
    start_s, end_s = boot.until_s, math.inf
    if not block.is_last and end > block.end:
        boot.until_s = end_s = _time_before(clock, _offset(block, block.end))
    if math.isnan(boot.origin_s) and len(clock.t_s):
        boot.origin_s = float(clock.t_s[0])
    counts = Counter(block.formats.kinds[k].name for k in numbers[own].tolist())
    kinds = {name: _joined(name, parts) for name, parts in {**named, **boot.sparse}.items()}
    data = Dataflash(
        block.path, block.size, boot.number, kinds, tuple(boot.texts), dict(boot.parameters), frozenset(whole), counts,
        block.damaged, len(block.data) - block.found.rest if block.is_last else 0,
    )  # fmt: skip
    return Part(data, start_s, end_s, boot.origin_s, block.share_read)


def _offset(block: _Block, number: int) -> int:
    offsets = block.found.offsets
    return int(offsets[number]) if number < len(offsets) else len(block.data)


@dataclass(frozen=True)
class _Clock:
    """Stamps of the messages that are read, in file order: offsets (n,), times (n,) [s]."""

    offsets: NDArray[np.int64]
    t_s: Array


def _clock(block: _Block, offsets: NDArray[np.int64], numbers: NDArray[np.int16]) -> _Clock:
    places, times = [], []
    for number in np.unique(numbers).tolist():
        kind = block.formats.kinds[number]
        if kind.name in _KINDS and kind.dtype is not None and _stamp_field(kind) is not None:
            at = offsets[numbers == number]
            places.append(at)
            times.append(_stamps(records(block.data, kind, at), kind))
    if not places:
        return _Clock(np.empty(0, np.int64), np.empty(0))
    place, t_s = np.concatenate(places), np.concatenate(times)
    order = np.argsort(place)
    return _Clock(place[order], t_s[order])


def _stamp_field(kind: Kind) -> str | None:
    """GPS messages reuse TimeMS for the time of week; none of them is read here."""
    names = () if kind.dtype is None else kind.dtype.names or ()
    return next((f for f in ("TimeUS", "TimeMS") if f in names), None)


def _stamps(content: NDArray[Any], kind: Kind) -> Array:
    name = _stamp_field(kind)
    assert name is not None
    return np.asarray(content[name], float) / (1e6 if name == "TimeUS" else 1e3)


def _times(content: NDArray[Any], kind: Kind, offsets: NDArray[np.int64], clock: _Clock) -> Array:
    """Boot times [s]; a message without a stamp is as old as the message before it."""
    if _stamp_field(kind) is not None:
        return _stamps(content, kind)
    before = np.searchsorted(clock.offsets, offsets) - 1
    if not len(clock.t_s):
        return np.full(len(offsets), np.nan)
    return np.where(before >= 0, clock.t_s[np.maximum(before, 0)], np.nan)


def _time_before(clock: _Clock, offset: int) -> float:
    """Time of a place in the file: median of some messages before it."""
    i = int(np.searchsorted(clock.offsets, offset))
    return float(np.median(clock.t_s[max(i - _MIDDLE_OF, 0) : i])) if i else math.inf


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


def _add_parameters(out: dict[str, float], content: NDArray[Any]) -> None:
    if _kind_of(content, "Name") not in _TEXT or _kind_of(content, "Value") not in _NUMBER:
        return
    for name, value in zip(content["Name"], content["Value"].tolist(), strict=True):
        if math.isfinite(value):
            out[_text(name)] = float(value)


def _text(raw: bytes) -> str:
    return bytes(raw).split(b"\0")[0].decode("utf-8", "replace")
