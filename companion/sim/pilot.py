"""The scripted pilot: a ground station (system 255) that arms, takes off and flies a scenario's reference."""

from __future__ import annotations

import math
from enum import Enum
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.sim.autopilot import Mode
from companion.sim.flight import Flight
from companion.sim.link import (
    COMPANION,
    PILOT_COMPONENT,
    PILOT_SYSTEM,
    PX4_MODES,
    SYSTEM,
    VehicleLink,
)
from companion.sim.px4 import Px4

POSITION_AND_VELOCITY = 0x1C0 | 0x800
"""type_mask: position, velocity and yaw are commanded; acceleration and yaw rate are not."""
PERIOD_S = 0.05
"""Targets at 20 Hz."""
TAKE_OFF_S = 2.0
"""Boot time at which it takes off."""
SCRIPT_S = 12.0
"""Boot time at which the script begins, when the companion is ready by then."""
SETTLED_S = 3.0
"""For so long the companion must have been flying before the script begins."""
PATIENCE_S = 45.0
"""Wall-clock seconds after boot at which the script begins at the latest, flown by the autopilot if need be."""


class Recipient(Enum):
    """To whom the pilot speaks while the script runs."""

    AUTOPILOT = "autopilot"
    COMPANION = "companion"
    NONE = "none"


class ScriptedPilot:
    """Speaks real messages: to the autopilot directly, to the companion through the autopilot's router."""

    def __init__(
        self, flight: Flight, link: VehicleLink, recipient: Recipient, *, endless: bool, speed: float = 1.0
    ) -> None:
        self._flight = flight
        self._link = link
        self._recipient = recipient
        self._endless = endless
        self._patience_s = PATIENCE_S * max(1.0, speed)
        self._next_s = 0.0
        self._heartbeat_s = 0.0
        self._took_off = False
        self._companion_flies = False

    @property
    def over(self) -> bool:
        """The script has ended; an endless one never does."""
        return not self._endless and self._flight.script_s > self._flight.scenario.duration_s

    def step(self) -> None:
        """Act when due. Call once per physics step."""
        now = self._flight.time_s
        if self._recipient is Recipient.NONE or now < self._next_s:
            return
        self._next_s = now + PERIOD_S
        if now >= self._heartbeat_s:
            self._heartbeat_s += 1.0
            self._link.route(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
        if now < TAKE_OFF_S:
            return
        if not self._took_off:
            self._take_off()
            return
        flight = self._flight
        if math.isinf(flight.script_began_s):
            if (now >= SCRIPT_S and self._ready()) or now >= self._patience_s:
                flight.script_began_s = now
                # Whoever begins the script keeps it: a companion that falls silent meets GUID_TIMEOUT, as it would.
                self._companion_flies = self._recipient is Recipient.COMPANION and self._flowing()
            elif now > TAKE_OFF_S + 5.0:
                self._send_reference()
                self._enter_offboard()
            return
        if self._endless and flight.script_s > flight.scenario.duration_s:
            flight.script_began_s = now
        self._send_reference()

    def _ready(self) -> bool:
        """The companion, where it is to fly, is flying."""
        settled = self._flight.time_s - self._link.attitude_since_s > SETTLED_S
        return self._recipient is not Recipient.COMPANION or (self._flowing() and settled)

    def _flowing(self) -> bool:
        """The companion's attitude stream reaches the autopilot."""
        return self._flight.time_s - self._link.attitude_stream_s < 0.3

    def _take_off(self) -> None:
        flight, pilot = self._flight, self._flight.autopilot
        if not flight.px4 and pilot.mode is not Mode.GUIDED:
            self.set_mode(Mode.GUIDED)
        elif not pilot.armed:
            self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
        else:
            height = -self._flight.scenario.reference(-1.0).position[2]
            self._command(mavlink.MAV_CMD_NAV_TAKEOFF, p7=height)
            self._took_off = True

    def set_mode(self, mode: Mode) -> None:
        """Ask for a mode."""
        main, sub = PX4_MODES[mode] if self._flight.px4 else (int(mode), 0)
        self._command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, float(main), float(sub))

    def _enter_offboard(self) -> None:
        """PX4 takes off in a mode of its own; OFFBOARD once somebody's stream has been running for a second."""
        pilot = self._flight.autopilot
        if isinstance(pilot, Px4) and pilot.mode is Mode.LOITER and pilot.stream_runs:
            self.set_mode(Mode.GUIDED)

    def _command(self, number: int, p1: float = 0.0, p2: float = 0.0, p3: float = 0.0, p7: float = 0.0) -> None:
        self._to_autopilot(mavlink.MAVLink_command_long_message(SYSTEM, 1, number, 0, p1, p2, p3, 0.0, 0.0, 0.0, p7))

    def _send_reference(self) -> None:
        begun = math.isfinite(self._flight.script_began_s)
        if self._companion_flies if begun else self._recipient is Recipient.COMPANION and self._flowing():
            self._link.route(self._position_message(COMPANION))
        elif self._recipient is Recipient.AUTOPILOT or begun:
            self._to_autopilot(self._position_message(mavlink.MAV_COMP_ID_AUTOPILOT1))

    def _position_message(self, component: int) -> Any:
        r = self._flight.reference
        return mavlink.MAVLink_set_position_target_local_ned_message(
            self._link.boot_ms,
            SYSTEM,
            component,
            mavlink.MAV_FRAME_LOCAL_NED,
            POSITION_AND_VELOCITY,
            *r.position,
            *r.velocity,
            *(0.0, 0.0, 0.0),
            0.0,
            0.0,
        )

    def _to_autopilot(self, message: Any) -> None:
        self._link.hear(message, PILOT_SYSTEM, PILOT_COMPONENT)
