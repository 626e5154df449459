"""The 6-DOF loop: all flights of a batch side by side, one numpy operation for all. Arrays are (..., n flights).

Body FRD about the declared CG ("O"), world NED, ground at down = 0. 250 Hz semi-implicit steps; telemetry is sampled at
50 Hz into ``Tape`` without any sensor error (``recorder`` adds those). ``Tape.effect`` is the noise-free residual: what
a perfect observer with the declared vehicle and the declared air would find missing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from . import near_wall
from .craft import GRAVITY, RHO0, VANE_NEUTRAL, VANE_RAD_PER_US, Array, Craft
from .effects import CATALOGUE, Effect
from .pilot import Pilot, rotor_thrust
from .plan import CEILING_HEIGHT, EDGE_HEIGHT, WALL_EAST, WALL_NORTH, Leg
from .power import Battery, Heat
from .unlisted import UNLISTED

DT = 0.004
TICK = 5  # steps between telemetry samples
SETTLE_S = 10.0
NOISE_TAU = np.array([0.1, 0.35, 1.0, 3.0])
NOISE_SHARE = np.array([0.20, 0.30, 0.30, 0.20])


@dataclass(frozen=True)
class Job:
    """One flight to simulate."""

    seed: int
    plan: tuple[Leg, ...]
    effects: dict[str, dict[str, float]] = field(default_factory=dict)
    by_servo: bool = False
    ceiling: bool = False
    front_wall: bool = False


@dataclass(frozen=True)
class Tape:
    """What happened, at 50 Hz, without sensor errors; first axis time, last axis flight."""

    time: Array  # (t,)
    position: Array  # (t, 3, n)
    velocity: Array
    quaternion: Array  # (t, 4, n)
    rates: Array
    specific_force: Array  # at the declared CG
    rpm: Array  # (t, fans, n)
    pwm: Array  # (t, fans + vanes, n)
    ranges: Array  # (t, 4, n): down, right, up, front
    volts: Array  # (t, n)
    amperes: Array
    case_c: Array  # (t, fans, n)
    pressure: Array  # (t, n)
    air_c: Array
    effect: Array  # (t, 6, n)


class World:
    """State of all flights; effects read and change it through their hooks."""

    def __init__(
        self, craft: Craft, jobs: Sequence[Job], duration_s: float, settle_s: float = SETTLE_S
    ) -> None:
        n, fans = len(jobs), len(craft.fan_position)
        self.craft, self.jobs, self.n, self.dt = craft, jobs, n, DT
        self.duration_s, self.settle_s = duration_s, settle_s
        self.t = -settle_s
        self.rng = [np.random.default_rng([job.seed, 7]) for job in jobs]
        home = np.array([job.plan[0].down for job in jobs])
        self.p, self.v, self.w = np.zeros((3, n)), np.zeros((3, n)), np.zeros((3, n))
        self.p[2] = home
        self.q = np.zeros((4, n))
        self.q[0] = 1.0
        self.R = np.tile(np.eye(3)[..., None], (1, 1, n))
        self.yaw = np.zeros(n)
        self.mass = np.full(n, craft.mass_kg)
        self.base_inertia = np.tile(np.array(craft.inertia)[:, None], (1, n))
        self.inertia = self.base_inertia.copy()
        self.cg = np.zeros((3, n))
        self.by_servo = np.array([job.by_servo for job in jobs])
        self.rho = np.full(n, RHO0)
        self.air_c = np.array([rng.uniform(11.0, 20.0) for rng in self.rng])
        self.pressure_pa = RHO0 * 287.05 * (273.15 + self.air_c)
        self.cabin_pa = np.zeros(n)
        self.aux_current = np.zeros(n)
        self.range_bias, self.accel_bias = np.zeros(n), np.zeros((3, n))
        self.hot, self.weak = np.ones(n), np.ones(n)
        self.fixed_v = np.where(self.by_servo, craft.voltage_v, np.nan)
        self.motor_tau = np.where(self.by_servo, 0.006, 0.04)
        self.table_edge = np.full(n, -np.inf)
        # Object avoidance of the autopilot: distances [m] inside which it shifts its place away.
        self.keep_off_wall, self.keep_off_ceiling = np.full(n, 0.12), np.full(n, -np.inf)
        self.fan_rpm = np.full((fans, n), craft.hover_rpm)
        self.air_rpm = self.fan_rpm.copy()
        self.vane_us = np.full((len(craft.vane_position), n), VANE_NEUTRAL)
        self.pwm = np.full((fans, n), 1700.0)
        self.vane_wanted = self.vane_us.copy()
        self.lift = np.full((fans, n), craft.hover_fan_thrust)
        self.current = np.full(n, 25.0)
        self.effects = _gather(craft, jobs)
        for effect in self.effects:
            effect.start(self)
        self.battery = Battery.fresh(n, round(craft.voltage_v / 4.0), self.fixed_v, self.weak)
        self.heat = Heat.warm(fans, self.air_c.copy(), self.hot)
        self.pilot = Pilot(craft, n, np.array([rng.uniform(0.85, 1.15) for rng in self.rng]))
        self._plan = _PlanFollower(jobs, home)
        modes = len(NOISE_TAU)
        self._noise_state = np.zeros((fans + 5, modes, n))
        self.noise = np.zeros((fans + 5, n))
        scale = craft.mass_kg / 4.6
        self._noise_size = np.array(
            [*[0.34 * scale * np.sqrt(2.0 / fans)] * fans, 0.30, 0.30, 0.024, 0.02, 0.013]
        )
        self._noise_size[fans:] *= scale
        self._estimate = np.zeros((6, n))

    def attach(self, i: Array, kg: Array, x: float, y: float, z: Array) -> None:
        """A lump of ``kg`` at (x, y, z) from the declared CG joins flights ``i``."""
        bare = self.craft.mass_kg
        self.mass[i] = bare + kg
        lump = np.stack(np.broadcast_arrays(x, y, z))
        self.cg[:, i] = kg * lump / self.mass[i]
        reduced = bare * kg / self.mass[i]
        x2, y2, z2 = lump**2
        self.inertia[:, i] = self.base_inertia[:, i] + reduced * np.stack(
            [y2 + z2, x2 + z2, x2 + y2]
        )

    def fly(self) -> Tape:
        """Run all flights to the end."""
        frames: list[tuple[Array, ...]] = []
        steps = round((self.settle_s + self.duration_s) / DT)
        for k in range(steps):
            self.t = k * DT - self.settle_s
            tick = k % TICK == 0
            if tick:
                self._draw_noise()
            self._geometry()
            if k % 2 == 0:
                self._pilot()
            self._actuators(tick)
            force, spin_up = self._air()
            if tick and self.t >= -1e-9:
                frames.append(self._frame(force, spin_up))
            self._move(force, spin_up)
        columns = [np.stack(column) for column in zip(*frames, strict=True)]
        time: Array = np.array([k * DT * TICK for k in range(len(frames))])
        return Tape(time, *columns)

    # --- one step -------------------------------------------------------------------------------------------------

    def _geometry(self) -> None:
        w, x, y, z = self.q
        self.R[0] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
        self.R[1] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
        self.R[2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
        self.yaw = np.arctan2(self.R[1, 0], self.R[0, 0])
        fans = np.einsum("jkn,kf->jfn", self.R, np.array(self.craft.fan_position).T)
        self._fan_offset = fans
        self.fan_north = self.p[0] + fans[0]
        self.height = -(self.p[2] + fans[2])
        self.d = WALL_EAST - self.p[1] - fans[1] - self.craft.lip_m

    def _pilot(self) -> None:
        place, speed, push, yaw = self._plan.at(self.t, 2 * DT)
        place = place.copy()
        place[1] -= 2.0 * np.maximum(self.keep_off_wall - self.d.min(axis=0), 0.0)
        place[2] += 2.0 * np.maximum(
            self.keep_off_ceiling - (CEILING_HEIGHT - self.height.max(axis=0)), 0.0
        )
        seen_p, seen_v = self.p + self._estimate[:3], self.v + self._estimate[3:]
        self.pwm, self.vane_wanted = self.pilot.outputs(
            2 * DT, seen_p, seen_v, self.R, self.w, self.yaw, place, speed, push, yaw
        )

    def _actuators(self, tick: bool) -> None:
        craft = self.craft
        if tick:
            load = self.lift / craft.hover_fan_thrust
            watts = (170.0 if craft.rotors_per_fan == 2 else 65.0) * (load**1.5).sum(axis=0)
            self.current = watts / self.battery.volts * 2.0 + 0.8 + self.aux_current
            self.battery.step(DT * TICK, self.current)
            self.heat.step(DT * TICK, load)
        thrust = (
            rotor_thrust(craft, self.pwm)
            * craft.rotors_per_fan
            * (self.battery.volts / craft.voltage_v) ** 2
        )
        settled = craft.hover_rpm * (thrust / craft.hover_fan_thrust) ** (
            1.0 / (2.0 + craft.reynolds)
        )
        self.fan_rpm = self.fan_rpm + DT / self.motor_tau * (settled - self.fan_rpm)
        self.vane_us = self.vane_us + DT / 0.012 * (self.vane_wanted - self.vane_us)

    def _air(self) -> tuple[Array, Array]:
        craft = self.craft
        self.mass[:], self.cg[:] = craft.mass_kg, 0.0
        self.air_rpm = self.fan_rpm.copy()
        self.fan_gain = np.tile(self.rho / RHO0, (len(craft.fan_position), 1))
        for effect in self.effects:
            effect.body(self)
            effect.speeds(self)
            effect.factors(self)
        self.force, self.moment, self.lift = self._declared(
            self.height, self.d, self.air_rpm, self.fan_gain, self.vane_us
        )
        self._add_noise()
        for effect in self.effects:
            effect.loads(self)
        about_cg = self.moment - cross(self.cg, self.force)
        spin_up = (about_cg - cross(self.w, self.inertia * self.w)) / self.inertia
        return self.force, spin_up

    def _declared(
        self, h: Array, d: Array, rpm: Array, gain: Array | float, vane_us: Array
    ) -> tuple[Array, Array, Array]:
        """Force, moment (3, n) about the declared CG and lift (fans, n) of fans and vanes in the declared air."""
        craft = self.craft
        wrench = near_wall.to_body(
            near_wall.fan_wrench(craft, h, d, rpm) * gain, np.pi / 2 - self.yaw
        )
        force, moment = wrench[:3].sum(axis=1), wrench[3:].sum(axis=1)
        for f, (x, y, z) in enumerate(craft.fan_position):
            fx, fy, fz = wrench[:3, f]
            moment[0] += y * fz - z * fy
            moment[1] += z * fx - x * fz
            moment[2] += x * fy - y * fx
        lift = -wrench[2]
        if craft.cq:
            torque = craft.cq / craft.ct * craft.radius_m * near_wall.free_thrust(craft, rpm) * gain
            moment[2] -= (np.array(craft.spin)[:, None] * torque).sum(axis=0)
        for f, (x, _, z) in enumerate(craft.vane_position):
            side = craft.vane_gain * VANE_RAD_PER_US * (vane_us[f] - VANE_NEUTRAL) * lift[f]
            force[1] += side
            moment[0] -= z * side
            moment[2] += x * side
        return force, moment, lift

    def _draw_noise(self) -> None:
        keep = np.exp(-DT * TICK / NOISE_TAU)[None, :, None]
        shape = self._noise_state.shape[:2]
        kick = np.stack([rng.standard_normal((*shape,)) for rng in self.rng], axis=-1)
        size = np.sqrt(NOISE_SHARE * (1.0 - np.exp(-2.0 * DT * TICK / NOISE_TAU)))[None, :, None]
        self._noise_state = keep * self._noise_state + size * kick
        self.noise = self._noise_size[:, None] * self._noise_state.sum(axis=1)
        # The estimator errs slowly: centimetres, centimetres a second.
        wander = np.stack([rng.standard_normal(6) for rng in self.rng], axis=-1)
        self._estimate = 0.996 * self._estimate + np.array([[0.0012]] * 3 + [[0.002]] * 3) * wander

    def _add_noise(self) -> None:
        fans = len(self.craft.fan_position)
        rough = 1.0 + 0.8 * np.exp(-np.maximum(self.height, 0.0) / self.craft.radius_m)
        up = self.noise[:fans] * rough
        self.noise_force = np.stack([self.noise[fans], self.noise[fans + 1], up.sum(axis=0)])
        x, y = np.array(self.craft.fan_position).T[:2, :, None]
        self.noise_moment = self.noise[fans + 2 :] + np.stack(
            [(y * up).sum(axis=0), -(x * up).sum(axis=0), np.zeros(self.n)]
        )
        self.force += self.noise_force
        self.moment += self.noise_moment

    def _move(self, force: Array, spin_up: Array) -> None:
        accel = np.einsum("jkn,kn->jn", self.R, force / self.mass)
        accel[2] += GRAVITY
        # p, v are those of the declared CG.
        offset = cross(spin_up, self.cg) + cross(self.w, cross(self.w, self.cg))
        self.v = self.v + DT * (accel - np.einsum("jkn,kn->jn", self.R, offset))
        self.p = self.p + DT * self.v
        self.w = self.w + DT * spin_up
        a, b, c = 0.5 * DT * self.w
        w, x, y, z = self.q
        q = self.q + np.stack(
            [
                -x * a - y * b - z * c,
                w * a + y * c - z * b,
                w * b - x * c + z * a,
                w * c + x * b - y * a,
            ]
        )
        self.q = q / np.sqrt((q * q).sum(axis=0))

    # --- telemetry ------------------------------------------------------------------------------------------------

    def _frame(self, force: Array, spin_up: Array) -> tuple[Array, ...]:
        craft = self.craft
        felt = (
            force / self.mass
            - cross(spin_up, self.cg)
            - cross(self.w, cross(self.w, self.cg))
            + self.accel_bias
        )
        ranges = self._ranges()
        inertia = np.array(craft.inertia)[:, None]
        measured_m = inertia * spin_up + cross(self.w, inertia * self.w)
        h, d = self._seen_distances(ranges)
        rpm = np.where(self.by_servo, rpm_of_output(craft, self.pwm), self.fan_rpm)
        declared_f, declared_m, _ = self._declared(h, d, rpm, 1.0, self.vane_us)
        effect = np.concatenate(
            [
                craft.mass_kg * felt - declared_f - self.noise_force,
                measured_m - declared_m - self.noise_moment,
            ]
        )
        outputs = np.concatenate([self.pwm, self.vane_us])
        return (
            self.p.copy(), self.v.copy(), self.q.copy(), self.w.copy(), felt, self.fan_rpm.copy(), outputs, ranges,
            self.battery.volts.copy(), self.current.copy(), self.heat.case.copy(), self.pressure_pa + self.cabin_pa,
            self.air_c.copy(), effect,
        )  # fmt: skip

    def _ranges(self) -> Array:
        """Beams down, right, up and ahead [m]; inf where nothing is hit. Includes a sensor's fixed offset."""
        R, p, craft = self.R, self.p, self.craft
        with np.errstate(divide="ignore", invalid="ignore"):
            low = p + craft.down_ranger_m * R[:, 2]
            floor = np.where(low[0] < self.table_edge, -EDGE_HEIGHT, 0.0)
            down = np.where(R[2, 2] > 0.5, (floor - low[2]) / R[2, 2], np.inf) + self.range_bias
            right_at = p[1] + craft.side_ranger_m * R[1, 1]
            right = np.where(R[1, 1] > 0.3, (WALL_EAST - right_at) / R[1, 1], np.inf)
            top = p[2] - 0.06 * R[2, 2]
            up = np.where(R[2, 2] > 0.5, (CEILING_HEIGHT + top) / R[2, 2], np.inf)
            ahead = np.where(R[0, 0] > 0.3, (WALL_NORTH - p[0]) / R[0, 0], np.inf)
        return np.stack([down, right, up, ahead])

    def _seen_distances(self, ranges: Array) -> tuple[Array, Array]:
        """Each fan's h and d (fans, n) as the beams tell them to somebody who knows the attitude."""
        R, fans, craft = self.R, self._fan_offset, self.craft
        h = (ranges[0] + craft.down_ranger_m) * R[2, 2] - fans[2]
        wall = np.where(R[1, 1] > 0.3, (ranges[1] + craft.side_ranger_m) * R[1, 1], np.inf)
        return h, wall - fans[1] - craft.lip_m


class _PlanFollower:
    """A smooth reference that runs after the plan's places."""

    def __init__(self, jobs: Sequence[Job], home: Array) -> None:
        n = len(jobs)
        self.place, self.speed = np.zeros((3, n)), np.zeros((3, n))
        self.place[2] = home
        self.push = np.zeros((3, n))
        self.yaw, self.turn = np.zeros(n), np.zeros(n)
        self.ends = [np.cumsum([leg.duration_s for leg in job.plan]) for job in jobs]
        self.legs = [
            np.array([(g.north, g.east, g.down, g.yaw, g.speed) for g in job.plan]) for job in jobs
        ]
        self.now = np.stack([legs[0] for legs in self.legs], axis=-1)
        self.leg = [0] * n
        self.next = np.array([ends[0] for ends in self.ends])

    def at(self, t: float, dt: float) -> tuple[Array, Array, Array, Array]:
        """Place, speed, acceleration (3, n) and yaw (n) wanted at time ``t``."""
        for k in np.nonzero(t >= self.next)[0]:
            self.leg[k] = min(self.leg[k] + 1, len(self.legs[k]) - 1)
            self.now[:, k] = self.legs[k][self.leg[k]]
            self.next[k] = self.ends[k][self.leg[k]]
        wish = 1.3 * (self.now[:3] - self.place)
        fast = np.sqrt((wish * wish).sum(axis=0)) + 1e-9
        wish *= np.minimum(1.0, self.now[4] / fast)
        self.push = self.push + dt * 6.0 * (
            np.clip(3.0 * (wish - self.speed), -2.2, 2.2) - self.push
        )
        self.speed = self.speed + dt * self.push
        self.place = self.place + dt * self.speed
        swing = np.clip(2.0 * (self.now[3] - self.yaw), -0.9, 0.9)
        self.turn += dt * 3.0 * (swing - self.turn)
        self.yaw = self.yaw + dt * self.turn
        return self.place, self.speed, self.push, self.yaw


def rpm_of_output(craft: Craft, pwm: Array) -> Array:
    """Fan speed (rpm) at which the fan gives the thrust that the declared throttle curve tells for an output."""
    thrust = rotor_thrust(craft, pwm) * craft.rotors_per_fan
    return craft.hover_rpm * (thrust / craft.hover_fan_thrust) ** (1.0 / (2.0 + craft.reynolds))


def cross(a: Array, b: Array) -> Array:
    """a x b of (3, n) arrays."""
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def _gather(craft: Craft, jobs: Sequence[Job]) -> list[Effect]:
    """One effect object per name, over the flights that have it."""
    out: list[Effect] = []
    for name, kind in {**CATALOGUE, **UNLISTED}.items():
        index = np.array([k for k, job in enumerate(jobs) if name in job.effects], dtype=int)
        if index.size:
            keys = jobs[index[0]].effects[name]
            out.append(
                kind(
                    craft,
                    index,
                    {key: np.array([jobs[k].effects[name][key] for k in index]) for key in keys},
                )
            )
    return out
