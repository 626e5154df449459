"""How a message's payload is laid out: one precompiled struct for a frame, one numpy type for a column of them."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from companion.mavlink.dialect import MESSAGES

_SCALARS = {
    "b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "q": "<i8", "Q": "<u8", "f": "<f4",
    "d": "<f8",
}  # fmt: skip
"""numpy's name of each struct code that MAVLink uses."""


@dataclass(frozen=True, slots=True)
class WireFormat:
    """``unpacker`` gives a flat tuple; ``places`` says which part of it each field is."""

    unpacker: struct.Struct
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
    for name, (repeat, code) in zip(kind.ordered_fieldnames, _codes(kind.unpacker.format), strict=True):
        width = 1 if code == "s" else repeat or 1
        places[name] = slice(at, at + width)
        at += width
        if code == "s":
            types.append((name, f"S{repeat or 1}"))
        else:
            types.append((name, (_SCALARS[code], (repeat,))) if repeat else (name, _SCALARS[code]))
    return WireFormat(kind.unpacker, places, np.dtype(types))


def _codes(text: str) -> list[tuple[int, str]]:
    """(repeat, code) of every field of a struct format such as ``<IHH4f16sB``; repeat 0 where none is written."""
    return [(int(digits or 0), code) for digits, code in re.findall(r"(\d*)([a-zA-Z])", text)]
