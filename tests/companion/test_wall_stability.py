"""How steep a wall's pull the loop of the hold holds, against roots and a simulated loop."""

from __future__ import annotations

from dataclasses import replace

import pytest
from test_plant import swings

from companion.control.plant import FULL, AttitudeLoop, HoldGains, Timing, soften, tune
from companion.control.wall_stability import DECAY_1_S, roots_right_of, stiffness_held

SLOW = AttitudeLoop(0.16, 0.05)
"""An attitude loop with ATC_ANG_*_P 2.25, as it is measured in flight."""
AGE_S = 0.07
"""Positions at 10 Hz, 20 ms late."""


def gains_of(loop: AttitudeLoop, share: float) -> HoldGains:
    """Position and velocity softened alike, with a long lead."""
    led = replace(FULL, tilt_lead_s=0.8 * loop.lag_s)
    softened = soften(led, position_share=share, velocity_share=share)
    return replace(softened, integral_1_s2=FULL.integral_1_s2 * share**2)


def rightmost(gains: HoldGains, loop: AttitudeLoop, age_s: float, stiffness: float) -> float:
    """Real part of the rightmost root, by bisection of the line that it crosses."""
    low = -1.0
    high = 1.0
    for _ in range(20):
        middle = 0.5 * (low + high)
        if roots_right_of(middle, gains, loop, age_s, stiffness):
            low = middle
        else:
            high = middle
    return high


@pytest.mark.parametrize(
    ("share", "stiffness", "root"), [(0.61, 0.7, -0.16), (0.51, 1.8, 0.08), (0.43, 1.3, -0.04)]
)
def test_gains_softened_alike_hardly_hold_beside_a_wall_with_a_slow_attitude_loop(
    share, stiffness, root
):
    """A swing of 4 to 8 s that does not end was flown on ArduCopter 0.10 m from a wall."""
    softened = gains_of(SLOW, share)
    assert rightmost(softened, SLOW, AGE_S, stiffness) == pytest.approx(root, abs=0.01)
    assert rightmost(softened, SLOW, AGE_S, 0.0) < -DECAY_1_S


@pytest.mark.parametrize("stiffness", [0.7, 1.3, 1.8])
def test_the_gains_of_the_slow_loop_hold_every_pull_that_was_flown(stiffness):
    timing = Timing(position_period_s=0.10, position_late_s=0.02)
    tuned = tune(SLOW, timing)
    assert rightmost(tuned.gains, SLOW, tuned.age_s, stiffness) < -DECAY_1_S


@pytest.mark.parametrize("loop", [SLOW, AttitudeLoop(0.075, 0.09), AttitudeLoop(0.03, 0.02)])
@pytest.mark.parametrize("share", [0.43, 0.61, 0.92])
def test_a_nudge_dies_out_beside_the_pull_that_is_held_and_grows_beside_one_much_steeper(
    loop, share
):
    gains = gains_of(loop, share)
    held = stiffness_held(gains, loop, AGE_S)
    assert rightmost(gains, loop, AGE_S, held) == pytest.approx(-DECAY_1_S, abs=0.005)
    assert swings(gains, loop, AGE_S, stiffness_1_s2=held) < 0.2
    assert swings(gains, loop, AGE_S, seconds=20.0, stiffness_1_s2=3.0 * held + 1.0) > 1.0


def test_a_loop_that_rings_in_free_air_holds_no_pull():
    loop = AttitudeLoop(0.16, 0.12)
    assert stiffness_held(gains_of(loop, 1.0), loop, AGE_S) == 0.0
