"""One frame to a sample, for flight; many payloads to columns, for logs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from numpy.typing import NDArray

from companion.mavlink.boot_clock import BootClock
from companion.mavlink.frames import Frame
from companion.mavlink.message_table import LAYOUTS
from companion.mavlink.samples import Sample
from companion.mavlink.wire_layout import Layout


def decode(frame: Frame, arrival_us: int, clock: BootClock) -> Sample | None:
    """The sample in one frame, on the boot axis of ``clock`` (which it advances), or None.

    ``arrival_us``: the receiver's clock when the frame arrived, whole microseconds. MAVLink 2 cuts trailing zeros of a
    payload, and a later version of a message may append fields: the one is filled up, the other left out.
    """
    layout = LAYOUTS.get(frame.id)
    if layout is None:
        return None
    payload, unpacker = frame.payload, layout.wire.unpacker
    if len(payload) != unpacker.size:
        payload = payload[: unpacker.size].ljust(unpacker.size, b"\0")
    fields = unpacker.unpack(payload)
    if layout.stamp is None:
        t_s = clock.unstamped(arrival_us)
    else:
        t_s = clock.stamped(frame.system, frame.component, layout.stamp, fields[layout.stamp_place], arrival_us)
    head = (t_s, frame.system, frame.component)
    sample = layout.build(head, layout.name, *[read(fields) for read in layout.readers])
    late_s = 0.0 if sample is None or layout.stamp is None else clock.late(t_s, arrival_us)
    return sample if sample is None or late_s == 0.0 else replace(sample, late_s=late_s)


def columns(layout: Layout, records: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Quantities of many messages of one kind, by name: shape (n, k) in SI, or as on the wire where taken raw.

    ``records``: structured array (n,) of ``layout.wire.dtype``.
    """
    return {q.name: q.column(records) for q in layout.quantities}
