"""The boot axis of a whole log at once: the columnar counterpart of companion/mavlink/boot_clock.py.

Flight has to place a message the moment it arrives; a log may look ahead, so latencies are compared with those on both
sides. Stamped autopilot messages have the same times in both. Reboots split the axis.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from companion.mavlink import AUTOPILOT_COMPONENT
from companion.mavlink.boot_clock import Stamp
from companion.mavlink.message_table import LAYOUTS
from companion.mavlink.wire_layout import Layout
from models.errors import LogError
from replay.logs.tlog import Tlog, outliers

Micros = NDArray[np.int64]
_WINDOW_US = 2_000_000
"""In two seconds some message passes a link without delay, and two clocks drift apart by less than 0.2 ms (100 ppm)."""
_BACK_MS = 1000
"""Stamps that go back by more are of another boot (or damaged); less is disorder on the way."""
_AGREE_US = 10_000_000
"""A stamp this close to where its arrival puts it is of the boot clock; links never delay by ten seconds."""
_UNIX_US = 10**15
"""Above, a stamp counts from 1970 (1e15 us is 2001), not from boot (32 years)."""
_WRAP_MS = 2**32
"""time_boot_ms has 32 bits."""


class Envelope:
    """The smallest (arrival - stamp) around each moment: what separates two clocks, latency taken out."""

    def __init__(self, arrival_us: Micros, stamp_us: Micros) -> None:
        origin = int(stamp_us.min())
        window = (stamp_us - origin) // _WINDOW_US
        order = np.argsort(window, kind="stable")
        windows, first = np.unique(window[order], return_index=True)
        latency = (arrival_us - stamp_us)[order]
        smallest = np.minimum.reduceat(latency, first)
        if len(windows) > 2:
            # A window of its own may hold only late messages; its neighbours know better.
            smallest = sliding_window_view(np.pad(smallest, 1, mode="edge"), 3).min(axis=1)
        middle = origin + windows * _WINDOW_US + _WINDOW_US // 2
        self._origin = int(smallest[0])
        at = middle + smallest
        keep = np.concatenate([[True], np.diff(np.maximum.accumulate(at)) > 0])
        self._at, self._smallest = at[keep], smallest[keep]

    def offset_us(self, arrival_us: Micros) -> Micros:
        """Offset of the clocks at these arrivals, shape (n,)."""
        fine = np.interp(arrival_us, self._at, (self._smallest - self._origin).astype(float))
        return np.asarray(self._origin + np.rint(fine).astype(np.int64))


def boots(log: Tlog, system: int) -> Iterator[tuple[Tlog, BootAxis]]:
    """The frames of each boot of a vehicle, and their time axis. Raises LogError where there is no stamp to believe."""
    place, stamp_ms = _main_stamps(log, system)
    starts = place[1:][np.diff(stamp_ms) < -_BACK_MS]
    for first, end in itertools.pairwise([0, *starts.tolist(), len(log)]):
        i, j = np.searchsorted(place, (first, end))
        part = log.part(first, end)
        yield part, BootAxis(part, system, Envelope(part.arrival_us[place[i:j] - first], stamp_ms[i:j] * 1000))


def _main_stamps(log: Tlog, system: int) -> tuple[Micros, Micros]:
    """Boot stamps of the autopilot in file order, damaged ones out and the wraps of 32 bits undone: places (n,) of
    their frames, milliseconds (n,)."""
    places, stamps = [], []
    for layout in LAYOUTS.values():
        if layout.stamp is not Stamp.BOOT_MS:
            continue
        index = log.indices(layout.id, system)
        index = index[log.component[index] == AUTOPILOT_COMPONENT]
        if index.size:
            places.append(index)
            stamps.append(log.records(layout.id, index)["time_boot_ms"].astype(np.int64))
    if not places:
        raise LogError(
            f"{log.path}: no stamped message of the autopilot (system {system}), such as ATTITUDE: no time axis"
        )
    place, stamp = np.concatenate(places), np.concatenate(stamps)
    order = np.argsort(place)
    place, stamp = place[order], stamp[order]
    good = stamp > 0
    good[outliers(stamp, _BACK_MS)] = False
    place, stamp = place[good], stamp[good]
    if not place.size:
        raise LogError(f"{log.path}: no believable boot time in the autopilot's messages: no time axis")
    # A step back that the receiver's clock saw as a small step forward is the wrap of 32 bits, not a reboot.
    elapsed = np.diff(log.arrival_us[place]) // 1000 + _AGREE_US // 1000
    steps = np.diff(stamp)
    wraps = (steps < 0) & (steps + _WRAP_MS <= elapsed)
    stamp[1:] += np.cumsum(wraps) * _WRAP_MS
    return place, stamp


class BootAxis:
    """Boot times of the messages of one vehicle in the frames of one boot."""

    def __init__(self, log: Tlog, system: int, envelope: Envelope) -> None:
        self._log, self._system, self._envelope = log, system, envelope
        self.stamps_repaired = 0

    def times(self, layout: Layout, index: NDArray[np.int64], stamps: NDArray[np.uint64] | None) -> NDArray[np.float64]:
        """Boot times [s] of messages of one layout, shape (n,). ``stamps``: the time field as on the wire."""
        arrival = self._log.arrival_us[index]
        offset = self._envelope.offset_us(arrival)
        by_arrival = np.maximum(arrival - offset, 0)  # as if it had arrived without delay
        if layout.stamp is None or stamps is None:
            return np.asarray(by_arrival / 1e6)
        stamp = np.minimum(stamps, np.uint64(2**62)).astype(np.int64)
        if layout.stamp is Stamp.BOOT_MS:
            stamp *= 1000
        wrap = {Stamp.BOOT_MS: _WRAP_MS * 1000, Stamp.BOOT_US32: 2**32}.get(layout.stamp)
        if wrap is not None:
            stamp += np.rint((by_arrival - stamp) / wrap).astype(np.int64) * wrap
        component = self._log.component[index]
        ours = (component == AUTOPILOT_COMPONENT) & (self._log.system[index] == self._system)
        direct = ours & (np.abs(stamp - by_arrival) <= _AGREE_US) & (stamp > 0)
        out = np.where(direct, stamp, by_arrival)
        for key in np.unique(component[~direct]):
            rows = np.flatnonzero(~direct & (component == key) & (stamp > 0))
            if not rows.size or (key == AUTOPILOT_COMPONENT and not (stamp[rows] > _UNIX_US).all()):
                self.stamps_repaired += int(rows.size)
                continue
            foreign = Envelope(arrival[rows], stamp[rows]).offset_us(arrival[rows])
            out[rows] = np.maximum(stamp[rows] + foreign - offset[rows], 0)
        return np.asarray(out / 1e6)
