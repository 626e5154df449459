"""What one message looks like on the wire: its fields, their units, and the builder of its sample."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.mavlink.boot_clock import Stamp
from companion.mavlink.dialect import ID_OF, MESSAGES
from companion.mavlink.samples import Quaternion, Sample
from models.common.frames import GRAVITY

NAN = math.nan


@dataclass(frozen=True, slots=True)
class WireFormat:
    """``places`` says which part of the flat tuple of a message's fields each field is."""

    places: dict[str, slice]
    dtype: np.dtype[Any]
    """Packed structured type, fields in wire order under their own names; text is bytes."""


@lru_cache(maxsize=512)
def wire_format(message_id: int) -> WireFormat:
    """The layout of a message's payload, extension fields included. KeyError where the dialect has no such message."""
    kind = MESSAGES[message_id]
    places: dict[str, slice] = {}
    types: list[Any] = []
    at = 0
    # Repeat and code of every field of a struct format such as "<IHH4f16sB"; numpy has the same codes.
    codes = re.findall(r"(\d*)([a-zA-Z])", kind.unpacker.format)
    for name, (repeat, code) in zip(kind.ordered_fieldnames, codes, strict=True):
        if code == "s":
            width = 1
        else:
            width = int(repeat or 1)
        places[name] = slice(at, at + width)
        at += width
        types.append((name, f"S{repeat}" if code == "s" else f"{repeat}<{code}"))
    return WireFormat(places, np.dtype(types))


PER_SI = {
    "": 1.0, "rad": 1.0, "rad/s": 1.0, "m": 1.0, "m/s": 1.0, "m/s/s": 1.0, "degC": 1.0, "us": 1.0,
    "rpm": 1.0, "deg": math.degrees(1.0), "cm": 100.0, "cm^2": 1e4, "mV": 1000.0, "cA": 100.0,
    "cdegC": 100.0, "hPa": 0.01, "mrad/s": 1000.0, "mG": 1000.0 / GRAVITY,
}  # fmt: skip
"""Wire units in one unit used inside: SI, but for rpm, us of a servo pulse and deg C."""


@dataclass(frozen=True, slots=True)
class SI:
    """Wire fields that make one quantity, in ``PER_SI`` units; |value| > limit is NaN."""

    name: str
    fields: str
    """Names on the wire, with blanks between; an array counts as its elements."""
    unit: str = ""
    limit: float = math.inf
    unknown: tuple[int, ...] = ()

    def reader(self, wire: WireFormat) -> Callable[[tuple[Any, ...]], Any]:
        """A function from one message's unpacked fields to the number, or the tuple of them where there are several.

        Made once: it runs for every message.
        """
        per = PER_SI[self.unit]
        unknown = self.unknown
        # The largest float, so that one comparison also turns inf into NaN; a comparison with NaN is false.
        limit = min(self.limit, sys.float_info.max)
        places = []
        for name in self.fields.split():
            for i in range(*wire.places[name].indices(1 << 16)):
                places.append(i)
        if len(places) == 1:
            (place,) = places
            return lambda fields: (
                v
                if (x := fields[place]) not in unknown and -limit <= (v := x / per) <= limit
                else NAN
            )
        pick = itemgetter(*places)
        return lambda fields: tuple(
            [
                v if x not in unknown and -limit <= (v := x / per) <= limit else NAN
                for x in pick(fields)
            ]
        )

    def column(self, records: NDArray[Any]) -> NDArray[np.float64]:
        """The numbers of many messages, shape (n, k)."""
        raw = np.column_stack([records[name] for name in self.fields.split()])
        with np.errstate(over="ignore", invalid="ignore"):
            out: NDArray[np.float64] = raw.astype(np.float64) / PER_SI[self.unit]
            bad = ~(np.abs(out) <= self.limit)
        if self.unknown:
            bad |= np.isin(raw, self.unknown)
        out[bad] = NAN
        return out


@dataclass(frozen=True, slots=True)
class Raw:
    """Whole numbers or text of one wire field, taken as they are."""

    name: str

    def reader(self, wire: WireFormat) -> Callable[[tuple[Any, ...]], Any]:
        """A function from one message's unpacked fields to the value; arrays are tuples, text ends at a zero."""
        place = wire.places[self.name]
        if wire.dtype[self.name].kind == "S":
            return lambda fields: fields[place.start].split(b"\0", 1)[0].decode("ascii", "replace")
        return itemgetter(place if place.stop - place.start > 1 else place.start)

    def column(self, records: NDArray[Any]) -> NDArray[Any]:
        """The values of many messages, shape (n,) or (n, k)."""
        out: NDArray[Any] = records[self.name]
        return out


Head = tuple[float, int, int]


class Layout:
    """One message: what stamps it, its quantities in the builder's order, and the builder of its sample."""

    def __init__(
        self,
        name: str,
        stamp: Stamp | None,
        build: Callable[..., Sample | None] | None,
        *quantities: SI | Raw,
    ) -> None:
        """``build`` None: no sample is made of it; it is read in logs only."""
        self.id = ID_OF[name]
        self.name = name
        self.stamp = stamp
        self.build = build
        self.quantities = quantities
        self.wire = wire_format(self.id)
        self.readers = [quantity.reader(self.wire) for quantity in quantities]
        """One a quantity, from the unpacked fields."""
        self.stamp_field = "time_boot_ms" if stamp is Stamp.BOOT_MS else "time_usec"
        self.stamp_place = -1 if stamp is None else self.wire.places[self.stamp_field].start
        """Where the time field is among the unpacked fields; -1 without one."""


def finite(*groups: tuple[float, ...]) -> bool:
    """True where there is no NaN (inf never gets this far, and the limits keep the sum from reaching it)."""
    for group in groups:
        total = sum(group)
        if math.isnan(total):
            return False
    return True


def unit_quaternion(q: tuple[float, ...]) -> Quaternion | None:
    """A quaternion of length 1, or None where it is none: NaN, or a length more than 10 % off."""
    w, x, y, z = q
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    if not 0.9 <= norm <= 1.1:
        return None
    return (w / norm, x / norm, y / norm, z / norm)
