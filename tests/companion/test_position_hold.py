"""The hold's horizontal loop against a vehicle whose attitude follows late."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import pytest

from companion.control.plant import FULL, AttitudeLoop, HoldGains, Timing, tune
from companion.control.position_hold import Motion, engage, fly
from companion.mavlink.firmware import ThrustMap
from models.common.frames import GRAVITY
from models.vehicle import Limits

THRUST = ThrustMap(hover=0.5, slope=1.0)
STEP_S = 0.02


def swing(
    gains: HoldGains,
    *,
    overshoot: float,
    late_s: float,
    seconds: float,
    push: float = 0.0,
    every: int = 1,
) -> list[float]:
    """Positions north [m] after a nudge: a pitch loop of 6 rad/s that gets setpoints late and answers too strongly.

    A ceiling or wall near by does this: it pulls harder at the fan that tilts towards it. ``every``: steps between
    two attitudes that the hold is told.
    """
    level = Motion((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.0)
    hold = engage(0.0, level, (0.0, 0.0), THRUST.hover, THRUST)
    north, speed, pitch, rate = 0.0, 0.1, 0.0, 0.0
    setpoints = deque([0.0] * (1 + round(late_s / STEP_S)), maxlen=1 + round(late_s / STEP_S))
    out = []
    for k in range(round(seconds / STEP_S)):
        if k % every == 0:
            down = (math.sin(pitch), 0.0, math.cos(pitch))
        place, velocity = (north, 0.0, 0.0), (speed, 0.0, 0.0)
        hold, setpoint = fly(
            hold, gains, Limits(), k * STEP_S, Motion(place, velocity, down, 0.0), THRUST
        )
        setpoints.append(setpoint.pitch)
        rate += STEP_S * (36.0 * (overshoot * setpoints[0] - pitch) - 8.0 * rate)
        pitch += STEP_S * rate
        speed += STEP_S * (-GRAVITY * math.tan(pitch) + push)
        north += STEP_S * speed
        out.append(north)
    return out


def grown(positions: list[float]) -> float:
    """Largest distance in the last two seconds over that in the first two."""
    return max(map(abs, positions[-100:])) / max(map(abs, positions[:100]))


def test_a_late_attitude_that_overshoots_does_not_make_the_hold_swing() -> None:
    blind = replace(FULL, tilt_lead_s=0.0)
    assert grown(swing(blind, overshoot=1.4, late_s=0.06, seconds=20.0)) > 1.0
    for late_s in (0.06, 0.1):
        for every in (1, 5):
            loop = AttitudeLoop(tau_s=1.0 / 6.0, delay_s=late_s, gain=1.4)
            gains = tune(loop, Timing(attitude_period_s=every * STEP_S)).gains
            assert (
                grown(swing(gains, overshoot=1.4, late_s=late_s, seconds=20.0, every=every)) < 0.1
            )


def test_a_steady_push_is_held_off_without_standing_aside() -> None:
    assert swing(FULL, overshoot=1.0, late_s=0.0, seconds=30.0, push=0.5)[-1] == pytest.approx(
        0.0, abs=2e-3
    )


def test_at_the_limit_of_tilt_the_integral_goes_to_what_the_tilt_balances_and_does_not_wind_up() -> (
    None
):
    gains = FULL
    level = Motion((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.0)
    far = level._replace(position=(1.0, 0.0, 0.0), offset=(-0.3, 0.0), balance=(-1.5, 0.2))
    for seconds, expected in ((0.1, (-0.4, 0.07)), (3.0, (-1.2, 0.2))):
        hold = engage(0.0, level, (0.0, 0.0), THRUST.hover, THRUST)
        for k in range(round(seconds / STEP_S)):
            hold, setpoint = fly(hold, gains, Limits(), (k + 1) * STEP_S, far, THRUST)
            assert math.hypot(setpoint.roll, setpoint.pitch) == pytest.approx(
                math.radians(15.0), abs=0.01
            )
        assert hold.integral[:2] == pytest.approx(expected, abs=0.05)
