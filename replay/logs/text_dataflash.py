"""An ArduPilot dataflash log as text (Mission Planner's .log), turned into the bytes of a .BIN.

A line is a message: its name, then its fields as its FMT line declares them. Values stand as people read them: what a
.BIN holds in hundredths is written with two decimals. A line that does not fit its FMT line is left out and counted.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pymavlink.DFReader import FORMAT_TO_STRUCT

from companion.mavlink.dialect import mavlink
from models.common.errors import LogError

_HEAD = b"\xa3\x95"
_FMT = 128
_TYPES = 256
_NAME_BYTES = 4
_FORMAT_BYTES = 16
_COLUMNS_BYTES = 64
"""Of the texts of a FMT message."""
_FIELDS_OF_FMT = 4
"""Type, length, name and format; what follows is all columns."""
_MODES = {
    entry.name.removeprefix("COPTER_MODE").replace("_", ""): number
    for number, entry in mavlink.enums["COPTER_MODE"].items()
}
_SHOWN = 4
"""Names of messages that are told."""


@dataclass(frozen=True)
class _Line:
    """What a FMT line declares: how its lines become bytes."""

    head: bytes
    layout: struct.Struct
    values: tuple[Callable[[str], object], ...]

    def packed(self, fields: list[str]) -> bytes:
        """The message; raises ValueError, TypeError or struct.error where a field does not fit."""
        values = [value(field) for value, field in zip(self.values, fields, strict=True)]
        return self.head + self.layout.pack(*values)


def binary_of_text(path: Path, data: bytes) -> tuple[bytes, list[str]]:
    """The log as a .BIN holds it, and what a reader should know. Raises LogError where no line fits its FMT line."""
    text = data.decode("utf-8-sig", "replace")
    # Where a comma is the decimal point, fields are told apart by the space, or by semicolons.
    separator = next((s for s in (", ", ";", ",") if f"FMT{s}" in text), ",")
    declared: dict[str, _Line] = {}
    numbers: dict[int, str] = {}
    unfit: Counter[str] = Counter()
    unknown: Counter[str] = Counter()
    out = bytearray()
    read = 0
    for line in text.splitlines():
        name, _, rest = line.strip().partition(separator)
        name = name.strip()
        if name == "FMT":
            out += _declare(rest, separator, declared, numbers)
            continue
        kind = declared.get(name)
        if kind is None:
            if rest and name.isalnum() and name.isupper():
                unknown[name] += 1
            continue
        fields = rest.split(separator, len(kind.values) - 1) if kind.values else []
        try:
            out += kind.packed(fields)
        except (ValueError, TypeError, struct.error):
            unfit[name] += 1
            continue
        read += 1
    if not read:
        raise LogError(
            f"{path}: is a dataflash log as text, but no line fits its FMT line: give the .BIN"
        )
    notes = _notes(unfit, "do not fit their FMT line") + _notes(unknown, "have no FMT line")
    return bytes(out), notes


def _notes(lines: Counter[str], why: str) -> list[str]:
    if not lines:
        return []
    names = ", ".join(name for name, _ in lines.most_common(_SHOWN))
    return [f"{lines.total()} lines not read: they {why} ({names})"]


def _declare(
    rest: str, separator: str, declared: dict[str, _Line], numbers: dict[int, str]
) -> bytes:
    """Learns a FMT line; returns it as a FMT message, or nothing where it cannot be understood."""
    parts = [part.strip() for part in rest.split(separator, _FIELDS_OF_FMT)]
    if len(parts) < _FIELDS_OF_FMT or not parts[0].isdigit():
        return b""
    name = parts[2]
    formats = parts[3]
    names = "".join(parts[_FIELDS_OF_FMT:]).replace(";", ",").split(",")
    columns = ",".join(map(str.strip, names))
    if name == "FMT":
        declared.clear()
        numbers.clear()
        return _fmt_message(_FMT, 89, name, "BBnNZ", "Type,Length,Name,Format,Columns")
    fits = (
        len(name) <= _NAME_BYTES
        and len(formats) <= _FORMAT_BYTES
        and len(columns) <= _COLUMNS_BYTES
    )
    if not fits or not all(f in FORMAT_TO_STRUCT for f in formats):
        return b""
    number = int(parts[0]) % _TYPES
    if number == _FMT or numbers.get(number, name) != name:
        number = next(n for n in range(1, _TYPES) if n != _FMT and n not in numbers)
    numbers[number] = name
    codes = [FORMAT_TO_STRUCT[format_][0] for format_ in formats]
    layout = struct.Struct("<" + "".join(codes))
    head = _HEAD + bytes([number])
    declared[name] = _Line(head, layout, tuple(map(_value, formats)))
    return _fmt_message(number, len(head) + layout.size, name, formats, columns.strip(","))


def _fmt_message(number: int, length: int, name: str, formats: str, columns: str) -> bytes:
    texts = [text.encode("ascii", "replace") for text in (name, formats, columns)]
    return _HEAD + bytes([_FMT]) + struct.pack("<BB4s16s64s", number, length, *texts)


def _value(format_: str) -> Callable[[str], object]:
    """From a field of a line to what struct packs."""
    code, scale, _ = FORMAT_TO_STRUCT[format_]
    if format_ == "M":
        return _mode
    if code.endswith("s"):
        return lambda field: field.strip().encode("utf-8", "replace")
    if code in "fde":
        return _number
    if scale is None:
        return _whole
    return lambda field: round(_number(field) / scale)


def _number(field: str) -> float:
    return float(field.replace(",", "."))


def _whole(field: str) -> int:
    # Beyond 2**53 a float would lose digits.
    if "." not in field and "," not in field:
        return int(field)
    return round(_number(field))


def _mode(field: str) -> int:
    """A flight mode is written by its number or by its name."""
    name = "".join(letter for letter in field.upper() if letter.isalnum())
    if name in _MODES:
        return int(_MODES[name])
    return _whole(field)
