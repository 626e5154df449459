"""The walk over sets: it finds what was put in, keeps every set that it weighed, and their probabilities are shares."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_up import biased, some

from models.effects import get
from replay.diagnosis.diagnose import conclude
from replay.residual.record import Record
from replay.search import walk as walk_module
from replay.search.channel import hundredths
from replay.search.evidence import Evidence
from replay.search.library import Library
from replay.search.posterior import Sets, Walked
from replay.search.thresholds import HOPELESS
from replay.search.walk import LONG_S, MOST_WORK, additions, walk, with_aliases

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


def with_effect(record: Record, name: str, weight_percent: float) -> Record:
    """With an effect that is so large at most (99th percentile)."""
    effect = get(name)
    shape = effect.shape_grid(record.context)[0]
    does = np.nan_to_num(effect.regressors(record.context, shape))[..., 0]
    largest = np.percentile(np.abs(does[record.valid]), 99.0, axis=0).max()
    unit = float(hundredths(record.context)[0])
    return replace(record, residual=record.residual + weight_percent * unit / largest * does)


def test_what_is_too_small_for_a_name_takes_no_place_among_what_is_tried() -> None:
    record = biased(seconds=120.0, bias=0.0)
    record = replace(record, residual=0.3 * record.residual)
    record = with_effect(record, "rotor_drag", 0.4)
    record = with_effect(record, "thrust_scale", 1.3)
    evidence = Evidence(Library([record], some("rotor_drag", "thrust_scale")))
    empty = evidence.fit([], evidence.noises.unfitted)
    _, surest = evidence.promising(empty, range(len(evidence.library.terms)))[0]
    assert surest.name == "rotor_drag"
    assert evidence.stands_out(empty, surest) < HOPELESS
    (tried,) = {t.name for t in additions(Sets(evidence, {empty.key: empty}), empty, 1)}
    assert tried == "thrust_scale"


def test_probabilities_are_shares_of_all_sets(walked: Walked) -> None:
    weights = [w for _, w in walked.weighted()]
    assert 0.99 < sum(weights) <= 1.0 + 1e-12
    assert walked.probability("imu_bias", ()) > 0.99
    assert walked.probability("rotor_drag", ()) == pytest.approx(
        sum(w for fit, w in walked.weighted() if "rotor_drag" in names(fit)), abs=6e-4
    )


def test_a_set_less_one_term_is_weighed_anew_and_what_is_likelier_is_gone(walked: Walked) -> None:
    (bias,) = walked.best.terms
    less = walked.without([bias.key], "it does harm")
    assert names(less.best) == set()
    cut = less.at_most(less.best)
    assert max(fit.score for fit in cut.fits.values()) == less.best.score
    assert walked.best.key not in cut.fits


def test_aliases_of_the_best_set_are_weighed_in_its_place_but_for_what_was_taken_out() -> None:
    """A scale of the thrust was named alone where a load was as likely: no set with it had been weighed."""
    whole = walk([biased()], some("imu_bias", "wind"))
    without_wind = {key: fit for key, fit in whole.fits.items() if "wind" not in names(fit)}
    cut = replace(whole, fits=without_wind)
    again = with_aliases(cut)
    assert {"wind"} in [names(fit) for fit in again.fits.values()]
    assert again.best.key == whole.best.key
    taken_out = with_aliases(replace(cut, dropped={"wind": "it does harm"}))
    assert not any("wind" in names(fit) for fit in taken_out.fits.values())


def test_why_an_effect_is_not_named_is_said(walked: Walked) -> None:
    assert walked.why_not("no such effect") == "no better than chance"
    assert walked.why_not("rotor_drag") in {
        "no better than chance", "too small beside the other effects", "the other effects fit as well without it",
        "not likely together with the other effects",
    }  # fmt: skip


def test_a_search_that_would_take_too_long_stops_with_the_best_and_says_what_it_left_out(
    monkeypatch,
) -> None:
    whole = walk([biased()], some(*EFFECTS))
    assert whole.left_out == ()
    monkeypatch.setattr(walk_module, "MOST_WORK", 0.5 * whole.evidence.work)
    cut, again = (walk([biased()], some(*EFFECTS)) for _ in range(2))
    assert cut.left_out
    assert names(cut.best) == {"imu_bias"}
    assert cut.evidence.work < 0.9 * whole.evidence.work
    assert (cut.best.score, cut.left_out) == (again.best.score, again.left_out)
    (note,) = (n for n in conclude([biased()], effects=some(*EFFECTS)).notes if "left out" in n)
    assert all(what in note for what in cut.left_out)


def test_nothing_is_left_out_of_an_ordinary_search() -> None:
    answer = conclude([biased()], effects=some(*EFFECTS))
    assert answer.left_out == ()
    assert not any("left out" in note for note in answer.notes)


def test_longer_flights_and_several_logs_may_take_longer_in_proportion() -> None:
    record = biased()
    other = replace(record, path=Path("other.tlog"))
    assert walk_module.allowed([record, other]) == 2.0 * MOST_WORK
    many = [record] * (1 + int(LONG_S / record.seconds))
    short = walk_module.allowed([record])
    assert short == MOST_WORK
    assert walk_module.allowed(many) == pytest.approx(
        MOST_WORK * len(many) * record.seconds / LONG_S
    )
