"""When the hold may take over, and what it starts with: out of a take-off, in a mode that listens, bumplessly."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from companion.config import Tuning
from companion.control.authority import Reason
from companion.control.position_hold import tilt_acceleration
from companion.mavlink.firmware import Stack, stack_of, takes_setpoints
from companion.mavlink.samples import Heartbeat
from models.evolve import replace
from models.frames import Array

ON_GROUND, IN_AIR, TAKE_OFF, LANDING = 1, 2, 3, 4
"""MAV_LANDED_STATE."""


@dataclass(frozen=True)
class Engagement:
    """What leads up to a hold."""

    listens: bool = False
    """The mode takes setpoints."""
    mode: int | None = None
    changed_s: float = -math.inf
    """When the mode last changed, as far as heartbeats tell."""
    steady_since_s: float = math.inf
    """Since when the vehicle has neither climbed nor sunk."""
    out_of_take_off: bool = False


def hear_heartbeat(engagement: Engagement, heartbeat: Heartbeat) -> Engagement:
    """Note the mode."""
    changed = heartbeat.custom_mode != engagement.mode
    return replace(
        engagement,
        listens=takes_setpoints(heartbeat),
        mode=heartbeat.custom_mode,
        changed_s=heartbeat.t_s if changed else engagement.changed_s,
    )


def watch_take_off(
    engagement: Engagement,
    t_s: float,
    climb_m_s: float | None,
    landed_state: int,
    airborne_since_s: float,
    tuning: Tuning,
) -> Engagement:
    """Whether a take-off is over: steady for a second, or flown in another mode since; never while the
    autopilot reports one.

    ``airborne_since_s`` is inf on the ground, which makes the next flight begin with a take-off again.
    """
    if math.isinf(airborne_since_s):
        return replace(engagement, steady_since_s=math.inf, out_of_take_off=False)
    if engagement.out_of_take_off:
        return engagement
    steady = climb_m_s is not None and abs(climb_m_s) < tuning.settled_climb_m_s and landed_state != TAKE_OFF
    since = min(engagement.steady_since_s, t_s) if steady else math.inf
    flown_elsewhere = engagement.changed_s > airborne_since_s + tuning.airborne_after_s and landed_state != TAKE_OFF
    over = flown_elsewhere or t_s - since >= tuning.settled_s
    return replace(engagement, steady_since_s=since, out_of_take_off=over)


def waits_for_mode(heartbeat: Heartbeat | None, refusals: set[Reason]) -> bool:
    """PX4 enters OFFBOARD only while a stream is running: until then one that means "stay as you are" is sent.

    ``refusals`` are those that hold back everything.
    """
    return heartbeat is not None and stack_of(heartbeat) is Stack.PX4 and refusals == {Reason.WRONG_MODE}


@dataclass(frozen=True)
class Balance:
    """Which part of the tilt balances wind and walls: averages of what the tilt gives and of the velocity (2,)."""

    tilt: Array = field(default_factory=lambda: np.zeros(2))
    velocity: Array = field(default_factory=lambda: np.zeros(2))
    t_s: float = -math.inf
    acceleration: Array = field(default_factory=lambda: np.zeros(2))
    """The tilt's average acceleration less the vehicle's own [m/s^2]."""


def watch_balance(balance: Balance, t_s: float, velocity: Array, body_down: Array, tuning: Tuning) -> Balance:
    """Take in velocity (3,) and the body's down axis (3,), NED."""
    tilt = tilt_acceleration(body_down)
    dt = t_s - balance.t_s
    if not 0.0 < dt <= 1.0:
        return Balance(tilt, velocity[:2].copy(), t_s, np.zeros(2))
    share = min(dt / tuning.balance_mean_s, 1.0)
    tilt_mean = balance.tilt + share * (tilt - balance.tilt)
    mean = balance.velocity + share * (velocity[:2] - balance.velocity)
    # The mean of a derivative under a first-order average: what the quantity is ahead of its own mean, over the time.
    own = (velocity[:2] - mean) / tuning.balance_mean_s
    return Balance(tilt_mean, mean, t_s, tilt_mean - own)
