"""Training by every method, on good, awkward and huge data sets."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from models import dataset
from models.common.errors import ModelError
from models.common.frames import AXES
from models.corner_law import ClosedForm
from models.dataset import DataSet
from models.surrogate import coordinates, free_air, store
from models.training import levenberg, nets, train
from models.training.problem import folds, frame, increments
from models.training.scores import r_squared
from models.training.train import METHODS, PAPER_METHODS

INF = np.inf


def _thin(every: int = 8) -> DataSet:
    data = ClosedForm().data_set()
    rng = np.random.default_rng(0)
    keep = (rng.random(len(data)) < 1 / every) | data.free_air
    return data.take(keep)


@pytest.fixture
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nets that stop early, where their accuracy is not asked for."""
    monkeypatch.setattr(levenberg, "EVALUATIONS", 10)
    monkeypatch.setattr(nets, "DECAYS", (1e-7,))


@pytest.fixture(scope="module")
def small() -> DataSet:
    return _thin()


@pytest.mark.slow
@pytest.mark.usefixtures("hasty")
@pytest.mark.parametrize("method", METHODS)
def test_every_method_trains_saves_and_flies_without_its_trainer(
    method: str, small: DataSet, tmp_path: Path
) -> None:
    if method in PAPER_METHODS:
        pytest.importorskip("torch", reason="training extra not installed")
    if method == "kriging":
        pytest.importorskip("sklearn", reason="training extra not installed")
    trained = train.train(small, method, 1, epochs=40)
    store.save_model(tmp_path, trained.model)
    model = store.load(tmp_path)
    h, d = np.array([0.1, 0.3, INF]), np.array([0.1, 0.2, INF])
    np.testing.assert_allclose(
        model.wrench(h, d, 4000.0), trained.model.wrench(h, d, 4000.0), rtol=1e-6, atol=1e-9
    )
    np.testing.assert_array_equal(model.wrench(INF, INF, 4000.0), model.free_air(4000.0))
    assert model.info["method"] == method
    r = trained.report
    assert {"method", "seed", "rows", "train", "test", "seconds"} <= set(r)
    assert set(r["test"]) == set(AXES)
    assert set(r["test"]["Fx"]) == {"r2", "mse"}
    assert r["test"]["Fz"]["r2"] > 0.99, "rpm^2 is in the law, not in the net"
    assert all(np.isfinite(v["r2"]) for part in ("train", "test") for v in r[part].values())


@pytest.mark.slow
def test_the_ensemble_meets_the_goal_on_every_component() -> None:
    report = train.train(_thin(5), "ensemble", 0).report
    assert min(report["increments"]["test"][a]["r2"] for a in AXES) >= 0.98
    assert min(report["test"][a]["r2"] for a in AXES) >= 0.98
    coverage = [report["coverage_95"]["test"][a] for a in AXES]
    assert min(coverage) >= 0.88
    assert np.mean(coverage) <= 0.995


def test_training_repeats_by_seed(small: DataSet) -> None:
    one, other = (train.train(small, "polynomial", 5) for _ in range(2))
    assert one.report["test"] == other.report["test"]
    assert train.train(small, "polynomial", 6).report["test"] != one.report["test"]


def test_an_unknown_method_is_refused(small: DataSet) -> None:
    with pytest.raises(ModelError, match="method 'forest' is not known"):
        train.train(small, "forest")


@pytest.mark.usefixtures("hasty")
@pytest.mark.parametrize("column", ["h", "d", "rpm"])
def test_a_constant_input_column_trains(column: str) -> None:
    data = ClosedForm().data_set()
    value = {"h": np.unique(data.h)[5], "d": np.unique(data.d)[5], "rpm": 4000.0}[column]
    data = data.take((getattr(data, column) == value) | (data.free_air & (column != "rpm")))
    trained = train.train(data, "ensemble", 0)
    assert trained.report["test"]["Fz"]["r2"] > 0.9
    assert np.all(np.isfinite(trained.model.wrench(0.2, 0.2, 4000.0)))


@pytest.mark.usefixtures("hasty")
def test_a_constant_component_is_met_exactly_and_has_no_score(small: DataSet) -> None:
    wrench = small.wrench.copy()
    wrench[:, 1] = 0.0
    trained = train.train(replace(small, wrench=wrench), "ensemble", 0)
    assert trained.report["test"]["Fy"] == {"r2": None, "mse": 0.0}
    assert np.all(trained.model.wrench(np.linspace(0, 1, 20), 0.1, 4000.0)[:, 1] == 0.0)


def test_without_free_air_rows_the_outermost_stand_in_and_it_is_said() -> None:
    data = ClosedForm().data_set()
    trained = train.train(data.take(np.isfinite(data.h) & np.isfinite(data.d)), "polynomial", 0)
    assert trained.model.free_air_law.origin == "outermost rows"
    assert any("no free-air rows" in note for note in trained.report["notes"])
    np.testing.assert_allclose(
        trained.model.free_air(4000.0)[2], ClosedForm().lift(4000.0), rtol=0.01
    )
    assert trained.model.trust(INF, INF, 4000.0) < 1.0, (
        "what was never measured is not wholly trusted"
    )


def test_a_surface_the_data_never_saw_is_not_trusted_nearby() -> None:
    data = ClosedForm().data_set()
    model = train.train(data.take(np.isinf(data.d)), "polynomial").model
    assert model.trust(0.2, INF, 4000.0) > 0.9
    assert model.trust(0.2, 0.2, 4000.0) == 0.0
    np.testing.assert_array_equal(model.wrench(0.2, 0.2, 4000.0), model.wrench(0.2, INF, 4000.0))


def test_too_few_places_are_refused() -> None:
    data = ClosedForm().data_set()
    few = data.take(data.free_air | ((data.h == data.h[0]) & (data.d < 0.05)))
    for _ in range(4):
        few = replace(
            few, **{k: np.concatenate([getattr(few, k)] * 2) for k in ("h", "d", "rpm", "wrench")}
        )
    with pytest.raises(
        ModelError, match=r"distinct places \(h, d\) to learn from; at least 10 are needed"
    ):
        train.train(few, "ensemble")


def test_lift_with_the_wrong_sign_is_refused(small: DataSet) -> None:
    with pytest.raises(ModelError, match="free-air lift must be positive"):
        train.train(replace(small, wrench=-small.wrench), "polynomial")


@pytest.mark.slow
def test_noise_does_not_pass_for_precision() -> None:
    data = _thin(6)
    rng = np.random.default_rng(0)
    noise = 0.01 * ClosedForm().lift(data.rpm)[:, None] * np.array([0.1, 0.01, 1, 0.01, 0.1, 0.01])
    trained = train.train(
        replace(data, wrench=data.wrench + noise * rng.normal(size=data.wrench.shape)),
        "ensemble",
        0,
    )
    sigma = trained.model.query(0.3, 0.2, 4000.0).sigma
    assert 0.5 < sigma[2] / (0.01 * 22.56) < 2.0
    assert np.mean(list(trained.report["coverage_95"]["test"].values())) == pytest.approx(
        0.95, abs=0.03
    )


@pytest.mark.slow
def test_a_tilted_fan_keeps_its_side_force() -> None:
    data = ClosedForm().data_set()
    wrench = data.wrench.copy()
    wrench[:, 0] += 0.05 * ClosedForm().lift(data.rpm)
    model = train.train(replace(data, wrench=wrench), "polynomial", 0).model
    assert not model.coordinates.axisymmetric
    assert model.wrench(INF, INF, 4000.0)[0] == pytest.approx(0.05 * 22.555, rel=0.01)


@pytest.mark.slow
def test_a_million_rows_train_on_those_that_are_drawn() -> None:
    rng = np.random.default_rng(0)
    n = 1_000_000
    h, d, rpm = rng.uniform(0.06, 0.9, n), rng.uniform(0.02, 0.8, n), rng.uniform(2500, 5500, n)
    h[:1000] = d[:1000] = INF
    data = DataSet(
        h=h, d=d, rpm=rpm, wrench=ClosedForm().wrench(h, d, rpm), source="million", sha256=""
    )
    trained = train.train(data, "polynomial", 0)
    assert trained.report["rows"] == n
    assert any("drawn at random" in note for note in trained.report["notes"])


def test_the_reynolds_exponent_is_found() -> None:
    law = free_air.fit(ClosedForm().data_set())
    assert law.exponent == pytest.approx(0.04)
    assert np.isnan(law.lift(-1.0))
    assert law.lift(0.0) == 0.0


def test_the_reach_of_ground_and_wall_is_found() -> None:
    data = ClosedForm().data_set()
    law = free_air.fit(data)
    c = coordinates.fit(data, increments(data.wrench, data.rpm, law), axisymmetric=True)
    assert 3.5 * 0.165 < c.h_far <= 4.3 * 0.165
    assert 3.3 * 0.165 < c.d_far <= 4.1 * 0.165
    near = data.take((data.h < 0.2) | data.free_air)
    part = coordinates.fit(near, increments(near.wrench, near.rpm, law), axisymmetric=True)
    assert part.h_far == pytest.approx(1.5 * near.h[np.isfinite(near.h)].max())


def test_folds_keep_a_place_together(small: DataSet) -> None:
    problem = frame(small)
    fold = folds(problem, 5, np.random.default_rng(0))
    for place in range(20):
        assert len(np.unique(fold[problem.locations == place])) == 1
    assert set(np.unique(fold)) == {0, 1, 2, 3, 4}


def test_r_squared_is_the_papers_and_not_defined_for_a_constant() -> None:
    """Eq. 17."""
    truth = np.array([[1.0, 3.0, 3.0], [2.0, 3.0, 3.0], [3.0, 3.0, 3.0]])
    answer = np.array([[1.0, 3.0, 3.1], [2.0, 3.0, 3.0], [4.0, 3.0, 3.0]])
    np.testing.assert_allclose(r_squared(truth, answer), [0.5, np.nan, np.nan])


@pytest.mark.slow
def test_reference_data_train_to_the_goal(
    shared_data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Accuracy alone: the weakest decay is given and little calibrated, for speed."""
    monkeypatch.setattr(nets, "DECAYS", (1e-7,))
    monkeypatch.setattr(train, "CALIBRATION_ROWS", 200)
    monkeypatch.setattr(nets, "TRIAL_ROWS", 200)
    data = dataset.read(shared_data / "undeclared" / "corner.csv")
    report = train.train(data.take(data.rpm != 3200.0), "ensemble", 0).report
    assert min(report["test"][a]["r2"] for a in AXES) >= 0.99
    assert min(report["increments"]["test"][a]["r2"] for a in AXES) >= 0.99


@pytest.mark.slow
def test_rows_that_are_known_badly_count_less(small: DataSet) -> None:
    """Places with a large error and a sigma that says so: the nets answer nearer to the truth than without it."""
    rng = np.random.default_rng(3)
    bad = (
        np.isin(small.locations, rng.permutation(np.unique(small.locations))[::3]) & ~small.free_air
    )
    noise = rng.normal(0.0, 1.0, small.wrench.shape) * np.array([0.5, 0.5, 2.0, 0.05, 0.05, 0.05])
    noisy = replace(small, wrench=small.wrench + noise * bad[:, None])
    sigma = np.where(
        bad[:, None], [0.5, 0.5, 2.0, 0.05, 0.05, 0.05], [0.02, 0.02, 0.02, 0.002, 0.002, 0.002]
    )

    def miss(data: DataSet) -> float:
        model = train.train(data, "ensemble", seed=1).model
        return float(
            np.sqrt(np.mean((model.wrench(small.h, small.d, small.rpm) - small.wrench)[:, 2] ** 2))
        )

    assert miss(replace(noisy, sigma=sigma)) < 0.7 * miss(noisy)
