"""Manoeuvre plans: where the pilot is told to go, drawn per seed. World NED, home 1 m up, a wall in the east."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .craft import Craft

WALL_EAST = 2.0  # m, from home


@dataclass(frozen=True)
class Leg:
    """Go to a place (NED m, yaw rad) at no more than ``speed`` and stay until ``duration_s`` is over."""

    duration_s: float
    north: float
    east: float
    down: float
    yaw: float = 0.0
    speed: float = 0.7


Rng = np.random.Generator
Block = Callable[[Rng, Craft, float], list[Leg]]


def _hover(rng: Rng, craft: Craft, home: float) -> list[Leg]:
    return [Leg(float(rng.uniform(5.0, 8.0)), 0.0, 0.0, home)]


def _ground(rng: Rng, craft: Craft, home: float) -> list[Leg]:
    heights = craft.radius_m * rng.permutation([0.85, 1.1, 1.5, 2.1, 3.2]) * rng.uniform(0.95, 1.15)
    heights = heights + (0.1 if craft.cq else 0.0)  # open rotors sit on legs
    legs = [Leg(float(rng.uniform(3.5, 5.0)), 0.0, 0.0, -float(h), speed=0.6) for h in heights]
    middle = Leg(2.5, 0.0, 0.0, -0.75, speed=0.6)
    return [*legs[:2], middle, *legs[2:], Leg(4.0, 0.0, 0.0, home)]


def _wall_at(height: float) -> Block:
    def block(rng: Rng, craft: Craft, home: float) -> list[Leg]:
        gaps = craft.radius_m * rng.permutation([1.0, 1.4, 2.0, 2.9]) * rng.uniform(0.95, 1.15)
        east = WALL_EAST - craft.lip_m - gaps
        legs = [Leg(float(rng.uniform(3.5, 4.5)), 0.0, float(y), -height, speed=0.45) for y in east]
        start = Leg(4.0, 0.0, float(WALL_EAST - craft.lip_m - 4.0 * craft.radius_m), -height)
        return [start, *legs, Leg(5.0, 0.0, 0.0, home)]

    return block


def _turn(rng: Rng, craft: Craft, home: float) -> list[Leg]:
    sign = float(rng.choice([-1.0, 1.0]))
    legs = [
        Leg(
            float(rng.uniform(3.0, 4.5)),
            0.0,
            0.0,
            home,
            sign * q * np.pi / 2 + float(rng.uniform(-0.2, 0.2)),
        )
        for q in (1, 2, 3, 4, 3, 1)
    ]
    return [*legs, Leg(4.5, 0.0, 0.0, home)]


def _lateral(rng: Rng, craft: Craft, home: float) -> list[Leg]:
    a, b = rng.uniform(0.6, 1.0, 2)
    yaw = float(rng.choice([0.0, np.pi / 2, -np.pi / 2]))
    spots = [(a, 0), (-a, 0), (a, -0.2), (0, -b), (0, b * 0.6), (-0.5 * a, -b), (0, 0)]
    legs = [Leg(float(rng.uniform(2.2, 3.2)), x, y, home, yaw, 1.5) for x, y in spots]
    return [Leg(3.0, 0.0, 0.0, home, yaw), *legs, Leg(4.0, 0.0, 0.0, home)]


def _vertical(rng: Rng, craft: Craft, home: float) -> list[Leg]:
    steps = rng.uniform(0.25, 0.6, 6) * np.array([1, -0.6, 1, -0.6, 1, -0.6])
    return [
        *(Leg(float(rng.uniform(2.2, 3.5)), 0.0, 0.0, home - float(z), speed=1.1) for z in steps),
        *_hover(rng, craft, home),
    ]


def _dash(rng: Rng, craft: Craft, home: float) -> list[Leg]:
    far = float(rng.uniform(3.2, 4.0))
    legs = [
        Leg(3.2, x, y, home, 0.0, 3.4)
        for x, y in ((far, -1), (-far, -1), (far, -1), (0, -2 * far), (0, -1), (-1, -2 * far))
    ]
    return [*legs, Leg(5.0, 0.0, 0.0, home, 0.0, 1.5)]


def _wobble(rng: Rng, craft: Craft, home: float) -> list[Leg]:
    spots = rng.uniform(-0.5, 0.5, (12, 2))
    return [
        *(Leg(float(rng.uniform(0.8, 1.6)), float(x), float(y), home, 0.0, 2.0) for x, y in spots),
        Leg(4.0, 0.0, 0.0, home),
    ]


def _ceiling(rng: Rng, craft: Craft, home: float) -> list[Leg]:
    top = -CEILING_HEIGHT
    gaps = rng.permutation([0.22, 0.27, 0.33, 0.42]) * rng.uniform(0.95, 1.1)
    legs = [Leg(float(rng.uniform(4.0, 5.5)), 0.0, 0.0, top + float(g), speed=0.5) for g in gaps]
    return [Leg(4.0, 0.0, 0.0, -1.2), *legs, Leg(4.5, 0.0, 0.0, home)]


def _vertex(rng: Rng, craft: Craft, home: float) -> list[Leg]:
    legs = []
    for height in (0.95, 0.5):
        for front in rng.permutation([0.18, 0.28, 0.42, 0.6]):
            right = float(rng.uniform(0.2, 0.45))
            legs.append(_beside_both(4.0, float(front), right, height, craft))
        legs.append(_beside_both(3.5, 1.2, float(rng.uniform(0.2, 0.35)), height, craft))
    return [_beside_both(5.0, 1.2, 0.5, 0.95, craft), *legs, Leg(6.0, 0.0, 0.0, home)]


def _beside_both(duration: float, front: float, right: float, height: float, craft: Craft) -> Leg:
    nose = craft.fan_position[0][0] + craft.lip_m
    return Leg(
        duration, WALL_NORTH - nose - front, WALL_EAST - craft.lip_m - right, -height, 0.0, 0.5
    )


def _push(rng: Rng, craft: Craft, home: float) -> list[Leg]:
    east = WALL_EAST - craft.lip_m
    legs = []
    for height in rng.uniform(0.8, 1.2, 5):
        legs += [
            Leg(2.5, 0.0, east - 0.25, -float(height), speed=0.4),
            Leg(
                float(rng.uniform(2.0, 3.0)),
                0.0,
                east - float(rng.uniform(-0.03, 0.04)),
                -float(height),
                speed=0.3,
            ),
            Leg(2.0, 0.0, east - 0.3, -float(height), speed=0.5),
        ]
    return [Leg(4.0, 0.0, east - 0.4, home), *legs, Leg(5.0, 0.0, 0.0, home)]


def _edge(rng: Rng, craft: Craft, home: float) -> list[Leg]:
    legs = []
    for h in rng.permutation([0.14, 0.2, 0.28]):
        down = -(EDGE_HEIGHT + float(h))
        for north in (-0.9, -0.32, -0.1, 0.15, 0.4, 0.1, -0.2, -0.9):
            legs.append(Leg(float(rng.uniform(2.2, 2.8)), EDGE_NORTH + north, 0.0, down, speed=0.6))
    return [
        Leg(4.0, EDGE_NORTH - 0.9, 0.0, -1.1),
        *legs,
        Leg(5.0, EDGE_NORTH - 0.9, 0.0, -1.1),
        Leg(4.0, 0.0, 0.0, home),
    ]


CEILING_HEIGHT = 1.9
WALL_NORTH = 2.4
EDGE_NORTH = -1.5
EDGE_HEIGHT = 0.55  # a table stands south of EDGE_NORTH

_BLOCKS: dict[str, Block] = {
    "hover": _hover,
    "ground": _ground,
    "wall_high": _wall_at(0.95),
    "wall_low": _wall_at(0.32),
    "turn": _turn,
    "lateral": _lateral,
    "vertical": _vertical,
    "dash": _dash,
    "wobble": _wobble,
    "ceiling": _ceiling,
    "vertex": _vertex,
    "push": _push,
    "edge": _edge,
}
STANDARD = ("hover", "ground", "wall_high", "wall_low", "turn", "lateral", "vertical")


def draw_plan(
    rng: Rng,
    craft: Craft,
    blocks: tuple[str, ...],
    duration_s: float,
    home: float = -1.0,
    first: tuple[str, ...] = (),
) -> list[Leg]:
    """Blocks in a random order, hover at both ends, more blocks of the same kinds until the time is filled.

    ``first`` names blocks that must not fall off the end: they come among the first three.
    """
    order = [str(b) for b in rng.permutation([b for b in blocks if b not in ("hover", *first)])]
    for block in first:
        order.insert(int(rng.integers(3)), block)
    legs = _hover(rng, craft, home)
    if not order:
        return [Leg(duration_s + 30.0, 0.0, 0.0, home)]
    spent = legs[0].duration_s
    k = 0
    while spent < duration_s:
        drawn = _BLOCKS[order[k % len(order)]](rng, craft, home)
        legs += drawn
        spent += sum(leg.duration_s for leg in drawn)
        k += 1
    return [*legs, Leg(30.0, 0.0, 0.0, home)]
