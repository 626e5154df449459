"""Ramps of position targets: what follows the reference late stops where the target stops."""

import math

import numpy as np
import pytest

from companion.config import HoldGains
from companion.control.position_target import Target, advance, start_reference
from models.vehicle import Limits

STEP_S, SPEED_M_S, SECONDS = 0.02, 0.3, 4.0


def expected_of(every: int, *, with_velocity: bool) -> np.ndarray:
    """Where a vehicle that answers late is, (n,) [m]: a ramp in steps of ``every`` setpoints that stops abruptly."""
    gains, limits = HoldGains(), Limits()
    reference, target, out = start_reference((0.0,) * 3, (0.0,) * 3, (0.0,) * 3), None, []
    for k in range(round((SECONDS + 8.0) / STEP_S)):
        t_s = k * STEP_S
        if k % every == 0:
            moving = t_s < SECONDS
            velocity = (SPEED_M_S if with_velocity and moving else 0.0, 0.0, 0.0)
            target = Target((SPEED_M_S * min(t_s, SECONDS), 0.0, 0.0), velocity, 0.0, t_s)
        reference = advance(reference, target, gains, limits, t_s, STEP_S)
        out.append(reference.expected.position[0])
    return np.array(out)


@pytest.mark.parametrize("with_velocity", [True, False])
@pytest.mark.parametrize("every", [1, 5, 17])
def test_a_ramp_that_stops_abruptly_is_not_overshot(every, with_velocity):
    place = expected_of(every, with_velocity=with_velocity)
    end = SPEED_M_S * SECONDS
    assert place.max() < end + 0.005
    arrived_s = STEP_S * np.argmax(place > end - 0.05)
    assert SECONDS < arrived_s < SECONDS + 2.0


def test_a_target_that_moves_as_the_vehicle_can_is_followed_without_delay():
    gains, limits = HoldGains(), Limits()
    reference = start_reference((0.0,) * 3, (0.0,) * 3, (0.0,) * 3)
    for k in range(500):
        t_s = k * STEP_S
        target = Target((1.0 - math.cos(0.5 * t_s), 0.0, 0.0), (0.5 * math.sin(0.5 * t_s), 0.0, 0.0), 0.0, t_s)
        reference = advance(reference, target, gains, limits, t_s, STEP_S)
        assert reference.expected.position[0] == pytest.approx(target.position[0], abs=0.01)
