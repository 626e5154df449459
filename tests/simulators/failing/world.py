"""Rigid bodies with rotors in wind, over a ground and before a wall. Flights of one frame run side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .cases import Case
from .control import Autopilot, cross, curve
from .craft import Array, Craft, G

DT = 0.004
EVERY = 5
"""Steps between samples that are kept: 50 Hz."""
TAKE_OFF_S = 4.0
WEAK_S = 20.0
WEAK_EVERY_S = 30.0
"""How long a fan is weak, and when the next one begins to be."""
HOP_M_S = 0.3
PRESSING_SHARE = 0.8
"""Speed beyond what the place asks at which a vehicle hops, and thrust over weight between hops."""


@dataclass(frozen=True, kw_only=True)
class Tape:
    """What happened at 50 Hz, without errors of sensors; axes (samples, flights, ...)."""

    time_s: Array
    position: Array
    velocity: Array
    quaternion: Array
    rates: Array
    force: Array
    """Specific force [m/s^2], body FRD."""
    command: Array
    """Of each motor, 0 to 1."""
    speed: Array
    """Of each rotor [rad/s]."""
    volts: Array
    shaken: Array
    """Vibration of a damaged rotor, as a share of g."""


def fly(crafts: Sequence[Craft], cases: Sequence[Case], rng: np.random.Generator) -> Tape:
    """Every case on its craft, to the longest duration."""
    return _World(crafts, cases, rng).run()


class _World:
    def __init__(
        self, crafts: Sequence[Craft], cases: Sequence[Case], rng: np.random.Generator
    ) -> None:
        n = len(crafts)
        self.n = n
        self.crafts = crafts
        self.cases = cases
        self.rng = rng
        self.mass = np.array([c.mass_kg for c in crafts])
        self.inertia = np.array([c.inertia for c in crafts])
        self.places = np.stack([c.places for c in crafts])
        self.spins = np.stack([c.spins for c in crafts])
        self.top = np.array([c.max_thrust_n for c in crafts])
        self.torque = np.array([c.torque_m for c in crafts])
        self.expo = np.array([c.expo for c in crafts])
        self.tau = np.array([c.motor_tau_s for c in crafts])
        self.tip = np.array([c.top_speed_rad_s * c.rotor_radius_m for c in crafts])
        self.inflow = np.array([c.inflow for c in crafts])
        self.drag = np.array([c.drag_per_s for c in crafts])
        self.arm = np.array([c.arm_m for c in crafts])
        self.pilot = Autopilot(crafts, rng)
        self.p = np.zeros((n, 3))
        self.p[:, 2] = -0.6 * self.arm
        self.v = np.zeros((n, 3))
        self.q = np.zeros((n, 4))
        self.q[:, 0] = 1.0
        self.w = np.zeros((n, 3))
        self.turning = np.zeros(self.spins.shape)
        self.command = np.full(self.spins.shape, 0.15)
        self.wind = rng.normal(0.0, 1.5, (n, 3))
        self.wind[:, 2] = 0.0
        self.eddies = np.zeros((n, 3))
        self.rough = rng.uniform(0.3, 1.2, n)
        self.spent = np.zeros(n)
        self.resistance = rng.uniform(0.02, 0.05, n)
        self.roll_error = np.zeros(n)
        self.legs = [_legs(case, rng) for case in cases]
        self.feet = touching(self.places, self.arm)
        self.order = np.tile(np.arange(self.spins.shape[1]), (n, 1))
        for i, case in enumerate(cases):
            if case.kind == "hops":
                # Who hops by hand asks for as much thrust as that takes.
                self.pilot.known_mass[i] = self.mass[i]
            if case.kind == "exchanged":
                first, second = case.motors
                self.order[i, [first - 1, second - 1]] = [second - 1, first - 1]

    def run(self) -> Tape:
        kept: list[tuple[Array, ...]] = []
        seconds = max(case.end_s for case in self.cases)
        for k in range(round(seconds / DT)):
            t = k * DT
            rotation = _rotation(self.q)
            if k % 2 == 0:
                self._pilot(t, rotation)
            thrust, drawn = self._rotors(t, rotation)
            force, moment = self._loads(t, rotation, thrust)
            if k % EVERY == 0:
                kept.append(self._sample(t, rotation, force))
            self._move(rotation, force, moment)
            self.spent += drawn * DT
        columns = [np.stack(column) for column in zip(*kept, strict=True)]
        names = (
            "time_s",
            "position",
            "velocity",
            "quaternion",
            "rates",
            "force",
            "command",
            "speed",
            "volts",
        )
        return Tape(**dict(zip((*names, "shaken"), columns, strict=True)))

    def _pilot(self, t: float, rotation: Array) -> None:
        target = np.zeros((self.n, 3))
        target_v = np.zeros((self.n, 3))
        turn = np.full(self.n, np.nan)
        yaw = np.zeros(self.n)
        seen = self.p.copy()
        for i, case in enumerate(self.cases):
            target[i], target_v[i], yaw[i] = self.legs[i].at(t)
            since = t - case.since_s
            if case.kind == "hops":
                target[i, :2] = self.p[i, :2]
                target_v[i, 2] = -HOP_M_S
                continue
            if since < 0.0:
                continue
            if case.kind == "glitch":
                seen[i, :2] += case.size * np.array([0.8, 0.6])
            if case.kind == "dive":
                target[i, 2] = 5.0
                target_v[i] = [2.0, 1.0, case.size]
            if case.kind == "wall":
                target[i, 0] = self.legs[i].home[0] + 60.0
                target_v[i, 0] = case.size
            if case.kind == "landing":
                target[i, 2] = 3.0
                target_v[i] = [case.size, 0.5 * case.size, case.size]
            if case.kind == "flip" and since < 2.0 * np.pi / case.size:
                turn[i] = case.size
            if case.kind == "attitude":
                self.roll_error[i] = min(case.size * since, 1.4)
        believed = rotation @ _about_roll(self.roll_error)
        force = self.pilot.wanted_force(seen, self.v, target, target_v, 2 * DT)
        pressed = np.stack([legs.pressed(t) for legs in self.legs])
        on_feet = np.isfinite(pressed).all(axis=1)
        force[on_feet] = pressed[on_feet]
        self.pilot.speed_sum[on_feet] = 0.0
        self.command = self.pilot.outputs(believed, self.w, force, yaw, turn, 2 * DT)
        if t < TAKE_OFF_S:
            self.command[:] = 0.15
            self.pilot.speed_sum[:] = 0.0
            self.pilot.rate_sum[:] = 0.0

    def _rotors(self, t: float, rotation: Array) -> tuple[Array, Array]:
        self.spread = np.take_along_axis(self.command, self.order, axis=1)
        share = np.ones(self.spins.shape)
        torque = np.ones(self.spins.shape)
        fixed = np.full(self.spins.shape, np.nan)
        dead = np.ones(self.n)
        self.shake = np.zeros(self.n)
        for i, case in enumerate(self.cases):
            since = t - case.since_s
            if since < 0.0 or not case.motors:
                continue
            k = case.motors[0] - 1
            if case.kind == "stopped":
                fixed[i, k] = 0.0
            elif case.kind == "desync":
                fixed[i, k] = 0.12 + 0.08 * np.sin(23.0 * since)
            elif case.kind == "thrown":
                share[i, k] = 0.0
                torque[i, k] = 0.03
            elif case.kind == "partial":
                share[i, k] = 1.0 - case.size
                torque[i, k] = 1.0 - 0.7 * case.size
                self.shake[i] = 0.15 * case.size
            elif case.kind == "weak":
                # One after the other, each for a while.
                for number, motor in enumerate(case.motors):
                    if 0.0 <= since - number * WEAK_EVERY_S < WEAK_S:
                        share[i, motor - 1] = 1.0 - case.size
                        torque[i, motor - 1] = 1.0 - 0.7 * case.size
            elif case.kind == "commanded":
                self.command[i, k] = 0.0
                self.spread[i, k] = 0.0
        for i, case in enumerate(self.cases):
            if case.kind == "battery" and t > case.since_s:
                dead[i] = 1.0 - case.size * min((t - case.since_s) / 3.0, 1.0)
        loaded = self.turning**2
        drawn = (loaded * self.turning).sum(axis=1) / self.spins.shape[1]
        volts = (1.0 - 0.0012 * self.spent - self.resistance * drawn) * dead
        self.volts = volts * np.array([c.volts for c in self.crafts])
        reach = np.sqrt(curve(np.maximum(self.spread, 0.0), self.expo[:, None])) * volts[:, None]
        # A motor without its propeller turns at no-load speed.
        bare = np.minimum(np.maximum(self.spread, 0.0) * 1.6, 1.5) * volts[:, None]
        goal = np.where(torque < 0.1, bare, reach)
        goal = np.where(np.isfinite(fixed), fixed, goal)
        self.turning = self.turning + DT / self.tau[:, None] * (goal - self.turning)
        self.turning = np.where(
            self.spread <= 0.0, np.maximum(self.turning - 4.0 * DT, 0.0), self.turning
        )
        hubs = self._velocity_of(rotation, self.places)
        up = -hubs[..., 2] / self.tip[:, None]
        thrust = self.turning * (self.turning - self.inflow[:, None] * 0.35 * up)
        thrust = np.clip(thrust, -0.1, 2.0) * share * self.top[:, None]
        self.reaction = self.turning**2 * torque * self.top[:, None] * self.torque[:, None]
        return thrust, drawn

    def _velocity_of(self, rotation: Array, points: Array) -> Array:
        """Of points (n, m, 3) through the air, body axes."""
        air = self.v - self.wind - self.eddies - self.gust
        body = np.einsum("nji,nj->ni", rotation, air)
        return body[:, None, :] + cross(self.w[:, None, :], points)

    @property
    def gust(self) -> Array:
        out = np.zeros((self.n, 3))
        for i, case in enumerate(self.cases):
            since = self.t - case.since_s
            if case.kind == "gust" and 0.0 < since < 2.5:
                out[i, 0] = 0.5 * case.size * (1.0 - np.cos(2.0 * np.pi * since / 2.5))
        return out

    t = 0.0

    def _loads(self, t: float, rotation: Array, thrust: Array) -> tuple[Array, Array]:
        self.t = t
        forces = np.zeros((*thrust.shape, 3))
        forces[..., 2] = -thrust
        through = self._velocity_of(rotation, self.places)
        held = (self.drag * self.mass / thrust.shape[1])[:, None] * self.turning / 0.6
        forces[..., :2] -= held[..., None] * through[..., :2]
        middle = self._velocity_of(rotation, np.zeros((self.n, 1, 3)))[:, 0]
        speed = np.linalg.norm(middle, axis=1, keepdims=True)
        area = 0.12 * self.arm[:, None] ** 2
        body = -0.5 * 1.225 * area * speed * middle
        moment = cross(self.places, forces).sum(axis=1)
        moment[:, 2] += (-self.spins * self.reaction).sum(axis=1)
        moment -= 0.02 * (self.mass * self.arm**2)[:, None] * self.w
        force = forces.sum(axis=1) + body
        touch, twist = self._touch(rotation)
        self._loose(t, moment, force)
        return force + touch, moment + twist

    def _loose(self, t: float, moment: Array, force: Array) -> None:
        """A load that hangs off the middle, until it drops."""
        for i, case in enumerate(self.cases):
            if case.kind == "drop" and t < case.since_s:
                weight = case.size * self.mass[i] * G
                force[i] += _rotation(self.q[i : i + 1])[0].T @ np.array([0.0, 0.0, weight])
                moment[i, 0] += 0.05 * self.arm[i] * weight
                moment[i, 1] += 0.04 * self.arm[i] * weight

    def _touch(self, rotation: Array) -> tuple[Array, Array]:
        """Ground below 0 and, for flights into a wall, a wall to the north: springs with damping and friction."""
        where = self.p[:, None] + np.einsum("nij,nkj->nki", rotation, self.feet)
        moving = self.v[:, None] + np.einsum(
            "nij,nkj->nki", rotation, cross(self.w[:, None], self.feet)
        )
        stiff = (self.mass * G / (0.03 * self.arm))[:, None]
        damping = 0.6 * np.sqrt(stiff * self.mass[:, None] / 4.0)
        world = np.zeros_like(where)
        deep = np.maximum(where[..., 2], 0.0)
        press = np.where(deep > 0.0, np.maximum(stiff * deep + damping * moving[..., 2], 0.0), 0.0)
        world[..., 2] -= press
        slide = moving[..., :2] / (np.linalg.norm(moving[..., :2], axis=2, keepdims=True) + 0.1)
        world[..., :2] -= 0.6 * press[..., None] * slide
        for i, case in enumerate(self.cases):
            if case.kind == "wall" and self.t > case.since_s:
                inside = np.maximum(where[i, :, 0] - self.legs[i].home[0] - 4.0, 0.0)
                push = np.maximum(stiff[i] * inside + damping[i] * moving[i, :, 0], 0.0) * (
                    inside > 0.0
                )
                world[i, :, 0] -= push
        body = np.einsum("nji,nkj->nki", rotation, world)
        return body.sum(axis=1), cross(self.feet, body).sum(axis=1)

    def _move(self, rotation: Array, force: Array, moment: Array) -> None:
        accel = np.einsum("nij,nj->ni", rotation, force) / self.mass[:, None]
        accel[:, 2] += G
        spin = moment - cross(self.w, self.inertia * self.w)
        self.w = np.clip(self.w + DT * spin / self.inertia, -60.0, 60.0)
        self.v = self.v + DT * accel
        self.p = self.p + DT * self.v
        self.q = self.q + 0.5 * DT * _product(self.q, self.w)
        self.q /= np.linalg.norm(self.q, axis=1, keepdims=True)
        kick = self.rng.standard_normal((self.n, 3)) * self.rough[:, None]
        self.eddies += DT / 0.8 * (-self.eddies) + np.sqrt(2.0 * DT / 0.8) * kick

    def _sample(self, t: float, rotation: Array, force: Array) -> tuple[Array, ...]:
        half = 0.5 * self.roll_error
        believed = self.q.copy()
        lean = np.stack([np.cos(half), np.sin(half), 0.0 * half, 0.0 * half], axis=1)
        believed = _times(believed, lean)
        turning = self.turning * np.array([c.top_speed_rad_s for c in self.crafts])[:, None]
        return (
            np.array(t),
            self.p.copy(),
            self.v.copy(),
            believed,
            self.w.copy(),
            force / self.mass[:, None],
            self.command.copy(),
            turning,
            self.volts.copy(),
            self.shake.copy(),
        )


@dataclass(frozen=True)
class _Legs:
    """Places [m] to fly to, each for some seconds, from take-off on."""

    times: Array
    places: Array
    yaws: Array
    home: Array
    pressing: Array | None = None
    """World force over the mass (legs, 3) that is asked for on the feet; NaN in the air."""

    def pressed(self, t: float) -> Array:
        """What is asked for on the feet (3,), else NaN."""
        if self.pressing is None:
            return np.full(3, np.nan)
        return self.pressing[int(np.searchsorted(self.times, t, side="right")) - 1]

    def at(self, t: float) -> tuple[Array, Array, float]:
        """Where to be, how fast to go there, and the heading."""
        k = int(np.searchsorted(self.times, t, side="right")) - 1
        return self.places[k], np.zeros(3), float(self.yaws[k])


def _hops(case: Case, rng: np.random.Generator) -> _Legs:
    """Up for 1 to 3 s to ``height_m`` over the feet, and as long on the feet, in turn."""
    durations = rng.uniform(1.0, 3.0, 2 * int(case.end_s / 2.0))
    times = TAKE_OFF_S + np.concatenate([[0.0], np.cumsum(durations)])
    count = len(times)
    places = np.zeros((count, 3))
    places[:, 2] = -rng.uniform(*case.height_m, count)
    angle = rng.uniform(0.0, case.size, count)
    to = rng.uniform(0.0, 2.0 * np.pi, count)
    level = np.sin(angle)
    asked = np.stack([level * np.cos(to), level * np.sin(to), -np.cos(angle)], axis=1)
    asked[::2] = np.nan
    times[0] = 0.0
    return _Legs(times, places, np.zeros(count), np.zeros(3), PRESSING_SHARE * G * asked)


def _legs(case: Case, rng: np.random.Generator) -> _Legs:
    if case.kind == "hops":
        return _hops(case, rng)
    count = int(case.end_s / 4.0) + 2
    times = TAKE_OFF_S + 4.0 * np.arange(count)
    height = rng.uniform(*case.height_m)
    places = np.column_stack(
        [rng.normal(0.0, 2.5, count), rng.normal(0.0, 2.5, count), np.full(count, -height)]
    )
    places[:, 2] += rng.uniform(-0.15, 0.15, count) * height
    still = rng.random(count) < 0.5
    for k in range(1, count):
        if still[k]:
            places[k] = places[k - 1]
    places[:2, :2] = 0.0
    # The place is held from a little before what happens, so that its beginning is not a manoeuvre.
    yaws = np.where(times < 14.0, 0.0, rng.uniform(-0.6, 0.6))
    later = times > case.since_s
    home = places[max(int(np.argmax(later)) - 1, 0)].copy()
    places[later] = home if case.kind != "partial" else places[later]
    times[0] = 0.0
    return _Legs(times, places, yaws, home)


def touching(places: Array, arm: Array) -> Array:
    """Points that touch: four feet below and every rotor's tip."""
    feet = []
    for x, y in ((0.6, 0.6), (0.6, -0.6), (-0.6, 0.6), (-0.6, -0.6)):
        feet.append(np.stack([x * arm, y * arm, 0.6 * arm], axis=1))
    return np.concatenate([np.stack(feet, axis=1), 1.3 * places], axis=1)


def _rotation(q: Array) -> Array:
    w, x, y, z = q.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def _about_roll(angle: Array) -> Array:
    q = np.stack([np.cos(angle / 2), np.sin(angle / 2), 0.0 * angle, 0.0 * angle], axis=1)
    return _rotation(q)


def _product(q: Array, w: Array) -> Array:
    return _times(q, np.column_stack([np.zeros(len(w)), w]))


def _times(a: Array, b: Array) -> Array:
    aw, ax, ay, az = a.T
    bw, bx, by, bz = b.T
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=1,
    )
