"""The shipped surrogate as a caller sees it: exactness where physics is exact, shapes, spread, trust, speed paths."""

from __future__ import annotations

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import models
from models.corner_law import ClosedForm
from models.surrogate.fan_surrogate import FanSurrogate

INF = float("inf")
NAN = float("nan")


@pytest.fixture(scope="module")
def model() -> FanSurrogate:
    return models.load()


def test_it_answers_close_to_the_closed_form_it_was_trained_on(model: FanSurrogate) -> None:
    rng = np.random.default_rng(0)
    h, d, rpm = (
        rng.uniform(0.08, 0.8, 2000),
        rng.uniform(0.03, 0.7, 2000),
        rng.uniform(2600, 5500, 2000),
    )
    truth, lift = ClosedForm().wrench(h, d, rpm), ClosedForm().lift(rpm)[:, None]
    free = np.array([0, 0, 1, 0, 0, 0])
    y, answer = truth / lift - free, model.wrench(h, d, rpm) / lift - free
    r2 = 1 - ((y - answer) ** 2).sum(0) / ((y - y.mean(0)) ** 2).sum(0)
    assert r2.min() > 0.99


def test_it_says_that_it_is_not_cfd(model: FanSurrogate) -> None:
    assert model.info["fidelity"] == {"level": 0, "label": "closed form, not CFD"}
    assert model.effects == ()


@settings(deadline=None)
@given(
    h=st.floats(0.67, 50) | st.just(INF),
    d=st.floats(0.67, 50) | st.just(INF),
    rpm=st.floats(0, 8000),
)
def test_far_from_everything_the_disturbance_is_exactly_zero(
    h: float, d: float, rpm: float
) -> None:
    model = models.load()
    np.testing.assert_array_equal(model.wrench(h, d, rpm), model.wrench(INF, INF, rpm))
    np.testing.assert_array_equal(
        model.wrench(np.array([h]), d, rpm), model.wrench(np.array([INF]), INF, rpm)
    )


@settings(deadline=None)
@given(h=st.floats(0.0, 5.0), rpm=st.floats(1000, 6000))
def test_without_a_wall_no_direction_is_preferred(h: float, rpm: float) -> None:
    w = models.load().wrench(h, INF, rpm)
    assert np.all(w[[0, 1, 3, 4]] == 0.0)


def test_free_air_is_the_wrench_at_infinity(model: FanSurrogate) -> None:
    rpm = np.array([2000.0, 4000.0, 6000.0])
    np.testing.assert_allclose(model.free_air(rpm), model.wrench(INF, INF, rpm), rtol=1e-14)
    np.testing.assert_allclose(model.free_air(rpm)[:, 2], ClosedForm().lift(rpm), rtol=1e-9)


def test_at_rest_the_wrench_is_zero(model: FanSurrogate) -> None:
    assert np.all(model.wrench(0.1, 0.1, 0.0) == 0.0)
    assert np.all(model.wrench(np.array([0.1, INF]), 0.1, 0.0) == 0.0)


@pytest.mark.parametrize("point", [(NAN, 0.2, 4000.0), (0.2, NAN, 4000.0), (0.2, 0.2, NAN), (-0.1, 0.2, 4000.0),
                                   (0.2, -0.1, 4000.0), (0.2, 0.2, -1.0), (0.2, 0.2, INF)])  # fmt: skip
def test_nonsense_in_gives_nan_and_no_trust(
    model: FanSurrogate, point: tuple[float, float, float]
) -> None:
    for answer in (model.query(*point), model.query(*(np.array([v]) for v in point))):
        assert np.all(np.isnan(answer.wrench))
        assert np.all(np.isnan(answer.sigma))
        assert np.all(np.asarray(answer.trust) == 0.0)


def test_a_nan_does_not_reach_its_neighbours(model: FanSurrogate) -> None:
    h = np.array([0.2, NAN, 0.3])
    w = model.wrench(h, 0.2, 4000.0)
    np.testing.assert_allclose(w[[0, 2]], model.wrench(h[[0, 2]], 0.2, 4000.0), rtol=1e-12)


def test_shapes_broadcast(model: FanSurrogate) -> None:
    answer = model.query(np.full((3, 1), 0.2), np.array([0.1, INF]), 4000.0)
    assert answer.wrench.shape == (3, 2, 6)
    assert answer.sigma.shape == (3, 2, 6)
    assert answer.trust.shape == (3, 2)
    assert model.wrench(1, 1, 4000).shape == (6,)
    assert model.wrench(np.zeros((0,)), 1.0, 4000.0).shape == (0, 6)


@settings(max_examples=200, deadline=None)
@given(h=st.floats(0.0, 2.0), d=st.floats(0.0, 2.0), rpm=st.floats(0.0, 9000.0))
def test_one_point_and_many_give_the_same_answer(h: float, d: float, rpm: float) -> None:
    model = models.load()
    one, many = model.query(h, d, rpm), model.query(np.full(20, h), d, rpm)
    few = model.query(np.full(2, h), d, rpm)
    for answer in (few, many):
        np.testing.assert_allclose(one.wrench, answer.wrench[0], rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(one.sigma, answer.sigma[0], rtol=1e-7, atol=1e-12)
        np.testing.assert_allclose(one.trust, answer.trust[0], rtol=1e-7, atol=1e-12)


def test_answers_do_not_change_when_the_next_is_asked(model: FanSurrogate) -> None:
    first = model.query(0.2, 0.1, 4000.0)
    kept = first.wrench.copy(), first.sigma.copy()
    model.query(0.4, 0.3, 3000.0)
    np.testing.assert_array_equal(first.wrench, kept[0])
    np.testing.assert_array_equal(first.sigma, kept[1])


def test_trust_is_whole_inside_and_gone_far_outside(model: FanSurrogate) -> None:
    rng = np.random.default_rng(1)
    inside = model.trust(
        rng.uniform(0.06, 0.8, 500), rng.uniform(0.02, 0.7, 500), rng.uniform(2600, 5500, 500)
    )
    assert inside.min() > 0.9
    assert inside.max() <= 1.0
    assert model.trust(INF, INF, 4000.0) > 0.9
    for outside in (
        (0.01, 0.2, 4000.0),
        (0.2, 0.001, 4000.0),
        (0.2, 0.2, 1000.0),
        (0.2, 0.2, 9000.0),
        (0.2, 0.2, 0.0),
    ):
        assert model.trust(*outside) == 0.0


def test_curvature_along_a_path_is_the_laws_own(model: FanSurrogate) -> None:
    """No artificial waves between data: second differences of lift and tilt stay near those of the law."""
    path = np.linspace(0.07, 0.62, 400)
    for h, d in ((path, 0.1), (path, INF), (0.2, path), (INF, path)):
        truth, answer = ClosedForm().wrench(h, d, 4000.0), model.wrench(h, d, 4000.0)
        for c in (2, 4):
            rough, own = (np.sqrt(np.mean(np.diff(w[:, c], 2) ** 2)) for w in (answer, truth))
            assert rough <= 1.5 * own + 1e-9


def test_loading_and_asking_needs_no_torch_and_no_scipy() -> None:
    code = (
        "import sys, models; models.load().query(0.2, 0.1, 4000.0); "
        "sys.exit(any(name in sys.modules for name in ('torch', 'scipy', 'sklearn', 'matplotlib')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_importing_the_package_costs_nothing_and_its_names_are_there() -> None:
    code = (
        "import sys, models; assert 'numpy' not in sys.modules; assert 'load' in dir(models); "
        "from models import *; assert load is models.load and save_model; "
        "assert not hasattr(models, 'nothing')"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_threads_may_share_a_model(model: FanSurrogate) -> None:
    heights = np.linspace(0.05, 0.6, 400)
    alone = [model.wrench(h, 0.1, 4000.0) for h in heights.tolist()]
    with ThreadPoolExecutor(8) as pool:
        shared = list(pool.map(lambda h: model.wrench(h, 0.1, 4000.0), heights.tolist()))
    np.testing.assert_array_equal(shared, alone)
