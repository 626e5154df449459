"""What acts on a flight beyond what its vehicle file declares, and how large it is drawn.

Defaults are a healthy vehicle in a hall: every effect is there, none is worth a pilot's attention. ``DRAWS`` makes one
of them large, in sizes that occur on vehicles of the kind.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from .airframes import RHO0, Airframe, Array, G
from .power import hover_current

Rng = np.random.Generator
Number = float | Array


@dataclass(frozen=True)
class Conditions:
    """One flight (floats), or several side by side (arrays (n,), see ``stacked``). SI units."""

    wind_north: Number = 0.0
    wind_east: Number = 0.0
    gusts: Number = 0.12
    rotor_drag: Number = 0.08
    """Of all rotors at hover speed over mass [1/s]."""
    body_cda: Number = 0.01
    """Drag area [m^2]."""
    pascal: Number = 101325.0
    kelvin: Number = 288.15
    scale: Number = 0.0
    """All rotors: share of thrust more than declared."""
    reynolds: Number = 0.0
    """C_T ~ speed^reynolds."""
    declared_slope: Number = 0.0
    """Share by which the declared thrust curve is too steep at hover (declared by outputs only)."""
    weak_rotor: Number = 0.0
    weak_share: Number = 0.0
    load_kg: Number = 0.0
    load_x: Number = 0.0
    load_y: Number = 0.0
    load_z: Number = 0.0
    load_at_s: Number = -1.0
    cg_x: Number = 0.0
    cg_y: Number = 0.0
    range_bias: Number = 0.0
    bias_x: Number = 0.0
    bias_y: Number = 0.0
    bias_z: Number = 0.0
    heating: Number = 12.0
    """How much warmer the windings get in hover than they were [K]."""
    heating_s: Number = 40.0
    minutes: Number = 40.0
    """Hover time of the pack; its resistance grows as the capacity shrinks."""
    charge: Number = 0.585
    slow: Number = 1.0
    """Factor on the rotors' inertia."""
    ground_gain: Number = 1.0
    wall_gain: Number = 1.0
    ceiling_gain: Number = 1.0
    wall_north: Number = np.inf
    wall_east: Number = np.inf
    ceiling_m: Number = np.inf
    edge_north: Number = np.inf
    """North of here (m) stands a table."""
    table_m: Number = 0.0
    bumper_m: Number = 0.0
    """How far a soft bumper stands out beyond the lips."""
    bumper_n_m: Number = 0.0
    slung_kg: Number = 0.0
    rope_m: Number = 0.5
    grate_n: Number = 0.0
    """Vertical force that waves with the north position [N] (in no catalogue)."""
    grate_m: Number = 1.0
    downwash_n: Number = 0.0
    """A neighbour's downwash, at times that no channel tells [N] (in no catalogue)."""
    downwash_s: Number = 20.0
    rock_nm: Number = 0.0
    """Roll moment periodic in time [N m] (in no catalogue)."""
    rock_hz: Number = 0.4
    unsteady: Number = 0.004
    """Standard deviation of each rotor's thrust by turbulence, as a share."""

    @property
    def rho(self) -> Number:
        """Air density [kg/m^3], ideal gas."""
        return self.pascal / (287.05 * self.kelvin)


def stacked(several: Sequence[Conditions]) -> Conditions:
    """Flights side by side: every field an array (n,)."""
    return Conditions(
        **{
            f.name: np.array([float(getattr(c, f.name)) for c in several])
            for f in fields(Conditions)
        }
    )


def healthy(rng: Rng, frame: Airframe) -> Conditions:
    """A vehicle with nothing worth a pilot's attention: small amounts of everything that always acts."""
    kelvin = 288.15 + float(rng.uniform(-2.0, 2.0))
    return Conditions(
        rotor_drag=float(rng.uniform(0.06, 0.10)),
        body_cda=float(rng.uniform(0.2, 0.5)) * frame.area,
        kelvin=kelvin,
        pascal=RHO0 * 287.05 * kelvin * (1.0 + float(rng.uniform(-0.005, 0.005))),
        scale=float(rng.uniform(-0.005, 0.005)),
        cg_x=float(rng.uniform(-0.004, 0.004)) * frame.arm_m,
        cg_y=float(rng.uniform(-0.004, 0.004)) * frame.arm_m,
        bias_x=float(rng.uniform(-0.03, 0.03)),
        bias_y=float(rng.uniform(-0.03, 0.03)),
        bias_z=float(rng.uniform(-0.03, 0.03)),
        heating=float(rng.uniform(5.0, 10.0)),
        charge=float(rng.uniform(0.57, 0.60)),
        minutes=float(rng.uniform(35.0, 50.0)),
    )


def signed(rng: Rng, low: float, high: float) -> float:
    """Between ``low`` and ``high``, of random sign."""
    return float(rng.uniform(low, high) * rng.choice([-1.0, 1.0]))


Draw = Callable[[Rng, Airframe, Conditions], Conditions]


def _wind(rng: Rng, frame: Airframe, c: Conditions) -> Conditions:
    speed, bearing = float(rng.uniform(1.2, 4.5)), float(rng.uniform(0.0, 2.0 * np.pi))
    return replace(
        c, wind_north=speed * np.cos(bearing), wind_east=speed * np.sin(bearing), gusts=float(rng.uniform(0.06, 0.15)),
        rotor_drag=max(c.rotor_drag, float(rng.uniform(0.12, 0.25))),
    )  # fmt: skip


def _load(rng: Rng, frame: Airframe, c: Conditions) -> Conditions:
    return replace(
        c, load_kg=frame.mass_kg * float(rng.uniform(0.03, 0.12)), load_z=float(rng.uniform(0.03, 0.08)),
        load_x=signed(rng, 0.0, 0.02) * frame.arm_m, load_y=signed(rng, 0.0, 0.02) * frame.arm_m,
        load_at_s=float(rng.choice([-1.0, float(rng.uniform(25.0, 60.0))])),
    )  # fmt: skip


def _density(rng: Rng, frame: Airframe, c: Conditions) -> Conditions:
    metres, warm = float(rng.uniform(400.0, 1500.0)), float(rng.uniform(-5.0, 15.0))
    kelvin = 288.15 - 0.0065 * metres + warm
    return replace(c, pascal=101325.0 * (1.0 - 2.25577e-5 * metres) ** 5.25588, kelvin=kelvin)


def _curve(rng: Rng, frame: Airframe, c: Conditions) -> Conditions:
    if frame.declares == "servo":
        return replace(c, declared_slope=-float(rng.uniform(0.25, 0.5)))
    return replace(c, reynolds=signed(rng, 0.3, 0.6))


def _weak(rng: Rng, frame: Airframe, c: Conditions) -> Conditions:
    return replace(
        c, weak_rotor=float(rng.integers(frame.count)), weak_share=-float(rng.uniform(0.06, 0.20))
    )


def _cg(rng: Rng, frame: Airframe, c: Conditions) -> Conditions:
    # A moment of 2 to 6 % of the weight times the arm on one axis, less on the other.
    long, short = signed(rng, 0.02, 0.06) * frame.arm_m, signed(rng, 0.005, 0.02) * frame.arm_m
    return (
        replace(c, cg_x=long, cg_y=short)
        if rng.random() < 0.5
        else replace(c, cg_x=short, cg_y=long)
    )


def _bias(rng: Rng, frame: Airframe, c: Conditions) -> Conditions:
    return replace(
        c, bias_x=signed(rng, 0.15, 0.5), bias_y=signed(rng, 0.05, 0.5), bias_z=signed(rng, 0.05, 0.4)
    )  # fmt: skip


def _slung(rng: Rng, frame: Airframe, c: Conditions) -> Conditions:
    return replace(
        c,
        slung_kg=frame.mass_kg * float(rng.uniform(0.03, 0.09)),
        rope_m=float(rng.uniform(0.3, 0.9)),
    )


def _contact(rng: Rng, frame: Airframe, c: Conditions) -> Conditions:
    return replace(c, bumper_m=0.05, bumper_n_m=frame.mass_kg * float(rng.uniform(25.0, 60.0)))


DRAWS: dict[str, Draw] = {
    "wind": _wind,
    "rotor_drag": lambda r, f, c: replace(c, rotor_drag=float(r.uniform(0.22, 0.50))),
    "body_drag": lambda r, f, c: replace(c, body_cda=float(r.uniform(0.04, 0.08)) * f.mass_kg),
    "vertical_inflow": lambda r, f, c: c,  # what differs is the plan: it climbs and sinks faster
    "air_density": _density,
    "thrust_scale": lambda r, f, c: replace(c, scale=signed(r, 0.025, 0.10)),
    "thrust_curve": _curve,
    "fan_imbalance": _weak,
    "payload": _load,
    "cg_offset": _cg,
    "imu_bias": _bias,
    "thermal_derating": lambda r, f, c: replace(
        c, heating=float(r.uniform(45.0, 85.0)), heating_s=float(r.uniform(25.0, 50.0))
    ),
    "battery_sag": lambda r, f, c: replace(
        c, minutes=float(r.uniform(4.0, 6.0)), charge=float(r.uniform(0.75, 1.0))
    ),
    "motor_lag": lambda r, f, c: replace(c, slow=float(r.uniform(1.6, 2.4))),
    "ground_effect": lambda r, f, c: replace(
        c, ground_gain=float(r.uniform(1.5, 2.0) if f.table else r.uniform(0.8, 1.3))
    ),
    "wall_effect": lambda r, f, c: replace(c, wall_gain=float(r.uniform(2.0, 3.5))),
    "ceiling": lambda r, f, c: replace(
        c, ceiling_gain=float(r.uniform(0.8, 1.4)), ceiling_m=f.home_m + 0.9
    ),
    "second_wall": lambda r, f, c: replace(c, wall_gain=float(r.uniform(2.0, 3.0)), wall_east=2.0),
    "partial_ground": lambda r, f, c: replace(
        c, edge_north=0.0, table_m=float(r.uniform(0.5, 0.7))
    ),
    "range_offset": lambda r, f, c: replace(c, range_bias=signed(r, 0.04, 0.09)),
    "contact": _contact,
    "slung_load": _slung,
    "x_grate": lambda r, f, c: replace(
        c, grate_n=f.mass_kg * G * float(r.uniform(0.03, 0.07)), grate_m=float(r.uniform(0.7, 1.4))
    ),
    "x_downwash": lambda r, f, c: replace(
        c,
        downwash_n=f.mass_kg * G * float(r.uniform(0.05, 0.12)),
        downwash_s=float(r.uniform(13.0, 22.0)),
    ),
    "x_rock": lambda r, f, c: replace(
        c,
        rock_nm=f.mass_kg * G * f.arm_m * float(r.uniform(0.025, 0.06)),
        rock_hz=float(r.uniform(0.15, 0.6)),
    ),
}


def pack(frame: Airframe, minutes: Number) -> tuple[Number, Number]:
    """Capacity [A s] and resistance [ohm] of a pack that hovers for ``minutes``: 1.5 mohm per cell at 10 Ah."""
    amperes = hover_current(frame)
    capacity = minutes * 60.0 * amperes
    return capacity, frame.cells * 0.0015 * 36000.0 / capacity
