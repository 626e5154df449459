"""The walk over sets: it finds what was put in, keeps every set that it weighed, and their probabilities are shares."""

from __future__ import annotations

import pytest
from made_up import biased, some

from replay.search.sets import Walked
from replay.search.walk import walk

EFFECTS = ("imu_bias", "rotor_drag")


@pytest.fixture(scope="module")
def walked() -> Walked:
    return walk([biased()], some(*EFFECTS))


def names(fit: object) -> set[str]:
    return {t.name for t in fit.terms if t.effect is not None}  # type: ignore[attr-defined]


def test_the_best_set_is_what_was_put_in(walked: Walked) -> None:
    assert names(walked.best) == {"imu_bias"}


def test_nothing_is_found_in_noise() -> None:
    assert names(walk([biased(bias=0.0)], some(*EFFECTS)).best) == set()


def test_every_set_is_known_by_its_keys_and_none_is_likelier_than_the_first(walked: Walked) -> None:
    assert all(fit.key == key for key, fit in walked.fits.items())
    assert frozenset() in walked.fits
    scores = [round(fit.score, 6) for fit in walked.ranked()]
    assert scores == sorted(scores, reverse=True)


def test_probabilities_are_shares_of_all_sets(walked: Walked) -> None:
    weights = [w for _, w in walked.weighted()]
    assert 0.99 < sum(weights) <= 1.0 + 1e-12
    assert walked.probability("imu_bias", ()) > 0.99
    assert walked.probability("rotor_drag", ()) == pytest.approx(
        sum(w for fit, w in walked.weighted() if "rotor_drag" in names(fit)), abs=6e-4
    )


def test_a_set_less_one_term_is_weighed_anew_and_what_is_likelier_is_gone(walked: Walked) -> None:
    (bias,) = walked.best.terms
    less = walked.without(bias.key)
    assert names(less.best) == set()
    cut = less.at_most(less.best)
    assert max(fit.score for fit in cut.fits.values()) == less.best.score
    assert walked.best.key not in cut.fits


def test_why_an_effect_is_not_named_is_said(walked: Walked) -> None:
    assert walked.why_not("no such effect") == "no better than chance"
    assert walked.why_not("rotor_drag") in {
        "no better than chance", "too small beside the other effects", "the other effects fit as well without it",
        "not likely together with the other effects",
    }  # fmt: skip
