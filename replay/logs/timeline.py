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
from models.common.frames import Array, Mask, Whole
from replay.logs.receiver_clock import clock_steps, without_steps
from replay.logs.tlog import Tlog, outliers, places_of
from replay.spill import Spool, blocks, picked, spans, spilled

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
_WRAPS_US = {Stamp.BOOT_MS: _WRAP_MS * 1000, Stamp.BOOT_US32: 2**32}
_UNBOUNDED_US = 2**62
"""No time on either side."""
_PAUSE_MS = 3_600_000
"""A wrap is seen across a pause of an hour at most. Nobody reboots within that of 49.7 days."""


class Envelope:
    """The smallest difference of two clocks around each place in the file: latency taken out."""

    def __init__(self, place: Whole, axis_us: Whole, difference_us: Whole) -> None:
        """Of messages in file order: their places, times that set the windows, and differences, each of shape (m,)."""
        origin = axis_us.min()
        parts = []
        for rows in blocks(len(place)):
            window = (axis_us[rows] - origin) // _WINDOW_US
            once = np.ones(len(window), np.int64)
            part = _by_window(window, difference_us[rows], place[rows], once)
            parts.append(part)
        whole = map(np.concatenate, zip(*parts, strict=True))
        _, smallest, places, count = _by_window(*whole)
        middle = places / count
        in_file = np.argsort(middle)
        smallest = smallest[in_file]
        if len(smallest) > 2:
            # A window of its own may hold only late messages; its neighbours know better.
            padded = np.pad(smallest, 1, mode="edge")
            smallest = sliding_window_view(padded, 3).min(axis=1)
        self._origin = int(smallest[0])
        self._place = middle[in_file]
        self._smallest = (smallest - self._origin).astype(float)

    def at(self, place: Whole) -> Whole:
        """The difference at these places, shape (n,)."""
        fine = np.interp(place, self._place, self._smallest)
        return np.asarray(self._origin + np.rint(fine).astype(np.int64))


def _by_window(
    window: Whole, smallest: Whole, places: Whole, count: Whole
) -> tuple[Whole, Whole, Whole, Whole]:
    """Rows (m,) of the same window as one: its number, the smallest difference, the sum of places, the count."""
    order = np.argsort(window, kind="stable")
    numbers, first = np.unique(window[order], return_index=True)
    least = np.minimum.reduceat(smallest[order], first)
    sums = np.add.reduceat(places[order], first)
    counts = np.add.reduceat(count[order], first)
    return numbers, least, sums, counts


def boots(log: Tlog, system: int) -> Iterator[tuple[Tlog, BootAxis]]:
    """The frames of each boot of a vehicle, and their time axis. Raises LogError where there is no stamp to believe."""
    place, stamp_ms = _main_stamps(log, system)
    back = places_of(stamp_ms, lambda steps: steps < -_BACK_MS)
    following = back[:, None] + np.arange(1, _DECIDING + 1)
    deciding_ms = stamp_ms[np.minimum(following, len(stamp_ms) - 1)]
    lasts = stamp_ms[back] - deciding_ms.max(axis=1) > _BACK_MS
    starts = place[back[lasts] + 1].tolist()
    for first, end in itertools.pairwise([0, *starts, len(log)]):
        i, j = np.searchsorted(place, (first, end))
        own = place[i:j]
        if first:
            own = own - first
        part = log.part(first, end)
        stamp_us = spilled(stamp_ms[i:j] * 1000)
        yield part, BootAxis(part, system, own, stamp_us)


def steady(log: Tlog, system: int) -> Tlog:
    """The log of a ground station as if its clock had never been set.

    A recording of the companion stays as it is: its clock is never set, and its replay repeats every bit.
    """
    if (log.component == OWN_COMPONENT).any():
        return log
    arrival_us = Spool(np.int64)
    try:
        for part, axis in boots(log, system):
            steady_us = without_steps(part.arrival_us, axis.clock_steps)
            arrival_us.append(steady_us)
    except LogError:  # without a boot stamp nothing shows a step
        return log
    return replace(log, arrival_us=arrival_us.array())


def _main_stamps(log: Tlog, system: int) -> tuple[Whole, Whole]:
    """Boot stamps of the autopilot in file order, damaged ones out and the wraps of 32 bits undone: places (n,) of
    their frames, milliseconds (n,)."""
    places = Spool(np.int64)
    stamps = Spool(np.int64)
    for rows in blocks(len(log)):
        part = log.part(rows.start, rows.stop)
        found, stamp_ms = _stamps_in(part, system)
        places.append(found + rows.start)
        stamps.append(stamp_ms)
    place = places.array()
    stamp = stamps.array()
    if not place.size:
        raise LogError(
            f"{log.path}: no stamped message of the autopilot (system {system}), such as "
            "ATTITUDE: no time axis"
        )
    good = stamp > 0
    back = places_of(picked(stamp, good), lambda steps: steps < -_BACK_MS)
    if len(back) > _TWO_CLOCKS * len(stamp):
        raise LogError(
            f"{log.path}: two autopilots send as system {system}, each with its own boot clock: "
            "give each vehicle its own number (SYSID_THISMAV, MAV_SYSID, MAV_SYS_ID) and record "
            "again"
        )
    good[outliers(stamp, _BACK_MS)] = False
    place = picked(place, good)
    stamp = picked(stamp, good)
    if not place.size:
        raise LogError(
            f"{log.path}: no believable boot time in the autopilot's messages: no time axis"
        )
    wraps = places_of(stamp, lambda steps: steps < _PAUSE_MS - _WRAP_MS)
    if len(wraps):
        stamp = stamp.copy()
        for wrap in wraps.tolist():
            stamp[wrap + 1 :] += _WRAP_MS
    return place, stamp


def _stamps_in(log: Tlog, system: int) -> tuple[Whole, Whole]:
    """Places (n,) and boot stamps (n,) [ms] of the autopilot's stamped messages, in file order."""
    places = [np.empty(0, np.int64)]
    stamps = [np.empty(0, np.int64)]
    for layout in LAYOUTS.values():
        if layout.stamp is not Stamp.BOOT_MS:
            continue
        index = log.indices(layout.id, system)
        index = index[log.component[index] == AUTOPILOT_COMPONENT]
        if index.size:
            records = log.records(layout.id, index)
            places.append(index)
            stamps.append(records["time_boot_ms"].astype(np.int64))
    place = np.concatenate(places)
    stamp = np.concatenate(stamps)
    in_file = np.argsort(place)
    return place[in_file], stamp[in_file]


class BootAxis:
    """Boot times of the messages of one vehicle in the frames of one boot."""

    def __init__(self, log: Tlog, system: int, place: Whole, stamp_us: Whole) -> None:
        """``place``: of the autopilot's stamped frames, shape (m,); ``stamp_us``: their boot times, shape (m,)."""
        self._log = log
        self._system = system
        self.stamps_repaired = 0
        self.clock_steps = clock_steps(log.arrival_us, place, stamp_us)
        steps = sorted(self.clock_steps, key=lambda step: step.place)
        self._step_places = np.array([step.place for step in steps], np.int64)
        self._moved_us = np.cumsum([0, *(step.by_us for step in steps)])
        self._place = place
        self._newest_us = spilled(np.maximum.accumulate(stamp_us))
        late_us = Spool(np.int64)
        for rows in spans(place):
            arrival_us = self._arrival(place[rows])
            late_us.append(arrival_us - stamp_us[rows])
        self._offset = Envelope(place, stamp_us, late_us.array())

    def _arrival(self, index: Whole) -> Whole:
        """Arrivals (n,) by a clock that was never set."""
        steps_before = np.searchsorted(self._step_places, index, side="right")
        moved_us = self._moved_us[steps_before]
        return np.asarray(self._log.arrival_us[index] - moved_us)

    def _ours(self, index: Whole) -> Mask:
        """Which frames (n,) are of the autopilot."""
        of_autopilot = self._log.component[index] == AUTOPILOT_COMPONENT
        of_vehicle = self._log.system[index] == self._system
        return np.asarray(of_autopilot & of_vehicle)

    def _received(self, index: Whole) -> Whole:
        """Boot times of frames (n,) as if they had arrived without delay."""
        out = np.empty(len(index), np.int64)
        for rows in blocks(len(index)):
            out[rows] = self._received_in(index[rows])
        return out

    def _received_in(self, index: Whole) -> Whole:
        by_arrival = self._arrival(index) - self._offset.at(index)
        # The stamped frames around these are all that places them.
        first, last = np.searchsorted(self._place, (index.min(), index.max()))
        around = slice(max(first - 1, 0), last + 2)
        place = self._place[around]
        newest_us = self._newest_us[around]
        following = np.searchsorted(place, index)
        before_us = np.append(-_UNBOUNDED_US, newest_us)[following]
        after_us = np.append(newest_us, _UNBOUNDED_US)[following]
        slack_us = np.where(self._ours(index), _SAMPLED_US, _AGREE_US)
        late_enough = by_arrival >= before_us - slack_us
        early_enough = by_arrival <= after_us + slack_us
        by_place = np.rint(np.interp(index, place, newest_us)).astype(np.int64)
        times_us = np.where(late_enough & early_enough, by_arrival, by_place)
        return np.maximum(times_us, 0)

    def times(self, layout: Layout, index: Whole, stamps: NDArray[np.uint64] | None) -> Array:
        """Boot times [s] of messages of one layout, shape (n,). ``stamps``: the time field as on the wire."""
        out = Spool(np.float64)
        astray = [np.empty(0, np.int64)]
        for rows in spans(index):
            received = self._received(index[rows])
            if stamps is None:
                out.append(received / 1e6)
                continue
            stamp = _unwrapped(layout, stamps[rows], received)
            near = np.abs(stamp - received) <= _AGREE_US
            direct = self._ours(index[rows]) & near & (stamp > 0)
            out.append(np.where(direct, stamp, received) / 1e6)
            astray.append(rows.start + np.flatnonzero(~direct))
        times = out.array()
        others = np.concatenate(astray)
        if stamps is None or not len(others):
            return times
        times = times.copy()
        times_us = self._of_others(layout, index[others], stamps[others])
        times[others] = times_us / 1e6
        return times

    def _of_others(self, layout: Layout, index: Whole, stamps: NDArray[np.uint64]) -> Whole:
        """Boot times (n,) of messages whose stamps are not of the autopilot's clock, or damaged."""
        received = self._received(index)
        stamp = _unwrapped(layout, stamps, received)
        component = self._log.component[index]
        out = received.copy()
        for sender in np.unique(component[stamp > 0]):
            rows = np.flatnonzero((component == sender) & (stamp > 0))
            of_1970 = (stamp[rows] > _UNIX_US).all()
            if sender == AUTOPILOT_COMPONENT and not of_1970:
                self.stamps_repaired += len(rows)
            else:
                out[rows] = self._moved(index[rows], stamp[rows])
        return out

    def _moved(self, place: Whole, stamp_us: Whole) -> Whole:
        """Stamps (n,) of another clock on the boot axis; one that its arrival contradicts is placed by its arrival."""
        received = self._received(place)
        offset = Envelope(place, received, received - stamp_us)
        moved = stamp_us + offset.at(place)
        agrees = np.abs(moved - received) <= _AGREE_US
        return np.maximum(np.where(agrees, moved, received), 0)


def _unwrapped(layout: Layout, stamps: NDArray[np.uint64], received: Whole) -> Whole:
    """Stamps (n,) of the wire in microseconds, as near to ``received`` as the bits that they lack allow."""
    stamp = np.minimum(stamps, np.uint64(2**62)).astype(np.int64)
    if layout.stamp is Stamp.BOOT_MS:
        stamp *= 1000
    if layout.stamp in _WRAPS_US:
        wrap_us = _WRAPS_US[layout.stamp]
        wraps = np.rint((received - stamp) / wrap_us).astype(np.int64)
        stamp += wraps * wrap_us
    return stamp
