"""A velocity that differs from the slope of its own position, as estimators send it for minutes."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from companion.control.plant import FULL
from companion.control.position_hold import Motion, engage, fly
from companion.estimation.velocity_bias import VelocityBias, corrected
from companion.mavlink.firmware import ThrustMap
from companion.mavlink.samples import LocalPosition
from models.common.frames import GRAVITY
from models.vehicle import Limits

STEP_S = 0.02
THRUST = ThrustMap(hover=0.5, slope=1.0)
BIAS_M_S = -0.017
"""What an ArduCopter in simulation sends for whole flights."""


def position(t_s: float, north: float, speed: float) -> LocalPosition:
    return LocalPosition(t_s, 1, 1, (north, 0.0, 0.0), (speed, 0.0, 0.0))


def velocities(place: Callable[[float], float], bias: float, seconds: float) -> list[float]:
    """Errors [m/s] of the velocity that is used, on a way whose velocity is sent with a bias."""
    known = VelocityBias()
    errors = []
    for k in range(round(seconds / STEP_S)):
        t_s = k * STEP_S
        speed = (place(t_s + 1e-4) - place(t_s - 1e-4)) / 2e-4
        known, used = corrected(known, position(t_s, place(t_s), speed + bias), set_anew=False)
        errors.append(used.velocity_ned[0] - speed)
    return errors


@pytest.mark.parametrize("bias", [0.0, BIAS_M_S, 0.03])
@pytest.mark.parametrize(
    "place", [lambda t: 0.0, lambda t: 0.3 * t, lambda t: 0.2 * math.sin(2.0 * t)]
)
def test_a_steady_bias_is_taken_out_at_rest_and_on_the_move(place, bias):
    errors = velocities(place, bias, 25.0)
    assert errors[0] == pytest.approx(bias)
    assert errors[-1] == pytest.approx(0.0, abs=1e-3)


def test_nothing_is_learned_over_a_gap_from_an_old_sample_or_while_positions_are_set_anew():
    known, _ = corrected(VelocityBias(), position(0.0, 0.0, 0.0), set_anew=False)
    for t_s, set_anew in ((0.0, False), (2.0, False), (0.02, True)):
        later, used = corrected(known, position(t_s, 0.0, 0.1), set_anew=set_anew)
        assert later.bias == (0.0, 0.0)
        assert used.velocity_ned == (0.1, 0.0, 0.0)


def test_the_hold_rests_at_its_place_though_the_velocity_is_wrong():
    known = VelocityBias()
    north, speed, pitch = 0.0, 0.0, 0.0
    level = Motion((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.0)
    hold = engage(0.0, level, (0.0, 0.0), THRUST.hover, THRUST)
    for k in range(round(40.0 / STEP_S)):
        t_s = k * STEP_S
        known, used = corrected(known, position(t_s, north, speed + BIAS_M_S), set_anew=False)
        down = (math.sin(pitch), 0.0, math.cos(pitch))
        motion = Motion(used.position_ned, used.velocity_ned, down, 0.0)
        hold, setpoint = fly(hold, FULL, Limits(), t_s, motion, THRUST)
        pitch += STEP_S * 8.0 * (setpoint.pitch - pitch)
        speed -= STEP_S * GRAVITY * math.tan(pitch)
        north += STEP_S * speed
    assert north == pytest.approx(0.0, abs=1e-3)
