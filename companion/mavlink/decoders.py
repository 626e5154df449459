"""One message to a sample, for flight; many messages to columns, for logs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.mavlink.boot_clock import BootClock
from companion.mavlink.dialect import mavlink
from companion.mavlink.esc_messages import BY_ID as ESC_BY_ID
from companion.mavlink.esc_messages import parse_frame
from companion.mavlink.message_table import _BY_NAME, LAYOUTS
from companion.mavlink.samples import Sample
from companion.mavlink.wire_layout import Layout


def decode(message: Any, arrival_us: int, clock: BootClock) -> Sample | None:
    """The sample in one message, on the boot axis of ``clock`` (which it advances), or None.

    ``message``: a pymavlink message of the dialect, or what pymavlink makes of a frame it does not know
    (``UNKNOWN_291``). ``arrival_us``: the receiver's clock when the frame arrived, whole microseconds.
    """
    layout = _BY_NAME.get(message.get_type())
    if layout is None:
        if not isinstance(message, mavlink.MAVLink_unknown):
            return None
        message = parse_frame(message.get_msgbuf())
        if message is None:
            return None
        layout = LAYOUTS[message.ID]
        system, component = message.system, message.component
    else:
        system, component = message.get_srcSystem(), message.get_srcComponent()
    if layout.stamp is None:
        t_s = clock.unstamped(arrival_us)
    else:
        t_s = clock.stamped(system, component, layout.stamp, getattr(message, layout.stamp_field), arrival_us)
    sample = layout.build((t_s, system, component), layout.name, *[q.scalar(message) for q in layout.quantities])
    late_s = 0.0 if sample is None or layout.stamp is None else clock.late(t_s, arrival_us)
    return sample if sample is None or late_s == 0.0 else replace(sample, late_s=late_s)


def source_of(message: Any) -> tuple[int, int]:
    """System and component that sent a message. pymavlink does not read the header of a frame it does not know."""
    if not isinstance(message, mavlink.MAVLink_unknown):
        return message.get_srcSystem(), message.get_srcComponent()
    frame = message.get_msgbuf()
    return (frame[5], frame[6]) if frame[0] == mavlink.PROTOCOL_MARKER_V2 else (frame[3], frame[4])


def id_of(message: Any) -> int:
    """Message id, also of a frame that pymavlink does not know (which it numbers -2)."""
    if not isinstance(message, mavlink.MAVLink_unknown):
        return int(message.get_msgId())
    return int(message.get_type().removeprefix("UNKNOWN_"))


def columns(layout: Layout, records: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Quantities of many messages of one kind, by name: shape (n, k) in SI, or as on the wire where taken raw.

    ``records``: structured array (n,) of ``wire_dtype(layout.id)``.
    """
    return {q.name: q.column(records) for q in layout.quantities}


_SCALARS = {
    "b": "i1",
    "B": "u1",
    "h": "<i2",
    "H": "<u2",
    "i": "<i4",
    "I": "<u4",
    "q": "<i8",
    "Q": "<u8",
    "f": "<f4",
    "d": "<f8",
}


def wire_dtype(message_id: int) -> np.dtype[Any]:
    """Packed structured dtype of a message's payload, fields in wire order under their own names; text is bytes."""
    if message_id in mavlink.mavlink_map:
        kind = mavlink.mavlink_map[message_id]
        names, formats = kind.ordered_fieldnames, _formats(kind.unpacker.format)
    else:
        names, formats = _ESC_FIELDS[message_id], _formats(ESC_BY_ID[message_id].PAYLOAD.format)
    return np.dtype(list(zip(names, formats, strict=True)))


_ESC_FIELDS = {
    290: (
        "time_usec",
        "error_count",
        "counter",
        "failure_flags",
        "temperature",
        "index",
        "count",
        "connection_type",
        "info",
    ),
    291: ("time_usec", "rpm", "voltage", "current", "index"),
}


def _formats(text: str) -> list[Any]:
    """numpy formats of a struct format string such as ``<IHH4f16sB``: one per field, repeats as sub-arrays."""
    out: list[Any] = []
    i = 1
    while i < len(text):
        j = i
        while text[j].isdigit():
            j += 1
        repeat, code, i = text[i:j], text[j], j + 1
        if code == "s":
            out.append(f"S{repeat or 1}")
        else:
            out.append((_SCALARS[code], (int(repeat),)) if repeat else _SCALARS[code])
    return out
