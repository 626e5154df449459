"""Reads an ArduPilot dataflash log (.BIN) into columns: A3 95, the type of a message, its fields as declared by FMT.

There is no checksum: a message is one where its first bytes and its type are right. Formats of fields: pymavlink's
DFReader. Units of fields: FMTU, UNIT and MULT, where the log has them. Times: TimeUS, in old logs TimeMS; where no
message has such, the time of GPS, between in the order of the file. A log as text is read through text_dataflash.py.
"""

from __future__ import annotations

import functools
import itertools
import math
from array import array
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from pymavlink.DFReader import FORMAT_TO_STRUCT

from companion.mavlink.wire_frames import Content
from models.common.frames import Array, Whole
from replay.logs.columns import Messages, believable
from replay.logs.files import HEAD_BYTES, check_head, is_text_dataflash, read_file
from replay.logs.parameters import Row
from replay.logs.text_dataflash import binary_of_text
from replay.spill import AT_ONCE, Spool, blocks, picked, release, spans, spilled

IMUS = ("IMU", "IMU2", "IMU3")
EKF = ("XKF1", "NKF1", "EKF1")
"""Filter output, newest name first: EKF3, EKF2, and EKF1 of old logs."""
ESCS = ("ESC", *(f"ESC{i}" for i in range(1, 33)))
_STAMPED = (
    "ATT",
    "XKQ",
    "NKQ",
    *IMUS,
    *EKF,
    "RCOU",
    "BAT",
    "CURR",
    "BARO",
    "RFND",
    *ESCS,
    "RPM",
    "MODE",
    "EV",
    "ARM",
    "CTUN",
    "VIBE",
)
"""Messages whose stamps are boot times. GPS messages reuse TimeMS for the time of week."""
_HEAD = b"\xa3\x95"
_FMT = 128
_FMT_TYPE = np.dtype(
    [
        ("head", "V3"),
        ("type", "u1"),
        ("length", "u1"),
        ("name", "S4"),
        ("format", "S16"),
        ("columns", "S64"),
    ]
)
_SHORTEST = 3
"""Bytes of a message without fields."""
_TIMES = ("TimeUS", "TimeMS")
_GPS = ("GPS", "GPS2")
"""Their TimeMS counts from the start of the week."""
_GPS_TIMES = ("T", "TimeMS", "Time")
_LASTING = ("FMT", "FMTU", "UNIT", "MULT", "PARM")
"""What is said once, at the start of a log."""
_FACTORS = {"deg/s": math.radians(1.0), "rad": math.degrees(1.0)}
"""From a unit of UNIT.Label to that of ArduPilot's own messages, where these have another: rad/s, deg."""
_BACK_S = 1.0
"""Stamps that go back by more are of another boot."""
_DECIDING = 5
"""So many stamps after a step back say whether it lasts."""
_TEXT_FORMATS = "nNZ"
_TEXT = ("S", "V")
_NUMBER = ("f", "i", "u")
"""numpy's letters for a field that holds text, and for one that holds numbers."""


@dataclass(frozen=True, eq=False, kw_only=True)
class MessageFormat:
    """One declared message: its type, its name, its bytes, and its fields with what they are divided by."""

    number: int
    name: str
    length: int
    fields: tuple[str, ...] = ()
    dtype: np.dtype[Any] | None
    """Of the declared fields; None where one has no known format, or two have the same name."""
    divisors: Mapping[str, float]

    @property
    def readable(self) -> bool:
        """Whether the declared fields make up the declared length."""
        return self.dtype is not None and self.dtype.itemsize == self.length

    @property
    def stamp(self) -> str | None:
        """The field with its boot time."""
        times = _TIMES[:1] if self.name in _GPS else _TIMES
        return next((field for field in times if field in self.fields), None)

    def fits(self, data: Content, i: int) -> bool:
        """Whether another message, or the end, follows one of this length at ``i``."""
        end = i + self.length
        return end == len(data) or data[end : end + len(_HEAD)] == _HEAD


@functools.cache
def _declared(message: bytes) -> MessageFormat:
    """What a FMT message declares; the same bytes declare the same."""
    declared = np.frombuffer(message, _FMT_TYPE)[0]
    formats = _ascii(declared["format"])
    columns = _ascii(declared["columns"])
    fields: tuple[str, ...] = ()
    if columns:
        fields = tuple(columns.split(","))
    dtype = None
    divisors = {}
    a_format_each = len(set(fields)) == len(fields) == len(formats)
    if a_format_each and all(format_ in FORMAT_TO_STRUCT for format_ in formats):
        types = [("head", "V3")]
        for field, format_ in zip(fields, formats, strict=True):
            code, multiplier, _ = FORMAT_TO_STRUCT[format_]
            types.append((field, _numpy(format_, code)))
            if multiplier is not None:
                divisors[field] = 1.0 / multiplier
        dtype = np.dtype(types)
    return MessageFormat(
        number=int(declared["type"]),
        name=_ascii(declared["name"]),
        length=int(declared["length"]),
        fields=fields,
        dtype=dtype,
        divisors=divisors,
    )


@functools.cache
def _summed(declared: MessageFormat) -> MessageFormat | None:
    """The same with the length that its fields make up, where this is another."""
    if declared.dtype is None or declared.readable:
        return None
    return replace(declared, length=declared.dtype.itemsize)


def _ascii(raw: bytes) -> str:
    return raw.decode("ascii", "replace")


def _numpy(format_: str, code: str) -> str:
    """numpy's type of a field; ``code``: that of ``struct``."""
    if not code.endswith("s"):
        return f"<{np.dtype(code).str[1:]}"
    letter = "S" if format_ in _TEXT_FORMATS else "V"
    return letter + code[:-1]


@dataclass(frozen=True, eq=False)
class _Records:
    """Messages of one declaration in the order of the file: their offsets (n,) and contents (n,)."""

    kind: MessageFormat
    offsets: Whole
    content: NDArray[Any]

    def letter(self, field: str) -> str:
        """numpy's letter for what a field holds; "" where there is none of that name, as in a damaged declaration."""
        if field in (self.content.dtype.names or ()):
            return self.content.dtype[field].kind
        return ""

    def has(self, *fields: str) -> bool:
        """Whether all of them are declared."""
        return set(fields) <= set(self.kind.fields)

    def texts(self, field: str) -> list[str]:
        """A field as text (n,)."""
        return [_text(raw) for raw in self.content[field]]

    def stamps(self) -> Array:
        """Times [s] (n,) of a kind that has such."""
        per_second = 1e6 if self.kind.stamp == "TimeUS" else 1e3
        return np.asarray(self.content[self.kind.stamp], float) / per_second


@dataclass(frozen=True, kw_only=True)
class Dataflash:
    """What a boot held, by message name; columns are made when they are asked for."""

    path: Path
    boot: int
    size: int
    """Bytes of the file."""
    data: Content
    """All of the log as a .BIN holds it."""
    places: Mapping[MessageFormat, Whole]
    """Offsets of the messages of every declaration, in the order of the file."""
    notes: tuple[str, ...]
    """What was skipped, or read in another way than declared."""

    def of(self, name: str) -> Messages:
        """All messages of a name; none where there are none. A field that a declaration lacks is NaN."""
        parts = []
        offsets = [np.empty(0, np.int64)]
        for records in self._records(name):
            parts.append(self._messages(records))
            offsets.append(records.offsets)
        if len(parts) == 1:
            return parts[0]
        columns: dict[str, NDArray[Any]] = {}
        for field in dict.fromkeys(itertools.chain(*(part.data for part in parts))):
            columns[field] = np.concatenate([part.column(field) for part in parts])
        t_s = np.concatenate([np.empty(0), *(part.t_s for part in parts)])
        in_file = np.argsort(np.concatenate(offsets))
        return Messages(name, t_s, columns).where(in_file)

    def texts(self) -> Iterator[tuple[float, str]]:
        """MSG: time [s], text."""
        for records in self._records("MSG"):
            if records.letter("Message") in _TEXT:
                times = self._times(records).tolist()
                yield from zip(times, records.texts("Message"), strict=True)

    def parameters(self) -> list[Row]:
        """PARM in the order of the file: time [s] (before all others where it is unknown), name, value."""
        found: list[tuple[int, Row]] = []
        for records in self._records("PARM"):
            if records.letter("Name") not in _TEXT or records.letter("Value") not in _NUMBER:
                continue
            times = np.nan_to_num(self._times(records), nan=-math.inf).tolist()
            with np.errstate(invalid="ignore"):  # damage may make a NaN of the kind that signals
                values = records.content["Value"].astype(float).tolist()
            rows = zip(times, records.texts("Name"), values, strict=True)
            found += zip(records.offsets.tolist(), rows, strict=True)
        return [row for _, row in sorted(found) if math.isfinite(row[2])]

    def _records(self, *names: str) -> Iterator[_Records]:
        """Of every declaration of these names what can be read."""
        data = np.frombuffer(self.data, np.uint8)
        for kind, offsets in self.places.items():
            if kind.dtype is not None and kind.readable and kind.name in names and len(offsets):
                messages = sliding_window_view(data, kind.length)
                raw = Spool(np.uint8, (kind.length,))
                for rows in spans(offsets, AT_ONCE):
                    raw.append(messages[offsets[rows]])
                yield _Records(kind, offsets, raw.array().view(kind.dtype).reshape(-1))

    def _messages(self, records: _Records) -> Messages:
        """Numbers as they are meant; text is left out."""
        kind = records.kind
        factors = self._factors(kind)
        numbers: dict[str, NDArray[Any]] = {}
        for name in records.content.dtype.names or ():
            if records.letter(name) not in _TEXT:
                divisor = kind.divisors.get(name, 1.0)
                factor = factors.get(name, 1.0)
                numbers[name] = _scaled(records.content[name], divisor, factor)
        return Messages(kind.name, believable(self._times(records)), numbers)

    def _factors(self, kind: MessageFormat) -> dict[str, float]:
        """By field: what FMTU, UNIT and MULT declare that a value is to be multiplied by.

        A format with a divisor of its own needs no multiplier. Times are read as microseconds, whatever is declared.
        """
        out = {}
        units, signs = self._declared_units.get((kind.number, len(kind.fields)), ("", ""))
        every_sign = signs.ljust(len(units), "-")
        for field, unit, sign in zip(kind.fields, units, every_sign, strict=False):
            factor = _FACTORS.get(self._units.get(unit, ""), 1.0)
            multiplier = self._multipliers.get(sign, 0.0)
            if multiplier > 0.0 and field not in kind.divisors:
                factor *= multiplier
            if factor != 1.0 and field not in _TIMES:
                out[field] = factor
        return out

    @functools.cached_property
    def _declared_units(self) -> dict[tuple[int, int], tuple[str, str]]:
        """FMTU by type and number of fields: their units and multipliers, a character each."""
        out = {}
        for records in self._records("FMTU"):
            if records.has("FmtType", "UnitIds", "MultIds"):
                types = records.content["FmtType"].tolist()
                units = records.texts("UnitIds")
                signs = records.texts("MultIds")
                for number, unit, sign in zip(types, units, signs, strict=True):
                    out[number, len(unit)] = (unit, sign)
        return out

    @functools.cached_property
    def _units(self) -> dict[str, str]:
        """UNIT: label of a unit by its character."""
        return {sign: _text(label) for sign, label in self._by_character("UNIT", "Label")}

    @functools.cached_property
    def _multipliers(self) -> dict[str, float]:
        """MULT: multiplier by its character."""
        return {sign: float(number) for sign, number in self._by_character("MULT", "Mult")}

    def _by_character(self, name: str, value: str) -> Iterator[tuple[str, Any]]:
        """``Id`` as a character, and a value."""
        for records in self._records(name):
            if records.has("Id", value):
                for row in records.content:
                    yield chr(int(row["Id"])), row[value]

    def _times(self, records: _Records) -> Array:
        """Boot times [s] (n,); a message without a stamp is as old as the message before it."""
        if records.kind.stamp:
            return records.stamps()
        place, t_s = self._clock
        if len(place):
            before = np.searchsorted(place, records.offsets)
            return np.concatenate([[np.nan], t_s])[before]
        place, t_s = self._gps_clock
        if len(place):
            return np.interp(records.offsets, place, t_s)
        return np.full(len(records.offsets), np.nan)

    @property
    def clock(self) -> str:
        """Where the times are from."""
        if len(self._clock[0]):
            return "TimeUS or TimeMS of the messages"
        if len(self._gps_clock[0]):
            return "time of GPS, between in the order of the file"
        return "none"

    @functools.cached_property
    def _clock(self) -> tuple[Whole, Array]:
        """Offsets (m,) of the messages with a stamp, in file order, and their times (m,) [s]."""
        places = [np.empty(0, np.int64)]
        times = [np.empty(0)]
        for records in self._records(*_STAMPED):
            if records.kind.stamp:
                places.append(records.offsets)
                times.append(records.stamps())
        place = np.concatenate(places)
        order = np.argsort(place)
        return picked(place, order), picked(np.concatenate(times), order)

    @functools.cached_property
    def _gps_clock(self) -> tuple[Whole, Array]:
        """Offsets (m,) of GPS messages, and their times (m,) [s] since the first: the only clock of ArduCopter to 3.1.

        T is the time since boot. TimeMS and Time are the time of the week.
        """
        for records in self._records(*_GPS):
            offsets = records.offsets
            field = next((name for name in _GPS_TIMES if records.has(name)), None)
            if field is None:
                t_s = np.zeros(len(offsets))
            else:
                t_s = np.asarray(records.content[field], float) / 1e3
            newest = np.maximum.accumulate(np.concatenate([[0.0], believable(t_s)]))
            grown = np.flatnonzero(t_s > newest[:-1])
            if len(grown) > 1:
                return offsets[grown], t_s[grown] - t_s[grown[0]]
        return np.empty(0, np.int64), np.empty(0)

    def starts(self) -> list[Dataflash]:
        """The same, split where the clock starts anew: a reboot in flight that went on in the same log."""
        place, t_s = self._clock
        good = np.isfinite(believable(t_s))
        place = picked(place, good)
        t_s = picked(t_s, good)
        if not len(place):
            return [self]
        following = np.pad(t_s[1:], (0, _DECIDING), constant_values=-1.0)
        highest_next = sliding_window_view(following, _DECIDING)[: len(t_s) - 1].max(axis=1)
        cuts = place[1:][t_s[:-1] - highest_next > _BACK_S].tolist()
        if not cuts:
            return [self]
        ends = itertools.pairwise([0, *cuts, len(self.data)])
        return [self._part(first, end) for first, end in ends]

    def _part(self, first: int, end: int) -> Dataflash:
        """The messages of first <= offset < ``end``, with what was declared and set before."""
        own = {}
        for kind, offsets in self.places.items():
            since = 0 if kind.name in _LASTING else first
            begins, ends = offsets.searchsorted((since, end))
            own[kind] = offsets[begins:ends]
        return replace(self, places=own)


def read_boots(path: Path) -> list[Dataflash]:
    """The boots in the file: more than one where logs were joined, or the autopilot started anew in the midst of one.

    Raises LogError where it cannot be read.
    """
    data = raw = read_file(path)
    notes: list[str] = []
    if is_text_dataflash(raw):
        data, notes = binary_of_text(path, raw[:])
    check_head(path, data[:HEAD_BYTES], _HEAD, "ArduPilot dataflash log")
    walk = _Walk(data)
    notes += walk.notes()
    parts: list[Dataflash] = []
    for boot in walk.boots:
        if boot:
            places = {}
            for kind, offsets in boot.items():
                places[kind] = spilled(np.frombuffer(offsets, np.int64))
            log = Dataflash(
                path=path, boot=0, size=len(raw), data=data, places=places, notes=tuple(notes)
            )
            parts += log.starts()
    return [replace(part, boot=number) for number, part in enumerate(parts)]


class _Walk:
    """One pass over a log: of every boot the offsets of its messages, and what could not be read.

    Messages keep the declaration before them; a log begins where FMT declares itself. A declaration that comes a second
    time, or does not add up, is believed where the messages after it have its length.
    """

    def __init__(self, data: Content) -> None:
        self._data = data
        self._fmt = MessageFormat(
            number=_FMT, name="FMT", length=_FMT_TYPE.itemsize, dtype=_FMT_TYPE, divisors={}
        )
        self._kinds: list[MessageFormat | None] = [None] * 256
        self._kinds[_FMT] = self._fmt
        self._doubted: dict[int, list[MessageFormat]] = {}
        """By type: what its messages may be, until one of them decides."""
        self._skipped = 0
        self._undeclared: Counter[int] = Counter()
        self._anew: dict[str, str] = {}
        boot: dict[MessageFormat, array[int]] = {}
        self.boots = [boot]
        n = len(data)
        i = 0
        looked_through = AT_ONCE
        kinds = self._kinds
        doubted = self._doubted
        while i + _SHORTEST <= n:
            if data[i] == _HEAD[0] and data[i + 1] == _HEAD[1]:
                kind = kinds[data[i + 2]]
            else:
                kind = None
            if kind is None:
                i = self._resume(i)
                continue
            if doubted and kind.number in doubted:
                kind = self._decided(kind, i)
            if i + kind.length > n:
                break
            if kind is self._fmt:
                new = _declared(data[i : i + kind.length])
                if new.number == _FMT:
                    self.boots.append(boot := {})
                else:
                    self._declare(new)
            places = boot.get(kind)
            if places is None:
                places = boot[kind] = array("q")
            places.append(i)
            i += kind.length
            if i >= looked_through:
                looked_through = i + AT_ONCE
                release()
        self._rest = n - i

    def _declare(self, new: MessageFormat) -> None:
        """From here on; the messages that follow decide where there is a choice."""
        before = self._kinds[new.number]
        if before is new or new.number == _FMT:
            return
        possible = []
        for kind in (new, _summed(new), before):
            if kind is not None and kind.length >= _SHORTEST:
                possible.append(kind)
        if possible:
            self._kinds[new.number] = possible[0]
        if len(possible) > 1:
            self._doubted[new.number] = possible

    def _decided(self, declared: MessageFormat, i: int) -> MessageFormat:
        """The first declaration whose length the message at ``i`` has; the newest where none has."""
        possible = self._doubted.pop(declared.number)
        kind = next((kind for kind in possible if kind.fits(self._data, i)), declared)
        before = possible[-1]
        if before.fields != kind.fields and before.name == kind.name:
            gone = [field for field in before.fields if field not in kind.fields]
            self._anew[kind.name] = f", without {', '.join(gone)}" if gone else ""
        self._kinds[kind.number] = kind
        return kind

    def _resume(self, i: int) -> int:
        """Place of the next message of a declared type that another follows, or of one more of an undeclared type."""
        data = self._data
        if data[i : i + len(_HEAD)] == _HEAD:
            self._undeclared[data[i + 2]] += 1
        at = i + 1
        while (at := data.find(_HEAD, at)) >= 0 and at + 2 < len(data):
            number = data[at + 2]
            kind = self._kinds[number]
            if kind is None:
                found = number in self._undeclared
            else:
                found = number in self._doubted or kind.fits(data, at)
            if found:
                break
            at += 1
        else:
            at = len(data)
        self._skipped += at - i
        return at

    def notes(self) -> list[str]:
        """What a reader should know, in words."""
        out = []
        unreadable: Counter[str] = Counter()
        for boot in self.boots:
            for kind, places in boot.items():
                if not kind.readable:
                    unreadable[kind.name] += len(places)
        for name, count in unreadable.items():
            out.append(f"{count} messages {name} not read: their FMT does not add up")
        # One alone is damage, and among the bytes that are skipped.
        undeclared = {number: count for number, count in self._undeclared.items() if count > 1}
        if undeclared:
            types = ", ".join(map(str, sorted(undeclared)))
            out.append(
                f"{sum(undeclared.values())} messages not read: no FMT declares their type "
                f"({types})"
            )
        for name, gone in self._anew.items():
            out.append(f"{name} is declared anew in the midst of the log{gone}")
        if self._skipped:
            out.append(f"{self._skipped} bytes that are no message skipped")
        if self._rest > 0:
            out.append(f"last message cut off ({self._rest} bytes)")
        return out


def _scaled(values: NDArray[Any], divisor: float, factor: float) -> NDArray[Any]:
    """Values (n,) as they are meant."""
    if divisor == factor == 1.0:
        return spilled(values)
    out = Spool(np.result_type(values.dtype, 1.0))
    for rows in blocks(len(values)):
        out.append(values[rows] / divisor * factor)
    return out.array()


def _text(raw: bytes) -> str:
    return bytes(raw).split(b"\0")[0].decode("utf-8", "replace")
