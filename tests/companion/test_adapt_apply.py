"""What is believed becomes a share of the model and something measured beside: bounded and slow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.adaptation import apply
from companion.adaptation.apply import Applied, share_of, towards
from companion.adaptation.near_map import CELLS, NOTHING, NearField
from companion.adaptation.words import sentence
from companion.disturbance.about_cg import about_cg
from companion.disturbance.records import FanPlaces
from companion.vehicles import default_vehicle

TANDEM = default_vehicle()
AROUND = FanPlaces((1.3, 1.4), (0.7, 0.8), (22.0, 23.0), 1.2)
ABOVE = [[0.5, 0.03, 1.3, 0.02, 0.3, 0.01], [0.7, -0.02, 1.8, -0.01, 0.2, 0.0]]
"""What the model says of ground and wall at each fan, corner frame."""
AHEAD = about_cg(TANDEM, ABOVE, AROUND.bearing_rad)
NO_EFFECTS = np.zeros((0, 6))


def test_a_sure_size_is_compensated_as_it_is_and_an_unsure_one_less():
    assert share_of(1.0, 0.0) == 1.0
    assert share_of(1.0, 0.3) == pytest.approx(1.0 / 1.09)
    shares = [share_of(1.0, sd) for sd in (0.0, 0.1, 0.3, 1.0, 3.0)]
    assert shares == sorted(shares, reverse=True)


def test_a_contradicted_effect_is_not_compensated_at_all():
    assert share_of(-0.9, 0.1) == 0.0
    assert share_of(0.0, 0.1) == 0.0
    assert share_of(0.2, 0.03) < 0.05
    assert share_of(9.0, 0.0) == apply.MOST


def change(applied: Applied, effects: np.ndarray = NO_EFFECTS) -> np.ndarray:
    """What is compensated minus what is modelled."""
    return applied.compensated(TANDEM, ABOVE, AROUND, effects) - np.sum(AHEAD, axis=0)


def near(size: float) -> NearField:
    return NearField(size, (0.3 * size,) * CELLS, (0.1 * size,) * CELLS, (0.2 * size,) * CELLS)


def test_as_modelled_changes_nothing_and_shares_scale_each_part():
    assert change(Applied((1.0, 1.0, 1.0))) == pytest.approx(np.zeros(6), abs=1e-12)
    halved = np.array(change(Applied((0.5, 1.0, 0.0))))
    assert halved == pytest.approx(-0.5 * np.array(AHEAD[0]) - np.array(AHEAD[2]))


def test_what_is_measured_comes_beside_the_model():
    rows = np.array(near(0.5).rows(TANDEM, AROUND))
    assert rows[0, 2] < 0.0  # lift is negative down
    assert rows[1] @ np.array(AHEAD[1]) > 0.0 or rows[1, :2].any()
    assert change(Applied((1.0, 1.0, 1.0), near(0.5))) == pytest.approx(rows.sum(axis=0))


def test_an_adopted_effect_follows_its_own_share():
    effects = np.arange(6.0).reshape(1, 6)
    applied = Applied((1.0, 1.0, 1.0, 0.25))
    assert change(applied, effects=effects) == pytest.approx(-0.75 * effects[0])


def test_shares_and_what_is_measured_grow_slowly_and_shares_fade_like_other_offsets():
    now, wanted, seconds = Applied((0.0,) * 3), Applied((1.0,) * 3, near(1.0)), 0.0
    while now.shares[0] < 1.0:
        now, seconds = towards(now, wanted, 0.2), seconds + 0.2
    assert seconds == pytest.approx(4.0)
    assert now.near.lift[0] == pytest.approx(4.0 * apply._MAP_1_S)
    assert now.near.ground == pytest.approx(4.0 * apply.GIVE_1_S)
    faded = towards(Applied((1.0,) * 3), replace(wanted, shares=(0.0,) * 3, near=NOTHING), 0.2)
    assert faded.shares[0] == pytest.approx(0.8)
    close = towards(Applied((0.5,) * 3), Applied((0.52,) * 3), 0.2)
    assert close.shares == (0.52,) * 3


def test_the_pilot_reads_which_effect_and_what_is_done():
    assert (
        sentence("ground_lift", 0.2, 0.18)
        == "ground lift measured 0.2 of the model's: compensating with that"
    )
    assert (
        sentence("wall_pull", -0.7, 0.0)
        == "wall pull measured -0.7 of the model's: not compensating it"
    )
    assert (
        sentence("wall_tilt", 2.4, 1.5)
        == "wall tilt measured 2.4 of the model's: compensating with 1.5"
    )
