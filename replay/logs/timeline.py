"""The boot axis of a whole log at once: the columnar counterpart of companion/mavlink/boot_clock.py.

Flight has to place a message the moment it arrives; a log may look ahead, so latencies are compared with those on both
sides. Stamped autopilot messages have the same times in both. Reboots split the axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from companion.mavlink.boot_clock import Stamp
from companion.mavlink.message_table import LAYOUTS
from companion.mavlink.wire_layout import Layout
from models.errors import LogError
from replay.logs.tlog import AUTOPILOT, Tlog, outliers

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
    """The smallest (arrival - stamp) around each moment: what separates two clocks, latency taken out.

    ``origin_us``: stamp at which a window begins; None: the earliest. Stretches of one log that overlap by some windows
    of one origin give the same offsets there.
    """

    def __init__(self, arrival_us: Micros, stamp_us: Micros, origin_us: int | None = None) -> None:
        origin = int(stamp_us.min()) if origin_us is None else origin_us
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
        out: Micros = self._origin + np.rint(fine).astype(np.int64)
        return out


@dataclass(frozen=True)
class Stamps:
    """Boot stamps of the autopilot in file order, damaged ones out: places (n,) of their frames, milliseconds (n,)."""

    place: Micros
    ms: Micros

    def starts(self) -> Micros:
        """Places of the frames at which each boot after the first begins."""
        return self.place[1:][np.diff(self.ms) < -_BACK_MS]


def main_stamps(log: Tlog, system: int, before: tuple[int, int] | None = None) -> Stamps:
    """The stamps of one vehicle, the wraps of 32 bits undone. Raises LogError where there is none to believe.

    ``before``: arrival [us] and unwrapped stamp [ms] of an earlier one, where ``log`` is not the begin of its file.
    """
    places, stamps = [], []
    for layout in LAYOUTS.values():
        if layout.stamp is not Stamp.BOOT_MS:
            continue
        index = log.indices(layout.id, system)
        index = index[log.component[index] == AUTOPILOT]
        if index.size:
            places.append(index)
            stamps.append(log.records(layout.id, index)["time_boot_ms"].astype(np.int64))
    if not places:
        raise LogError(f"{log.path}: no stamped message of the autopilot (system {system}): no time axis")
    place, stamp = np.concatenate(places), np.concatenate(stamps)
    order = np.argsort(place)
    place, stamp = place[order], stamp[order]
    good = stamp > 0
    good[outliers(stamp, _BACK_MS)] = False
    place, stamp = place[good], stamp[good]
    if not place.size:
        raise LogError(f"{log.path}: no believable boot time in the autopilot's messages: no time axis")
    arrival = log.arrival_us[place]
    known = (int(arrival[0]), int(stamp[0])) if before is None else before
    # A step back that the receiver's clock saw as a small step forward is the wrap of 32 bits, not a reboot.
    elapsed = np.diff(arrival, prepend=known[0]) // 1000 + _AGREE_US // 1000
    steps = np.diff(stamp, prepend=known[1] % _WRAP_MS)
    wraps = (steps < 0) & (steps + _WRAP_MS <= elapsed)
    stamp += (known[1] // _WRAP_MS + np.cumsum(wraps)) * _WRAP_MS
    return Stamps(place, stamp)


class BootAxis:
    """Boot times of the messages of one vehicle in a stretch of a log that holds one boot."""

    def __init__(self, log: Tlog, system: int, stamps: Stamps, origin_us: int | None = None) -> None:
        self._log = log
        self._system = system
        self.origin_us = int(stamps.ms.min()) * 1000 if origin_us is None else origin_us
        self._envelope = Envelope(log.arrival_us[stamps.place], stamps.ms * 1000, self.origin_us)
        self.stamps_repaired = 0

    def by_arrival(self, index: NDArray[np.int64]) -> Micros:
        """Boot times [us] (n,) at which frames would have arrived without delay."""
        arrival = self._log.arrival_us[index]
        out: Micros = np.maximum(arrival - self._envelope.offset_us(arrival), 0)
        return out

    def times(self, layout: Layout, index: NDArray[np.int64], stamps: NDArray[np.uint64] | None) -> NDArray[np.float64]:
        """Boot times [s] of messages of one layout, shape (n,). ``stamps``: the time field as on the wire."""
        by_arrival = self.by_arrival(index)
        if layout.stamp is None or stamps is None:
            seconds: NDArray[np.float64] = by_arrival / 1e6
            return seconds
        stamp = np.minimum(stamps, np.uint64(2**62)).astype(np.int64)
        if layout.stamp is Stamp.BOOT_MS:
            stamp *= 1000
        wrap = {Stamp.BOOT_MS: _WRAP_MS * 1000, Stamp.BOOT_US32: 2**32}.get(layout.stamp)
        if wrap is not None:
            stamp += np.rint((by_arrival - stamp) / wrap).astype(np.int64) * wrap
        component = self._log.component[index]
        ours = (component == AUTOPILOT) & (self._log.system[index] == self._system)
        direct = ours & (np.abs(stamp - by_arrival) <= _AGREE_US) & (stamp > 0)
        out = np.where(direct, stamp, by_arrival)
        arrival = self._log.arrival_us[index]
        for key in np.unique(component[~direct]):
            rows = np.flatnonzero(~direct & (component == key) & (stamp > 0))
            if not rows.size or (key == AUTOPILOT and not (stamp[rows] > _UNIX_US).all()):
                self.stamps_repaired += int(rows.size)
                continue
            foreign = Envelope(arrival[rows], stamp[rows]).offset_us(arrival[rows])
            offset = self._envelope.offset_us(arrival[rows])
            out[rows] = np.maximum(stamp[rows] + foreign - offset, 0)
        result: NDArray[np.float64] = out / 1e6
        return result
