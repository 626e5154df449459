"""The manners of PX4: OFFBOARD and its loss, position control without a shaped target, thrust that is the output.

Structure and defaults follow PX4's documented parameters (mc_pos_control, mc_att_control, commander, hover thrust
estimator; v1.16); the code is our own. No MAVLink here.
"""

from __future__ import annotations

import math
from dataclasses import replace

from arducopter import STICKS_LOST_S, ArduCopter

from companion.sim.autopilot import (
    DT,
    Gains,
    Guided,
    Mode,
    PositionTarget,
    Shaper,
    wrap,
)
from companion.sim.body import MotorOutput
from companion.sim.sensors import Estimate
from models.common.frames import GRAVITY
from models.vehicle import Vehicle

STREAM_BEFORE_S = 1.0
"""OFFBOARD is refused unless setpoints have been coming for this long."""
HOVER_TIME_S = 1.5
"""Time constant of the hover thrust estimator."""


PX4_MOTOR = MotorOutput(0.0, 1.0, 0.0)
"""PX4's default THR_MDL_FAC is 0: the command is the output, so lift is not proportional to it."""


class Px4(ArduCopter):
    """A PX4-like autopilot. ``hover`` is its own estimate of the hover thrust, not MPC_THR_HOVER."""

    motor = PX4_MOTOR
    gains = Gains(accel_xy=3.0, jerk_xy=8.0, accel_z=3.0, jerk_z=8.0, angle=(6.5, 6.5, 2.8))

    def __init__(self, vehicle: Vehicle, hover: float) -> None:
        super().__init__(vehicle, hover)
        self.mode = Mode.LOITER
        self.stream_s = -math.inf
        """When the last setpoint arrived, whatever the mode."""
        self._stream_since_s = math.inf
        self._wanted = self.mode
        """The mode that the pilot asked for; OFFBOARD is entered again when its stream comes back."""
        self._lost_s = math.inf
        self.hover = self.parameters["MPC_THR_HOVER"]
        self._acc_i = [0.0, 0.0, 0.0]

    # -- parameters -------------------------------------------------------------------------------------------------

    def default_parameters(self) -> dict[str, float]:
        """The parameters that are published; most are obeyed."""
        return {
            "MPC_THR_HOVER": 0.5,
            "MPC_USE_HTE": 1.0,
            "THR_MDL_FAC": self.motor.expo,
            "COM_OF_LOSS_T": 1.0,
            "COM_FAIL_ACT_T": 5.0,
            "MC_ROLL_P": self.gains.angle[0],
            "MC_PITCH_P": self.gains.angle[1],
            "MC_YAW_P": self.gains.angle[2],
            "MPC_XY_P": 0.95,
            "MPC_XY_VEL_P_ACC": 1.8,
            "MPC_XY_VEL_I_ACC": 0.4,
            "MPC_XY_VEL_D_ACC": 0.2,
            "MPC_Z_P": 1.0,
            "MPC_Z_VEL_P_ACC": 4.0,
            "MPC_Z_VEL_I_ACC": 2.0,
            "MPC_XY_VEL_MAX": 12.0,
            "MPC_Z_V_AUTO_UP": 3.0,
            "MPC_Z_V_AUTO_DN": 1.5,
            "MPC_VEL_MANUAL": 10.0,
        }

    def _obey(self, p: dict[str, float]) -> None:
        self.gains = replace(self.gains, angle=(p["MC_ROLL_P"], p["MC_PITCH_P"], p["MC_YAW_P"]))
        if self.landed:
            self.hover = p["MPC_THR_HOVER"]

    @property
    def stick_speed_m_s(self) -> float:
        """Speed at full stick."""
        return self.parameters["MPC_VEL_MANUAL"]

    # -- modes ------------------------------------------------------------------------------------------------------

    def stream_heard(self) -> None:
        """A setpoint has arrived, whatever the mode."""
        if self.time_s - self.stream_s > self.parameters["COM_OF_LOSS_T"]:
            self._stream_since_s = self.time_s
        self.stream_s = self.time_s

    @property
    def stream_runs(self) -> bool:
        """Whether OFFBOARD would be accepted now."""
        fresh = self.time_s - self.stream_s <= self.parameters["COM_OF_LOSS_T"]
        return fresh and self.time_s - self._stream_since_s >= STREAM_BEFORE_S

    def set_mode(self, mode: Mode, now: Estimate) -> None:
        """Change mode by the pilot's will."""
        self._wanted = mode
        self._lost_s = math.inf
        self._enter(mode, now)

    def _enter(self, mode: Mode, now: Estimate) -> None:
        if mode is not self.mode:
            self.mode = mode
            self._reset_position(now)
            self.guided = Guided.HOLD
            self.target = PositionTarget(
                position=now.position, yaw=self.shaped[2], time_s=self.time_s
            )

    def take_off(self, height_m: float, now: Estimate) -> bool:
        """AUTO_TAKEOFF: climb straight up, then hold."""
        if not super().take_off(height_m, now):
            return False
        self.mode = self._wanted = Mode.TAKEOFF
        return True

    def _climb_away(self) -> None:
        """MPC_TKO_SPEED 1.5 m/s over MPC_TKO_RAMP_T 3 s: a quarter of a metre in the first second."""
        super()._climb_away()
        if self.guided is Guided.TAKEOFF:
            self.axes[2].accel_max = 0.5

    def _end_take_off(self, now: Estimate) -> None:
        super()._end_take_off(now)
        if self.mode is Mode.TAKEOFF and self.guided is not Guided.TAKEOFF:
            self.set_mode(Mode.LOITER, now)

    def _failsafe(self, now: Estimate) -> None:
        """OFFBOARD without a stream: Position with sticks; without, Hold, then Return. The stream brings it back."""
        if not self.armed or self.landed:
            return
        if (
            self.mode is Mode.GUIDED
            and self.time_s - self.stream_s > self.parameters["COM_OF_LOSS_T"]
        ):
            self._lost_s = self.time_s
            sticks = self.time_s - self.sticks.time_s < STICKS_LOST_S
            self._enter(Mode.POSHOLD if sticks else Mode.LOITER, now)
        elif self._wanted is Mode.GUIDED and self.mode is not Mode.GUIDED:
            if self.stream_runs:
                self._lost_s = math.inf
                self._enter(Mode.GUIDED, now)
            elif (
                self.mode is Mode.LOITER
                and self.time_s - self._lost_s > self.parameters["COM_FAIL_ACT_T"]
            ):
                self._enter(Mode.RTL, now)

    # -- control ----------------------------------------------------------------------------------------------------

    def _watch_ground(self, now: Estimate, touching: bool) -> None:
        super()._watch_ground(now, touching)
        if self.landed or touching or not self.parameters["MPC_USE_HTE"] or self.throttle < 0.1:
            return
        lift = max(0.3, 1.0 - self._acc_filtered / GRAVITY)
        upright = math.cos(self.shaped[0]) * math.cos(self.shaped[1])
        seen = min(0.9, max(0.1, self.throttle * upright / lift))
        self.hover += (seen - self.hover) * DT / HOVER_TIME_S

    def _boost(self) -> float:
        return 1.0

    def _reset_position(self, now: Estimate) -> None:
        super()._reset_position(now)
        up = 0.0 if self.landed else -GRAVITY * (self.throttle / max(self.hover, 0.1) - 1.0)
        self._acc_i = [*(loop.integral for loop in self._vel_loops), max(-4.0, min(4.0, up))]

    def _demand_attitude(self, roll: float, pitch: float, yaw: float) -> None:
        """Attitude setpoints are not shaped; the yaw turns at 45 degrees per second."""
        self.command = (roll, pitch)
        step = math.radians(45.0) * DT
        turn = max(-step, min(step, wrap(yaw - self.shaped[2])))
        self.shaped = [roll, pitch, wrap(self.shaped[2] + turn)]
        self.shaped_rates = [0.0, 0.0, 0.0]

    def _axis(self, axis: Shaper, i: int, raw: bool) -> tuple[float, float]:
        """Velocity and acceleration demanded of one axis; OFFBOARD's targets go in as they are."""
        t, p = self.target, self.parameters
        if raw:
            place = t.position[i]
            gain = p["MPC_XY_P"] if i < 2 else p["MPC_Z_P"]
            axis.position = self._place[i] if place is None else place
            axis.velocity, axis.accel = t.velocity[i], 0.0
            return t.velocity[i] + (
                0.0 if place is None else gain * (place - self._place[i])
            ), t.accel[i]
        axis.step(DT, t.position[i], t.velocity[i])
        gain = p["MPC_XY_P"] if i < 2 else p["MPC_Z_P"]
        return axis.velocity + gain * (axis.position - self._place[i]), axis.accel

    def _position(self, now: Estimate) -> float:
        p, dt = self.parameters, DT
        self._place = now.position
        raw = self.mode is Mode.GUIDED and self.guided is Guided.POSITION
        pairs = [self._axis(axis, i, raw) for i, axis in enumerate(self.axes)]
        speed = math.hypot(pairs[0][0], pairs[1][0])
        scale = min(1.0, p["MPC_XY_VEL_MAX"] / speed) if speed else 1.0
        down = max(-p["MPC_Z_V_AUTO_UP"], min(p["MPC_Z_V_AUTO_DN"], pairs[2][0]))
        wanted = (scale * pairs[0][0], scale * pairs[1][0], down)
        demand = [0.0, 0.0, 0.0]
        for i in range(3):
            letter, limit = ("XY", 4.0) if i < 2 else ("Z", GRAVITY)
            error = wanted[i] - now.velocity[i]
            if not self.landed:
                step = p[f"MPC_{letter}_VEL_I_ACC"] * error * dt
                self._acc_i[i] = max(-limit, min(limit, self._acc_i[i] + step))
            demand[i] = pairs[i][1] + p[f"MPC_{letter}_VEL_P_ACC"] * error + self._acc_i[i]
            if i < 2:
                self._vel_loops[i].differentiate(now.velocity[i])
                demand[i] -= p["MPC_XY_VEL_D_ACC"] * self._vel_loops[i].slope
        roll, pitch = self._lean(now, demand[0], demand[1])
        if self.landed:
            # Spool up on the ground until it lifts off.
            return max(0.0, min(1.0, self.hover + self._thr_i))
        lift = self.hover * (1.0 - demand[2] / GRAVITY)
        return max(0.05, min(1.0, lift / (math.cos(roll) * math.cos(pitch))))

    def _climb(self, now: Estimate, up_m_s: float) -> float:
        """Hold height, or climb at a rate, without a position."""
        error = -up_m_s - now.velocity[2]
        self._acc_i[2] = max(
            -GRAVITY, min(GRAVITY, self._acc_i[2] + self.parameters["MPC_Z_VEL_I_ACC"] * error * DT)
        )
        demand = self.parameters["MPC_Z_VEL_P_ACC"] * error + self._acc_i[2]
        return max(0.05, min(1.0, self.hover * (1.0 - demand / GRAVITY)))

    def _attitude_command(self, now: Estimate) -> float:
        """The stream's attitude and thrust as they come; its loss is the commander's business."""
        self._follow_attitude(self.attitude)
        return self.attitude.thrust
