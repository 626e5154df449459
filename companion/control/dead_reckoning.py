"""Dead reckoning: what accelerations have added to velocity and place since a late position was measured.

v(t) - v(u) and x(t) - x(u) - (t - u) v(u) for an instant u, from the running sums v = int a dt and x = int v dt. Plain
floats: it runs for every setpoint.
"""

from __future__ import annotations

from typing import NamedTuple

from models.vehicle import Vector3

KEPT_S = 0.35
"""A position older than this is not carried on further: what is known of the accelerations since says too little."""


class Sums(NamedTuple):
    """The running sums at a time: velocity [m/s] and place [m], NED."""

    t_s: float
    velocity_n: float = 0.0
    velocity_e: float = 0.0
    velocity_d: float = 0.0
    north: float = 0.0
    east: float = 0.0
    down: float = 0.0


Reckoning = tuple[Sums, ...]
"""The sums of the last ``KEPT_S``, the newest last."""


class Gained(NamedTuple):
    """What was added to velocity [m/s] and place [m], NED."""

    velocity: Vector3
    place: Vector3


def accelerated(reckoning: Reckoning, t_s: float, dt_s: float, acceleration: Vector3) -> Reckoning:
    """``acceleration`` [m/s^2], NED, has acted for the last ``dt_s``."""
    if not reckoning:
        return (Sums(t_s),)
    _, vn, ve, vd, north, east, down = reckoning[-1]
    added_n = acceleration[0] * dt_s
    added_e = acceleration[1] * dt_s
    added_d = acceleration[2] * dt_s
    newest = Sums(
        t_s=t_s,
        velocity_n=vn + added_n,
        velocity_e=ve + added_e,
        velocity_d=vd + added_d,
        north=north + (vn + 0.5 * added_n) * dt_s,
        east=east + (ve + 0.5 * added_e) * dt_s,
        down=down + (vd + 0.5 * added_d) * dt_s,
    )
    too_old = len(reckoning) > 1 and reckoning[1].t_s <= t_s - KEPT_S
    kept = reckoning[1:] if too_old else reckoning
    return (*kept, newest)


def gained_since(reckoning: Reckoning, since_s: float) -> Gained:
    """What the accelerations have added from ``since_s`` to the newest sums."""
    t_s, vn, ve, vd, north, east, down = reckoning[-1]
    then = _sums_at(reckoning, max(since_s, t_s - KEPT_S))
    passed_s = t_s - then.t_s
    return Gained(
        velocity=(vn - then.velocity_n, ve - then.velocity_e, vd - then.velocity_d),
        place=(
            north - then.north - then.velocity_n * passed_s,
            east - then.east - then.velocity_e * passed_s,
            down - then.down - then.velocity_d * passed_s,
        ),
    )


def _sums_at(reckoning: Reckoning, t_s: float) -> Sums:
    """The sums at a time: interpolated, or those of the beginning or the end."""
    later = reckoning[-1]
    for earlier in reversed(reckoning):
        if earlier.t_s <= t_s:
            return _between(earlier, later, t_s)
        later = earlier
    return later


def _between(earlier: Sums, later: Sums, t_s: float) -> Sums:
    """Linear between two; of two at one time the earlier."""
    between_s = later.t_s - earlier.t_s
    if between_s <= 0.0:
        return earlier
    share = min((t_s - earlier.t_s) / between_s, 1.0)
    return Sums(*[a + share * (b - a) for a, b in zip(earlier, later, strict=True)])
