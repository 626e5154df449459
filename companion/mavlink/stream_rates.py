"""Asks for the messages the pipeline needs, watches what arrives, and asks again: other stations rewrite rates."""

from __future__ import annotations

from collections import Counter, deque
from typing import NamedTuple

from companion.mavlink.dialect import ID_OF
from companion.mavlink.firmware import Stack
from companion.mavlink.message_table import LAYOUTS
from companion.mavlink.outgoing import Message, command_long
from models.vehicle import Vehicle

_CHECK_S = 2.0
"""Rates are counted over this time: the slowest stream asked for sends two messages in it."""
_PARTS = 8
"""So often counts are taken in that time."""
_IN_VAIN = 3
"""Requests in a row after which a slow stream is reported to the pilot."""
_GLANCE = 10
"""A stream that was fast enough is looked at over a quarter of that time, if so many messages are due in it: a station
that sets rates back, as MAVProxy does every 15 s, would else take the ranges away for up to 2.6 s."""
_ENOUGH = 0.7
"""Of the rate asked for: autopilots round periods to their own loop, and links lose messages."""
_SET_MESSAGE_INTERVAL = 511
"""MAV_CMD_SET_MESSAGE_INTERVAL."""


class Wanted(NamedTuple):
    """A message id, the rate asked for, and whether flying needs it."""

    message_id: int
    hz: float
    needed: bool


def wanted_streams(vehicle: Vehicle, stack: Stack, *, recorded: bool = False) -> tuple[Wanted, ...]:
    """What to ask for; ESC groups by the ESC numbers of the vehicle file, PX4's ESC dialect on PX4.

    ``recorded``: the diagnosis will want outputs, which control does not need (docs/autopilots.md). Accelerations are
    the witness that says which is wrong where position and wall range part.
    """
    px4 = stack is Stack.PX4
    sensors = vehicle.rangefinders
    groups = sorted(
        {(rotor.esc - 1) // 4 * 4 + 1 for rotor in vehicle.rotors if rotor.esc is not None}
    )
    outputs = recorded or bool(vehicle.vanes) or not vehicle.telemetered
    table = [
        ("ATTITUDE_QUATERNION", 50.0, True, True),
        ("LOCAL_POSITION_NED", 50.0, True, True),
        ("ATTITUDE_TARGET", 20.0, False, True),
        # A change of mode is known after a fifth of a second rather than after one.
        ("HEARTBEAT", 5.0, False, True),
        ("EXTENDED_SYS_STATE", 2.0, False, True),
        ("BATTERY_STATUS", 2.0, False, True),
        ("SCALED_PRESSURE", 1.0, False, True),
        ("HIGHRES_IMU", 50.0, False, True),
        ("SERVO_OUTPUT_RAW", 50.0, not vehicle.telemetered, outputs),
        ("DISTANCE_SENSOR", 25.0, True, any(not sensor.ring for sensor in sensors)),
        ("OBSTACLE_DISTANCE", 10.0, True, any(sensor.ring for sensor in sensors)),
        ("ESTIMATOR_STATUS" if px4 else "EKF_STATUS_REPORT", 5.0, False, True),
        ("ESC_STATUS", 25.0, True, px4 and bool(groups)),
        ("ESC_INFO", 1.0, False, px4 and bool(groups)),
        *((f"ESC_TELEMETRY_{first}_TO_{first + 3}", 25.0, True, not px4) for first in groups),
    ]
    return tuple(
        Wanted(ID_OF[name], hz, needed) for name, hz, needed, asked_for in table if asked_for
    )


class StreamKeeper:
    """Counts arrivals by id and says which requests to send again. Times are the receiver's clock [s]."""

    def __init__(self, wanted: tuple[Wanted, ...]) -> None:
        self.wanted = wanted
        self._count = dict.fromkeys((w.message_id for w in wanted), 0)
        self._noted: deque[tuple[float, dict[int, int]]] = deque(maxlen=_PARTS + 1)
        """Counts of the last two seconds and when they were taken, eight a period: the same memory at any rate."""
        self._checked_s: float | None = None
        self._fast: set[int] = set()
        """Streams that were fast enough when last looked at."""
        self._in_a_row: Counter[int] = Counter()
        self.in_vain: dict[str, float] = {}
        """Needed messages that stay slow [Hz] though they were asked for several times, by name."""
        self.set_back: Counter[str] = Counter()
        """How often needed messages became slow while others came as before: somebody else asked for another rate."""

    def heard(self, message_id: int) -> None:
        """Count one arrival. Runs for every message; ``due`` looks at the clock."""
        if message_id in self._count:
            self._count[message_id] += 1

    def rate(self, message_id: int, now_s: float) -> float:
        """Messages of one id per second over the last two seconds."""
        if not self._noted:
            return 0.0
        since_s, then = self._noted[0]
        return (self._count[message_id] - then[message_id]) / max(
            now_s - since_s, _CHECK_S / _PARTS
        )

    def due(self, now_s: float) -> list[Wanted]:
        """What to ask for now: everything at first, then every 2 s what arrives at less than 70 % of its rate.

        What was fast enough until now is asked for within half a second.
        """
        noted = not self._noted or now_s - self._noted[-1][0] >= _CHECK_S / _PARTS
        if noted:
            self._noted.append((now_s, dict(self._count)))
        if self._checked_s is None:
            self._checked_s = now_s
            return list(self.wanted)
        if now_s - self._checked_s < _CHECK_S:
            if noted:
                return self._glance()
            return []
        self._checked_s = now_s
        slow = [w for w in self.wanted if self.rate(w.message_id, now_s) < _ENOUGH * w.hz]
        self._fast = set(self._count) - {w.message_id for w in slow}
        self._in_a_row = Counter({w.message_id: self._in_a_row[w.message_id] + 1 for w in slow})
        for w in slow:
            if w.needed and self._in_a_row[w.message_id] == _IN_VAIN:
                self.in_vain[LAYOUTS[w.message_id].name] = self.rate(w.message_id, now_s)
        return slow

    def _glance(self) -> list[Wanted]:
        """Streams that were fast enough and suddenly are not."""
        if len(self._noted) < 3:
            return []
        (then_s, then), (_, before), (now_s, now) = list(self._noted)[-3:]
        looked = [
            w
            for w in self.wanted
            if w.message_id in self._fast and w.hz * (now_s - then_s) >= _GLANCE
        ]
        ids = [w.message_id for w in looked]
        slow = [
            w
            for w in looked
            if now[w.message_id] - then[w.message_id] < _ENOUGH * w.hz * (now_s - then_s)
        ]
        going_on = any(now[i] - before[i] >= _ENOUGH * (before[i] - then[i]) > 0 for i in ids)
        self._fast -= {w.message_id for w in slow}
        for w in slow:
            if w.needed and going_on:
                self.set_back[LAYOUTS[w.message_id].name] += 1
        return slow

    def restart(self, now_s: float) -> None:
        """Count anew: what was sent while nobody read is no measure."""
        self._noted.clear()
        self._checked_s = now_s

    def forget(self) -> None:
        """After a reboot or a lost link: ask for everything again."""
        self._checked_s = None


def interval_request(wanted: Wanted, system: int) -> Message:
    """SET_MESSAGE_INTERVAL as a command to the autopilot."""
    return command_long(
        system, 1, _SET_MESSAGE_INTERVAL, float(wanted.message_id), float(round(1e6 / wanted.hz))
    )
