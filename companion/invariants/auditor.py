"""The checker: frames of both directions in order, as a .tlog holds them, and decisions where there are any.

One checker for simulated flights, tests and recordings. It knows nothing of the program's state, only of the protocol:
a requirement counts as kept where the messages themselves show it.
"""

from __future__ import annotations

from companion.invariants.heard import Heard
from companion.invariants.offsets import OffsetChecks
from companion.invariants.requirements import Audit, Requirement
from companion.invariants.setpoints import SetpointChecks
from companion.mavlink import OWN_COMPONENT
from companion.mavlink.dialect import ID_OF
from companion.mavlink.message_filter import Intake
from companion.mavlink.message_table import LAYOUTS
from companion.mavlink.setpoints import SET_ATTITUDE_TARGET, SET_POSITION_TARGET
from companion.mavlink.wire_frames import Frame, unpacked
from companion.state.decision import Decision
from models.vehicle import Vehicle

_COMMAND_LONG = 76
_SET_MESSAGE_INTERVAL = 511
_NAMED_VALUE_FLOAT = 251
"""MAVLink numbers: a message, the one command in it that is sent, and a message."""
_DECLARED = {
    ID_OF[name]
    for name in (
        "HEARTBEAT",
        "PARAM_REQUEST_READ",
        "COMMAND_LONG",
        "NAMED_VALUE_FLOAT",
        "STATUSTEXT",
        "TIMESYNC",
        "SET_ATTITUDE_TARGET",
        "SET_POSITION_TARGET_LOCAL_NED",
    )
}


class Auditor:
    """Takes frames and decisions in order; ``audit`` says how it stands.

    ``vehicle`` None: limits are the defaults of a vehicle file, and only rangefinders as a whole can be missed.
    ``hold`` False: setpoints of an upstream controller are forwarded, whose thrust and positions are its own business.
    """

    def __init__(
        self,
        vehicle: Vehicle | None = None,
        *,
        hold: bool = True,
        dry_run: bool = False,
        system: int | None = None,
    ) -> None:
        self.audit = Audit()
        self._vehicle = vehicle
        self._intake = Intake(system)
        self._heard = Heard(vehicle=vehicle)
        self._offsets = OffsetChecks(self.audit, vehicle, hold=hold)
        self._setpoints = SetpointChecks(
            self.audit, self._intake, vehicle, hold=hold, dry_run=dry_run
        )
        self._start_us: int | None = None
        self._boot = 0

    def frame(self, arrival_us: int, frame: Frame) -> None:
        """One frame of either direction."""
        if self._start_us is None:
            self._start_us = arrival_us
        self.audit.now_s = (arrival_us - self._start_us) / 1e6
        if frame.component == OWN_COMPONENT:
            if self._intake.system in (None, frame.system):
                self._check_own(arrival_us, frame)
            return
        if frame.id not in LAYOUTS:
            return
        sample = self._intake.sample(frame, arrival_us)
        if self._intake.clock.boot != self._boot:
            self._boot = self._intake.clock.boot
            self._heard = Heard(vehicle=self._vehicle)
            self._setpoints.start_over()
            self._offsets.start_over()
        if sample is not None:
            self._heard.take(sample, arrival_us)

    def decision(self, decision: Decision) -> None:
        """What was decided on the frames so far; its offset is then checked exactly and at every setpoint."""
        self._offsets.decision(decision, self._heard)

    def _check_own(self, arrival_us: int, frame: Frame) -> None:
        """A frame that the flight program sent."""
        self.audit.sent += 1
        declared = frame.id in _DECLARED
        if frame.id == SET_ATTITUDE_TARGET:
            self._setpoints.attitude(unpacked(frame.id, frame.payload), self._heard, arrival_us)
        elif frame.id == SET_POSITION_TARGET:
            self._setpoints.position(unpacked(frame.id, frame.payload), self._heard, arrival_us)
        elif frame.id == _NAMED_VALUE_FLOAT:
            _, value, name = unpacked(frame.id, frame.payload)
            word = name.rstrip(b"\0").decode("ascii", "replace")
            self._offsets.named_value(word, value, self._heard)
        elif frame.id == _COMMAND_LONG:
            declared = unpacked(frame.id, frame.payload)[7] == _SET_MESSAGE_INTERVAL
        text = f"message {frame.id}, {frame.payload[:33].hex()}"
        self.audit.check(Requirement.DECLARED, declared, text)
