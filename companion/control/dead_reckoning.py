"""Dead reckoning: what accelerations have added to velocity and place since a late position was measured.

v(t) - v(u) and x(t) - x(u) - (t - u) v(u) for an instant u, from the running sums v = int a dt and x = int v dt.
"""

from __future__ import annotations

from typing import NamedTuple

from companion.estimation.vectors import minus, plus, scaled
from models.vehicle import Vector3

KEPT_S = 0.4
"""A position older than this is not carried on further: what is known of the accelerations since says too little."""
_NONE = (0.0, 0.0, 0.0)


class Sums(NamedTuple):
    """The running sums at a time: NED, m/s and m."""

    t_s: float
    velocity: Vector3
    place: Vector3


Reckoning = tuple[Sums, ...]
"""The sums of the last ``KEPT_S``, the newest last."""


class Gained(NamedTuple):
    """What was added to velocity [m/s] and place [m], NED."""

    velocity: Vector3
    place: Vector3


def accelerated(reckoning: Reckoning, t_s: float, dt_s: float, acceleration: Vector3) -> Reckoning:
    """``acceleration`` [m/s^2], NED, has acted for the last ``dt_s``."""
    if not reckoning:
        return (Sums(t_s, _NONE, _NONE),)
    last = reckoning[-1]
    added = scaled(acceleration, dt_s)
    halfway = plus(last.velocity, scaled(added, 0.5))
    place = plus(last.place, scaled(halfway, dt_s))
    newest = Sums(t_s, plus(last.velocity, added), place)
    too_old = len(reckoning) > 1 and reckoning[1].t_s <= t_s - KEPT_S
    kept = reckoning[1:] if too_old else reckoning
    return (*kept, newest)


def gained_since(reckoning: Reckoning, since_s: float) -> Gained:
    """What the accelerations have added from ``since_s`` to the newest sums."""
    now = reckoning[-1]
    then = _sums_at(reckoning, max(since_s, now.t_s - KEPT_S))
    straight = scaled(then.velocity, now.t_s - then.t_s)
    return Gained(
        velocity=minus(now.velocity, then.velocity),
        place=minus(minus(now.place, then.place), straight),
    )


def _sums_at(reckoning: Reckoning, t_s: float) -> Sums:
    """The sums at a time between the oldest and the newest, interpolated."""
    later = reckoning[-1]
    for earlier in reversed(reckoning):
        if earlier.t_s <= t_s:
            break
        later = earlier
    else:
        return reckoning[0]
    between_s = later.t_s - earlier.t_s
    if between_s <= 0.0:
        return earlier
    share = (min(t_s, later.t_s) - earlier.t_s) / between_s
    velocity = plus(earlier.velocity, scaled(minus(later.velocity, earlier.velocity), share))
    place = plus(earlier.place, scaled(minus(later.place, earlier.place), share))
    return Sums(earlier.t_s + share * between_s, velocity, place)
