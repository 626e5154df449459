"""The hold's horizontal loop against a vehicle whose attitude follows late."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import numpy as np
import pytest

from companion.autopilot import ThrustMap
from companion.hold import HoldGains, engage, fly
from models.wrench import GRAVITY

THRUST = ThrustMap(hover=0.5, slope=1.0)
STEP_S = 0.02


def swing(gains: HoldGains, *, overshoot: float, late_s: float, seconds: float, push: float = 0.0) -> list[float]:
    """Positions north [m] after a nudge: a pitch loop of 6 rad/s that gets setpoints late and answers too strongly.

    A ceiling or wall near by does this: it pulls harder at the fan that tilts towards it.
    """
    hold = engage(0.0, np.zeros(3), 0.0, 0.0, 0.0, 0.0)
    north, speed, pitch, rate = 0.0, 0.1, 0.0, 0.0
    setpoints = deque([0.0] * (1 + round(late_s / STEP_S)), maxlen=1 + round(late_s / STEP_S))
    out = []
    for k in range(round(seconds / STEP_S)):
        down = np.array([math.sin(pitch), 0.0, math.cos(pitch)])
        place, velocity = np.array([north, 0.0, 0.0]), np.array([speed, 0.0, 0.0])
        hold, setpoint = fly(hold, gains, k * STEP_S, place, velocity, down, THRUST)
        setpoints.append(setpoint.pitch)
        rate += STEP_S * (36.0 * (overshoot * setpoints[0] - pitch) - 8.0 * rate)
        pitch += STEP_S * rate
        speed += STEP_S * (-GRAVITY * math.tan(pitch) + push)
        north += STEP_S * speed
        out.append(north)
    return out


def test_a_late_attitude_that_overshoots_does_not_make_the_hold_swing() -> None:
    gains = HoldGains()
    blind = swing(replace(gains, lean_lead_s=0.0), overshoot=1.4, late_s=0.06, seconds=20.0)
    seeing = swing(gains, overshoot=1.4, late_s=0.06, seconds=20.0)
    assert max(map(abs, blind[-100:])) > max(map(abs, blind[:100]))  # without the lead it grows
    assert max(map(abs, seeing[-100:])) < 0.1 * max(map(abs, seeing[:100]))


def test_a_steady_push_is_held_off_without_standing_aside() -> None:
    assert swing(HoldGains(), overshoot=1.0, late_s=0.0, seconds=30.0, push=0.5)[-1] == pytest.approx(0.0, abs=2e-3)
