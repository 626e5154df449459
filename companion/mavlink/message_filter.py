"""Which messages reach ``step``, live and in replay: one rule, by content alone, so that both decide the same."""

from __future__ import annotations

from companion.mavlink import AUTOPILOT_COMPONENT, NO_AUTOPILOT, OWN_COMPONENT
from companion.mavlink.boot_clock import BootClock
from companion.mavlink.dialect import ID_OF
from companion.mavlink.message_table import LAYOUTS, decode, stamp_of
from companion.mavlink.outgoing import TIMESYNC, timesync_answer
from companion.mavlink.samples import Range, Sample
from companion.mavlink.setpoints import SET_ATTITUDE_TARGET, SET_POSITION_TARGET
from companion.mavlink.wire_frames import Frame

_DOWN_COS = 0.94
"""A beam within 20 degrees of straight down."""
HEARTBEAT = 0
_AUTOPILOT_BYTE = 5
"""Message id, and the place of ``autopilot`` in its payload."""
_ESTIMATES = frozenset(
    ID_OF[name]
    for name in (
        "ATTITUDE",
        "ATTITUDE_QUATERNION",
        "LOCAL_POSITION_NED",
        "EKF_STATUS_REPORT",
        "ESTIMATOR_STATUS",
    )
)
"""What the autopilot alone may say of the vehicle: a camera or a gimbal means its own frame by the same messages."""
_SETPOINTS = (SET_ATTITUDE_TARGET, SET_POSITION_TARGET)

UNREAD = frozenset(number for number, layout in LAYOUTS.items() if layout.build is None)
"""Ids of messages that the pipeline does not read; some are recorded for the diagnosis. Of these only the stamp is
taken."""


def is_autopilot_heartbeat(frame: Frame) -> bool:
    """A HEARTBEAT of a flight controller: component 1, and not the 'no autopilot' of a ground station."""
    if frame.id != HEARTBEAT or frame.component != AUTOPILOT_COMPONENT:
        return False
    if len(frame.payload) > _AUTOPILOT_BYTE:
        autopilot = frame.payload[_AUTOPILOT_BYTE]
    else:
        autopilot = 0
    return autopilot != NO_AUTOPILOT


class Intake:
    """Takes the messages of one vehicle, and the setpoints that others send it, onto its boot axis.

    ``system`` None: the first autopilot heard. What comes before its first heartbeat, from other systems, and from this
    component itself (a log holds both directions) is left out. ``others`` are the autopilots that were ignored.
    RANGEFINDER repeats a downward DISTANCE_SENSOR, without its limits and stamp: left out once one was heard.
    ``unread``: ids whose content nobody wants. Their stamps still move the clock, so that it does not depend on it.
    """

    def __init__(self, system: int | None = None, unread: frozenset[int] = frozenset()) -> None:
        self.system = system
        self.unread = unread
        self.clock = BootClock(system)
        self.others: set[int] = set()
        self.ignored = 0
        """Frames of other systems that were left out."""
        self.not_the_autopilots: set[tuple[int, int]] = set()
        """Message id and component of attitudes and positions that were left out."""
        self._heard = False
        self._down_heard = False

    def sample(self, frame: Frame, arrival_us: int) -> Sample | None:
        """The sample of one frame, or None where it is not for ``step``."""
        system = frame.system
        component = frame.component
        if not self._heard:
            if not is_autopilot_heartbeat(frame) or self.system not in (None, system):
                return None
            self._heard = True
            self.system = self.clock.system = system
        if system == self.system:
            if component == OWN_COMPONENT:
                return None
            if component != AUTOPILOT_COMPONENT and frame.id in _ESTIMATES:
                self.not_the_autopilots.add((frame.id, component))
                return None
        elif frame.id not in _SETPOINTS:
            self.ignored += 1
            if is_autopilot_heartbeat(frame):
                self.others.add(system)
            return None
        if frame.id == TIMESYNC and component == AUTOPILOT_COMPONENT:
            if (found := timesync_answer(frame.payload)) is not None:
                self.clock.answered(*found, arrival_us)
            return None
        if frame.id in self.unread:
            stamp_of(frame, arrival_us, self.clock)
            return None
        sample = decode(frame, arrival_us, self.clock)
        if type(sample) is Range:
            if sample.source == "RANGEFINDER":
                if self._down_heard:
                    return None
                return sample
            self._down_heard |= (
                sample.direction_frd is not None and sample.direction_frd[2] > _DOWN_COS
            )
        return sample
