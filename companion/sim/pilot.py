"""The scripted pilot: a ground station (system 255) that arms, takes off and flies a scenario's reference."""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.sim.autopilot import Mode
from companion.sim.flight import SimulatedFlight
from companion.sim.link import AUTOPILOT, COMPANION, SYSTEM, VehicleLink

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
"""Boot time at which the script begins at the latest, flown by the autopilot if need be."""


class ScriptedPilot:
    """Speaks real messages: to the autopilot directly, to the companion through the autopilot's router.

    ``companion``: the companion is to fly the script, not the autopilot. ``endless``: again and again.
    """

    link: type[VehicleLink] = VehicleLink
    """The kind of link over which it flies."""
    take_off_mode = Mode.GUIDED

    def __init__(
        self, flight: SimulatedFlight, link: VehicleLink, *, companion: bool, endless: bool = False
    ) -> None:
        self._flight = flight
        self._link = link
        self._companion = companion
        self._endless = endless
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
        if now < self._next_s:
            return
        self._next_s = now + PERIOD_S
        if now >= self._heartbeat_s:
            self._heartbeat_s += 1.0
            self._link.route(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
        if not self._took_off:
            if now >= TAKE_OFF_S:
                self._take_off()
        elif self._begun:
            if self._endless and self._flight.script_s > self._flight.scenario.duration_s:
                self._flight.script_began_s = now
            self._send_reference()
        elif (now >= SCRIPT_S and self._ready()) or now >= PATIENCE_S:
            self._flight.script_began_s = now
            # Whoever begins the script keeps it: a companion that falls silent meets GUID_TIMEOUT, as it would.
            self._companion_flies = self._companion and self._flowing()
        elif now > TAKE_OFF_S + 5.0:
            self._wait()

    @property
    def _begun(self) -> bool:
        return math.isfinite(self._flight.script_began_s)

    def _ready(self) -> bool:
        """The companion, where it is to fly, is flying."""
        settled = self._flight.time_s - self._link.attitude_since_s > SETTLED_S
        return not self._companion or (self._flowing() and settled)

    def _flowing(self) -> bool:
        """The companion's attitude stream reaches the autopilot."""
        return self._flight.time_s - self._link.attitude_stream_s < 0.3

    def _take_off(self) -> None:
        pilot = self._flight.autopilot
        if pilot.mode is not self.take_off_mode:
            self.set_mode(self.take_off_mode)
        elif not pilot.armed:
            self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
        else:
            height = -self._flight.scenario.reference(-1.0).position[2]
            self._command(mavlink.MAV_CMD_NAV_TAKEOFF, p7=height)
            self._took_off = True

    def set_mode(self, mode: Mode) -> None:
        """Ask for a mode."""
        self._command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, *self._link.mode_numbers(mode))

    def _wait(self) -> None:
        """In the air, before the script begins."""
        self._send_reference()

    def _command(
        self, number: int, p1: float = 0.0, p2: float = 0.0, p3: float = 0.0, p7: float = 0.0
    ) -> None:
        self._link.hear(
            mavlink.MAVLink_command_long_message(
                target_system=SYSTEM,
                target_component=1,
                command=number,
                confirmation=0,
                param1=p1,
                param2=p2,
                param3=p3,
                param4=0.0,
                param5=0.0,
                param6=0.0,
                param7=p7,
            )
        )

    def _send_reference(self) -> None:
        if self._companion_flies if self._begun else self._companion and self._flowing():
            self._link.route(self._position_message(COMPANION))
        elif self._begun or not self._companion:
            self._link.hear(self._position_message(AUTOPILOT))

    def _position_message(self, component: int) -> Any:
        r = self._flight.reference
        nothing = (0.0, 0.0, 0.0, 0.0, 0.0)
        return mavlink.MAVLink_set_position_target_local_ned_message(
            self._link.boot_ms,
            SYSTEM,
            component,
            mavlink.MAV_FRAME_LOCAL_NED,
            POSITION_AND_VELOCITY,
            *r.position,
            *r.velocity,
            *nothing,
        )
