"""The rigid body: actuator outputs in, true state out, with every force and moment kept apart by cause.

Plain floats throughout: one step costs tens of microseconds, so that flight runs faster than time.
World NED with the origin on the ground, body FRD about the CG, SI units.
"""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass, field

from companion.sim.air import (
    NOMINAL,
    PAPER_CQ,
    PAPER_CT,
    REYNOLDS_EXPONENT,
    RPM_HOVER,
    Increments,
    SurfaceLaw,
    Unsteadiness,
)
from companion.sim.fan_wrench import (
    DRAG_ARM_RADII,
    INFLOW_PER_M_S,
    ZERO6,
    SimFan,
    Vec,
    Wrench6,
    added,
    corner_wrench,
    momentum_drag,
    unsteady_wrench,
    wrench_of,
)
from models.common.frames import GRAVITY, rotation_rows
from models.vehicle import RHO_SEA_LEVEL, Rotor, Vehicle

DT = 0.0025
"""Step [s]: ArduCopter's own main loop runs at 400 Hz."""
SPIN_UP_S = 0.04
SPIN_DOWN_S = 0.05
SERVO_S = 0.025
"""Time constants of a rotor that speeds up, slows down, and of a vane's servo [s]: usual for 0.33 m rotors on ESCs
that do not brake, and for a digital servo; the companion is given none of them."""
COEFFICIENT_SD = 0.01
VANE_SD = 0.03
HOVER_SD = 0.02
"""Standard deviations of what the vehicle file has wrong, as shares: rotor coefficients, vanes, hover throttle."""
PWM_LOW_US = 1000.0
PWM_SPAN_US = 1000.0
"""Servo output of a stopped motor and from there to full [us], where the vehicle file has no [throttle]."""
DUCTED_LIP = 1.1
"""A lip this many rotor radii from the axis is a duct's."""
OPEN_RAM = 0.35
"""Share of the momentum drag of a duct that an open rotor has [1]: it turns only part of its flow. A choice."""
FIGURE_OF_MERIT = 0.6
"""Ideal over real power of a small rotor with its motor [1]: Leishman 2006, ch. 2, less the motor's losses."""
AVIONICS_W = 15.0
"""Drawn by everything that is no rotor [W]."""
CURRENT_SHARE = 0.2
"""Of a change of the current per step [1]: the battery's voltage follows within some 10 ms."""
VANE_LIMIT_RAD = 0.5
"""Mechanical stop of a vane [rad]: a choice."""
GEAR_M = 0.13
"""The feet stand this far below the CG."""
LEAST_STANCE_M = 0.15
"""The feet stand at least this far from the CG, forward and sideways [m]."""
GROUND_FRICTION = 0.6
WALL_FRICTION = 0.15
"""Rubber feet; a smooth bumper on the lip."""
CONTACT_STIFFNESS = 50.0**2
"""Stiffness of a contact over the vehicle's mass [1/s^2]: it settles by 4 mm under its weight."""
CONTACT_DAMPING = 0.7
"""Damping ratio of a contact [1]: one small bounce."""
NEAR_GROUND_M = 0.2
NEAR_WALL_M = 1.0
"""Nearer than this to its feet the ground, and to its CG the wall, are looked at [m]; saves time further away."""
SLIDE_M_S = 0.02
"""Friction is proportional to the sliding speed below this [m/s]: keeps it smooth at rest."""

Rotation = tuple[float, ...]
"""The nine elements, row by row, of the rotation FRD -> NED."""

SPIN_MIN = 0.15
SPIN_MAX = 0.95
THRUST_EXPO = 0.65
"""ArduPilot's defaults of MOT_SPIN_MIN, MOT_SPIN_MAX and MOT_THST_EXPO: where a motor idles, ends, and how it bends."""


@dataclass(frozen=True)
class MotorOutput:
    """How a firmware turns a thrust 0...1 into a motor's output: its expo curve, squeezed between two ends."""

    lowest: float
    highest: float
    expo: float

    def output(self, thrust: float) -> float:
        """Output 0...1 for a thrust 0...1."""
        x = min(1.0, max(0.0, thrust))
        e = self.expo
        if e:
            root = math.sqrt((1.0 - e) ** 2 + 4.0 * e * x)
            x = ((e - 1.0) + root) / (2.0 * e)
        return self.lowest + (self.highest - self.lowest) * x


ARDUPILOT_MOTOR = MotorOutput(SPIN_MIN, SPIN_MAX, THRUST_EXPO)


@dataclass(frozen=True)
class Surroundings:
    """Flat ground at height zero and one wall, a vertical plane.

    ``wall_m`` is its distance from the origin along ``wall_azimuth_rad`` (from north, to the east). ``air`` off keeps
    the obstacles solid and takes their air away.
    """

    wall_m: float = math.inf
    wall_azimuth_rad: float = 0.5 * math.pi
    air: bool = True


@dataclass(kw_only=True)
class Causes:
    """The wrench of each cause about the CG, body FRD, at the last step."""

    free: Wrench6 = ZERO6
    corner: Wrench6 = ZERO6
    unsteady: Wrench6 = ZERO6
    drag: Wrench6 = ZERO6
    vanes: Wrench6 = ZERO6
    contact: Wrench6 = ZERO6


@dataclass(kw_only=True)
class Pack:
    """A six-cell battery: open-circuit voltage falling with charge, behind a resistance (typical of LiPo packs)."""

    full_v: float = 25.0
    empty_v: float = 21.0
    capacity_ah: float = 16.0
    resistance_ohm: float = 0.015
    used_ah: float = 0.0
    current_a: float = 0.0
    voltage_v: float = 25.0

    def draw(self, power_w: float, dt: float) -> None:
        """Supply ``power_w`` for ``dt`` seconds."""
        used = min(1.0, self.used_ah / self.capacity_ah)
        open_v = self.full_v - (self.full_v - self.empty_v) * used
        needed_a = power_w / self.voltage_v
        self.current_a += (needed_a - self.current_a) * CURRENT_SHARE
        self.voltage_v = open_v - self.resistance_ohm * self.current_a
        self.used_ah += self.current_a * dt / 3600.0


def pulses(vehicle: Vehicle) -> tuple[float, float]:
    """Servo output of a stopped motor, and from there to full [us]."""
    curve = vehicle.throttle
    if curve:
        return (curve.pwm_min_us, curve.pwm_max_us - curve.pwm_min_us)
    return (PWM_LOW_US, PWM_SPAN_US)


def thrust_share(actuator: float, expo: float = THRUST_EXPO) -> float:
    """Thrust over full thrust of a motor at ``actuator`` 0...1."""
    return (1.0 - expo) * actuator + expo * actuator * actuator


def channel_of(rotor: Rotor) -> int:
    """Index of a rotor's servo output."""
    return (rotor.esc or rotor.servo or 1) - 1


def clipped(value: float, most: float) -> float:
    """``value`` within +-``most``."""
    return max(-most, min(most, value))


def placed(rot: Rotation, origin: Sequence[float], v: Vec) -> Vec:
    """A vector of the body in NED, from an origin on."""
    x, y, z = v
    n, e, d = origin
    return (
        n + rot[0] * x + rot[1] * y + rot[2] * z,
        e + rot[3] * x + rot[4] * y + rot[5] * z,
        d + rot[6] * x + rot[7] * y + rot[8] * z,
    )


def turned(rot: Rotation, v: Vec) -> Vec:
    """A vector of the body in NED; ``rot``: see ``Body.rotation``."""
    x, y, z = v
    return (
        rot[0] * x + rot[1] * y + rot[2] * z,
        rot[3] * x + rot[4] * y + rot[5] * z,
        rot[6] * x + rot[7] * y + rot[8] * z,
    )


def turned_back(rot: Rotation, v: Vec) -> Vec:
    """A vector in NED in the body's axes."""
    n, e, d = v
    return (
        rot[0] * n + rot[3] * e + rot[6] * d,
        rot[1] * n + rot[4] * e + rot[7] * d,
        rot[2] * n + rot[5] * e + rot[8] * d,
    )


def euler(q: Sequence[float]) -> Vec:
    """Roll, pitch, yaw [rad] of a unit quaternion (w, x, y, z)."""
    w, x, y, z = q
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = math.asin(clipped(2.0 * (w * y - z * x), 1.0))
    yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return (roll, pitch, yaw)


@dataclass(kw_only=True)
class Body:
    """A vehicle in its surroundings. ``seed`` draws the law of the air and what the vehicle file has slightly wrong."""

    vehicle: Vehicle
    surroundings: Surroundings
    law: SurfaceLaw = NOMINAL
    seed: int = 0
    dt: float = DT
    motor: MotorOutput = ARDUPILOT_MOTOR
    wind: Vec = (0.0, 0.0, 0.0)
    """Velocity of the air, NED [m/s]; may change in flight."""
    position: list[float] = field(
        default_factory=lambda: [0.0, 0.0, GRAVITY / CONTACT_STIFFNESS - GEAR_M]
    )
    velocity: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    quaternion: list[float] = field(default_factory=lambda: [1.0, 0.0, 0.0, 0.0])
    rates: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    specific_force: Vec = (0.0, 0.0, -GRAVITY)
    causes: Causes = field(default_factory=Causes)
    pack: Pack = field(default_factory=Pack)
    contact: bool = False
    wall_contact: bool = False
    time_s: float = 0.0

    def __post_init__(self) -> None:
        v = self.vehicle
        rng = random.Random(f"vehicle {self.seed}")
        self.radius = v.rotor_radius_m
        self._area = v.disc_area_m2
        tip_speed_per_rpm = 2.0 * math.pi / 60.0 * self.radius
        self._per_rpm2 = RHO_SEA_LEVEL * self._area * tip_speed_per_rpm**2
        self._fans = self._prepared_fans(rng)
        self._vane_gains = []
        for vane in v.vanes:
            gain = vane.force_per_thrust_rad * rng.gauss(1.0, VANE_SD)
            self._vane_gains.append(gain)
        self._prepare_rotors(rng)
        self.rpm = [0.0] * len(v.rotors)
        self.deflection = [0.0] * len(v.vanes)
        self._unsteady = Unsteadiness(f"unsteady {self.seed}", 6 * len(v.fans), self.dt)
        self.change_step(self.dt)
        self._prepare_contacts()

    def _prepared_fans(self, rng: random.Random) -> list[SimFan]:
        fans: list[SimFan] = []
        first = 0
        for fan in self.vehicle.fans:
            count = len(fan.rotors)
            each = (fan.cq or 0.0) / count * self._per_rpm2 * self.radius
            net_torque = 0.0
            if fan.ct is None:
                net_torque = (fan.cq or PAPER_CQ) * self._per_rpm2 * self.radius
            x, y, z = fan.position_m
            prepared = SimFan(
                x=x,
                y=y,
                z=z,
                lip=fan.lip_radius_m,
                rotors=tuple(range(first, first + count)),
                ct=(fan.ct or PAPER_CT) * rng.gauss(1.0, COEFFICIENT_SD),
                cq_torque=tuple(-rotor.spin * each for rotor in fan.rotors),
                net_torque=net_torque,
            )
            fans.append(prepared)
            first += count
        return fans

    def _prepare_rotors(self, rng: random.Random) -> None:
        """From output to speed, and the power that it draws."""
        v = self.vehicle
        curve = self.vehicle.throttle
        self.rotor_channels = tuple(map(channel_of, v.rotors))
        self._rotor_gain = [rng.gauss(1.0, COEFFICIENT_SD) for _ in v.rotors]
        self._pwm_low, self._pwm_span = pulses(v)
        self._expo = curve.expo if curve else THRUST_EXPO
        # Full thrust such that the file's hover throttle hovers, a few percent off: nobody weighs before each flight.
        hover = v.hover_thrust * rng.gauss(1.0, HOVER_SD)
        weight_each = v.mass_kg * GRAVITY / len(v.fans)
        full_n = weight_each / thrust_share(self.motor.output(hover), self._expo)
        if curve:
            full_n = curve.max_thrust_n * len(v.fans[0].rotors)
        self._rpm_full = math.sqrt(full_n / (self._per_rpm2 * self._fans[0].ct))
        ducted = v.fans[0].lip_radius_m > DUCTED_LIP * self.radius
        self._ram = 1.0 if ducted else OPEN_RAM
        # Ideal power: T^1.5 / sqrt(2 rho A), of a duct whose wake does not contract T^1.5 / sqrt(4 rho A).
        areas = 4.0 if ducted else 2.0
        ideal = math.sqrt(areas * RHO_SEA_LEVEL * self._area)
        self._power_per_thrust15 = 1.0 / (ideal * FIGURE_OF_MERIT)
        hover_power = len(v.fans) * weight_each**1.5 * self._power_per_thrust15
        sag_v = self.pack.resistance_ohm * hover_power / self.pack.full_v
        self._hover_v = self.pack.full_v - sag_v

    def _prepare_contacts(self) -> None:
        x = max(LEAST_STANCE_M, *(abs(fan.x) for fan in self._fans))
        y = max(LEAST_STANCE_M, *(abs(fan.y) for fan in self._fans))
        self._feet = [(-x, -y, GEAR_M), (-x, y, GEAR_M), (x, -y, GEAR_M), (x, y, GEAR_M)]
        each = self.vehicle.mass_kg / len(self._feet)
        self._spring = each * CONTACT_STIFFNESS
        self._damper = 2.0 * CONTACT_DAMPING * each * math.sqrt(CONTACT_STIFFNESS)
        self._wall_cos = math.cos(self.surroundings.wall_azimuth_rad)
        self._wall_sin = math.sin(self.surroundings.wall_azimuth_rad)

    def change_step(self, dt: float) -> None:
        """Steps of another length [s] from here on."""
        self.dt = dt
        self._unsteady.change_step(dt)
        self._spin_up = 1.0 - math.exp(-dt / SPIN_UP_S)
        self._spin_down = 1.0 - math.exp(-dt / SPIN_DOWN_S)
        self._servo = 1.0 - math.exp(-dt / SERVO_S)

    def hover_drag(self) -> tuple[float, float]:
        """Momentum drag of all fans at hover thrust [N per m/s], and how far above the CG it acts [m]."""
        count = len(self._fans)
        weight_each = self.vehicle.mass_kg * GRAVITY / count
        drag = count * self._mass_flow(weight_each)
        mean_z = sum(fan.z for fan in self._fans) / count
        return drag, DRAG_ARM_RADII * self.radius - mean_z

    def _mass_flow(self, thrust: float) -> float:
        """Air that a fan takes in and turns [kg/s]: sqrt(rho A T), for a duct; Leishman 2006, ch. 2."""
        return math.sqrt(RHO_SEA_LEVEL * self._area * thrust) * self._ram

    @property
    def clearance_m(self) -> float:
        """Height of the lowest foot over the ground."""
        rot = self.rotation()
        return -max(placed(rot, self.position, foot)[2] for foot in self._feet)

    @property
    def wall_gap_m(self) -> float:
        """Distance of the CG from the wall plane."""
        return self._wall_gap_of(self.position)

    def _wall_gap_of(self, point: Sequence[float]) -> float:
        wall_m = self.surroundings.wall_m
        return wall_m - point[0] * self._wall_cos - point[1] * self._wall_sin

    def rotation(self) -> Rotation:
        """The nine elements, row by row, of the rotation FRD -> NED."""
        north, east, down = rotation_rows(*self.quaternion)
        return (*north, *east, *down)

    def euler(self) -> Vec:
        """Roll, pitch, yaw [rad]."""
        return euler(self.quaternion)

    def step(self, pwm: Sequence[float]) -> None:
        """Advance by ``dt`` under servo outputs ``pwm`` [us], channel 1 first."""
        self._spin_rotors(pwm)
        rot = self.rotation()
        self._air(pwm, rot)
        self._contact(rot)
        self._integrate(rot)
        self.time_s += self.dt

    def _spin_rotors(self, pwm: Sequence[float]) -> None:
        sag = self.pack.voltage_v / self._hover_v
        rpm = self.rpm
        for k, channel in enumerate(self.rotor_channels):
            actuator = min(1.0, max(0.0, (pwm[channel] - self._pwm_low) / self._pwm_span))
            share = math.sqrt(thrust_share(actuator, self._expo))
            error = self._rpm_full * share * sag * self._rotor_gain[k] - rpm[k]
            follows = self._spin_up if error > 0.0 else self._spin_down
            rpm[k] += error * follows

    def _air(self, pwm: Sequence[float], rot: Rotation) -> None:
        """Everything the air does, by cause."""
        vn, ve, vd = self.velocity
        wn, we, wd = self.wind
        u, v, w = turned_back(rot, (vn - wn, ve - we, vd - wd))
        bearing = self.surroundings.wall_azimuth_rad - math.atan2(rot[3], rot[0])
        cb = math.cos(bearing)
        sb = math.sin(bearing)
        noise = self._unsteady.step()
        radius = self.radius
        rpm = self.rpm
        inflow = 1.0 + INFLOW_PER_M_S * w
        fz = mx = my = mz = power = 0.0
        corner = unsteady = drag = ZERO6
        lifts = []
        for i, fan in enumerate(self._fans):
            square = sum(rpm[k] * rpm[k] for k in fan.rotors) / len(fan.rotors)
            reynolds = (max(math.sqrt(square), 1.0) / RPM_HOVER) ** REYNOLDS_EXPONENT
            t0 = fan.ct * self._per_rpm2 * square * reynolds * inflow
            power += max(t0, 0.0) ** 1.5 * self._power_per_thrust15
            inc = self._near_air(fan, rot)
            # the free fan
            fz -= t0
            mx -= fan.y * t0
            my += fan.x * t0
            for k, torque in zip(fan.rotors, fan.cq_torque, strict=True):
                mz += torque * rpm[k] * rpm[k]
            near = corner_wrench(
                fan=fan, lift=t0, square=square, inc=inc, radius=radius, cb=cb, sb=sb
            )
            rough = unsteady_wrench(fan, t0 * inc.rms, noise, 6 * i, radius)
            flow = self._mass_flow(max(t0, 0.0))
            corner = added(corner, near)
            unsteady = added(unsteady, rough)
            drag = added(drag, momentum_drag(fan, flow, u, v, radius))
            lifts.append(t0 * (1.0 + inc.z + inc.rms * noise[6 * i + 2]))
        causes = self.causes
        causes.free = (0.0, 0.0, fz, mx, my, mz)
        causes.corner = corner
        causes.unsteady = unsteady
        causes.drag = drag
        causes.vanes = self._vane_wrench(pwm, lifts)
        self.pack.draw(power + AVIONICS_W, self.dt)

    def _near_air(self, fan: SimFan, rot: Rotation) -> Increments:
        """What ground and wall do to one fan where it is."""
        if not self.surroundings.air:
            return self.law.increments(math.inf, math.inf)
        at = placed(rot, self.position, (fan.x, fan.y, fan.z))
        h = -at[2]
        d = self._wall_gap_of(at) - fan.lip
        return self.law.increments(h / self.radius, d / self.radius)

    def _vane_wrench(self, pwm: Sequence[float], lifts: list[float]) -> Wrench6:
        total = ZERO6
        for k, vane in enumerate(self.vehicle.vanes):
            target = 0.0  # without a pulse the vane stays
            pulse_us = pwm[vane.servo - 1]
            if pulse_us > 0.0:
                target = vane.rad_per_us * (pulse_us - vane.neutral_us)
            error = clipped(target, VANE_LIMIT_RAD) - self.deflection[k]
            self.deflection[k] += error * self._servo
            side = self._vane_gains[k] * self.deflection[k] * lifts[vane.fan - 1]
            ax, ay, az = vane.axis
            force = (side * ax, side * ay, side * az)
            total = added(total, wrench_of(force, vane.position_m))
        return total

    def _contact(self, rot: Rotation) -> None:
        """Feet on the ground and lips on the wall: spring, damper and friction."""
        pz = self.position[2]
        near_ground = pz > -(GEAR_M + NEAR_GROUND_M)
        near_wall = self.wall_gap_m < NEAR_WALL_M
        self.contact = self.wall_contact = False
        total = ZERO6
        if near_ground:
            down = (0.0, 0.0, 1.0)
            for foot in self._feet:
                depth = placed(rot, self.position, foot)[2]
                if depth > 0.0:
                    pressed = self._press(rot, foot, down, depth, GROUND_FRICTION)
                    total = added(total, pressed)
        if near_wall:
            into = (self._wall_cos, self._wall_sin, 0.0)
            bx = rot[0] * into[0] + rot[3] * into[1]
            by = rot[1] * into[0] + rot[4] * into[1]
            size = math.hypot(bx, by)
            for fan in self._fans:
                lip = (fan.x + fan.lip * bx / size, fan.y + fan.lip * by / size, fan.z)
                n, e, _ = turned(rot, lip)
                depth = n * into[0] + e * into[1] - self.wall_gap_m
                if depth > 0.0:
                    self.wall_contact = True
                    pressed = self._press(rot, lip, into, depth, WALL_FRICTION)
                    total = added(total, pressed)
        self.causes.contact = total

    def _press(
        self, rot: Rotation, point: Vec, into: Vec, depth: float, friction: float
    ) -> Wrench6:
        """Wrench of a surface whose inward normal (NED) is ``into`` on a body point ``depth`` [m] inside it."""
        self.contact = True
        p, q, r = self.rates
        x, y, z = point
        turning = (q * z - r * y, r * x - p * z, p * y - q * x)
        v = placed(rot, self.velocity, turning)
        inward = v[0] * into[0] + v[1] * into[1] + v[2] * into[2]
        normal = max(0.0, self._spring * depth + self._damper * inward)
        slide = [v[i] - inward * into[i] for i in range(3)]
        speed = math.hypot(*slide) + SLIDE_M_S
        n, e, d = (-normal * into[i] - friction * normal * slide[i] / speed for i in range(3))
        return wrench_of(turned_back(rot, (n, e, d)), point)

    def _integrate(self, rot: Rotation) -> None:
        dt = self.dt
        causes = vars(self.causes).values()
        fx, fy, fz, mx, my, mz = map(sum, zip(*causes, strict=True))
        m = self.vehicle.mass_kg
        ix, iy, iz = self.vehicle.inertia_kgm2
        self.specific_force = (fx / m, fy / m, fz / m)
        accel = turned(rot, self.specific_force)
        p, q, r = self.rates
        p += dt * (mx - (iz - iy) * q * r) / ix
        q += dt * (my - (ix - iz) * r * p) / iy
        r += dt * (mz - (iy - ix) * p * q) / iz
        self.rates = [p, q, r]
        v = self.velocity
        x = self.position
        for i, gravity in enumerate((0.0, 0.0, GRAVITY)):
            v[i] += dt * (accel[i] + gravity)
            x[i] += dt * v[i]
        qw, qx, qy, qz = self.quaternion
        half = 0.5 * dt
        nw = qw + half * (-qx * p - qy * q - qz * r)
        nx = qx + half * (qw * p + qy * r - qz * q)
        ny = qy + half * (qw * q - qx * r + qz * p)
        nz = qz + half * (qw * r + qx * q - qy * p)
        scale = 1.0 / math.sqrt(nw * nw + nx * nx + ny * ny + nz * nz)
        self.quaternion = [nw * scale, nx * scale, ny * scale, nz * scale]
