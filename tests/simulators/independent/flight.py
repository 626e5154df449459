"""The flight itself: rigid body and rotors by Runge-Kutta 4; outputs, surfaces and outer loads held over a step.

State of one flight: position and velocity of the true CG (NED), quaternion, rates (body FRD), rotor speeds; the induced
velocities take one exponential step beside it. Flights of one vehicle run side by side.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from . import loads, power, rotor
from .airframes import Airframe, Array, G
from .conditions import Conditions, pack, stacked
from .controller import Autopilot
from .script import Reference
from .weather import coloured, wind

DT = 0.004
SMOOTHED = DT / (DT + 0.012)
"""Share of a step in the pack's current that its capacitors let through at once."""
WARM_UP_S = 4.0
"""Flown before the log begins, at the first target."""


@dataclass(frozen=True)
class Sortie:
    """One flight to be flown."""

    seed: int
    conditions: Conditions
    reference: Reference


@dataclass(frozen=True)
class Track:
    """What happened in one flight, every ``DT``; time last. Position and rates are of the true CG and body."""

    time: Array
    position: Array
    velocity: Array
    quaternion: Array
    rates: Array
    turning: Array
    """Angular acceleration (3, t)."""
    felt: Array
    """Specific force at the true CG, body (3, t)."""
    omega: Array
    induced: Array
    output: Array
    """Output shares (rotors, t)."""
    wind: Array
    unsteady: Array
    volts: Array
    amperes: Array
    warm: Array
    """Windings above their first temperature [K], (rotors, t)."""
    rope: Array
    """Pull of the slung load, NED (3, t)."""
    cg: Array
    """True CG from the declared one, body (3, t)."""


@dataclass
class _Outer:
    """What is held over one step."""

    near: loads.Near
    force: Array  # body, N, about the declared CG
    moment: Array
    mass: Array
    cg: Array
    inertia: Array
    wind: Array
    unsteady: Array
    volts: Array
    warm: Array


class Flight:
    """Flights of one vehicle side by side."""

    def __init__(
        self, frame: Airframe, sorties: list[Sortie], seconds: float, warm_up_s: float = WARM_UP_S
    ) -> None:
        self.frame, self.n = frame, len(sorties)
        self.steps, self.before = round(seconds / DT), round(warm_up_s / DT)
        total = self.steps + self.before
        self.c = stacked([s.conditions for s in sorties])
        rngs = [np.random.default_rng([s.seed, 1]) for s in sorties]
        self.wind = np.stack(
            [
                wind(
                    r,
                    total,
                    (s.conditions.wind_north, s.conditions.wind_east),
                    s.conditions.gusts,
                    DT,
                )
                for r, s in zip(rngs, sorties, strict=True)
            ],
            axis=-1,
        )
        shape = (total, frame.count)
        noise = [
            0.8 * coloured(r, shape, 0.12, DT) + 0.6 * coloured(r, shape, 1.0, DT) for r in rngs
        ]
        self.unsteady = np.stack(noise, axis=-1) * self.c.unsteady
        self.place = np.stack([s.reference.position for s in sorties], axis=-1)
        self.speed = np.stack([s.reference.velocity for s in sorties], axis=-1)
        self.yaw = np.stack([s.reference.yaw for s in sorties], axis=-1)
        self.pilot = Autopilot(frame, self.c.slow, DT)
        capacity, ohm = pack(frame, self.c.minutes)
        self.pack = power.Pack(frame.cells, capacity, ohm, self.c.charge.copy(), np.zeros(self.n))
        self.amperes = np.full(self.n, power.hover_current(frame))
        self.warm = np.zeros((frame.count, self.n))
        heat = power.motor_current(
            frame, np.array(frame.hover_duty * frame.nominal_v), np.array(frame.hover_speed), 0.0
        )
        self.hover_heat = float(heat**2 * frame.motor_ohm)
        self.rope = np.zeros((3, self.n))
        self.bob = np.stack([np.zeros(self.n), np.zeros(self.n), np.ones(self.n)])
        self.bob_rate = np.zeros((3, self.n))
        self.slung = bool((self.c.slung_kg > 0.0).any())

    def fly(self, progress: Callable[[int], None] | None = None) -> list[Track]:
        """All flights, to the end."""
        frame, n = self.frame, self.n
        r = frame.count
        x = np.zeros((13 + r, n))
        x[:3] = self.place[0]
        x[6] = 1.0
        x[13 : 13 + r] = frame.hover_speed
        self.induced = np.full((r, n), frame.hover_inflow)
        rows: dict[str, list[Array]] = {name: [] for name in _RECORDED}
        acceleration = np.zeros((3, n))
        for i in range(self.steps + self.before):
            k = max(i - self.before, 0)
            R = loads.rotation(x[6:10])
            outer = self._outer(i, k, x, R, acceleration)
            u = self.pilot.step(
                R, x[:3], x[3:6], x[10:13], self.place[k], self.speed[k], self.yaw[k]
            )
            u = np.rint(u * 1000.0) / 1000.0
            current = power.motor_current(frame, u * outer.volts, x[13:], outer.warm)
            d1, felt, turning = self._derivative(x, u, outer)
            amperes = (current * u).sum(axis=0)
            acceleration = d1[3:6]
            if i >= self.before:
                for name, value in zip(
                    _RECORDED,
                    (
                        x,
                        self.induced,
                        felt,
                        turning,
                        u,
                        outer.volts,
                        amperes,
                        outer.warm,
                        self.rope,
                        outer.cg,
                    ),
                    strict=True,
                ):
                    rows[name].append(value)
            d2 = self._derivative(x + 0.5 * DT * d1, u, outer)[0]
            d3 = self._derivative(x + 0.5 * DT * d2, u, outer)[0]
            d4 = self._derivative(x + DT * d3, u, outer)[0]
            self._breathe(x, R, outer.wind)
            x = x + DT / 6.0 * (d1 + 2.0 * d2 + 2.0 * d3 + d4)
            x[6:10] = x[6:10] / np.sqrt((x[6:10] ** 2).sum(axis=0))
            self.amperes = self.amperes + SMOOTHED * (amperes - self.amperes)
            if i >= self.before:
                self._drain(amperes, current)
            if progress and i % 250 == 0:
                progress(250)
        return self._tracks({name: np.stack(values, axis=-1) for name, values in rows.items()})

    def _breathe(self, x: Array, R: Array, air: Array) -> None:
        """The induced velocities at the end of a step that begins at ``x``."""
        ux, uy, climb = loads.at_rotors(self.frame, loads.into_body(R, x[3:6] - air), x[10:13])
        omega = np.maximum(x[13:], 5.0)
        self.induced = rotor.next_inflow(
            self.frame, omega, self.induced, climb, ux * ux + uy * uy, self.c.rho, DT
        )

    def _outer(self, i: int, k: int, x: Array, R: Array, acceleration: Array) -> _Outer:
        frame, c = self.frame, self.c
        kg = np.where(k * DT >= c.load_at_s, c.load_kg, 0.0)
        mass = frame.mass_kg + kg
        share = kg / mass
        at = np.stack([c.load_x, c.load_y, c.load_z])
        cg = np.stack([c.cg_x, c.cg_y, np.zeros(self.n)]) + share * at
        spread = kg * frame.mass_kg / mass
        squares = at**2
        inertia = np.array(frame.inertia)[:, None] + spread * (squares.sum(axis=0) - squares)
        origin = x[:3] - loads.into_world(R, cg)
        places = loads.rotor_places(frame, R, origin)
        force, moment = np.zeros((3, self.n)), np.zeros((3, self.n))
        if (c.bumper_n_m > 0.0).any():
            f, m = loads.contact(frame, c, R, places, x[3:6])
            force, moment = force + f, moment + m
        for f, m in loads.no_catalogue(c, k * DT, R, origin).values():
            force, moment = force + f, moment + m
        if self.slung:
            self._swing(acceleration, i)
            force = force + loads.into_body(R, self.rope)
        return _Outer(
            loads.near_surfaces(frame, c, places), force, moment, mass, cg, inertia, self.wind[i].copy(),
            self.unsteady[i], self.pack.volts(self.amperes), self.warm.copy(),
        )  # fmt: skip

    def _drain(self, amperes: Array, current: Array) -> None:
        self.pack.draw(amperes, DT)
        heat = current**2 * self.frame.motor_ohm / self.hover_heat
        self.warm = self.warm + DT / self.c.heating_s * (self.c.heating * heat - self.warm)

    def _swing(self, acceleration: Array, i: int) -> None:
        """The load on its rope: a spherical pendulum under the CG whose hook moves; sets the pull on the vehicle."""
        c = self.c
        felt = -acceleration
        felt[2] += G
        e, rate = self.bob, self.bob_rate
        along = (felt * e).sum(axis=0)
        turn2 = (rate**2).sum(axis=0)
        rate = rate + DT * ((felt - along * e) / c.rope_m - turn2 * e - 0.12 * rate)
        e = e + DT * rate
        self.bob = e / np.sqrt((e**2).sum(axis=0))
        self.bob_rate = rate - (rate * self.bob).sum(axis=0) * self.bob
        self.rope = np.maximum(c.slung_kg * (along + c.rope_m * turn2), 0.0) * self.bob
        if i < 2:
            self.rope = c.slung_kg * G * self.bob

    def _derivative(self, x: Array, u: Array, o: _Outer) -> tuple[Array, Array, Array]:
        frame, c = self.frame, self.c
        v, q, w = x[3:6], x[6:10], x[10:13]
        omega = np.maximum(x[13:], 5.0)
        R = loads.rotation(q)
        air = loads.into_body(R, v - o.wind)
        ux, uy, climb = loads.at_rotors(frame, air, w)
        across2 = ux * ux + uy * uy
        through = self.induced + climb
        free = rotor.thrust(frame, omega, through, across2, c.rho)
        lift = free * blade_gain(frame, c, omega) * o.near.factor * (1.0 + o.unsteady)
        drag = -loads.rotor_drag_constant(frame, c) * omega
        force, moment = loads.from_rotors(frame, lift, np.stack([drag * ux, drag * uy]))
        force = force + loads.body_drag(c, air) + o.force
        moment = moment + o.moment
        for wall in (0, 1):
            if o.near.pull[wall].any():
                f, m = loads.wall_wrench(frame, o.near, lift, R, wall)
                force, moment = force + f, moment + m
        current = power.motor_current(frame, u * o.volts, omega, o.warm)
        shaft = power.motor_torque(frame, current, o.warm)
        spin = np.array(frame.spin)[:, None]
        inertia = frame.rotor_inertia * c.slow
        spin_up = (shaft - rotor.torque(frame, omega, free, through, c.rho)) / inertia
        momentum = (inertia * spin * omega).sum(axis=0)
        moment[2] -= (spin * shaft).sum(axis=0)
        moment[0] -= w[1] * momentum
        moment[1] += w[0] * momentum
        moment = moment - loads.cross(o.cg, force)
        felt = force / o.mass
        turning = (moment - loads.cross(w, o.inertia * w)) / o.inertia
        dx = np.empty_like(x)
        dx[:3] = v
        dx[3:6] = loads.into_world(R, felt)
        dx[5] += G
        dx[6] = -0.5 * (q[1] * w[0] + q[2] * w[1] + q[3] * w[2])
        dx[7:10] = 0.5 * (q[0] * w + loads.cross(q[1:], w))
        dx[10:13] = turning
        dx[13:] = spin_up
        return dx, felt, turning

    def _tracks(self, rows: dict[str, Array]) -> list[Track]:
        time = np.arange(self.steps) * DT
        out = []
        for k in range(self.n):
            x = rows["state"][:, k]
            out.append(
                Track(
                    time, x[:3], x[3:6], x[6:10], x[10:13], rows["turning"][:, k], rows["felt"][:, k],
                    x[13:], rows["induced"][:, k], rows["output"][:, k], self.wind[self.before :, :, k].T,
                    self.unsteady[self.before :, :, k].T, rows["volts"][k], rows["amperes"][k], rows["warm"][:, k],
                    rows["rope"][:, k], rows["cg"][:, k],
                )
            )  # fmt: skip
        return out


_RECORDED = (
    "state",
    "induced",
    "felt",
    "turning",
    "output",
    "volts",
    "amperes",
    "warm",
    "rope",
    "cg",
)


def blade_gain(frame: Airframe, c: Conditions, omega: Array) -> Array:
    """Factor (rotors, n) on the thrust of healthy blades: wear of all, of one, and C_T over speed."""
    number = np.arange(frame.count)[:, None]
    weak = np.where(number == c.weak_rotor, c.weak_share, 0.0)
    gain = (1.0 + c.scale) * (1.0 + weak)
    if np.any(np.asarray(c.reynolds) != 0.0):
        gain = gain * (omega / frame.hover_speed) ** c.reynolds
    return gain * np.ones_like(omega)
