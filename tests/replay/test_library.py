"""Terms of some flights: which effects a flight can show, in which shapes, and what a coefficient does there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_up import biased, some

from models.effects import get
from replay.search.library import Library
from replay.search.terms import regressors_of, without_form

NAMES = ("imu_bias", "wind", "ceiling")


@pytest.fixture(scope="module")
def library() -> Library:
    return Library([biased()], some(*NAMES))


def test_what_a_flight_cannot_show_is_lacking_with_its_reason(library: Library) -> None:
    assert library.lacking == {"ceiling": get("ceiling").lacking(library.records[0].context)}
    assert {t.name for t in library.terms if t.effect is not None} == {"imu_bias", "wind"}


def test_an_effect_of_forces_is_not_tried_where_no_force_is_judged() -> None:
    moments = replace(biased(), axes=(3, 4, 5))
    assert "cannot judge the force" in Library([moments], some("imu_bias")).lacking["imu_bias"]


def test_every_shape_is_a_term_and_shares_one_prior(library: Library) -> None:
    wind = get("wind")
    terms = [t for t in library.terms if t.name == "wind"]
    assert [t.shape for t in terms] == list(wind.shape_grid(library.records[0].context))
    assert {t.key for t in terms} == {("wind", terms[0].flight, None, 1)}
    assert [library.terms[i] for i in library.numbers_of[terms[0].key]] == terms


def test_columns_of_different_terms_are_their_own(library: Library) -> None:
    every = np.concatenate([t.columns for t in library.terms])
    assert len(set(every.tolist())) == len(every) == library.size - len(library.trim)


def test_a_coefficient_does_what_the_catalogue_says(library: Library) -> None:
    term = next(t for t in library.terms if t.name == "imu_bias")
    own, form = library.wrenches(term, 0)
    np.testing.assert_allclose(own, regressors_of(get("imu_bias"), library.records[0], ()))
    assert form.shape[2] == int(term.form.sum())


def test_between_two_shapes_lies_one_more_and_it_is_taken_in_once() -> None:
    library = Library([biased()], some("wind"))
    term = next(t for t in library.terms if t.shape == (0.5,))
    assert [t.shape for t in library.finer(term, 0.5)] == [(0.375,), (0.625,)]
    assert library.finer(term, 0.0) == []


def test_a_term_without_its_errors_of_form_has_none_of_their_wrenches() -> None:
    """A map of surfaces stands for them."""
    library = Library([biased()], some("rotor_drag"))
    term = next(t for t in library.terms if t.form.any())
    _, with_form = library.wrenches(term, 0)
    _, none = library.wrenches(without_form(term), 0)
    assert with_form.shape[2] == term.form.sum()
    assert none.shape[2] == 0
