"""What one message looks like on the wire: its fields, their units, and the builder of its sample."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.mavlink.boot_clock import Stamp
from companion.mavlink.samples import Quaternion, Sample
from models.frames import GRAVITY

NAN = math.nan


PER_SI = {
    "": 1.0, "rad": 1.0, "rad/s": 1.0, "m": 1.0, "m/s": 1.0, "m/s/s": 1.0, "V": 1.0, "A": 1.0, "degC": 1.0, "us": 1.0,
    "rpm": 1.0, "deg": math.degrees(1.0), "cm": 100.0, "cm^2": 1e4, "mV": 1000.0, "cV": 100.0, "cA": 100.0,
    "cdegC": 100.0, "hPa": 0.01, "mrad/s": 1000.0, "mG": 1000.0 / GRAVITY,
}  # fmt: skip
"""Wire units in one unit used inside: SI, but for rpm, us of a servo pulse and deg C."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """Wire fields that make one quantity of ``len`` numbers, converted to ``PER_SI`` units; |value| > limit is NaN."""

    name: str
    fields: tuple[str, ...]
    unit: str = ""
    limit: float = math.inf
    unknown: tuple[int, ...] = ()
    array: bool = False
    """True where the one field is an array on the wire."""
    read: Callable[[Any], Any] = field(init=False, repr=False, compare=False)
    per: float = field(init=False)

    def __post_init__(self) -> None:
        # Looked up once: this runs for every number of every message.
        object.__setattr__(self, "read", attrgetter(*self.fields))
        object.__setattr__(self, "per", PER_SI[self.unit])
        # The largest float, so that one comparison also turns inf into NaN.
        object.__setattr__(self, "limit", min(self.limit, sys.float_info.max))

    def scalar(self, message: Any) -> tuple[float, ...]:
        """The numbers of one message."""
        per, limit, unknown = self.per, self.limit, self.unknown
        raw = self.read(message)
        if len(self.fields) == 1 and not self.array:
            raw = (raw,)
        # A comparison with NaN is false, so NaN stays NaN.
        if unknown:
            return tuple([v if x not in unknown and -limit <= (v := x / per) <= limit else NAN for x in raw])
        return tuple([v if -limit <= (v := x / per) <= limit else NAN for x in raw])

    def column(self, records: NDArray[Any]) -> NDArray[np.float64]:
        """The numbers of many messages, shape (n, k)."""
        raw = records[self.fields[0]] if self.array else np.stack([records[f] for f in self.fields], axis=-1)
        with np.errstate(over="ignore", invalid="ignore"):
            out: NDArray[np.float64] = raw.astype(np.float64) / self.per
            bad = ~(np.abs(out) <= self.limit)
        if self.unknown:
            bad |= np.isin(raw, self.unknown)
        out[bad] = NAN
        return out


@dataclass(frozen=True, slots=True)
class Raw:
    """Whole numbers or text taken as they are."""

    field: str

    @property
    def name(self) -> str:
        """The quantity is called as on the wire."""
        return self.field

    def scalar(self, message: Any) -> Any:
        """The value of one message."""
        return getattr(message, self.field)

    def column(self, records: NDArray[Any]) -> NDArray[Any]:
        """The values of many messages, shape (n,) or (n, k)."""
        out: NDArray[Any] = records[self.field]
        return out


Head = tuple[float, int, int]


@dataclass(frozen=True, slots=True)
class Layout:
    """One message: its id and name, what stamps it, its quantities in the builder's order, and the builder."""

    id: int
    name: str
    stamp: Stamp | None
    quantities: tuple[Quantity | Raw, ...]
    build: Callable[..., Sample | None]

    @property
    def stamp_field(self) -> str:
        """Name of the time field on the wire."""
        return "time_boot_ms" if self.stamp is Stamp.BOOT_MS else "time_usec"


def finite(*groups: tuple[float, ...]) -> bool:
    """True where there is no NaN (inf never gets this far, and the limits keep the sum from reaching it)."""
    total = sum([sum(group) for group in groups])
    return total == total


def unit_quaternion(q: tuple[float, ...]) -> Quaternion | None:
    """A quaternion of length 1, or None where it is none: NaN, or a length more than 10 % off."""
    w, x, y, z = q
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    if not 0.9 <= norm <= 1.1:
        return None
    return (w / norm, x / norm, y / norm, z / norm)
