"""What may be undeclared: one class per name of the contract's catalogue, each from its own physics.

A class handles all flights of a batch that have the effect: ``index`` says which, ``p`` holds its parameters, one
number per flight. Hooks are called by ``world.World`` in the order of ``Effect``; the default does nothing. Nothing
here follows the formulas of the program under test; every docstring says what was assumed instead.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from . import near_wall, rotor_flow
from .craft import GRAVITY, RHO0, Array, Craft
from .plan import CEILING_HEIGHT, EDGE_HEIGHT, EDGE_NORTH, WALL_NORTH

if TYPE_CHECKING:
    from .world import World

Rng = np.random.Generator
Index = np.ndarray


def signed(rng: Rng, low: float, high: float) -> float:
    """A size between ``low`` and ``high`` of random sign."""
    return float(rng.uniform(low, high) * rng.choice([-1.0, 1.0]))


class Effect:
    """Base: no effect."""

    name: ClassVar[str]
    blocks: ClassVar[tuple[str, ...]] = ()
    """Manoeuvres the plan must contain besides the standard ones."""
    without: ClassVar[tuple[str, ...]] = ()
    """Manoeuvres that would break the vehicle."""

    def __init__(self, craft: Craft, index: Index, p: dict[str, Array]) -> None:
        self.craft, self.i, self.p = craft, index, p

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        """Parameters of one flight."""
        return {}

    def start(self, s: World) -> None:
        """Once, before the first step."""

    def body(self, s: World) -> None:
        """Every step: mass, inertia, CG."""

    def speeds(self, s: World) -> None:
        """Every step: the rotor speed the air answers to (``air_rpm``)."""

    def factors(self, s: World) -> None:
        """Every step: factors on the fans' wrench (``fan_gain``)."""

    def loads(self, s: World) -> None:
        """Every step: more force and moment about the declared CG, body FRD."""


def _push_fans(s: World, i: Index, forces: Array, above_m: float | Array = 0.0) -> None:
    """Add body forces (3, fans, m) that act ``above_m`` the fans' reference points."""
    x, y, z = (np.asarray(c)[:, None] for c in zip(*s.craft.fan_position, strict=True))
    z = z - above_m
    fx, fy, fz = forces
    s.force[:, i] += forces.sum(axis=1)
    s.moment[:, i] += np.stack([y * fz - z * fy, z * fx - x * fz, x * fy - y * fx]).sum(axis=1)


def fan_velocity(s: World, i: Index) -> Array:
    """Velocity of each fan over ground in body axes, (3, fans, m)."""
    v = np.einsum("jkn,jn->kn", s.R[:, :, i], s.v[:, i])
    w = s.w[:, i]
    out = np.empty((3, len(s.craft.fan_position), len(i)))
    for f, (x, y, z) in enumerate(s.craft.fan_position):
        out[0, f] = v[0] + w[1] * z - w[2] * y
        out[1, f] = v[1] + w[2] * x - w[0] * z
        out[2, f] = v[2] + w[0] * y - w[1] * x
    return out


class Ceiling(Effect):
    """A ceiling at 1.9 m: the image of the rotor's sink disc draws air up; less inflow gives the blades more thrust."""

    name = "ceiling"
    blocks = ("ceiling",)
    without = ("vertical",)

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {"gain": float(rng.uniform(1.0, 1.5))}

    def start(self, s: World) -> None:
        s.keep_off_ceiling[self.i] = 0.2

    def loads(self, s: World) -> None:
        i = self.i
        gap = np.maximum(CEILING_HEIGHT - s.height[:, i], 0.04)
        zeta = 2.0 * gap / self.craft.radius_m
        relief = 0.5 * (1.0 - zeta / np.sqrt(1.0 + zeta * zeta))
        extra = self.p["gain"] * relief * s.lift[:, i]
        zero = np.zeros_like(extra)
        _push_fans(s, i, np.stack([zero, zero, -extra]))


class SecondWall(Effect):
    """A wall ahead besides the declared one: the near-wall law once more, and a loss of lift in the vertex."""

    name = "second_wall"
    blocks = ("vertex",)
    without = ("lateral",)

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {"gain": float(rng.uniform(0.9, 1.4)), "loss": float(rng.uniform(0.09, 0.14))}

    def loads(self, s: World) -> None:
        i, craft = self.i, self.craft
        d2 = np.maximum(WALL_NORTH - s.fan_north[:, i] - craft.lip_m, 0.01)
        alone = near_wall.fan_wrench(craft, s.height[:, i], d2, s.air_rpm[:, i])
        free = near_wall.fan_wrench(
            craft, s.height[:, i], np.full_like(d2, np.inf), s.air_rpm[:, i]
        )
        extra = near_wall.to_body(
            self.p["gain"] * (alone - free), np.broadcast_to(-s.yaw[i], d2.shape)
        )
        extra[2] += (
            self.p["loss"] * s.lift[:, i] * np.exp(-(np.maximum(s.d[:, i], 0.0) + d2) / 0.45)
        )
        _push_fans(s, i, extra[:3])
        s.moment[:, i] += extra[3:].sum(axis=1)


class PartialGround(Effect):
    """A table whose edge the vehicle crosses: each fan feels the share of its disc that is over the table."""

    name = "partial_ground"
    blocks = ("edge",)

    def start(self, s: World) -> None:
        s.table_edge[self.i] = EDGE_NORTH

    def loads(self, s: World) -> None:
        i, craft = self.i, self.craft
        t = np.clip((EDGE_NORTH - s.fan_north[:, i]) / craft.radius_m, -1.0, 1.0)
        covered = (
            0.5 + (t * np.sqrt(1.0 - t * t) + np.arcsin(t)) / np.pi
        )  # area of a circle's segment
        rpm = s.air_rpm[:, i]
        over = near_wall.fan_wrench(
            craft, np.maximum(s.height[:, i] - EDGE_HEIGHT, 0.02), s.d[:, i], rpm
        )[2]
        floor = near_wall.fan_wrench(craft, s.height[:, i], s.d[:, i], rpm)[2]
        zero = np.zeros_like(over)
        _push_fans(s, i, np.stack([zero, zero, -covered * (over - floor)]))


class _RelativeWind(Effect):
    """Sideways force of the air each fan takes in (Glauert's induced flow) and of its blades; acts above the lip."""

    def side(self, s: World, wind: Array | float) -> Array:
        velocity = fan_velocity(s, self.i)
        if isinstance(wind, np.ndarray):
            velocity = velocity - np.einsum("jkn,jn->kn", s.R[:, :, self.i], wind)[:, None]
        ux, uy, down = velocity
        return rotor_flow.side_force(
            self.craft, s.lift[:, self.i], s.air_rpm[:, self.i], ux, uy, -down, self.p["turned"]
        )

    def push(self, s: World, side: Array) -> None:
        _push_fans(
            s, self.i, np.stack([side[0], side[1], np.zeros_like(side[0])]), self.p["above_m"]
        )

    @staticmethod
    def draw_fan(rng: Rng, craft: Craft) -> dict[str, float]:
        share = (0.8, 1.4) if craft.rotors_per_fan == 2 else (0.5, 0.9)
        return {"turned": float(rng.uniform(*share)), "above_m": float(rng.uniform(0.06, 0.15))}


class Wind(_RelativeWind):
    """A steady horizontal wind: the relative-wind force of moving air, its dependence on speed included."""

    name = "wind"

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        angle = float(rng.uniform(0.0, 2.0 * np.pi))
        speed = float(rng.uniform(0.4, 0.8))
        return Wind.draw_fan(rng, craft) | {
            "north": speed * np.cos(angle),
            "east": speed * np.sin(angle),
        }

    def loads(self, s: World) -> None:
        wind = np.stack([self.p["north"], self.p["east"], np.zeros(len(self.i))])
        self.push(s, self.side(s, wind))


class RotorDrag(_RelativeWind):
    """Drag of the fans in still air: Glauert momentum of the turned stream and profile drag of the blades."""

    name = "rotor_drag"

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return RotorDrag.draw_fan(rng, craft)

    def loads(self, s: World) -> None:
        self.push(s, self.side(s, 0.0))


class BodyDrag(Effect):
    """A bluff load: cross-flow drag axis by axis, drag coefficient falling slowly with Reynolds number (Re^-0.1)."""

    name = "body_drag"
    blocks = ("dash",)

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {
            "front_m2": float(rng.uniform(0.25, 0.42)),
            "side_m2": float(rng.uniform(0.25, 0.42)),
        }

    def loads(self, s: World) -> None:
        v = np.einsum("jkn,jn->kn", s.R[:, :, self.i], s.v[:, self.i])
        for axis, area in (
            (0, self.p["front_m2"]),
            (1, self.p["side_m2"]),
            (2, 0.3 * self.p["front_m2"]),
        ):
            speed = np.abs(v[axis])
            s.force[axis, self.i] -= (
                0.5 * RHO0 * area * 1.1 * speed * v[axis] * (speed + 0.3) ** -0.1
            )


class VerticalInflow(Effect):
    """Climb changes the blades' angle of attack: thrust of blade elements in Glauert inflow at fixed speed."""

    name = "vertical_inflow"

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {"gain": float(rng.uniform(0.8, 1.4))}

    def loads(self, s: World) -> None:
        ux, _, down = fan_velocity(s, self.i)
        still = np.zeros_like(ux)
        ratio = rotor_flow.thrust_ratio(self.craft, s.air_rpm[:, self.i], still, -down)
        extra = self.p["gain"] * (ratio - 1.0) * s.lift[:, self.i]
        _push_fans(s, self.i, np.stack([still, still, -extra]))


class AirDensity(Effect):
    """Thin or dense air: all aerodynamic loads of the fans scale with the ideal-gas density that p and T tell."""

    name = "air_density"

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        hot = bool(rng.random() < 0.6)
        return {
            "kelvin": 273.15 + float(rng.uniform(21.0, 29.0) if hot else rng.uniform(0.0, 8.0)),
            "pascal": float(
                rng.uniform(99500.0, 101300.0) if hot else rng.uniform(101300.0, 102500.0)
            ),
        }

    def start(self, s: World) -> None:
        s.pressure_pa[self.i] = self.p["pascal"]
        s.air_c[self.i] = self.p["kelvin"] - 273.15
        s.rho[self.i] = self.p["pascal"] / (287.05 * self.p["kelvin"])


class ThrustScale(Effect):
    """Worn blades: every fan gives the same share less (or, cleaned, more) than declared."""

    name = "thrust_scale"

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {"share": signed(rng, 0.025, 0.05)}

    def factors(self, s: World) -> None:
        s.fan_gain[:, self.i] *= 1.0 + self.p["share"]


class FanImbalance(Effect):
    """One nicked fan: only its wrench is smaller."""

    name = "fan_imbalance"

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        fans = len(craft.fan_position)
        return {
            "fan": float(rng.integers(fans)),
            "share": -float(rng.uniform(0.03, 0.05)) * fans / 1.4,
        }

    def factors(self, s: World) -> None:
        s.fan_gain[self.p["fan"].astype(int), self.i] *= 1.0 + self.p["share"]


class Payload(Effect):
    """A rigid lump below the CG is picked up (or was there from the start): mass, CG and inertia change."""

    name = "payload"

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {
            "kg": float(rng.uniform(0.025, 0.05)) * craft.mass_kg,
            "below_m": float(rng.uniform(0.03, 0.08)),
            "at_s": float(rng.uniform(50.0, 110.0)),
        }

    def body(self, s: World) -> None:
        on = s.t >= self.p["at_s"]
        s.attach(self.i, np.where(on, self.p["kg"], 0.0), 0.0, 0.0, self.p["below_m"])


class CgOffset(Effect):
    """The battery sits elsewhere than declared: the body turns about a shifted CG (its inertia kept)."""

    name = "cg_offset"

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        # About 3 % of weight at a lever of 0.3 m.
        return {"x": signed(rng, 0.007, 0.014), "y": signed(rng, 0.005, 0.010)}

    def body(self, s: World) -> None:
        s.cg[0, self.i] += self.p["x"]
        s.cg[1, self.i] += self.p["y"]


class RangeOffset(Effect):
    """The down-looking rangefinder reads short or long by a fixed length."""

    name = "range_offset"
    blocks = ("ground",)

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {"m": signed(rng, 0.055, 0.085)}

    def start(self, s: World) -> None:
        s.range_bias[self.i] = self.p["m"]


class ImuBias(Effect):
    """Accelerometer offsets that creep with the board's temperature."""

    name = "imu_bias"

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {
            "x": signed(rng, 0.15, 0.4),
            "y": signed(rng, 0.15, 0.4),
            "z": signed(rng, 0.1, 0.3),
        }

    def loads(self, s: World) -> None:
        creep = 1.0 + 0.05 * (1.0 - np.exp(-s.t / 60.0))
        s.accel_bias[:, self.i] = np.stack([self.p["x"], self.p["y"], self.p["z"]]) * creep


class ThermalDerating(Effect):
    """Hot motors: a two-node heat network; tip gap (or, without rpm, speed) gives way more than linearly."""

    name = "thermal_derating"

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {"share": float(rng.uniform(0.02, 0.03)), "hot": float(rng.uniform(1.8, 2.6))}

    def start(self, s: World) -> None:
        s.hot[self.i] = self.p["hot"]

    def factors(self, s: World) -> None:
        x = (s.heat.winding[:, self.i] - s.heat.ambient[self.i] - 14.0) / 60.0
        s.fan_gain[:, self.i] *= 1.0 - self.p["share"] * (0.75 * x + 0.25 * x * np.abs(x))


class BatterySag(Effect):
    """A weak pack. Without rpm, outputs give less thrust as it empties; with rpm, the ESCs report speed too high."""

    name = "battery_sag"

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {"weak": float(rng.uniform(1.7, 2.1)), "share": float(rng.uniform(0.2, 0.3))}

    def start(self, s: World) -> None:
        # Without rpm the pack acts on thrust in full, so a lesser weakness is as much force.
        s.weak[self.i] = np.where(
            s.by_servo[self.i], 1.0 + 0.2 * (self.p["weak"] - 1.0), self.p["weak"]
        )
        s.fixed_v[self.i] = np.nan

    def factors(self, s: World) -> None:
        drop = 1.0 - s.battery.volts[self.i] / s.craft.voltage_v
        seen = ~s.by_servo[self.i]
        s.fan_gain[:, self.i] *= np.where(seen, (1.0 - self.p["share"] * drop) ** 2, 1.0)


class Gyroscopic(Effect):
    """Flywheels: the rotors' spins do not cancel. Euler's equation of the rotors: -w x H - dH/dt."""

    name = "gyroscopic"
    blocks = ("wobble",)

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {"kgm2": signed(rng, 4e-4, 7e-4)}

    def start(self, s: World) -> None:
        self.last = np.full(len(self.i), np.nan)

    def loads(self, s: World) -> None:
        spin = self.p["kgm2"] * s.fan_rpm[:, self.i].sum(axis=0) * np.pi / 30.0
        change = np.where(np.isnan(self.last), 0.0, spin - self.last) / s.dt
        self.last = spin
        w = s.w[:, self.i]
        s.moment[:, self.i] -= np.stack([w[1] * spin, -w[0] * spin, change])


class GroundEffect(Effect):
    """More ground effect than declared: Hayden's power ratio turned into thrust at fixed speed by blade elements."""

    name = "ground_effect"
    blocks = ("ground",)

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {
            "gain": float(rng.uniform(0.35, 0.6))
            if craft.rotors_per_fan == 2
            else float(rng.uniform(0.8, 1.2))
        }

    def loads(self, s: World) -> None:
        i = self.i
        height = np.maximum(s.height[:, i], 0.06) / (2.0 * self.craft.radius_m)
        power = 1.0 / (0.9926 + 0.0379 / (height * height))
        extra = self.p["gain"] * 0.8 * (1.0 - np.minimum(power, 1.0)) * s.lift[:, i]
        zero = np.zeros_like(extra)
        _push_fans(s, i, np.stack([zero, zero, -extra]))


class WallEffect(Effect):
    """More wall effect than declared: the image sink draws the inflow to the wall and tilts the lip's suction."""

    name = "wall_effect"
    blocks = ("wall_high", "wall_low")

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {"gain": float(rng.uniform(2.2, 3.2))}

    def start(self, s: World) -> None:
        s.keep_off_wall[self.i] = 0.3

    def loads(self, s: World) -> None:
        i, craft = self.i, self.craft
        away = np.maximum(s.d[:, i], 0.0) + craft.lip_m
        thrust = s.lift[:, i]
        flow = np.sqrt(thrust * craft.area / (2.0 * RHO0))  # volume flow of the disc
        drawn = flow / (4.0 * np.pi * (2.0 * away) ** 2)
        pull = self.p["gain"] * RHO0 * flow * drawn
        tilt = (
            self.p["gain"] * 0.25 * thrust * craft.radius_m * (craft.radius_m / (2.0 * away)) ** 2
        )
        bearing = np.broadcast_to(np.pi / 2 - s.yaw[i], pull.shape)
        zero = np.zeros_like(pull)
        extra = near_wall.to_body(np.stack([pull, zero, zero, zero, tilt, zero]), bearing)
        _push_fans(s, i, extra[:3])
        s.moment[:, i] += extra[3:].sum(axis=1)


class MotorLag(Effect):
    """Thrust comes late: two poles of dynamic inflow behind the reported speed; without rpm, slow motors."""

    name = "motor_lag"
    blocks = ("vertical",)

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {"tau": float(rng.uniform(0.07, 0.11))}

    def start(self, s: World) -> None:
        s.motor_tau[self.i] = np.where(s.by_servo[self.i], self.p["tau"], s.motor_tau[self.i])
        self.one = s.fan_rpm[:, self.i].copy()
        self.two = self.one.copy()

    def speeds(self, s: World) -> None:
        rate = s.dt * 2.0 / self.p["tau"]
        self.one += rate * (s.fan_rpm[:, self.i] - self.one)
        self.two += rate * (self.one - self.two)
        s.air_rpm[:, self.i] = np.where(s.by_servo[self.i], s.air_rpm[:, self.i], self.two)


class Contact(Effect):
    """A soft bumper ring 7 cm outside the lips touches the wall: spring, damper, and sliding friction along it."""

    name = "contact"
    blocks = ("push",)

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {"n_m": float(rng.uniform(20.0, 40.0)), "friction": float(rng.uniform(0.05, 0.2))}

    def start(self, s: World) -> None:
        s.keep_off_wall[self.i] = 0.0

    def loads(self, s: World) -> None:
        i = self.i
        depth = np.maximum(0.07 - s.d[:, i], 0.0)
        velocity = fan_velocity(s, i)
        east = s.R[1, :, i].T[:, None]  # the wall's normal in body axes
        north = s.R[0, :, i].T[:, None]
        closing = (velocity * east).sum(axis=0)
        press = np.where(depth > 0.0, np.maximum(self.p["n_m"] * depth + 8.0 * closing, 0.0), 0.0)
        slide = np.tanh((velocity * north).sum(axis=0) / 0.05)
        _push_fans(s, i, -press * east - self.p["friction"] * press * slide * north)


class SlungLoad(Effect):
    """A point mass on an elastic rope: its own dynamics in world axes, with air drag."""

    name = "slung_load"
    blocks = ("wobble",)
    without = ("ground", "wall_low", "lateral")

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {
            "kg": float(rng.uniform(0.025, 0.05)) * craft.mass_kg,
            "rope_m": float(rng.uniform(0.35, 0.6)),
        }

    def start(self, s: World) -> None:
        self.place = s.p[:, self.i].copy()
        self.place[2] += 0.1 + self.p["rope_m"]
        self.speed = np.zeros_like(self.place)

    def loads(self, s: World) -> None:
        i = self.i
        R, w = s.R[:, :, i], s.w[:, i]
        hook = s.p[:, i] + 0.1 * R[:, 2]
        hook_v = s.v[:, i] + 0.1 * (w[1] * R[:, 0] - w[0] * R[:, 1])
        line = self.place - hook
        length = np.sqrt((line * line).sum(axis=0)) + 1e-9
        along = line / length
        stretch = length - self.p["rope_m"]
        opening = ((self.speed - hook_v) * along).sum(axis=0)
        tension = np.where(stretch > 0.0, np.maximum(450.0 * stretch + 8.0 * opening, 0.0), 0.0)
        accel = -tension * along / self.p["kg"] - 0.15 * self.speed
        accel[2] += GRAVITY
        self.speed = self.speed + s.dt * accel
        self.place = self.place + s.dt * self.speed
        pull = np.einsum("jkn,jn->kn", R, tension * along)
        s.force[:, i] += pull
        s.moment[:, i] += np.stack([-0.1 * pull[1], 0.1 * pull[0], np.zeros(len(i))])


class RateDamping(Effect):
    """Plates that the vehicle swings through the air: a moment that is part linear, part quadratic in the rate."""

    name = "rate_damping"
    blocks = ("wobble",)

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {"per_s": float(rng.uniform(4.0, 6.0))}

    def loads(self, s: World) -> None:
        w = s.w[:, self.i]
        inertia = np.array(self.craft.inertia)[:, None]
        s.moment[:, self.i] -= self.p["per_s"] * inertia * w * (0.9 + 0.2 * np.abs(w))


class FlappingMoment(Effect):
    """Blades on stiff roots: the advancing one lifts more, flaps up ahead, and its root turns the hub nose up."""

    name = "flapping_moment"
    blocks = ("dash",)

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {"root_nm": float(rng.uniform(0.6, 1.0))}

    def loads(self, s: World) -> None:
        ux, uy, _ = fan_velocity(s, self.i)
        tip = s.fan_rpm[:, self.i] * np.pi / 30.0 * self.craft.radius_m
        stiff = self.p["root_nm"] * self.craft.mass_kg * GRAVITY * self.craft.radius_m
        back, side = (stiff * (u / np.maximum(tip, 1.0)).sum(axis=0) for u in (ux, uy))
        s.moment[:, self.i] += np.stack([-side, back, np.zeros(len(self.i))])


class TrimMoment(Effect):
    """A spring between hull and something that does not move with it: the same moment at every thrust."""

    name = "trim_moment"

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {"roll": signed(rng, 0.04, 0.07), "pitch": signed(rng, 0.04, 0.07)}

    def loads(self, s: World) -> None:
        arm = self.craft.mass_kg * GRAVITY * self.craft.radius_m
        none = np.zeros(len(self.i))
        s.moment[:, self.i] += arm * np.stack([self.p["roll"], self.p["pitch"], none])


class RotorInertia(Effect):
    """Heavy rotors: what they gain of angular momentum, the hull loses. Rotors of both spins, so only yaw shows it."""

    name = "rotor_inertia"
    blocks = ("turn", "wobble")

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {"kgm2": float(rng.uniform(4e-4, 7e-4))}

    def start(self, s: World) -> None:
        self.last = np.full(len(self.i), np.nan)

    def loads(self, s: World) -> None:
        each = np.repeat(s.fan_rpm[:, self.i], self.craft.rotors_per_fan, axis=0)
        spins = np.array(self.craft.spin)[:, None]
        spin = self.p["kgm2"] * (spins * each).sum(axis=0) * np.pi / 30.0
        change = np.where(np.isnan(self.last), 0.0, spin - self.last) / s.dt
        self.last = spin
        s.moment[2, self.i] -= change


class MomentumThrust(Effect):
    """Speed over ground feeds a fan with fresh air: blade elements in Glauert inflow, level motion alone."""

    name = "momentum_thrust"
    blocks = ("dash",)

    @staticmethod
    def draw(rng: Rng, craft: Craft) -> dict[str, float]:
        return {"gain": float(rng.uniform(1.5, 2.5))}

    def loads(self, s: World) -> None:
        ux, uy, _ = fan_velocity(s, self.i)
        still = np.zeros_like(ux)
        ratio = rotor_flow.thrust_ratio(self.craft, s.air_rpm[:, self.i], np.hypot(ux, uy), still)
        extra = self.p["gain"] * (ratio - 1.0) * s.lift[:, self.i]
        _push_fans(s, self.i, np.stack([still, still, -extra]))


CATALOGUE: dict[str, type[Effect]] = {
    kind.name: kind
    for kind in (
        Ceiling, SecondWall, PartialGround, Wind, RotorDrag, BodyDrag, VerticalInflow, AirDensity, ThrustScale,
        FanImbalance, Payload, CgOffset, RangeOffset, ImuBias, ThermalDerating, BatterySag, Gyroscopic, GroundEffect,
        WallEffect, MotorLag, Contact, SlungLoad, RateDamping, FlappingMoment, TrimMoment, RotorInertia,
        MomentumThrust,
    )
}  # fmt: skip
