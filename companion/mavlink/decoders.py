"""One frame to a sample, for flight; many payloads to columns, for logs."""

from __future__ import annotations

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
    _, system, component, payload, _ = frame
    fields, stamp = _unpacked(layout, payload), layout.stamp
    if stamp is None:
        t_s = clock.unstamped(arrival_us)
    else:
        t_s = clock.stamped(system, component, stamp, fields[layout.stamp_place], arrival_us)
    if layout.build is None:
        return None
    sample = layout.build((t_s, system, component), layout.name, *[read(fields) for read in layout.readers])
    if sample is not None and stamp is not None:
        # Nobody else has seen the sample yet; a copy of it costs more than all the rest of its decoding.
        object.__setattr__(sample, "late_s", clock.late(t_s, arrival_us))
    return sample


def stamp_of(frame: Frame, arrival_us: int, clock: BootClock) -> None:
    """Advance ``clock`` by the stamp of a frame whose content is not wanted, as ``decode`` would."""
    layout = LAYOUTS[frame.id]
    if layout.stamp is not None:
        stamp = _unpacked(layout, frame.payload)[layout.stamp_place]
        clock.stamped(frame.system, frame.component, layout.stamp, stamp, arrival_us)


def _unpacked(layout: Layout, payload: bytes) -> tuple[Any, ...]:
    """The fields on the wire, one after another; trailing zeros filled up, fields of a later version left out."""
    unpacker = layout.wire.unpacker
    if len(payload) != unpacker.size:
        payload = payload[: unpacker.size].ljust(unpacker.size, b"\0")
    return unpacker.unpack(payload)


def columns(layout: Layout, records: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Quantities of many messages of one kind, by name: shape (n, k) in SI, or as on the wire where taken raw.

    ``records``: structured array (n,) of ``layout.wire.dtype``.
    """
    return {q.name: q.column(records) for q in layout.quantities}
