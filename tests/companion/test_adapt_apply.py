"""What is believed becomes a share of the model: less where little is known, bounded, slow."""

from __future__ import annotations

import pytest

from companion.adaptation.apply import share_of, towards, wanted_shares
from companion.adaptation.options import Adapt, AdaptTuning
from companion.adaptation.words import sentence

TUNING = AdaptTuning()


def test_a_sure_size_is_compensated_as_it_is_and_an_unsure_one_less():
    assert share_of(1.0, 0.0, 1.5, 0.5) == 1.0
    assert share_of(1.0, 0.3, 1.5, 0.5) == pytest.approx(1.0 / 1.09)
    shares = [share_of(1.0, sd, 1.5, 0.5) for sd in (0.0, 0.1, 0.3, 1.0, 3.0)]
    assert shares == sorted(shares, reverse=True)


def test_a_contradicted_model_is_not_compensated_at_all():
    assert share_of(-0.9, 0.1, 1.5, 0.5) == 0.0
    assert share_of(0.0, 0.1, 1.5, 0.5) == 0.0
    assert share_of(0.2, 0.03, 1.5, 0.5) < 0.05
    assert share_of(9.0, 0.0, 1.5, 0.0) == 1.5


@pytest.mark.parametrize("adapt", [Adapt.GATE, Adapt.FULL])
def test_without_evidence_nothing_changes(adapt):
    assert wanted_shares(adapt, (0.4, 1.3), (0.3, 0.3), (False, False), TUNING) == (1.0, 1.0)


def test_gate_only_takes_away():
    values, sds, seen = (0.8, 1.3), (0.02, 0.02), (True, True)
    gate = wanted_shares(Adapt.GATE, values, sds, seen, TUNING)
    full = wanted_shares(Adapt.FULL, values, sds, seen, TUNING)
    assert gate[0] == full[0] < 1.0
    assert gate[1] == 1.0 < full[1] <= TUNING.most


def test_shares_grow_slowly_and_fade_like_other_offsets():
    shares, seconds = (0.0,), 0.0
    while shares[0] < 1.0:
        shares, seconds = towards(shares, (1.0,), 0.2, TUNING), seconds + 0.2
    assert seconds == pytest.approx(4.0)
    assert towards((1.0,), (0.0,), 0.2, TUNING)[0] == pytest.approx(0.8)
    assert towards((0.5,), (0.52,), 0.2, TUNING) == (0.52,)


def test_the_pilot_reads_which_effect_and_what_is_done():
    assert sentence("ground_lift", 0.2, 0.18) == "ground lift measured 0.2 of the model's: compensating with that"
    assert sentence("wall_pull", -0.7, 0.0) == "wall pull measured -0.7 of the model's: not compensating it"
    assert sentence("wall_tilt", 2.4, 1.5) == "wall tilt measured 2.4 of the model's: compensating with 1.5"
