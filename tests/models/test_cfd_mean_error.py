"""How far the mean of a computed flow is from the truth, on made-up cases whose errors are known."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from models.cfd import fidelity
from models.cfd.case_run import Result, Row
from models.cfd.labels import Label, MeanError, labels
from models.cfd.position import FREE, Position

INF = math.inf
KIND = ("full", 0.75)
SWING = (0.4, 0.4, 0.3, 0.02, 0.02, 0.005)


def case(
    h: float,
    d: float,
    wrench: tuple[float, ...],
    status: str = "cycling",
    rpm: float = 4000.0,
    **more,
) -> Row:
    result = Result(
        wrench=wrench,
        swing=SWING,
        drift=(0.0,) * 6,
        parts=(8.0, 8.0, 8.0),
        status=status,
        cells=1000,
        iterations=192,
        steps=0,
        seconds=1.0,
        start="rest",
    )
    return Row(Position(h=h, d=d, rpm=rpm, swirl=True, level=0.75), replace(result, **more))


def marched(h: float, d: float, mean: tuple[float, ...], iterated: tuple[float, ...]) -> Row:
    """A case that was marched after iterations with another mean; its mean is known to a tenth of the swing."""
    error = tuple(0.1 * s for s in SWING)
    more = {"steps": 320, "error": error, "iterated": iterated, "iterated_error": SWING}
    return case(h, d, mean, "averaged", **more)


def test_what_a_case_without_a_wall_shows_is_the_error_of_its_neighbours_at_that_height():
    """A flow tipped over by 2 N, whichever way, beside cases that say 0.4 N of themselves."""
    rows = [
        case(1.0, INF, (1.2, 1.6, 28.0, 0.0, 0.0, 0.0)),
        case(1.0, 0.5, (0.0,) * 6),
        case(4.0, INF, (0.0,) * 6),
    ]
    found = labels([*rows, case(4.0, 0.5, (0.0,) * 6)], 4000.0, KIND)
    assert found[1.0, 0.5].sigma[:2] == pytest.approx([math.sqrt(2.0)] * 2, rel=1e-3)
    assert found[1.0, 0.5].sigma[2] == pytest.approx(0.3)
    # Far from the ground nothing tips over: the case's own swing is all.
    assert found[4.0, 0.5].sigma[:2] == pytest.approx([0.4, 0.4], rel=1e-3)
    # Without a wall zero is exact; what the flow shows there is its amplitude.
    assert found[1.0, INF].wrench[:2] == pytest.approx([0.0, 0.0])
    assert found[1.0, INF].sigma[:2] == pytest.approx([0.0, 0.0])
    assert found[1.0, INF].amplitude[1] == pytest.approx(1.6)


def test_errors_without_a_wall_go_with_the_square_of_the_rotor_speed():
    rows = [case(1.0, INF, (3.0, 3.0, 28.0, 0.0, 0.0, 0.0)), case(1.0, 0.5, (0.0,) * 6, rpm=2000.0)]
    assert labels(rows, 2000.0, KIND)[1.0, 0.5].sigma[0] == pytest.approx(0.75)


def test_the_mean_of_iterations_is_judged_by_cases_that_were_then_marched():
    """Iterations that missed the lift in time by 0.9 N make others doubtful; the marched case keeps its own error."""
    far = (0.0, 0.0, 26.9, 0.0, 0.0, 0.0)
    rows = [
        marched(1.5, 0.5, (0.0, 0.0, 26.0, 0.0, 0.0, 0.0), far),
        case(1.5, 1.0, (0.0, 0.0, 26.5, 0.0, 0.0, 0.0)),
    ]
    found = labels(rows, 4000.0, KIND)
    assert found[1.5, 1.0].sigma[2] == pytest.approx(math.sqrt(0.9**2 - 0.03**2))
    assert found[1.5, 0.5].sigma[2] == pytest.approx(0.03)


def test_side_force_and_tilt_count_over_both_directions():
    """Which way the flow tips is chance: a case whose x component happens to be small is no better for it."""
    learnt = MeanError([case(1.0, INF, (0.0, 2.0, 28.0, 0.1, 0.0, 0.0))])
    error = learnt.of(case(1.0, 0.5, (0.0,) * 6))
    assert error[:2] == pytest.approx([math.sqrt(2.0)] * 2)
    assert error[3:5] == pytest.approx([0.1 / math.sqrt(2.0)] * 2)


def test_stated_errors_that_hold_are_not_raised():
    rng = np.random.default_rng(4)
    own = np.array(SWING)
    rows = [
        marched(h, 0.5, tuple(np.zeros(6)), tuple(0.3 * own * rng.normal(size=6)))
        for h in (1.0, 1.25, 1.5, 2.0, 3.0)
    ]
    for h in (1.0, 1.5, 3.0):
        assert MeanError(rows).of(case(h, 1.0, (0.0,) * 6)) == pytest.approx(own)


def test_what_doubtful_full_models_miss_does_not_count_against_half_models_far_from_the_wall():
    """Differences that are all noise of the stated size, large below 2 R: no correction, and an error that fades."""
    rng = np.random.default_rng(6)
    places = [(h, d) for h in (1.0, 1.5, 2.0, 3.0, 4.0) for d in (0.15, 0.5, 1.0, 2.0, 5.0)]
    error = {FREE: np.zeros(6)} | {p: np.full(6, 2.0 if p[0] < 2.0 else 0.05) for p in places}
    noise = {FREE: np.zeros(6)} | {p: error[p] * rng.normal(size=6) for p in places}
    half = dict.fromkeys(noise, Label(*[np.zeros(6)] * 4, "steady", 1))
    full = {p: replace(half[p], wrench=noise[p], sigma=error[p]) for p in noise}
    found = fidelity.learn(full, half)
    assert not found.learnt.any()
    plain = math.sqrt(np.mean(found.change[:, 0] ** 2))
    assert plain > 1.0
    beside, far = found.error_at((1.0, 0.15)), found.error_at((1.0, 5.0))
    assert far[0] < beside[0] < plain
    assert far[0] < 0.5
    assert found.error_at((1.0, INF))[[0, 1, 3, 4]] == pytest.approx(np.zeros(4))
