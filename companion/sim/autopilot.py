"""The control laws of an ArduCopter-like autopilot: shaped targets, cascaded position control, attitude control.

No MAVLink here. Structure and defaults follow ArduCopter's documented parameters; the code is our own, and
docs/lab/simulator.md compares its figures with those measured on the real one. It flies GUIDED alone; all other modes,
failsafes and sticks are in tests/simulators.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum, IntEnum

from companion.sim.body import ARDUPILOT_MOTOR, DT, MotorOutput, clipped
from companion.sim.fan_wrench import Vec
from companion.sim.mixer import Mixer
from companion.sim.sensors import Estimate
from models.common.frames import GRAVITY
from models.vehicle import Vehicle


class Mode(IntEnum):
    """ArduCopter's custom_mode numbers."""

    STABILIZE = 0
    ALT_HOLD = 2
    GUIDED = 4
    LOITER = 5
    RTL = 6
    LAND = 9
    POSHOLD = 16
    GUIDED_NOGPS = 20
    TAKEOFF = 100
    """PX4's: ArduCopter takes off within GUIDED."""


TAKE_OFF_ACCEL = 1.0
"""Of a take-off [m/s^2]: ArduCopter's WPNAV_ACCEL_Z."""
LIFT_OFF_LEAD_M = 0.3
"""How far above the origin the target of a take-off waits until the vehicle has left the ground."""
SPOOL_S = 0.5
"""From idle to full throttle: ArduCopter's MOT_SPOOL_TIME."""
SPOOL_UP_1_S = 0.25
SPOOL_UP_MOST = 0.3
"""Throttle added per second, and at most, beyond hover while a take-off waits on the ground."""
LANDED_THROTTLE = 0.6
LANDED_M_S = 0.2
LANDED_S = 0.5
AIRBORNE_S = 0.1
"""Land detector: throttle below this share of hover and vertical speed below this [m/s] for so long [s]; and how long
[s] off the ground until it is in the air. ArduCopter waits for 1 s."""
ARRIVED_M = 0.1
"""A take-off is over this near to its height [m]."""
MAX_TILT_RAD = math.radians(30.0)
"""Of the position controller: ArduCopter's ANGLE_MAX."""
VEL_I_MOST = 4.0
RATE_I_MOST = 8.0
THR_I_MOST = 0.5
"""Most that integrators hold: horizontal acceleration [m/s^2], angular acceleration [rad/s^2], throttle [1]."""
YAW_RATE_RAD_S = 1.0
"""Most that the heading's target turns."""
SHARE_20_HZ = 0.27
SHARE_5_HZ = 0.075
"""Of the change per step of DT: first-order low passes of 20 Hz (ArduCopter's rate and PSC_ACCZ filters) and 5 Hz
(PSC_VELXY_FLTE)."""


class Guided(Enum):
    """What GUIDED is doing."""

    HOLD = "hold"
    TAKEOFF = "takeoff"
    POSITION = "position"
    ATTITUDE = "attitude"


@dataclass(frozen=True, kw_only=True)
class Gains:
    """Position controller and attitude controller, named after ArduCopter's parameters; SI and radians.

    Chosen so that the answers come near those measured on ArduCopter 4.6 with its defaults (docs/lab/simulator.md).
    ``rate_*`` are angular accelerations per rad/s: the real ones act on normalised outputs.
    """

    pos_xy: float = 1.2
    vel_xy_p: float = 2.5
    vel_xy_i: float = 1.0
    vel_xy_d: float = 0.25
    pos_z: float = 1.0
    vel_z: float = 5.0
    acc_z_p: float = 0.05  # throttle per m/s^2
    acc_z_i: float = 0.10
    accel_xy: float = 2.5
    jerk_xy: float = 10.0
    accel_z: float = 2.5
    jerk_z: float = 10.0
    input_tc: float = 0.15
    angle: Vec = (4.5, 4.5, 4.5)
    rate_p: Vec = (14.0, 14.0, 8.0)
    rate_i: Vec = (14.0, 14.0, 2.0)
    rate_d: Vec = (0.4, 0.4, 0.3)
    accel_max: Vec = (5.0, 5.0, 2.0)  # rad/s^2, attitude target shaping


def square_root(error: float, p: float, limit: float) -> float:
    """A proportional answer whose slope eases off so that its derivative never exceeds ``limit``."""
    linear = limit / (p * p)
    if abs(error) <= linear:
        return p * error
    size = math.sqrt(2.0 * limit * (abs(error) - 0.5 * linear))
    return math.copysign(size, error)


def towards(value: float, target: float, step: float) -> float:
    """``value`` moved by at most ``step`` towards ``target``."""
    return value + clipped(target - value, step)


def wrap(angle: float) -> float:
    """An angle in -pi...pi."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


@dataclass
class Shaper:
    """One axis of the target: position, velocity and acceleration that follow a demand within accel and jerk limits."""

    accel_max: float
    jerk_max: float
    position: float = 0.0
    velocity: float = 0.0
    accel: float = 0.0

    def reset(self, position: float, velocity: float) -> None:
        """Start from a state, unaccelerated."""
        self.position = position
        self.velocity = velocity
        self.accel = 0.0

    def step(self, dt: float, target: float | None, velocity: float, accel: float = 0.0) -> None:
        """Follow position ``target`` (None: velocity only) with feed-forward ``velocity`` and ``accel``."""
        self.position += dt * (self.velocity + 0.5 * dt * self.accel)
        self.velocity += dt * self.accel
        wanted = velocity
        p = self.jerk_max / self.accel_max
        if target is not None:
            wanted += square_root(target - self.position, 0.5 * p, 0.75 * self.accel_max)
        demand = square_root(wanted - self.velocity, p, self.jerk_max) + accel
        demand = clipped(demand, self.accel_max)
        self.accel = towards(self.accel, demand, self.jerk_max * dt)


@dataclass(kw_only=True)
class Loop:
    """A PID controller of one axis: bounded integral, derivative of the error behind a low pass."""

    p: float
    i: float
    d: float
    most: float
    """Of the integral."""
    share: float
    """Of the change of the derivative per step: the low pass."""
    integral: float = 0.0
    old: float = 0.0
    slope: float = 0.0

    def integrate(self, error: float) -> None:
        """One step of the integral."""
        self.integral = clipped(self.integral + self.i * error * DT, self.most)

    def differentiate(self, value: float) -> None:
        """One step of the derivative."""
        slope = (value - self.old) / DT
        self.slope += (slope - self.slope) * self.share
        self.old = value

    def answer(self, error: float, feed_forward: float = 0.0) -> float:
        """What is demanded."""
        self.differentiate(error)
        return feed_forward + self.p * error + self.integral + self.d * self.slope


@dataclass
class PositionTarget:
    """A demand in SET_POSITION_TARGET_LOCAL_NED: what is not commanded is None."""

    position: tuple[float | None, float | None, float | None] = (None, None, None)
    velocity: Vec = (0.0, 0.0, 0.0)
    accel: Vec = (0.0, 0.0, 0.0)
    yaw: float | None = None
    time_s: float = 0.0


@dataclass(kw_only=True)
class AttitudeDemand:
    """A demand in SET_ATTITUDE_TARGET."""

    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0
    rates: Vec | None = None
    """In place of the angles."""
    thrust: float = 0.0
    time_s: float = 0.0


class Autopilot:
    """Estimates in, servo outputs out, once per physics step.

    ``hover``: MOT_THST_HOVER, the throttle the position controller starts from. Never learnt, so it is off.
    """

    motor: MotorOutput = ARDUPILOT_MOTOR
    gains = Gains()
    guid_timeout_s = 3.0
    """Default of GUID_TIMEOUT."""
    stream_modes: tuple[Mode, ...] = (Mode.GUIDED,)
    """In which a stream of attitudes is obeyed."""

    def __init__(self, vehicle: Vehicle, hover: float) -> None:
        self.vehicle = vehicle
        self.hover = hover
        self.armed = False
        self.mode = Mode.STABILIZE
        self.guided = Guided.HOLD
        self.landed = True
        self.time_s = 0.0
        self.mixer = Mixer(vehicle, vehicle.hover_thrust, self.motor)
        self.parameters = self.default_parameters()
        g = self.gains
        north = Shaper(g.accel_xy, g.jerk_xy)
        east = Shaper(g.accel_xy, g.jerk_xy)
        self.axes = [north, east, Shaper(g.accel_z, g.jerk_z)]
        """North, east and down of the shaped position target."""
        self._rate_loops = []
        for p, i, d in zip(g.rate_p, g.rate_i, g.rate_d, strict=True):
            loop = Loop(p=p, i=i, d=d, most=RATE_I_MOST, share=SHARE_20_HZ)
            self._rate_loops.append(loop)
        level = Loop(p=g.vel_xy_p, i=g.vel_xy_i, d=g.vel_xy_d, most=VEL_I_MOST, share=SHARE_5_HZ)
        self._vel_loops = [level, replace(level)]
        self.attitude = AttitudeDemand()
        self.target = PositionTarget()
        self.shaped = [0.0, 0.0, 0.0]  # roll, pitch, yaw that the attitude controller chases
        self.shaped_rates = [0.0, 0.0, 0.0]
        """Of the shaped attitude target [rad/s]."""
        self._rate_filtered = [0.0, 0.0, 0.0]
        self._thr_i = 0.0
        self._acc_filtered = 0.0
        self.throttle = 0.0  # before angle boost, as ATTITUDE_TARGET.thrust reports it
        self.command = (0.0, 0.0)
        """Roll and pitch [rad] last demanded of the attitude controller, before shaping."""
        self._spool = 0.0
        self._grounded_s = 0.0
        self._airborne_s = 0.0

    # -- parameters -------------------------------------------------------------------------------------------------

    def default_parameters(self) -> dict[str, float]:
        """The parameters that are published."""
        g = self.gains
        return {
            "GUID_OPTIONS": 8.0,
            "GUID_TIMEOUT": self.guid_timeout_s,
            "MOT_SPIN_MIN": self.motor.lowest,
            "MOT_SPIN_MAX": self.motor.highest,
            "MOT_THST_EXPO": self.motor.expo,
            "MOT_THST_HOVER": self.hover,
            "ATC_INPUT_TC": g.input_tc,
            "ATC_ANG_RLL_P": g.angle[0],
            "ATC_ANG_PIT_P": g.angle[1],
            "ATC_ANG_YAW_P": g.angle[2],
            "ATC_ACCEL_R_MAX": 100.0 * math.degrees(g.accel_max[0]),
            "ATC_ACCEL_P_MAX": 100.0 * math.degrees(g.accel_max[1]),
            "ATC_ACCEL_Y_MAX": 100.0 * math.degrees(g.accel_max[2]),
        }

    @property
    def taking_off(self) -> bool:
        """On the way up of its own take-off."""
        return self.guided is Guided.TAKEOFF and not self.landed

    @property
    def hand(self) -> str:
        """Who gives the attitude: ``stream`` (SET_ATTITUDE_TARGET), ``position`` (its own controller) or ``none``."""
        if not self.armed:
            return "none"
        streaming = self.guided is Guided.ATTITUDE and self.mode in self.stream_modes
        return "stream" if streaming else "position"

    # -- commands ---------------------------------------------------------------------------------------------------

    def arm(self, on: bool) -> bool:
        """Arm or disarm; disarming in the air is refused."""
        if not on and not self.landed:
            return False
        self.armed = on
        self._spool = 0.0
        return True

    def set_mode(self, mode: Mode, now: Estimate) -> None:
        """Change mode; a mode that holds position starts from where the vehicle is."""
        if mode != self.mode:
            self.mode = mode
            self.hold_here(now)

    def hold_here(self, now: Estimate) -> None:
        """GUIDED initialised: stop and stay."""
        if self.guided is Guided.ATTITUDE or not self.armed or self.mode is not Mode.GUIDED:
            self._reset_position(now)
        self.guided = Guided.HOLD
        self.target = PositionTarget(position=now.position, yaw=self.shaped[2], time_s=self.time_s)

    def take_off(self, height_m: float, now: Estimate) -> bool:
        """Climb straight up to ``height_m`` above the origin."""
        if not self.armed or not self.landed:
            return False
        self._reset_position(now)
        self.guided = Guided.TAKEOFF
        n, e, _ = now.position
        self.target = PositionTarget(position=(n, e, -height_m), yaw=now.yaw, time_s=self.time_s)
        return True

    def fly_to(self, target: PositionTarget, now: Estimate) -> None:
        """A position, velocity, acceleration target."""
        if self.guided is Guided.ATTITUDE:
            self._reset_position(now)
        self.guided = Guided.POSITION
        self.target = target

    def fly_attitude(self, target: AttitudeDemand) -> None:
        """An attitude and thrust target."""
        self.guided = Guided.ATTITUDE
        self.attitude = target

    # -- the loop ---------------------------------------------------------------------------------------------------

    def step(self, now: Estimate, touching: bool, time_s: float) -> list[float]:
        """One control step; returns the servo outputs [us]."""
        self.time_s = time_s
        self._acc_filtered += (now.down_acceleration - self._acc_filtered) * SHARE_20_HZ
        self._watch_ground(now, touching)
        throttle = self._outer(now) if self.armed else 0.0
        if not self.armed or (self.landed and throttle <= 0.0):
            self.throttle = 0.0
            if self.armed:
                self.mixer.idle()
            else:
                self.mixer.stop()
            self._relax(now)
            return self.mixer.pwm
        self._spool = min(1.0, self._spool + DT / SPOOL_S)
        self.throttle = min(throttle, self._spool)
        boost = self._boost()
        roll, pitch, yaw = self._inner(now)
        self.mixer.drive(self.throttle / boost, roll, pitch, yaw)
        return self.mixer.pwm

    def _boost(self) -> float:
        """Throttle is divided by this, so that a tilt costs no lift."""
        return max(0.5, math.cos(self.shaped[0]) * math.cos(self.shaped[1]))

    def _watch_ground(self, now: Estimate, touching: bool) -> None:
        still = abs(now.velocity[2]) < LANDED_M_S
        low = self.throttle < LANDED_THROTTLE * self.hover
        self._grounded_s = self._grounded_s + DT if touching and low and still else 0.0
        self._airborne_s = 0.0 if touching else self._airborne_s + DT
        if self._touched_down:
            self.landed = True
        if self._airborne_s > AIRBORNE_S:
            self.landed = False

    @property
    def _touched_down(self) -> bool:
        """Whether it has stood on the ground for long enough."""
        return self._grounded_s > LANDED_S

    def _relax(self, now: Estimate) -> None:
        """On the ground: no integrator winds up, every target starts where the vehicle is."""
        self.shaped = [0.0, 0.0, now.yaw]
        self.shaped_rates = [0.0, 0.0, 0.0]
        for loop in self._rate_loops:
            loop.integral = 0.0
        if self.guided is not Guided.TAKEOFF:
            self._reset_position(now)

    def _reset_position(self, now: Estimate) -> None:
        """Hand-over to the position controller without a kick: the present tilt and throttle become its integrators."""
        for axis, place, speed in zip(self.axes, now.position, now.velocity, strict=True):
            axis.reset(place, speed)
        c = math.cos(now.yaw)
        s = math.sin(now.yaw)
        ahead = -GRAVITY * math.tan(self.shaped[1])
        right = GRAVITY * math.tan(self.shaped[0])
        north, east = self._vel_loops
        north.integral = c * ahead - s * right
        east.integral = s * ahead + c * right
        north.old, east.old = now.velocity[:2]
        self._thr_i = 0.0 if self.landed else self.throttle - self.hover

    def _outer(self, now: Estimate) -> float:
        """Throttle demand; sets the attitude demand."""
        if self.mode is not Mode.GUIDED:
            self._demand_attitude(0.0, 0.0, self.shaped[2])
            return 0.0
        if self.guided is Guided.ATTITUDE:
            return self._attitude_command(now)
        return self._to_target(now)

    def _level(self, now: Estimate) -> float:
        """Level, and the height held."""
        self._demand_attitude(0.0, 0.0, self.shaped[2])
        return 0.0 if self.landed else self._climb(now, 0.0)

    def _to_target(self, now: Estimate) -> float:
        """Position control, take-off included."""
        if self.landed and self.guided is not Guided.TAKEOFF:
            return 0.0
        if self.guided is Guided.TAKEOFF and self.landed:
            # Spool up on the ground, then let the position controller lift off.
            self._thr_i = min(SPOOL_UP_MOST, self._thr_i + SPOOL_UP_1_S * DT)
        self._climb_away()
        self._end_take_off(now)
        stale = self.time_s - self.target.time_s > self.guid_timeout_s
        if self.guided is Guided.POSITION and stale:
            self.target.velocity = (0.0, 0.0, 0.0)
            self.target.accel = (0.0, 0.0, 0.0)
        return self._position(now)

    def _climb_away(self) -> None:
        """A take-off accelerates gently: WPNAV_ACCEL_Z is 1 m/s^2, half a metre in the first second."""
        down = self.axes[2]
        if self.guided is not Guided.TAKEOFF:
            down.accel_max = self.gains.accel_z
            return
        down.accel_max = TAKE_OFF_ACCEL
        if self.landed and down.position < -LIFT_OFF_LEAD_M:
            down.reset(-LIFT_OFF_LEAD_M, 0.0)  # the target waits for the vehicle

    def _end_take_off(self, now: Estimate) -> None:
        height = self.target.position[2]
        if self.taking_off and height is not None and abs(now.position[2] - height) < ARRIVED_M:
            self.guided = Guided.HOLD

    def _attitude_command(self, now: Estimate) -> float:
        a = self.attitude
        if self.time_s - a.time_s > self.guid_timeout_s:
            # Real behaviour after GUID_TIMEOUT: level, altitude held, position not.
            return self._level(now)
        self._follow_attitude(a)
        # The height controller, when it takes over, starts from here.
        self.axes[2].reset(now.position[2], now.velocity[2])
        self._thr_i = a.thrust - self.hover
        return a.thrust

    def _follow_attitude(self, target: AttitudeDemand) -> None:
        if target.rates is not None:
            self._demand_rates(target.rates)
        else:
            self._demand_attitude(target.roll, target.pitch, target.yaw)

    def _climb(self, now: Estimate, up_m_s: float) -> float:
        """Hold height, or climb at a rate."""
        self.axes[2].step(DT, None, -up_m_s)
        return self._vertical(now)

    def _position(self, now: Estimate) -> float:
        t = self.target
        g = self.gains
        # Between two messages the demand moves on at its own velocity.
        n, e, d = (
            None if x is None else x + v * DT for x, v in zip(t.position, t.velocity, strict=True)
        )
        t.position = (n, e, d)
        for k, axis in enumerate(self.axes):
            axis.step(DT, t.position[k], t.velocity[k], t.accel[k])
        demand = []
        for k, loop in enumerate(self._vel_loops):
            axis = self.axes[k]
            wanted = axis.velocity + g.pos_xy * (axis.position - now.position[k])
            error = wanted - now.velocity[k]
            loop.integrate(error)
            demand.append(loop.answer(error, axis.accel))
        self._lean(now, *demand)
        return self._vertical(now)

    def _lean(self, now: Estimate, north: float, east: float) -> tuple[float, float]:
        """Demand the tilt of a horizontal acceleration [m/s^2] at the target's yaw; returns roll and pitch."""
        c = math.cos(now.yaw)
        s = math.sin(now.yaw)
        ahead = c * north + s * east
        right = -s * north + c * east
        pitch = clipped(-math.atan(ahead / GRAVITY), MAX_TILT_RAD)
        roll = clipped(math.atan(right * math.cos(pitch) / GRAVITY), MAX_TILT_RAD)
        yaw = self.shaped[2] if self.target.yaw is None else self.target.yaw
        self._demand_attitude(roll, pitch, yaw)
        return roll, pitch

    def _vertical(self, now: Estimate) -> float:
        g = self.gains
        axis = self.axes[2]
        wanted = axis.velocity + g.pos_z * (axis.position - now.position[2])
        accel = axis.accel + g.vel_z * (wanted - now.velocity[2])
        error = self._acc_filtered - accel  # positive: more throttle
        if not self.landed:
            integral = self._thr_i + g.acc_z_i * error * DT
            self._thr_i = max(-self.hover, min(THR_I_MOST, integral))
        throttle = self.hover + self._thr_i + g.acc_z_p * error
        return max(0.0, min(1.0, throttle))

    # -- attitude ---------------------------------------------------------------------------------------------------

    def _demand_attitude(self, roll: float, pitch: float, yaw: float) -> None:
        """Move the shaped target towards a demand: first order with input_tc, within the acceleration limit."""
        g = self.gains
        dt = DT
        self.command = (roll, pitch)
        for i, demand in enumerate((roll, pitch, yaw)):
            error = demand - self.shaped[i]
            if i == 2:
                error = wrap(error)
            limit = g.accel_max[i]
            rate = square_root(error, 1.0 / g.input_tc, limit)
            if i == 2:
                rate = clipped(rate, YAW_RATE_RAD_S)
            self.shaped_rates[i] = towards(self.shaped_rates[i], rate, limit * dt)
            self.shaped[i] += self.shaped_rates[i] * dt
        self.shaped[2] = wrap(self.shaped[2])

    def _demand_rates(self, rates: Vec) -> None:
        for i, rate in enumerate(rates):
            self.shaped_rates[i] = towards(self.shaped_rates[i], rate, self.gains.accel_max[i] * DT)
            self.shaped[i] += self.shaped_rates[i] * DT
        self.shaped[2] = wrap(self.shaped[2])

    def _inner(self, now: Estimate) -> Vec:
        """Moments [N m] that bring the attitude to the shaped target."""
        g = self.gains
        sr = math.sin(now.roll)
        cr = math.cos(now.roll)
        sp = math.sin(now.pitch)
        cp = math.cos(now.pitch)
        roll_error = self.shaped[0] - now.roll
        pitch_error = self.shaped[1] - now.pitch
        yaw_error = wrap(self.shaped[2] - now.yaw)
        roll_rate, pitch_rate, yaw_rate = self.shaped_rates
        er = g.angle[0] * roll_error + roll_rate
        ep = g.angle[1] * pitch_error + pitch_rate
        ey = g.angle[2] * yaw_error + yaw_rate
        # Euler rates -> body rates
        p = er - sp * ey
        q = cr * ep + sr * cp * ey
        r = -sr * ep + cr * cp * ey
        out = []
        for i, wanted in enumerate((p, q, r)):
            loop = self._rate_loops[i]
            self._rate_filtered[i] += (now.rates[i] - self._rate_filtered[i]) * SHARE_20_HZ
            error = wanted - self._rate_filtered[i]
            if not self.mixer.saturated and not self.landed:
                loop.integrate(error)
            out.append(loop.answer(error) * self.vehicle.inertia_kgm2[i])
        return (out[0], out[1], out[2])
