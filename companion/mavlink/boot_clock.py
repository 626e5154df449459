"""One time axis per vehicle: seconds since the autopilot's boot, for stamped and unstamped messages alike.

Pure in message content and arrival stamps (integer microseconds of the receiver's clock): the same messages with the
same stamps give the same times, in flight and in replay, bit for bit.

- The axis is the autopilot's own ``time_boot_ms``, unwrapped (32 bits of milliseconds wrap after 49.7 days).
- A message without a stamp (HEARTBEAT, ESC_TELEMETRY, BATTERY_STATUS, RPM, RANGEFINDER) is put on it by arrival:
  t = arrival - offset, the offset being the smallest (arrival - stamp) seen lately, since latency only ever adds.
- A sender with a clock of its own (another component, or a stamp in Unix time) has its own smallest (arrival - stamp);
  the difference of the two puts it on the axis. No sender can move the axis but the autopilot.
- How late a message is (``late``) is its arrival against the smallest (arrival - stamp) since boot. This grows only
  where the vehicle's clock runs steadily slower than the receiver's (a simulator on a loaded machine), which is learned
  from the last seconds; a link that falls behind is a step, and stays late.
- A round trip (TIMESYNC) tells a clock that was set back, stood still or drifted from a late link: its answer cannot
  have been stamped before it was asked for. A smallest (arrival - stamp) below what that allows counts no more, and
  ``set_back_s`` says by how much the clock was behind.
- Stamps that go back by more than a second, twice running, are a reboot: ``boot`` counts up and the axis starts anew.
"""

from __future__ import annotations

from collections import deque
from enum import Enum

import numpy as np

from companion.mavlink import AUTOPILOT_COMPONENT

_WINDOW_US = (
    2_000_000  # an offset lives one to two windows: clock drift of 100 ppm then costs 0.4 ms
)
_BACK_US = 1_000_000  # samples are stamped up to some 0.3 s before they are sent, in any order
_BEHIND_US = 100_000  # less is lateness of the answer
_AHEAD_US = 10_000_000  # no stamp runs further ahead of the receiver's clock
_SLOPE_WINDOW_US = (
    500_000  # long enough for 25 stamps at 50 Hz, the earliest of which was hardly delayed
)
_SLOPES = 16  # eight seconds
_LEARNING = 4  # the first slopes only teach: 2 s
_FASTEST_DRIFT = 0.5  # a simulator at half of real time
_QUARTZ = 1e-3  # ten times what two quartz clocks drift apart
_UNIX_US = 10**15  # as Unix time September 2001, as boot time 31 years
_SAME_CLOCK_US = 5_000_000  # two counters of one boot differ by less than it takes to start
_WRAP_MS_US = 2**32 * 1000
_WRAP_US = 2**32


class Stamp(Enum):
    """What a time field counts."""

    BOOT_MS = "32-bit milliseconds since boot"
    BOOT_US32 = "32-bit microseconds since boot"
    US64 = "64-bit microseconds since boot or since 1970: which one is for the receiver to tell"


class _Envelope:
    """The smallest offset of the current and the previous window."""

    __slots__ = ("_current", "_previous", "_until")

    def __init__(self, offset_us: int, now_us: int) -> None:
        self._current = self._previous = offset_us
        self._until = now_us + _WINDOW_US

    def update(self, offset_us: int, now_us: int) -> None:
        if now_us >= self._until:
            lapsed = now_us >= self._until + _WINDOW_US
            self._previous = offset_us if lapsed else self._current
            self._current = offset_us
            self._until = now_us + _WINDOW_US
        elif offset_us < self._current:
            self._current = offset_us

    @property
    def offset_us(self) -> int:
        return min(self._current, self._previous)


class _Quickest:
    """The smallest (arrival - stamp) since boot, growing as steadily as the two clocks drift apart.

    The drift is the median slope between the smallest offsets of half-second windows over the last eight seconds: a
    step changes one slope in sixteen, a slow clock all of them.
    """

    __slots__ = ("_at_us", "_before", "_offset_us", "_rate", "_slopes", "_smallest", "_until_us")

    def __init__(self, offset_us: int, arrival_us: int) -> None:
        self._offset_us = float(offset_us)
        self._at_us = arrival_us
        self._rate = 0.0
        self._slopes: deque[float] = deque(maxlen=_SLOPES)
        self._smallest = (offset_us, arrival_us)
        self._before: tuple[int, int] | None = None
        self._until_us = arrival_us + _SLOPE_WINDOW_US

    def at(self, arrival_us: int) -> float:
        """The smallest offset [us] expected of a message that arrives now."""
        since_us = arrival_us - self._at_us
        if since_us > 0:
            return self._offset_us + self._rate * since_us
        return self._offset_us

    def update(self, offset_us: int, arrival_us: int) -> None:
        over = arrival_us >= self._until_us
        if over:
            self._close(arrival_us)
        if over or offset_us < self._smallest[0]:
            self._smallest = (offset_us, arrival_us)
        if offset_us < self.at(arrival_us):
            self._offset_us = float(offset_us)
            self._at_us = arrival_us

    def _close(self, arrival_us: int) -> None:
        before = self._before
        now = self._smallest
        self._before = now
        self._until_us = arrival_us + _SLOPE_WINDOW_US
        if before is not None and now[1] > before[1]:
            self._slopes.append((now[0] - before[0]) / (now[1] - before[1]))
        expected = self.at(arrival_us)
        if self._slopes:
            # Half more than the median, so that a drift that is not quite steady adds up to nothing.
            self._rate = min(
                max(1.5 * float(np.median(self._slopes)), 0.0) + _QUARTZ, _FASTEST_DRIFT
            )
        if len(self._slopes) <= _LEARNING:
            expected = max(expected, now[0] + self._rate * (arrival_us - now[1]))
        self._offset_us = expected
        self._at_us = arrival_us


class BootClock:
    """The boot axis of one vehicle.

    ``system`` None: the system of the first stamped autopilot message. ``boot`` counts reboots seen, from 0.
    Before the first stamp of the autopilot the axis is not known; times are then 0.0 ("at boot or later"), so that
    heartbeats and parameters are not lost and time never runs backwards within a boot.
    """

    def __init__(self, system: int | None = None) -> None:
        self.system = system
        self.boot = 0
        self.set_back_s = 0.0
        """By how much the clock was last set back, or stood still, in the midst of a boot."""
        self._last_us = -1  # newest stamp of the axis; below 0 while there is none
        self._last_arrival_us = 0
        self._suspect_us = -1  # a stamp that does not fit, kept until the next one decides
        self._suspect_arrival_us = 0
        self._envelope = _Envelope(0, 0)
        self._quickest = _Quickest(0, 0)
        self._others: dict[tuple[int, int, bool], _Envelope] = {}

    @property
    def known(self) -> bool:
        """True once the autopilot has stamped a message."""
        return self._last_us >= 0

    def unstamped(self, arrival_us: int) -> float:
        """Boot time [s] of a message without a stamp. Links keep order: it is not older than the newest stamp."""
        if not self.known:
            return 0.0
        return max(arrival_us - self._envelope.offset_us, self._last_us) / 1e6

    def late(self, t_s: float, arrival_us: int) -> float:
        """Seconds by which a message of boot time ``t_s`` arrived later than the quickest message would have."""
        late_us = arrival_us - self._quickest.at(arrival_us) - t_s * 1e6
        if late_us > 0.0 and self._last_us >= 0:
            return late_us / 1e6
        return 0.0

    def answered(self, asked_us: int, clock_us: int, arrival_us: int) -> None:
        """An answer of the autopilot whose clock read ``clock_us`` after the question left at ``asked_us``.

        So (arrival - stamp) is at least asked - clock: what is later than a message before says nothing of the link.
        """
        least_us = asked_us - clock_us
        if not self.known or abs(clock_us - self._last_us) > _SAME_CLOCK_US:
            return
        if (behind_us := least_us - self._quickest.at(arrival_us)) > _BEHIND_US:
            self.set_back_s = behind_us / 1e6
            self._quickest = _Quickest(least_us, arrival_us)

    def stamped(
        self, system: int, component: int, unit: Stamp, stamp: int, arrival_us: int
    ) -> float:
        """Boot time [s] of a message whose time field reads ``stamp``. A stamp of 0 is no stamp."""
        if stamp <= 0:
            return self.unstamped(arrival_us)
        if self.system is None and component == AUTOPILOT_COMPONENT and unit is Stamp.BOOT_MS:
            self.system = system
        ours = system == self.system and component == AUTOPILOT_COMPONENT
        if unit is Stamp.BOOT_MS:
            stamp *= 1000
            if ours:
                return self._main(stamp, arrival_us)
            return self._other(system, component, stamp, arrival_us)
        if unit is Stamp.BOOT_US32:
            if not self.known:
                return 0.0
            stamp += round((self._last_us - stamp) / _WRAP_US) * _WRAP_US
            if stamp < 0:
                return self.unstamped(arrival_us)
        if ours and self.known and abs(stamp - self._last_us) <= _SAME_CLOCK_US:
            return stamp / 1e6
        return self._other(system, component, stamp, arrival_us)

    def _main(self, stamp_us: int, arrival_us: int) -> float:
        """Advance the axis by an autopilot's millisecond stamp, unless the stamp cannot be true."""
        last = self._last_us
        if last < 0:
            return self._restart(stamp_us, arrival_us)
        if last - _BACK_US <= stamp_us <= last + _AHEAD_US:
            return self._advance(stamp_us, arrival_us)  # as nearly always
        limit = last + max(arrival_us - self._last_arrival_us, 0) + _AHEAD_US
        stamp_us += last // _WRAP_MS_US * _WRAP_MS_US
        if stamp_us < last - _BACK_US and stamp_us + _WRAP_MS_US <= limit:
            stamp_us += _WRAP_MS_US
        elif stamp_us > limit and stamp_us - _WRAP_MS_US >= max(last - _BACK_US, 0):
            stamp_us -= _WRAP_MS_US
        if last - _BACK_US <= stamp_us <= limit:
            return self._advance(stamp_us, arrival_us)
        suspect = self._suspect_us
        ahead = max(arrival_us - self._suspect_arrival_us, 0) + _AHEAD_US
        if suspect >= 0 and suspect - _BACK_US <= stamp_us <= suspect + ahead:
            if stamp_us < last:
                self.boot += 1
                stamp_us %= _WRAP_MS_US
            return self._restart(stamp_us, arrival_us)
        self._suspect_us = stamp_us
        self._suspect_arrival_us = arrival_us
        return self.unstamped(arrival_us)

    def _advance(self, stamp_us: int, arrival_us: int) -> float:
        self._suspect_us = -1
        self._envelope.update(arrival_us - stamp_us, stamp_us)
        self._quickest.update(arrival_us - stamp_us, arrival_us)
        if stamp_us > self._last_us:
            self._last_us = stamp_us
            self._last_arrival_us = arrival_us
        return stamp_us / 1e6

    def _restart(self, stamp_us: int, arrival_us: int) -> float:
        self._last_us = stamp_us
        self._last_arrival_us = arrival_us
        self._suspect_us = -1
        self._envelope = _Envelope(arrival_us - stamp_us, stamp_us)
        self._quickest = _Quickest(arrival_us - stamp_us, arrival_us)
        self._others.clear()
        return stamp_us / 1e6

    def _other(self, system: int, component: int, stamp_us: int, arrival_us: int) -> float:
        """A stamp of another clock, on the axis through both clocks' smallest (arrival - stamp)."""
        if not self.known:
            return 0.0
        key = (system, component, stamp_us >= _UNIX_US)
        envelope = self._others.get(key)
        offset = arrival_us - stamp_us
        # A clock that was set, or a sender that restarted, is a new clock.
        if envelope is None or abs(offset - envelope.offset_us) > _AHEAD_US:
            envelope = self._others[key] = _Envelope(offset, stamp_us)
        else:
            envelope.update(offset, stamp_us)
        return max(stamp_us + envelope.offset_us - self._envelope.offset_us, 0) / 1e6
