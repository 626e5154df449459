"""When the hold may take over, and what it starts with: out of a take-off, in a mode that listens, bumplessly."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from companion.control.landed import AIRBORNE_AFTER_S, TAKE_OFF, Airborne
from companion.control.position_hold import tilt_acceleration
from companion.control.reasons import Reason
from companion.estimation.vectors import lagged
from companion.mavlink.firmware import Stack, stack_of
from companion.mavlink.samples import Heartbeat
from models.common.frozen_copy import with_changes
from models.vehicle import Vector3

_SETTLED_CLIMB_M_S = 0.25
_SETTLED_S = 1.0
"""A take-off is over when the vertical speed has been below that for so long."""
_BALANCE_MEAN_S = 1.0
"""Average of the tilt that balances wind before the hold engages."""


@dataclass(frozen=True)
class Engagement:
    """What leads up to a hold."""

    mode: int | None = None
    changed_s: float = -math.inf
    """When the mode last changed, as far as heartbeats tell."""
    steady_since_s: float = math.inf
    """Since when the vehicle has neither climbed nor sunk."""
    out_of_take_off: bool = False


def hear_heartbeat(engagement: Engagement, heartbeat: Heartbeat) -> Engagement:
    """Note the mode."""
    changed = heartbeat.custom_mode != engagement.mode
    if changed:
        changed_s = heartbeat.t_s
    else:
        changed_s = engagement.changed_s
    return with_changes(engagement, mode=heartbeat.custom_mode, changed_s=changed_s)


def watch_take_off(
    engagement: Engagement, t_s: float, climb_m_s: float | None, air: Airborne
) -> Engagement:
    """Whether a take-off is over: steady for a second, or flown in another mode since; never while the autopilot
    reports one.

    After the ground the next flight begins with a take-off again.
    """
    if math.isinf(air.since_s):
        return with_changes(engagement, steady_since_s=math.inf, out_of_take_off=False)
    if engagement.out_of_take_off:
        return engagement
    steady = (
        climb_m_s is not None
        and abs(climb_m_s) < _SETTLED_CLIMB_M_S
        and air.landed_state != TAKE_OFF
    )
    if steady:
        since = min(engagement.steady_since_s, t_s)
    else:
        since = math.inf
    flown_elsewhere = (
        engagement.changed_s > air.since_s + AIRBORNE_AFTER_S and air.landed_state != TAKE_OFF
    )
    over = flown_elsewhere or t_s - since >= _SETTLED_S
    return with_changes(engagement, steady_since_s=since, out_of_take_off=over)


def waits_for_mode(heartbeat: Heartbeat | None, refusals: set[Reason]) -> bool:
    """PX4 enters OFFBOARD only while a stream is running: until then one that means "stay as you are" is sent.

    ``refusals`` are those that hold back everything.
    """
    return (
        heartbeat is not None
        and stack_of(heartbeat) is Stack.PX4
        and refusals == {Reason.WRONG_MODE}
    )


class Balance(NamedTuple):
    """The part of the tilt that balances wind and walls: averages of its acceleration and of the velocity."""

    tilt: tuple[float, float] = (0.0, 0.0)
    velocity: tuple[float, float] = (0.0, 0.0)
    t_s: float = -math.inf
    acceleration: tuple[float, float] = (0.0, 0.0)
    """The tilt's average acceleration less the vehicle's own [m/s^2]."""


def watch_balance(balance: Balance, t_s: float, velocity: Vector3, body_down: Vector3) -> Balance:
    """Take in velocity and the body's down axis, NED."""
    tilt, (vn, ve, _) = tilt_acceleration(body_down), velocity
    dt = t_s - balance.t_s
    if not 0.0 < dt <= 1.0:
        return Balance(tilt, (vn, ve), t_s)
    share = min(dt / _BALANCE_MEAN_S, 1.0)
    north, east = lagged(balance.tilt, tilt, share)
    mean_n, mean_e = lagged(balance.velocity, (vn, ve), share)
    # The mean of a derivative under a first-order average: what the quantity is ahead of its own mean, over the time.
    own = ((vn - mean_n) / _BALANCE_MEAN_S, (ve - mean_e) / _BALANCE_MEAN_S)
    return Balance((north, east), (mean_n, mean_e), t_s, (north - own[0], east - own[1]))
