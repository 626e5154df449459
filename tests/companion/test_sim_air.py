from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.sim.air import NOMINAL, Unsteadiness, disturbed, increments, surrogate_error

PAPER_CT = 0.0450661

# (h/r, d/r): lift ratio, C_My x 1000, side force at 4000 rpm [N] of the published tables of the law
TABLE = [
    (1.0, 0.2, 1.0788, 2.947, 0.063),
    (1.0, 5.0, 1.0962, 0.0, 0.0),
    (1.5, 0.2, 0.9999, 3.942, 0.067),
    (2.5, 1.5, 0.9890, 0.932, -0.014),
    (5.0, 0.5, 1.0103, 1.716, 0.285),
    (3.0, 3.0, 1.0004, 0.185, -0.017),
]


@pytest.mark.parametrize(("eta", "delta", "lift", "c_my", "side"), TABLE)
def test_nominal_law_agrees_with_its_published_table(eta, delta, lift, c_my, side):
    i = increments(NOMINAL, eta, delta)
    assert 1.0 + i.z == pytest.approx(lift, abs=6e-5)
    assert 1000.0 * i.my * PAPER_CT == pytest.approx(c_my, abs=6e-4)
    assert 22.555 * i.x == pytest.approx(side, abs=6e-4)


@given(st.floats(4.0, 100.0), st.floats(3.8, 100.0))
def test_nothing_is_added_beyond_the_cut_offs(eta, delta):
    i = increments(NOMINAL, eta, delta)
    assert (i.x, i.y, i.z, i.mx, i.my, i.mz) == (0.0,) * 6
    assert i.rms == NOMINAL.rms_free


@given(st.floats(0.0, 10.0), st.floats(0.0, 10.0))
def test_increments_are_finite_and_small(eta, delta):
    i = increments(NOMINAL, eta, delta)
    assert all(math.isfinite(v) for v in (i.x, i.y, i.z, i.mx, i.my, i.mz, i.rms))
    assert abs(i.z) < 0.4
    assert i.rms >= NOMINAL.rms_free


def test_a_seed_draws_one_law_and_another_seed_another():
    assert disturbed(4) == disturbed(4)
    assert disturbed(4) != disturbed(5)


@pytest.mark.parametrize("seed", range(10))
def test_undisturbed_law_is_wrong_by_ten_to_thirty_percent(seed):
    wrong = surrogate_error(disturbed(seed))
    assert 0.10 <= wrong.lift <= 0.30
    assert 0.10 <= wrong.tilt <= 0.30
    assert wrong.pull <= 0.40


def test_unsteadiness_has_unit_variance_and_repeats_with_its_seed():
    a, b = Unsteadiness("x", 2, 0.01), Unsteadiness("x", 2, 0.01)
    values = [v for _ in range(20000) for v in a.step()]
    assert sum(v * v for v in values) / len(values) == pytest.approx(1.0, abs=0.15)
    assert sum(values) / len(values) == pytest.approx(0.0, abs=0.1)
    assert values[:2] == b.step()
