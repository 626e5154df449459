"""Where the pilot goes: blocks of targets, and the smooth reference that the autopilot follows. World NED."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from .airframes import Airframe, Array

Rng = np.random.Generator
WALL_M = 2.4


@dataclass(frozen=True)
class Target:
    """Fly towards a place at no more than ``speed`` [m/s] for ``seconds``."""

    seconds: float
    north: float
    east: float
    up: float
    yaw: float = 0.0
    speed: float = 0.4


def _u(rng: Rng, low: float, high: float) -> float:
    return float(rng.uniform(low, high))


def hover(rng: Rng, f: Airframe) -> list[Target]:
    """Stay."""
    return [Target(_u(rng, 5.0, 8.0), 0.0, 0.0, f.home_m)]


def square(rng: Rng, f: Airframe) -> list[Target]:
    """Sideways steps, slow."""
    a = _u(rng, 0.5, 0.9)
    return [
        Target(_u(rng, 3.0, 4.0), n * a, e * a, f.home_m)
        for n, e in ((1, 0), (1, 1), (-1, 1), (-1, -1), (0, 0))
    ]


def brisk(rng: Rng, f: Airframe) -> list[Target]:
    """Sideways steps at 1 to 2 m/s."""
    a, v = _u(rng, 1.5, 2.2), _u(rng, 1.2, 2.0)
    places = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1), (0, 0))
    return [Target(_u(rng, 3.0, 4.5), n * a, e * a, f.home_m, speed=v) for n, e in places]


def dash(rng: Rng, f: Airframe) -> list[Target]:
    """Long legs at 3.5 to 5 m/s and at half of it."""
    v, a = _u(rng, 3.5, 5.0), 9.0
    legs = [(1, 0, v), (-1, 0, v), (0, 1, v), (0, -1, v), (1, 0, v / 2), (0, 0, v / 2)]
    return [Target(_u(rng, 5.0, 6.0), n * a, e * a, f.home_m + 1.0, speed=s) for n, e, s in legs]


def circle(rng: Rng, f: Airframe) -> list[Target]:
    """A slow circle in chords, nose along it."""
    radius, turn = _u(rng, 0.6, 1.0), float(rng.choice([-1.0, 1.0]))
    angles = turn * np.arange(1, 13) * np.pi / 6.0
    out = [
        Target(1.3, radius * (np.cos(b) - 1.0), radius * np.sin(b), f.home_m, float(b))
        for b in angles
    ]
    return [*out, Target(3.0, 0.0, 0.0, f.home_m, float(angles[-1]))]


def turn(rng: Rng, f: Airframe) -> list[Target]:
    """Yaw through a full circle and back to zero."""
    sense = float(rng.choice([-1.0, 1.0]))
    return [
        Target(_u(rng, 2.5, 3.5), 0.0, 0.0, f.home_m, sense * k * np.pi / 2.0)
        for k in (1, 2, 3, 4, 2, 0)
    ]


def heave(rng: Rng, f: Airframe) -> list[Target]:
    """Slow steps up and down, above the ground's reach."""
    return [
        Target(_u(rng, 2.5, 4.0), 0.0, 0.0, f.home_m + s, speed=0.25)
        for s in (0.4, 0.0, 0.3, -0.1, 0.0)
    ]


def pump(rng: Rng, f: Airframe) -> list[Target]:
    """Quick steps up and down."""
    v = _u(rng, 1.0, 1.6)
    steps = rng.permutation([0.9, 0.1, 1.3, 0.5, 0.0, 1.0])
    return [
        Target(_u(rng, 2.0, 3.0), 0.0, 0.0, f.home_m + float(s), speed=v) for s in [*steps, 0.0]
    ]


def low(rng: Rng, f: Airframe) -> list[Target]:
    """Heights between 0.8 and 4 radii under the rotors."""
    heights = (
        f.radius_m * rng.permutation([0.9, 1.2, 1.6, 2.2, 3.2]) * _u(rng, 0.95, 1.1) + f.arms[0][2]
    )
    legs = [Target(_u(rng, 4.0, 5.0), 0.0, 0.0, max(float(h), 0.09), speed=0.3) for h in heights]
    middle = Target(4.5, 0.0, 0.0, f.home_m * 0.6, speed=0.5)
    return [
        Target(4.5, 0.0, 0.0, f.home_m * 0.6, speed=0.6),
        *legs[:3],
        middle,
        *legs[3:],
        Target(5.0, 0.0, 0.0, f.home_m),
    ]


def _reach(f: Airframe) -> float:
    return max(x for x, _, _ in f.arms) + f.lip_m


def wall(rng: Rng, f: Airframe) -> list[Target]:
    """Approach the wall in the north to distances between 0.4 and 3 radii, twice, at two heights."""
    out = [Target(5.0, WALL_M - _reach(f) - 4.0 * f.radius_m, 0.0, f.home_m)]
    for up in (f.home_m, f.home_m * 0.6):
        gaps = f.radius_m * rng.permutation([0.6, 0.9, 1.4, 2.4]) * _u(rng, 0.9, 1.15)
        out += [
            Target(_u(rng, 3.0, 4.0), WALL_M - _reach(f) - float(g), 0.0, up, speed=0.3)
            for g in gaps
        ]
    return [*out, Target(5.0, 0.0, 0.0, f.home_m)]


def corner(rng: Rng, f: Airframe) -> list[Target]:
    """The wall in the north and the one in the east, alone and together."""
    n0, e0, r = WALL_M - _reach(f), 2.0 - _reach(f), f.radius_m
    places = [(3.5, 0.7), (0.8, 0.8), (0.8, 3.5), (3.0, 0.6), (0.7, 1.5), (1.5, 0.7), (3.5, 3.5)]
    legs = [
        Target(_u(rng, 4.0, 5.0), n0 - a * r, e0 - b * r, f.home_m, speed=0.4) for a, b in places
    ]
    return [
        Target(5.0, n0 - 4.0 * r, e0 - 4.0 * r, f.home_m, speed=0.6),
        *legs,
        Target(6.0, 0.0, 0.0, f.home_m, speed=0.6),
    ]


def push(rng: Rng, f: Airframe) -> list[Target]:
    """Touch the wall softly, several times."""
    out = [Target(5.0, WALL_M - _reach(f) - 0.4, 0.0, f.home_m)]
    for _ in range(5):
        into = _u(rng, 0.04, 0.18)
        out.append(
            Target(_u(rng, 3.0, 4.0), WALL_M - _reach(f) - 0.05 + into, 0.0, f.home_m, speed=0.25)
        )
        out.append(Target(_u(rng, 2.0, 3.0), WALL_M - _reach(f) - 0.3, 0.0, f.home_m, speed=0.25))
    return [*out, Target(5.0, 0.0, 0.0, f.home_m)]


def under(rng: Rng, f: Airframe) -> list[Target]:
    """Close to the ceiling, 0.9 m above home, in steps."""
    gaps = f.radius_m * rng.permutation([0.9, 1.2, 1.6, 2.4]) * _u(rng, 0.9, 1.1)
    top = f.home_m + 0.9 + f.arms[0][2]
    legs = [Target(_u(rng, 3.5, 4.5), 0.0, 0.0, top - float(g), speed=0.25) for g in gaps]
    return [
        *legs,
        Target(4.0, 0.0, 0.0, f.home_m),
        *reversed(legs),
        Target(4.5, 0.0, 0.0, f.home_m),
    ]


def edge(rng: Rng, f: Airframe) -> list[Target]:
    """Cross the edge of a table several times at three heights over it."""
    out: list[Target] = []
    for radii in (1.0, 1.6, 2.4):
        up = 0.7 + radii * f.radius_m
        a = _u(rng, 0.5, 0.7)
        out += [Target(_u(rng, 3.5, 4.5), n * a, 0.0, up, speed=0.3) for n in (1, 0, -1, 0)]
    return [*out, Target(4.0, 0.0, 0.0, f.home_m)]


BLOCKS = {
    b.__name__: b
    for b in (
        hover,
        square,
        brisk,
        dash,
        circle,
        turn,
        heave,
        pump,
        low,
        wall,
        corner,
        push,
        under,
        edge,
    )
}


def targets(
    rng: Rng, frame: Airframe, needed: tuple[str, ...], without: tuple[str, ...], seconds: float
) -> list[Target]:
    """A flight: hover first, the needed blocks and ordinary ones in random order until time is over."""
    ordinary = [b for b in ("square", "turn", "heave", "circle") if b not in without]
    out = hover(rng, frame)
    queue = [*needed, *ordinary]
    first = [str(b) for b in rng.permutation(queue)]
    while sum(t.seconds for t in out) < seconds:
        if not first:
            again = [b for b in (*needed, *needed, *ordinary) if b not in without]
            first = [str(rng.choice(again))]
        out += BLOCKS[first.pop(0)](rng, frame)
    return out


@dataclass(frozen=True)
class Reference:
    """What the autopilot is to follow: (steps, 3) NED and (steps,) yaw."""

    position: Array
    velocity: Array
    yaw: Array


def reference(plan: list[Target], seconds: float, dt: float) -> Reference:
    """Targets, limited in speed and smoothed by a double pole of 0.35 s."""
    steps = round(seconds / dt)
    place, heading = np.array([plan[0].north, plan[0].east, -plan[0].up]), plan[0].yaw
    raw, yaw = np.empty((steps, 3)), np.empty(steps)
    ends = np.cumsum([t.seconds for t in plan])
    which = np.minimum(np.searchsorted(ends, np.arange(steps) * dt, side="right"), len(plan) - 1)
    for i in range(steps):
        t = plan[which[i]]
        way = np.array([t.north, t.east, -t.up]) - place
        far = float(np.sqrt(way @ way))
        place = place + way * min(1.0, t.speed * dt / max(far, 1e-9))
        heading += min(max(t.yaw - heading, -0.9 * dt), 0.9 * dt)
        raw[i], yaw[i] = place, heading
    keep = float(np.exp(-dt / 0.35))
    for _ in range(2):
        state = raw[:1] * keep
        raw = lfilter([1.0 - keep], [1.0, -keep], raw, axis=0, zi=state)[0]
    return Reference(raw, np.gradient(raw, dt, axis=0), yaw)
