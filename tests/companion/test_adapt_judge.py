"""With the model or without it: the odds follow what each predicts, and the map holds what no model explains."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from companion.adaptation import judge
from companion.adaptation import sizes as at
from companion.adaptation.apply import MOST
from companion.adaptation.channel import Channel, channels_of, place_of, rows
from companion.adaptation.judge import Belief, believed, learn
from companion.adaptation.learn import _ALIKE
from companion.adaptation.near_map import (
    CELLS,
    GAPS,
    HEIGHTS,
    MAP,
    NOTHING,
    NearField,
    cheeseman_bennett,
)  # fmt: skip
from companion.adaptation.sizes import size_table
from companion.disturbance.records import FanPlaces
from companion.vehicles import default_vehicle
from models import load
from models.corner_law import ClosedForm

TANDEM = default_vehicle()
RADIUS_M = TANDEM.rotor_radius_m
TABLE = size_table(TANDEM, load())
CHANNELS = channels_of(TABLE)
THRUST_N = 22.5
SIGMA_N = 0.3
Law = Callable[[float, float], float]
"""Share of a fan's thrust over height and gap in radii."""


def ground(height: float, _: float) -> float:
    return 0.1 * math.exp(1.0 - height)


def around(height: float, gap: float, bearing: float = 0.0) -> FanPlaces:
    return FanPlaces((height,) * 2, (gap,) * 2, (THRUST_N,) * 2, bearing)


def flown(channel: Channel, true: Law, model: Law, approaches: int = 3, seed: int = 1) -> Belief:
    """In free air, down to 1.2 radii at half a radius from a wall ahead, a while there, up again; so many times."""
    random, told = np.random.default_rng(seed), judge.initial(channel)
    low = [*np.geomspace(5.0, 1.2, 30), *[1.2] * 20, *np.geomspace(1.2, 5.0, 15)]
    for height in ([math.inf] * 40 + low) * approaches:
        regressors = np.zeros((5, len(TABLE)))
        fans = 2.0 * THRUST_N * np.array([1.0, 0.0, -1.0, 0.0, -RADIUS_M])
        gap = 0.5 if height < 9.0 else math.inf
        regressors[:, channel.own] = [
            f * model(height, gap) if a in channel.axes else 0.0 for a, f in enumerate(fans)
        ]
        regressors[2, at.THRUST], regressors[2, at.INFLOW] = -2.0 * THRUST_N, 0.0
        seen = []
        for axis, row in zip(
            channel.axes,
            rows(channel, regressors, place_of(around(height, gap)), RADIUS_M),
            strict=True,
        ):
            sd = SIGMA_N * (RADIUS_M if axis > 2 else 1.0)
            seen.append(
                (fans[axis] * true(height, gap) + sd * random.normal(), row, _ALIKE * sd**2)
            )
        told = learn(channel, told, 0.2, seen)
    return told


def compensated(channel: Channel, told: Belief, model: Law, height: float) -> float:
    """Share of the thrust."""
    gain, form, cell = believed(channel, told)
    there = sum(weight * cell[k] for k, weight in MAP.cells(height, 0.5))
    return gain * model(height, 0.5) + form * cheeseman_bennett(height) + there


@pytest.mark.parametrize("name", ["lift", "tilt"])
@pytest.mark.parametrize(
    ("model", "right"),
    [
        (ground, True),
        (lambda h, d: 0.8 * ground(h, d), True),
        (lambda h, d: -ground(h, d), False),
        (lambda h, _: 0.2 / (1.0 + (h - 2.5) ** 2), False),
    ],
)  # fmt: skip
def test_a_model_is_believed_where_it_predicts_and_what_is_compensated_is_right_in_any_case(
    name, model, right
):
    channel = CHANNELS[("lift", "pull", "tilt").index(name)]
    told = flown(channel, ground, model)
    assert (told.probability > 0.5) == right
    for height in (1.2, 1.5, 2.0):
        assert compensated(channel, told, model, height) == pytest.approx(
            ground(height, 0.5), abs=0.012
        )


def test_a_right_model_loses_next_to_nothing_in_its_first_approach():
    told = flown(CHANNELS[0], ground, ground, approaches=1)
    assert told.probability > 0.9
    assert compensated(CHANNELS[0], told, ground, 1.2) == pytest.approx(ground(1.2, 0.5), rel=0.1)


def test_a_model_that_is_right_but_for_its_size_is_measured():
    told = flown(CHANNELS[2], ground, lambda h, d: 3.0 * ground(h, d))
    assert told.mean[0, CHANNELS[2].gain] == pytest.approx(1.0 / 3.0, abs=0.05)


def test_the_gain_on_the_model_stays_within_its_bounds():
    for model in (lambda h, d: -ground(h, d), lambda h, d: 0.2 * ground(h, d)):
        told = flown(CHANNELS[0], ground, model)
        assert 0.0 <= told.mean[0, CHANNELS[0].gain] <= MOST
    assert abs(told.log_odds) <= judge._MOST_LOG_ODDS


def test_a_load_is_no_ground_effect():
    """Picked up while low: after a second of surprise it is taken for less thrust, not for less lift of the ground."""
    channel, told = CHANNELS[0], flown(CHANNELS[0], ground, ground)
    before = compensated(channel, told, ground, 1.2)
    regressors = np.zeros((5, len(TABLE)))
    regressors[2, at.LIFT], regressors[2, at.THRUST] = (
        -2.0 * THRUST_N * ground(1.2, 0.5),
        -2.0 * THRUST_N,
    )
    (row,) = rows(channel, regressors, place_of(around(1.2, 0.5)), RADIUS_M)
    for _ in range(100):
        value = regressors[2, at.LIFT] + 4.0
        told = learn(channel, told, 0.2, [(value, row, _ALIKE * SIGMA_N**2)])
    assert told.mean[0, 0] == pytest.approx(-4.0 / (2.0 * THRUST_N), abs=0.03)
    assert abs(compensated(channel, told, ground, 1.2) - before) < 0.4 * 4.0 / (2.0 * THRUST_N)


def test_what_is_not_a_number_tells_nothing():
    told = judge.initial(CHANNELS[2])
    row = np.ones(CHANNELS[2].mean.shape[1])
    after = learn(CHANNELS[2], told, 0.2, [(math.nan, row, 0.1), (1.0, row, math.nan)])
    assert np.array_equal(after.mean, told.mean)
    assert after.log_odds == told.log_odds


def test_no_covariance_grows_beyond_the_prior_and_none_loses_its_sign():
    told = flown(CHANNELS[0], ground, ground)
    for _ in range(3000):
        told = learn(CHANNELS[0], told, 1.0, [(math.nan, CHANNELS[0].mean[0], 1.0)])
    for found, first in zip(told.covariance, CHANNELS[0].covariance, strict=True):
        assert (np.diagonal(found) <= np.diagonal(first) * (1.0 + 1e-9) + 1e-15).all()
        assert np.linalg.eigvalsh(found).min() > -1e-9


def test_nothing_is_changed_in_place():
    told = flown(CHANNELS[1], ground, ground, approaches=1)
    mean, covariance = told.mean.copy(), told.covariance.copy()
    row = np.ones(mean.shape[1])
    learn(CHANNELS[1], told, 0.2, [(1.0, row, 0.1), (2.0, row, 0.1)])
    assert np.array_equal(mean, told.mean)
    assert np.array_equal(covariance, told.covariance)


def test_cells_interpolate_and_add_up_to_one():
    for height, gap in (
        (0.3, 0.1),
        (1.3, 0.9),
        (HEIGHTS[2], GAPS[1]),
        (9.0, 0.5),
        (math.inf, math.inf),
    ):
        found = MAP.cells(height, gap)
        assert sum(weight for _, weight in found) == pytest.approx(1.0)
        assert all(0 <= k < CELLS and weight >= 0.0 for k, weight in found)
    assert dict(MAP.cells(HEIGHTS[2], GAPS[1]))[2 * len(GAPS) + 1] == pytest.approx(1.0)


def test_the_prior_is_a_covariance_that_ends_with_the_surroundings():
    lift, pull = MAP.covariance(0.05, of_wall=False), MAP.covariance(0.05, of_wall=True)
    assert np.linalg.eigvalsh(lift).min() > -1e-12
    assert lift[-1, -1] == 0.0
    assert np.diagonal(pull).reshape(len(HEIGHTS), len(GAPS))[:, -1].max() == 0.0
    assert np.sqrt(np.diagonal(lift).max()) == pytest.approx(0.05)


def test_cheeseman_and_bennett():
    assert 1.0 + cheeseman_bennett(1.0) == pytest.approx(1.0 / (1.0 - 1.0 / 16.0))
    assert cheeseman_bennett(0.0) == cheeseman_bennett(0.5)
    assert cheeseman_bennett(4.0) == 0.0


def test_the_map_turns_with_the_wall():
    """A wall to the right draws to the right and tilts to the right, as the surrogate's corner frame has it."""
    near = NearField(0.0, NOTHING.lift, (0.1,) * CELLS, (0.1,) * CELLS)
    rows_right = np.array(near.rows(TANDEM, around(9.0, 0.5, math.pi / 2)))
    assert rows_right[1, 1] == pytest.approx(0.2 * THRUST_N)
    assert rows_right[2, 3] == pytest.approx(0.2 * THRUST_N * RADIUS_M)
    law = ClosedForm()
    assert law.wrench(9.9, 0.05, 4000.0)[0] > 0.0
    assert law.wrench(9.9, 0.05, 4000.0)[4] > 0.0
    assert near.pull_change_n(around(9.0, 0.5), 0.1) == pytest.approx(0.0)
    assert NOTHING.rows(TANDEM, around(9.0, 9.0)) == [[0.0] * 6] * 3


def test_the_maps_pull_counts_among_what_may_eat_the_damping():
    """As much as the map itself changes over the step: what the bound on delayed feed-forward is told."""
    by_gap = (0.1, 0.05, 0.01, 0.0) * len(HEIGHTS)
    near = NearField(0.0, NOTHING.lift, by_gap, NOTHING.tilt)
    here, further = around(1.2, 0.5), around(1.2, 0.6)
    expected = sum(
        t * (near.at_fan(h, d)[1] - near.at_fan(h, e)[1])
        for t, h, d, e in zip(here.free_lift_n, here.heights, here.gaps, further.gaps, strict=True)
    )
    assert near.pull_change_n(here, 0.1) == pytest.approx(expected)
    assert expected > 0.0
    assert NOTHING.pull_change_n(here, 0.1) == 0.0
