"""Which flights one seed stands for: nulls, one effect made large, pairs, and forces that are in no catalogue.

Seeds below ``HELD_OUT`` are open; from there on nobody who works on the diagnosis looks before it is frozen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np

from .airframes import AIRFRAMES, DOWN, FRONT, RIGHT, UP, Airframe, Beam
from .conditions import DRAWS, Conditions, healthy
from .flight import DT, Sortie
from .script import WALL_M, reference, targets

HELD_OUT = 100
SECONDS = 90.0

VEHICLES: dict[str, tuple[str, ...]] = {
    "wind": ("lifter", "hexa", "racer"),
    "rotor_drag": ("racer", "lifter", "hexa"),
    "body_drag": ("hexa", "lifter"),
    "vertical_inflow": ("lifter", "racer", "hexa"),
    "air_density": ("lifter", "hexa", "guarded"),
    "thrust_scale": ("hexa", "lifter", "guarded"),
    "thrust_curve": ("racer", "racer", "lifter"),
    "fan_imbalance": ("lifter", "hexa", "guarded"),
    "payload": ("hexa", "lifter", "racer"),
    "cg_offset": ("lifter", "hexa", "guarded"),
    "imu_bias": ("racer", "lifter", "guarded"),
    "thermal_derating": ("racer",),
    "battery_sag": ("racer",),
    "motor_lag": ("racer",),
    "ground_effect": ("lifter", "guarded", "racer"),
    "wall_effect": ("guarded", "lifter"),
    "ceiling": ("guarded", "lifter"),
    "second_wall": ("guarded",),
    "partial_ground": ("guarded",),
    "range_offset": ("guarded",),
    "contact": ("guarded",),
    "slung_load": ("hexa", "lifter"),
    "x_grate": ("lifter", "guarded", "racer"),
    "x_downwash": ("hexa", "lifter", "guarded"),
    "x_rock": ("racer", "hexa", "lifter"),
}
"""On which vehicles an effect is at home; seeds take them in turn."""

BLOCKS: dict[str, tuple[str, ...]] = {
    "wind": ("turn",), "rotor_drag": ("brisk",), "body_drag": ("dash", "brisk"), "vertical_inflow": ("pump",),
    "thrust_curve": ("pump",), "motor_lag": ("pump",), "ground_effect": ("low",), "range_offset": ("low",),
    "wall_effect": ("wall",), "second_wall": ("corner",), "contact": ("push",), "ceiling": ("under",),
    "partial_ground": ("edge",), "slung_load": ("brisk",), "x_grate": ("brisk",),
}  # fmt: skip
"""Manoeuvres that show an effect."""

PAIRS = (
    ("wind", "payload"), ("ground_effect", "imu_bias"), ("rotor_drag", "thrust_scale"),
    ("cg_offset", "vertical_inflow"), ("fan_imbalance", "rotor_drag"), ("payload", "vertical_inflow"),
    ("battery_sag", "motor_lag"), ("wall_effect", "cg_offset"), ("range_offset", "thrust_scale"),
    ("imu_bias", "thrust_curve"), ("wind", "x_downwash"), ("payload", "x_grate"),
)  # fmt: skip
PAIRS_A_SEED = 4


@dataclass(frozen=True)
class Case:
    """One flight of one seed."""

    seed: int
    name: str
    group: str
    """null, single, pair or unknown."""
    vehicle: str
    effects: tuple[str, ...] = ()

    @property
    def frame(self) -> Airframe:
        """The vehicle."""
        return AIRFRAMES[self.vehicle]

    @property
    def number(self) -> int:
        """Seed of everything random in this flight."""
        return crc32(f"independent/{self.seed}/{self.name}".encode())

    def conditions(self) -> Conditions:
        """What acts: a healthy vehicle, with this flight's effects made large."""
        rng = np.random.default_rng([self.number, 0])
        c = healthy(rng, self.frame)
        for effect in self.effects:
            c = DRAWS[effect](rng, self.frame, c)
        if {"wall", "corner", "push"} & set(self.blocks):
            c = replace(c, wall_north=WALL_M)
        return c

    @property
    def blocks(self) -> tuple[str, ...]:
        """Manoeuvres that this flight needs."""
        return tuple(dict.fromkeys(b for e in self.effects for b in BLOCKS.get(e, ())))

    def sortie(self) -> Sortie:
        """The flight for the simulator."""
        rng = np.random.default_rng([self.number, 3])
        plan = targets(rng, self.frame, self.blocks, (), SECONDS)
        return Sortie(self.number, self.conditions(), reference(plan, SECONDS, DT))

    @property
    def beams(self) -> tuple[Beam, ...]:
        """Rangefinders on board."""
        c, out = self.conditions(), [DOWN]
        out += [FRONT] if np.isfinite(c.wall_north) else []
        out += [RIGHT] if np.isfinite(c.wall_east) else []
        return (*out, UP) if np.isfinite(c.ceiling_m) else tuple(out)


def cases(seed: int) -> list[Case]:
    """All flights of a seed."""
    out = [Case(seed, f"null_{vehicle}", "null", vehicle) for vehicle in AIRFRAMES]
    for effect, vehicles in VEHICLES.items():
        vehicle = vehicles[seed % len(vehicles)]
        group = "unknown" if effect.startswith("x_") else "single"
        out.append(Case(seed, f"{effect}_{vehicle}", group, vehicle, (effect,)))
    for k in range(PAIRS_A_SEED):
        pair = PAIRS[(seed * PAIRS_A_SEED + k) % len(PAIRS)]
        both = [v for v in VEHICLES[pair[0]] if v in VEHICLES[pair[1]]] or list(VEHICLES[pair[0]])
        vehicle = both[seed % len(both)]
        out.append(Case(seed, f"{pair[0]}+{pair[1]}_{vehicle}", "pair", vehicle, pair))
    return out
