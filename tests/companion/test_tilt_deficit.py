"""What the tilt lacks of what was sent is seen, sent besides, and nothing of what the lags of the loop explain."""

from __future__ import annotations

import math

import pytest

from companion.control.attitude_lag import AT_REST, answered
from companion.control.tilt_deficit import TiltDeficit, sent, start_deficit, watch_tilt

STEP_S = 0.02
LAG_S = 0.36


def flown(
    asked: float, moment: float, seconds: float, *, lag_s: float = LAG_S
) -> tuple[list[float], list[float]]:
    """Tilt and deficit [m/s^2] over time: a loop of ``lag_s`` that a moment of the air keeps off by ``moment``."""
    deficit = TiltDeficit()
    loop = AT_REST
    tilts = []
    deficits = []
    for _ in range(round(seconds / STEP_S)):
        tilt = loop[2][0] - moment
        deficit = watch_tilt(deficit, (tilt, 0.0), STEP_S)
        command = (asked + deficit.lacking[0], 0.0)
        deficit = sent(deficit, command, STEP_S, LAG_S)
        loop = answered(loop, command, STEP_S, lag_s)
        tilts.append(tilt)
        deficits.append(deficit.lacking[0])
    return tilts, deficits


def test_a_loop_that_answers_as_known_lacks_nothing() -> None:
    _, deficits = flown(asked=0.8, moment=0.0, seconds=5.0)
    assert max(map(abs, deficits)) < 1e-9


def test_a_moment_that_the_loop_does_not_trim_out_is_trimmed_out() -> None:
    tilts, deficits = flown(asked=0.5, moment=0.3, seconds=6.0)
    assert tilts[50] < 0.35
    assert tilts[-1] == pytest.approx(0.5, abs=0.02)
    assert deficits[-1] == pytest.approx(0.3, abs=0.02)


@pytest.mark.parametrize("lag_s", [0.5 * LAG_S, 1.6 * LAG_S])
def test_a_loop_of_another_lag_is_not_overdriven(lag_s: float) -> None:
    tilts, _ = flown(asked=0.5, moment=0.0, seconds=8.0, lag_s=lag_s)
    assert max(tilts) < 0.6
    assert tilts[-1] == pytest.approx(0.5, abs=0.02)


def test_a_vehicle_that_does_not_listen_is_asked_for_little_more() -> None:
    deficit = TiltDeficit()
    for _ in range(1000):
        deficit = watch_tilt(deficit, (-5.0, 3.0), STEP_S)
    assert math.hypot(*deficit.lacking) < 0.9


def test_the_tilt_that_there_is_counts_as_sent() -> None:
    deficit = watch_tilt(start_deficit((0.7, -0.2)), (0.7, -0.2), STEP_S)
    assert deficit.lacking == (0.0, 0.0)
