"""Reads an ArduPilot dataflash log (.BIN) into columns: A3 95, the type of a message, its fields as declared by FMT.

There is no checksum: a message is one where its first bytes and its type are right. Formats of fields: pymavlink's
DFReader. Times: TimeUS, in old logs TimeMS.
"""

from __future__ import annotations

import functools
import math
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from pymavlink.DFReader import FORMAT_TO_STRUCT

from models.frames import Array
from replay.logs.columns import Messages, believable
from replay.logs.files import read_file
from replay.logs.parameters import Row

IMUS = ("IMU", "IMU2", "IMU3")
EKF = ("XKF1", "NKF1", "EKF1")
"""Filter output, newest name first: EKF3, EKF2, and EKF1 of old logs."""
ESCS = ("ESC", *(f"ESC{i}" for i in range(1, 33)))
_STAMPED = (
    "ATT", "XKQ", "NKQ", *IMUS, *EKF, "RCOU", "BAT", "CURR", "BARO", "RFND", *ESCS, "RPM", "MODE", "EV",
    "ARM", "CTUN", "VIBE",
)  # fmt: skip
"""Messages whose stamps are boot times. GPS messages reuse TimeMS for the time of week."""
_HEAD = b"\xa3\x95"
_FMT = 128
_FMT_TYPE = np.dtype(
    [("head", "V3"), ("type", "u1"), ("length", "u1"), ("name", "S4"), ("format", "S16"), ("columns", "S64")]
)
_TEXT_FORMATS = "nNZ"
_TEXT = ("S", "V")
"""numpy's letters for a field that holds text."""


@dataclass(frozen=True, eq=False)
class MessageFormat:
    """One declared message: its type, its name, its bytes, and its fields with what they are divided by."""

    number: int
    name: str
    length: int
    dtype: np.dtype[Any] | None
    """None where the declared fields do not make up the declared length."""
    divisors: Mapping[str, float]

    @property
    def stamp(self) -> str | None:
        """The field with its time."""
        names = () if self.dtype is None else self.dtype.names or ()
        return next((f for f in ("TimeUS", "TimeMS") if f in names), None)


@functools.cache
def _declared(message: bytes) -> MessageFormat:
    """What a FMT message declares; the same bytes declare the same."""
    declared = np.frombuffer(message, _FMT_TYPE)[0]
    name, formats, columns = (declared[k].decode("ascii", "replace") for k in ("name", "format", "columns"))
    pairs = list(zip(columns.split(","), formats, strict=False))
    length = int(declared["length"])
    known = all(c in FORMAT_TO_STRUCT for _, c in pairs) and len({f for f, _ in pairs}) == len(pairs)
    dtype = np.dtype([("head", "V3"), *((f, _numpy(c)) for f, c in pairs)]) if known else None
    return MessageFormat(
        int(declared["type"]),
        name,
        length,
        dtype if dtype is not None and dtype.itemsize == length else None,
        {f: 1.0 / FORMAT_TO_STRUCT[c][1] for f, c in pairs if known and FORMAT_TO_STRUCT[c][1] is not None},
    )


def _numpy(format_: str) -> str:
    code: str = FORMAT_TO_STRUCT[format_][0]
    if code.endswith("s"):
        return ("S" if format_ in _TEXT_FORMATS else "V") + code[:-1]
    return f"<{np.dtype(code).str[1:]}"


@dataclass(frozen=True)
class Dataflash:
    """What a boot held, by message name; columns are made when they are asked for."""

    path: Path
    boot: int
    data: bytes
    """All of the file."""
    places: Mapping[MessageFormat, array[int]]
    """Offsets of the messages of every declaration."""
    notes: Sequence[str]
    """What was skipped."""

    def of(self, name: str) -> Messages:
        """All messages of a name; none where there are none. A field that a declaration lacks is NaN."""
        parts = [self._messages(kind, offsets, content) for kind, offsets, content in self._records(name)]
        if len(parts) == 1:
            return parts[0]
        fields = dict.fromkeys(f for part in parts for f in part.data)
        t_s = np.concatenate([np.empty(0), *(part.t_s for part in parts)])
        return Messages(name, t_s, {f: np.concatenate([part.column(f) for part in parts]) for f in fields})

    def texts(self) -> Iterator[tuple[float, str]]:
        """MSG: time [s], text."""
        for kind, offsets, content in self._records("MSG"):
            if _letter(content, "Message") in _TEXT:
                times = self._times(kind, offsets, content)
                yield from zip(times.tolist(), map(_text, content["Message"]), strict=True)

    def parameters(self) -> list[Row]:
        """PARM in the order of the file: time [s] (before all others where it is unknown), name, value."""
        found: list[tuple[int, Row]] = []
        for kind, offsets, content in self._records("PARM"):
            if _letter(content, "Name") not in _TEXT or _letter(content, "Value") not in ("f", "i", "u"):
                continue
            times = np.nan_to_num(self._times(kind, offsets, content), nan=-math.inf)
            names = map(_text, content["Name"])
            values = content["Value"].astype(float)
            rows = zip(times.tolist(), names, values.tolist(), strict=True)
            found += [(offset, row) for offset, row in zip(offsets.tolist(), rows, strict=True)]
        return [row for _, row in sorted(found) if math.isfinite(row[2])]

    def _records(self, *names: str) -> Iterator[tuple[MessageFormat, NDArray[np.int64], NDArray[Any]]]:
        """Of every declaration of these names: offsets (n,) of its messages, and their fields (n,)."""
        data = np.frombuffer(self.data, np.uint8)
        for kind, places in self.places.items():
            if kind.dtype is not None and kind.name in names:
                offsets = np.frombuffer(places, np.int64)
                raw = np.ascontiguousarray(sliding_window_view(data, kind.length)[offsets])
                yield kind, offsets, raw.view(kind.dtype).reshape(-1)

    def _messages(self, kind: MessageFormat, offsets: NDArray[np.int64], content: NDArray[Any]) -> Messages:
        """Numbers as they are meant; text is left out."""
        numbers = {
            name: content[name] / kind.divisors[name] if name in kind.divisors else content[name]
            for name in content.dtype.names or ()
            if _letter(content, name) not in _TEXT
        }
        return Messages(kind.name, believable(self._times(kind, offsets, content)), numbers)

    def _times(self, kind: MessageFormat, offsets: NDArray[np.int64], content: NDArray[Any]) -> Array:
        """Boot times [s] (n,); a message without a stamp is as old as the message before it."""
        if kind.stamp:
            return _stamps(kind, content)
        place, t_s = self._clock
        return np.concatenate([[np.nan], t_s])[np.searchsorted(place, offsets)]

    @functools.cached_property
    def _clock(self) -> tuple[NDArray[np.int64], Array]:
        """Offsets (m,) of the messages with a stamp, in file order, and their times (m,) [s]."""
        stamped = [(offsets, _stamps(kind, c)) for kind, offsets, c in self._records(*_STAMPED) if kind.stamp]
        place = np.concatenate([np.empty(0, np.int64), *(offsets for offsets, _ in stamped)])
        order = np.argsort(place)
        return place[order], np.concatenate([np.empty(0), *(t_s for _, t_s in stamped)])[order]


def read_boots(path: Path) -> list[Dataflash]:
    """The boots in the file: more than one where logs were joined. Raises LogError where it cannot be read."""
    data = read_file(path, _HEAD, "ArduPilot dataflash log")
    boots, skipped, rest = _walk(data)
    notes = [f"{skipped} bytes that are no message skipped"] if skipped else []
    notes += [f"last message cut off ({len(data) - rest} bytes)"] if rest < len(data) else []
    return [Dataflash(path, number, data, found, notes) for number, found in enumerate(boots)]


def _walk(data: bytes) -> tuple[list[dict[MessageFormat, array[int]]], int, int]:
    """Of every boot the offsets of its messages; bytes between messages; where a last message begins that is not
    complete. Messages keep the declaration before them; a log begins where FMT declares itself."""
    kinds: list[MessageFormat | None] = [None] * 256
    kinds[_FMT] = fmt = MessageFormat(_FMT, "FMT", _FMT_TYPE.itemsize, _FMT_TYPE, {})
    boot: dict[MessageFormat, array[int]] = {}
    boots = [boot]
    n, i, skipped = len(data), 0, 0
    while i + 3 <= n:
        kind = kinds[data[i + 2]] if data[i] == _HEAD[0] and data[i + 1] == _HEAD[1] else None
        if kind is None:
            found = _next(data, i + 1, kinds)
            skipped += found - i
            i = found
            continue
        if i + kind.length > n:
            break
        if kind is fmt:
            new = _declared(data[i : i + kind.length])
            if new.number == _FMT:
                boots.append(boot := {})
            elif new.length > len(_HEAD):
                kinds[new.number] = new
        places = boot.get(kind)
        if places is None:
            places = boot[kind] = array("q")
        places.append(i)
        i += kind.length
    return [found for found in boots if found], skipped, i


def _next(data: bytes, i: int, kinds: Sequence[MessageFormat | None]) -> int:
    """Place of the next first bytes of a declared message, or the end."""
    while (i := data.find(_HEAD, i)) >= 0 and i + 2 < len(data):
        if kinds[data[i + 2]] is not None:
            return i
        i += 1
    return len(data)


def _stamps(kind: MessageFormat, content: NDArray[Any]) -> Array:
    """Times [s] (n,) of a kind that has such."""
    return np.asarray(content[kind.stamp], float) / (1e6 if kind.stamp == "TimeUS" else 1e3)


def _letter(content: NDArray[Any], field: str) -> str:
    """numpy's letter for what a field holds; "" where there is none of that name, as in a damaged declaration."""
    return content.dtype[field].kind if field in (content.dtype.names or ()) else ""


def _text(raw: bytes) -> str:
    return bytes(raw).split(b"\0")[0].decode("utf-8", "replace")
