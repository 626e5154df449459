"""One time axis per vehicle: seconds since the autopilot's boot, for stamped and unstamped messages alike.

Pure in message content and arrival stamps (integer microseconds of the receiver's clock): the same messages with the
same stamps give the same times, in flight and in replay, bit for bit.

- The axis is the autopilot's own ``time_boot_ms``, unwrapped (32 bits of milliseconds wrap after 49.7 days).
- A message without a stamp (HEARTBEAT, ESC_TELEMETRY, BATTERY_STATUS, RPM, RANGEFINDER) is put on it by arrival:
  t = arrival - offset, the offset being the smallest (arrival - stamp) seen lately, since latency only ever adds.
- A sender with a clock of its own (another component, or a stamp in Unix time) has its own smallest (arrival - stamp);
  the difference of the two puts it on the axis. No sender can move the axis but the autopilot.
- How late a message is (``late``) is its arrival against the smallest (arrival - stamp) seen since boot, which may grow
  by 0.1 % at most: enough for a clock that drifts, too little for a link that fell behind.
- Stamps that go back by more than a second, twice running, are a reboot: ``boot`` counts up and the axis starts anew.
"""

from __future__ import annotations

from enum import Enum

AUTOPILOT = 1  # MAV_COMP_ID_AUTOPILOT1

_WINDOW_US = 2_000_000  # an offset lives one to two windows: clock drift of 100 ppm then costs 0.4 ms
_BACK_US = 1_000_000  # samples are stamped up to some 0.3 s before they are sent, in any order
_AHEAD_US = 10_000_000  # no stamp runs further ahead of the receiver's clock
_DRIFT = 1000  # the smallest offset may grow by one part in this: ten times what quartz clocks differ by
_UNIX_US = 10**15  # as Unix time September 2001, as boot time 31 years
_SAME_CLOCK_US = 5_000_000
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


class BootClock:
    """The boot axis of one vehicle.

    ``system`` None: the system of the first stamped autopilot message. ``boot`` counts reboots seen, from 0.
    Before the first stamp of the autopilot the axis is not known; times are then 0.0 ("at boot or later"), so that
    heartbeats and parameters are not lost and time never runs backwards within a boot.
    """

    def __init__(self, system: int | None = None, component: int = AUTOPILOT) -> None:
        self.system = system
        self.component = component
        self.boot = 0
        self._last_us = -1  # newest stamp of the axis; below 0 while there is none
        self._last_arrival_us = 0
        self._suspect_us = -1  # a stamp that does not fit, kept until the next one decides
        self._suspect_arrival_us = 0
        self._envelope = _Envelope(0, 0)
        self._quickest_us, self._quickest_at_us = 0, 0  # smallest (arrival - stamp), and the arrival it was seen at
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
        if not self.known:
            return 0.0
        return max(arrival_us - self._quickest(arrival_us) - t_s * 1e6, 0.0) / 1e6

    def _quickest(self, arrival_us: int) -> int:
        return self._quickest_us + max(arrival_us - self._quickest_at_us, 0) // _DRIFT

    def stamped(self, system: int, component: int, unit: Stamp, stamp: int, arrival_us: int) -> float:
        """Boot time [s] of a message whose time field reads ``stamp``. A stamp of 0 is no stamp."""
        if stamp <= 0:
            return self.unstamped(arrival_us)
        if self.system is None and component == self.component and unit is Stamp.BOOT_MS:
            self.system = system
        ours = system == self.system and component == self.component
        if unit is Stamp.BOOT_MS:
            return (
                self._main(stamp * 1000, arrival_us)
                if ours
                else self._other(system, component, stamp * 1000, arrival_us)
            )
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
        if not self.known:
            return self._restart(stamp_us, arrival_us)
        last = self._last_us
        limit = last + max(arrival_us - self._last_arrival_us, 0) + _AHEAD_US
        stamp_us += last // _WRAP_MS_US * _WRAP_MS_US
        if stamp_us < last - _BACK_US and stamp_us + _WRAP_MS_US <= limit:
            stamp_us += _WRAP_MS_US
        elif stamp_us > limit and stamp_us - _WRAP_MS_US >= max(last - _BACK_US, 0):
            stamp_us -= _WRAP_MS_US
        if last - _BACK_US <= stamp_us <= limit:
            self._suspect_us = -1
            self._envelope.update(arrival_us - stamp_us, stamp_us)
            if arrival_us - stamp_us < self._quickest(arrival_us):
                self._quickest_us, self._quickest_at_us = arrival_us - stamp_us, arrival_us
            if stamp_us > last:
                self._last_us, self._last_arrival_us = stamp_us, arrival_us
            return stamp_us / 1e6
        suspect = self._suspect_us
        ahead = max(arrival_us - self._suspect_arrival_us, 0) + _AHEAD_US
        if suspect >= 0 and suspect - _BACK_US <= stamp_us <= suspect + ahead:
            if stamp_us < last:
                self.boot += 1
                stamp_us %= _WRAP_MS_US
            return self._restart(stamp_us, arrival_us)
        self._suspect_us, self._suspect_arrival_us = stamp_us, arrival_us
        return self.unstamped(arrival_us)

    def _restart(self, stamp_us: int, arrival_us: int) -> float:
        self._last_us, self._last_arrival_us, self._suspect_us = stamp_us, arrival_us, -1
        self._envelope = _Envelope(arrival_us - stamp_us, stamp_us)
        self._quickest_us, self._quickest_at_us = arrival_us - stamp_us, arrival_us
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
