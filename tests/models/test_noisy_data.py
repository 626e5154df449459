"""Few, noisy places, as a CFD campaign gives them: nothing is invented between them and nothing hidden about them."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from noisy_campaign import FAN, RPM, R, noisy_campaign

from models.common.frames import AXES, Array
from models.dataset import held_out
from models.surrogate import free_air, kriging
from models.surrogate.fan_surrogate import FanSurrogate
from models.training import compare, live_components, train
from models.training.problem import frame

INF = np.inf


@pytest.fixture(scope="module")
def trained() -> train.Trained:
    return train.train(noisy_campaign(0.01), "ensemble", 0)


def _surface(component: int, model: FanSurrogate | None = None) -> Array:
    """Shares of the lift at 4000 rpm on a grid, denser close by; the truth without ``model``."""
    t = np.linspace(0.0, 1.0, 61) ** 1.5
    h, d = np.meshgrid(R + 4 * R * t, 0.15 * R + 4.85 * R * t, indexing="ij")
    wrench = FAN.wrench(h, d, RPM) if model is None else model.wrench(h, d, RPM)
    out: Array = wrench[..., component] / FAN.lift(RPM)
    return out


def _roughness(surface: Array) -> float:
    """RMS second difference over the grid: waviness between samples."""
    return float(
        np.sqrt(
            np.mean(np.diff(surface, 2, axis=0) ** 2) + np.mean(np.diff(surface, 2, axis=1) ** 2)
        )
    )


def test_a_place_is_held_out_with_all_its_speeds_and_free_air_never() -> None:
    data = noisy_campaign()
    for seed in range(5):
        test = held_out(data, np.random.default_rng(seed))
        assert not np.any(test & data.free_air)
        assert set(data.locations[test]).isdisjoint(data.locations[~test])
        assert test.mean() == pytest.approx(0.2, abs=0.01)


def test_what_is_constant_or_noise_is_learnt_as_its_constant() -> None:
    """Fy and Mx are noise about zero, Mz noise about a constant."""
    for seed in range(3):
        data = free_air.level(noisy_campaign(seed=seed, mirrored=False))
        problem = frame(data)
        assert problem.live.tolist() == [True, False, True, False, True, False]
        assert problem.free_air.share[1] == problem.free_air.share[3] == 0.0
        lift = float(FAN.lift(RPM))
        assert problem.free_air.share[5] * lift == pytest.approx(0.1, rel=0.02)
        assert problem.free_air.scatter[1] == pytest.approx(0.005 / 3, rel=0.3)


def test_a_component_however_small_is_live_if_it_repeats() -> None:
    data = noisy_campaign(mirrored=False)
    wrench = data.wrench.copy()
    wrench[:, 1] = 1e-3 * FAN.wrench(data.h, data.d, data.rpm)[:, 0]
    assert frame(replace(data, wrench=wrench)).live[1]


def test_evidence_is_the_same_for_thousands_of_rows() -> None:
    rng = np.random.default_rng(0)
    x, place = rng.uniform(-1, 1, (4000, 3)), np.arange(4000)
    y = np.zeros((4000, 6))
    y[:, 0], y[:, 2] = rng.normal(size=4000), np.sin(2 * x[:, 0])
    y[:, 4] = 7.0
    assert live_components.live(x, y, np.ones_like(y), place).tolist() == [
        False,
        False,
        True,
        False,
        False,
        False,
    ]


def test_a_constant_component_has_no_r2_and_is_said_to_have_none() -> None:
    report = train.train(noisy_campaign(), "polynomial", 0).report
    for axis in ("Fy", "Mx", "Mz"):
        assert report["test"][axis]["r2"] is None
        assert report["increments"]["train"][axis]["r2"] is None
        assert any(note.startswith(f"{axis} does not vary") for note in report["notes"])
    assert report["test"]["Fx"]["r2"] > 0.5
    assert "NaN" not in json.dumps(report)
    with_constant = train.train(noisy_campaign(mirrored=False), "polynomial", 0).report
    assert with_constant["increments"]["test"]["Mz"]["r2"] is None
    assert with_constant["test"]["Mz"]["r2"] > 0.9, "it grows with the rotor speed"


def test_an_offset_that_no_place_lacks_is_taken_off_everywhere_and_said() -> None:
    data = noisy_campaign(0.002)
    level = free_air.level(data)
    assert any("subtracted everywhere: My" in note for note in level.notes)
    shift = (data.wrench - level.wrench)[data.rpm == RPM]
    np.testing.assert_allclose(shift[:, 4], 0.007, atol=0.002)
    assert not np.any(shift[:, [0, 1, 2, 3, 5]])
    model = train.train(data, "polynomial", 0).model
    assert np.all(model.wrench(np.array([R, 2 * R, INF]), INF, RPM)[:, [0, 1, 3, 4]] == 0.0)


def test_what_only_bare_ground_shows_sideways_is_not_believed() -> None:
    """Flow over bare ground has no preferred side; a steady solution may pick one and keep it."""
    data = noisy_campaign(0.002)
    wrench = data.wrench.copy()
    bare = np.isinf(data.d)
    wrench[bare, 0] += 0.02 * (FAN.lift(data.rpm) * np.exp(-data.h / R))[bare]
    problem = frame(free_air.level(replace(data, wrench=wrench)))
    assert problem.coordinates.axisymmetric
    assert not problem.gate[bare][:, [0, 1, 3, 4]].any()


def test_a_tilted_fan_is_no_offset() -> None:
    data = noisy_campaign(0.002)
    wrench = data.wrench.copy()
    wrench[:, 0] += 0.02 * FAN.lift(data.rpm)
    data = replace(data, wrench=wrench)
    assert not any("Fx" in note for note in free_air.level(data).notes)
    assert not frame(data).coordinates.axisymmetric
    assert free_air.fit(data).share[0] == pytest.approx(0.02, rel=0.1)


@pytest.mark.slow
def test_a_hundred_noisy_places_suffice(trained: train.Trained) -> None:
    for component, worst in ((0, 0.35), (2, 0.3), (4, 0.2)):
        truth, answer = _surface(component), _surface(component, trained.model)
        assert np.sqrt(np.mean((answer - truth) ** 2)) < worst * truth.std(), AXES[component]


@pytest.mark.slow
def test_noise_draws_no_waves_between_the_places(trained: train.Trained) -> None:
    """Artificial curvature: the net's surface is no rougher than the law it learnt from noisy samples."""
    for component in (0, 2, 4):
        own = _roughness(_surface(component))
        assert _roughness(_surface(component, trained.model)) < 1.3 * own, AXES[component]
    assert max(trained.report["decays"][axis] for axis in ("Fx", "Fz")) > 1e-6


@pytest.mark.slow
def test_kriging_does_not_take_repeated_speeds_for_certainty() -> None:
    pytest.importorskip("sklearn", reason="training extra not installed")
    data = free_air.level(noisy_campaign(0.01))
    problem = frame(data)
    one = problem.take(np.flatnonzero(data.rpm == RPM))
    for part in (problem, one):
        fitted = kriging.fit(part.x, part.y, part.gate, part.locations, 0)
        error = (part.gate * fitted.predict(part.x)[0] - part.y)[:, 2]
        assert 0.003 < np.sqrt(np.mean(error**2)) < 0.02, "noise of 0.01 is smoothed over, not met"


def test_every_part_of_the_comparison_holds_out_by_place() -> None:
    data = free_air.level(noisy_campaign())
    live = frame(data).live
    tasks = compare._tasks(data, live, 6, np.random.default_rng(0))
    for task in tasks:
        if task.kind == "split":
            assert set(data.locations[task.test]).isdisjoint(data.locations[~task.test])
            assert task.problem.live.tolist() == live.tolist()


def test_data_with_nothing_in_them_still_train() -> None:
    data = noisy_campaign(0.0, pitch_bias=0.0)
    lift = FAN.wrench(INF, INF, data.rpm)
    trained = train.train(replace(data, wrench=lift), "ensemble", 0)
    np.testing.assert_allclose(
        trained.model.wrench(0.2, 0.1, RPM), lift[data.rpm == RPM][0], atol=1e-9
    )
    assert all(trained.report["increments"]["test"][a]["r2"] is None for a in AXES)
