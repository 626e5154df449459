"""The boot axis of a whole log at once: the columnar counterpart of companion/mavlink/boot_clock.py.

Flight has to place a message the moment it arrives; a log may look ahead, so latencies are compared with those on both
sides. Stamped autopilot messages have the same times in both. Reboots split the axis.

The autopilot's boot time is the truth. The receiver's clock places only what has no boot stamp. Its steps are taken out
first. It never moves a message of the autopilot away from the stamped ones that surround it in the file.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from companion.mavlink import AUTOPILOT_COMPONENT, OWN_COMPONENT
from companion.mavlink.boot_clock import Stamp
from companion.mavlink.message_table import LAYOUTS
from companion.mavlink.wire_layout import Layout
from models.common.errors import LogError
from replay.logs.receiver_clock import Micros, clock_steps, without_steps
from replay.logs.tlog import Tlog, outliers

_WINDOW_US = 2_000_000
"""In two seconds some message passes a link without delay, and two clocks drift apart by less than 0.2 ms (100 ppm)."""
_BACK_MS = 1000
"""Stamps that go back by more are of another boot (or damaged); less is disorder on the way."""
_DECIDING = 5
"""So many stamps after a step back say whether it lasts. Two links out of step deliver old and new in turns."""
_TWO_CLOCKS = 0.05
"""Share of steps back that no reboots explain. A boot of two seconds has a hundred stamps."""
_AGREE_US = 10_000_000
"""A stamp this close to where its arrival puts it is of the boot clock; links never delay by ten seconds."""
_SAMPLED_US = 300_000
"""Samples are stamped up to so long before they are sent, in any order."""
_UNIX_US = 10**15
"""Above, a stamp counts from 1970 (1e15 us is 2001), not from boot (32 years)."""
_WRAP_MS = 2**32
"""time_boot_ms has 32 bits."""
_PAUSE_MS = 3_600_000
"""A wrap is seen across a pause of an hour at most. Nobody reboots within that of 49.7 days."""


class Envelope:
    """The smallest difference of two clocks around each place in the file: latency taken out."""

    def __init__(self, place: Micros, axis_us: Micros, difference_us: Micros) -> None:
        """Of messages in file order: their places, times that set the windows, and differences, each of shape (m,)."""
        window = (axis_us - axis_us.min()) // _WINDOW_US
        order = np.argsort(window, kind="stable")
        _, first = np.unique(window[order], return_index=True)
        smallest = np.minimum.reduceat(difference_us[order], first)
        middle = np.add.reduceat(place[order], first) / np.diff([*first.tolist(), len(order)])
        in_file = np.argsort(middle)
        smallest = smallest[in_file]
        if len(smallest) > 2:
            # A window of its own may hold only late messages; its neighbours know better.
            smallest = sliding_window_view(np.pad(smallest, 1, mode="edge"), 3).min(axis=1)
        self._origin = int(smallest[0])
        self._place = middle[in_file]
        self._smallest = (smallest - self._origin).astype(float)

    def at(self, place: Micros) -> Micros:
        """The difference at these places, shape (n,)."""
        fine = np.interp(place, self._place, self._smallest)
        return np.asarray(self._origin + np.rint(fine).astype(np.int64))


def boots(log: Tlog, system: int) -> Iterator[tuple[Tlog, BootAxis]]:
    """The frames of each boot of a vehicle, and their time axis. Raises LogError where there is no stamp to believe."""
    place, stamp_ms = _main_stamps(log, system)
    following = np.pad(stamp_ms[1:], (0, _DECIDING), constant_values=-1)
    highest_next = sliding_window_view(following, _DECIDING)[: len(stamp_ms) - 1].max(axis=1)
    starts = place[1:][stamp_ms[:-1] - highest_next > _BACK_MS]
    for first, end in itertools.pairwise([0, *starts.tolist(), len(log)]):
        i, j = np.searchsorted(place, (first, end))
        part = log.part(first, end)
        yield part, BootAxis(part, system, place[i:j] - first, stamp_ms[i:j] * 1000)


def steady(log: Tlog, system: int) -> Tlog:
    """The log of a ground station as if its clock had never been set.

    A recording of the companion stays as it is: its clock is never set, and its replay repeats every bit.
    """
    if (log.component == OWN_COMPONENT).any():
        return log
    try:
        parts = [
            without_steps(part.arrival_us, axis.clock_steps) for part, axis in boots(log, system)
        ]
    except LogError:  # without a boot stamp nothing shows a step
        return log
    return replace(log, arrival_us=np.concatenate(parts))


def _main_stamps(log: Tlog, system: int) -> tuple[Micros, Micros]:
    """Boot stamps of the autopilot in file order, damaged ones out and the wraps of 32 bits undone: places (n,) of
    their frames, milliseconds (n,)."""
    places = []
    stamps = []
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
            f"{log.path}: no stamped message of the autopilot (system {system}), such as "
            "ATTITUDE: no time axis"
        )
    place = np.concatenate(places)
    stamp = np.concatenate(stamps)
    order = np.argsort(place)
    place = place[order]
    stamp = stamp[order]
    good = stamp > 0
    if (np.diff(stamp[good]) < -_BACK_MS).sum() > _TWO_CLOCKS * len(stamp):
        raise LogError(
            f"{log.path}: two autopilots send as system {system}, each with its own boot clock: "
            "give each vehicle its own number (SYSID_THISMAV, MAV_SYSID, MAV_SYS_ID) and record "
            "again"
        )
    good[outliers(stamp, _BACK_MS)] = False
    place = place[good]
    stamp = stamp[good]
    if not place.size:
        raise LogError(
            f"{log.path}: no believable boot time in the autopilot's messages: no time axis"
        )
    wraps = np.diff(stamp) < _PAUSE_MS - _WRAP_MS
    stamp[1:] += np.cumsum(wraps) * _WRAP_MS
    return place, stamp


class BootAxis:
    """Boot times of the messages of one vehicle in the frames of one boot."""

    def __init__(self, log: Tlog, system: int, place: Micros, stamp_us: Micros) -> None:
        """``place``: of the autopilot's stamped frames, shape (m,); ``stamp_us``: their boot times, shape (m,)."""
        self._log = log
        self._system = system
        self._ours = (log.component == AUTOPILOT_COMPONENT) & (log.system == system)
        self.clock_steps = clock_steps(log.arrival_us, place, stamp_us)
        self._received_us = self._received(place, stamp_us)
        self.stamps_repaired = 0

    def _received(self, place: Micros, stamp_us: Micros) -> Micros:
        """Boot time of every frame (n,) as if it had arrived without delay."""
        arrival_us = without_steps(self._log.arrival_us, self.clock_steps)
        everywhere = np.arange(len(self._log))
        offset_us = Envelope(place, stamp_us, arrival_us[place] - stamp_us).at(everywhere)
        by_arrival = arrival_us - offset_us
        newest_us = np.maximum.accumulate(stamp_us)
        following = np.searchsorted(place, everywhere)
        unbounded = np.iinfo(np.int64)
        earliest = np.insert(newest_us, 0, unbounded.min // 2)[following]
        latest = np.append(newest_us, unbounded.max // 2)[following]
        slack_us = np.where(self._ours, _SAMPLED_US, _AGREE_US)
        believed = (by_arrival >= earliest - slack_us) & (by_arrival <= latest + slack_us)
        by_place = np.rint(np.interp(everywhere, place, newest_us)).astype(np.int64)
        return np.maximum(np.where(believed, by_arrival, by_place), 0)

    def times(
        self, layout: Layout, index: NDArray[np.int64], stamps: NDArray[np.uint64] | None
    ) -> NDArray[np.float64]:
        """Boot times [s] of messages of one layout, shape (n,). ``stamps``: the time field as on the wire."""
        received = self._received_us[index]
        if layout.stamp is None or stamps is None:
            return np.asarray(received / 1e6)
        stamp = np.minimum(stamps, np.uint64(2**62)).astype(np.int64)
        if layout.stamp is Stamp.BOOT_MS:
            stamp *= 1000
        wrap = {Stamp.BOOT_MS: _WRAP_MS * 1000, Stamp.BOOT_US32: 2**32}.get(layout.stamp)
        if wrap is not None:
            stamp += np.rint((received - stamp) / wrap).astype(np.int64) * wrap
        component = self._log.component[index]
        direct = self._ours[index] & (np.abs(stamp - received) <= _AGREE_US) & (stamp > 0)
        out = np.where(direct, stamp, received)
        for key in np.unique(component[~direct]):
            rows = np.flatnonzero(~direct & (component == key) & (stamp > 0))
            if not rows.size or (key == AUTOPILOT_COMPONENT and not (stamp[rows] > _UNIX_US).all()):
                self.stamps_repaired += int(rows.size)
                continue
            out[rows] = self._moved(index[rows], stamp[rows])
        return np.asarray(out / 1e6)

    def _moved(self, place: Micros, stamp_us: Micros) -> Micros:
        """Stamps (n,) of another clock on the boot axis; one that its arrival contradicts is placed by its arrival."""
        received = self._received_us[place]
        moved = stamp_us + Envelope(place, received, received - stamp_us).at(place)
        agrees = np.abs(moved - received) <= _AGREE_US
        return np.maximum(np.where(agrees, moved, received), 0)
