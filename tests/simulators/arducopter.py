"""The manners of ArduCopter beyond those of the built-in vehicle: modes, sticks, failsafe, settings that are obeyed.

No MAVLink here. Structure and defaults follow ArduCopter's documented parameters; the code is our own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from companion.sim.autopilot import AttitudeDemand, Autopilot, Guided, Mode
from companion.sim.sensors import Estimate
from models.vehicle import Vehicle

STICK_MODES = (Mode.LOITER, Mode.POSHOLD)
"""Modes in which centred sticks hold the place and others fly a velocity."""
STICKS_LOST_S = 0.5
"""Sticks heard longer ago than this count as centred [s]."""
LAND_SPEED_M_S = 0.3
"""Sinking in LAND: ArduCopter's LAND_SPEED is 0.5; less, since the script lands beside a wall."""
GUID_OPTION_THRUST = 8
"""Bit 3 of GUID_OPTIONS: SET_ATTITUDE_TARGET.thrust is thrust."""


@dataclass
class Sticks:
    """The pilot's sticks, -1...1: forward, right, up. ``time_s``: when last heard."""

    forward: float = 0.0
    right: float = 0.0
    up: float = 0.0
    time_s: float = -math.inf


class ArduCopter(Autopilot):
    """Every mode."""

    speed_up_m_s: float = 2.5
    speed_down_m_s: float = 1.5
    """Defaults of PILOT_SPEED_UP and PILOT_SPEED_DN."""
    stream_modes = (Mode.GUIDED, Mode.GUIDED_NOGPS)

    def __init__(self, vehicle: Vehicle, hover: float) -> None:
        super().__init__(vehicle, hover)
        self.sticks = Sticks()
        self._thrust_is_climb_rate = False

    # -- parameters -------------------------------------------------------------------------------------------------

    def default_parameters(self) -> dict[str, float]:
        """The parameters that are published; most are obeyed."""
        more = {
            "PILOT_SPEED_UP": 100.0 * self.speed_up_m_s,
            "LOIT_SPEED": 1250.0,
            "FS_EKF_ACTION": 1.0,
        }
        return {**super().default_parameters(), **more}

    def set_parameter(self, name: str, value: float) -> bool:
        """Store and obey a parameter; False where there is none of that name."""
        if name not in self.parameters:
            return False
        self.parameters[name] = value
        self._obey(self.parameters)
        return True

    def _obey(self, p: dict[str, float]) -> None:
        self.guid_timeout_s = p["GUID_TIMEOUT"]
        self.hover = p["MOT_THST_HOVER"]
        limits = [math.radians(p[f"ATC_ACCEL_{axis}_MAX"] / 100.0) for axis in "RPY"]
        self.gains = replace(
            self.gains,
            input_tc=max(0.02, p["ATC_INPUT_TC"]),
            angle=(p["ATC_ANG_RLL_P"], p["ATC_ANG_PIT_P"], p["ATC_ANG_YAW_P"]),
            accel_max=(limits[0], limits[1], limits[2]),
        )

    @property
    def stick_speed_m_s(self) -> float:
        """Speed at full stick."""
        return self.parameters["LOIT_SPEED"] / 100.0

    # -- commands ---------------------------------------------------------------------------------------------------

    def fly_attitude(self, target: AttitudeDemand) -> None:
        """An attitude, and thrust or a rate of climb."""
        super().fly_attitude(target)
        self._thrust_is_climb_rate = (
            not int(self.parameters.get("GUID_OPTIONS", GUID_OPTION_THRUST)) & GUID_OPTION_THRUST
        )

    def _failsafe(self, now: Estimate) -> None:
        """A position that the EKF does not trust is none: FS_EKF_ACTION 1 lands (modes that need no position go on)."""
        needs = self.mode in (Mode.GUIDED, Mode.RTL, *STICK_MODES)
        if (
            not now.trusted
            and needs
            and not self.landed
            and self.parameters["FS_EKF_ACTION"] == 1.0
        ):
            self.set_mode(Mode.LAND, now)

    # -- the loop ---------------------------------------------------------------------------------------------------

    def _watch_ground(self, now: Estimate, touching: bool) -> None:
        super()._watch_ground(now, touching)
        if self._touched_down and self.mode is Mode.LAND:
            self.armed = False

    def _outer(self, now: Estimate) -> float:
        """Throttle demand; sets the attitude demand."""
        self._failsafe(now)
        if self.mode in STICK_MODES:
            self._follow_sticks(now)
        elif self.mode is Mode.RTL:
            self._return_home(now)
        if self.mode is Mode.LAND:
            return self._land(now)
        if self.guided is Guided.ATTITUDE and self.mode is Mode.GUIDED_NOGPS:
            return self._attitude_command(now)
        if self.mode in (Mode.GUIDED_NOGPS, Mode.ALT_HOLD):
            return self._level(now)
        if self.mode in (Mode.STABILIZE, Mode.GUIDED):
            return super()._outer(now)
        return self._to_target(now)

    def _land(self, now: Estimate) -> float:
        """Sink where it is; level without a position."""
        if not now.trusted:
            self._demand_attitude(0.0, 0.0, self.shaped[2])
            return self._climb(now, -LAND_SPEED_M_S)
        self.target.position = (self.target.position[0], self.target.position[1], None)
        self.target.velocity = (0.0, 0.0, LAND_SPEED_M_S)
        return self._position(now)

    def _follow_sticks(self, now: Estimate) -> None:
        """A stick that is out of its middle flies a velocity; the place where that has ended is held."""
        s, t, top = self.sticks, self.target, self.stick_speed_m_s
        live = self.time_s - s.time_s < STICKS_LOST_S
        c, sn = math.cos(now.yaw), math.sin(now.yaw)
        ahead, right, up = (
            (top * s.forward, top * s.right, self.speed_up_m_s * s.up) if live else (0.0, 0.0, 0.0)
        )
        wanted = (c * ahead - sn * right, sn * ahead + c * right, -up)
        place = list(t.position)
        for i, axis in enumerate(self.axes):
            if abs(wanted[i]) > 0.02:
                place[i] = None
            elif place[i] is None and abs(axis.velocity) < 0.05:
                place[i] = axis.position
        t.position = (place[0], place[1], place[2])
        t.velocity, t.accel, t.time_s = wanted, (0.0, 0.0, 0.0), self.time_s

    def _return_home(self, now: Estimate) -> None:
        """To the place of boot at the present height, then down."""
        if math.hypot(now.position[0], now.position[1]) < 0.3:
            self.set_mode(Mode.LAND, now)
            return
        away = math.hypot(now.position[0], now.position[1])
        speed = min(1.0, 0.5 * away) / away
        height = self.target.position[2]
        self.target.position = (None, None, now.position[2] if height is None else height)
        self.target.velocity = (-speed * now.position[0], -speed * now.position[1], 0.0)
        self.target.time_s = self.time_s

    def _attitude_command(self, now: Estimate) -> float:
        a = self.attitude
        if not self._thrust_is_climb_rate or self.time_s - a.time_s > self.guid_timeout_s:
            return super()._attitude_command(now)
        self._follow_attitude(a)
        rate = (a.thrust - 0.5) * 2.0
        up = rate * (self.speed_up_m_s if rate > 0.0 else self.speed_down_m_s)
        return 0.0 if self.landed and up <= 0.0 else self._climb(now, up)
