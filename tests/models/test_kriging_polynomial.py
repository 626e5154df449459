"""The paper's two rivals: kriging against scikit-learn's own prediction, polynomials against exact polynomials."""

from __future__ import annotations

import numpy as np
import pytest

from models.surrogate import kriging, polynomial


def _data(rows: int = 150) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # type: ignore[type-arg]
    rng = np.random.default_rng(0)
    x = rng.uniform(-1, 1, (rows, 3))
    f = np.sin(2 * x[:, [0]]) + x[:, [1]] ** 2 * np.arange(1, 7) / 6
    return x, f, np.ones_like(f)


@pytest.mark.parametrize("degree", polynomial.DEGREES)
def test_a_polynomial_is_recovered_by_its_own_degree(degree: int) -> None:
    rng = np.random.default_rng(degree)
    x = rng.uniform(-1, 1, (300, 3))
    basis = polynomial.monomials(x, degree)
    y = basis @ rng.normal(size=(basis.shape[1], 6))
    fitted = polynomial.fit(x, y, np.ones_like(y), degree)
    np.testing.assert_allclose(fitted.predict(x)[0], y, atol=1e-8)
    assert fitted.residual.max() < 1e-8
    back = polynomial.PolynomialRegressor.from_arrays(fitted.arrays())
    np.testing.assert_array_equal(back.predict(x)[0], fitted.predict(x)[0])


def test_monomials_count_as_they_should() -> None:
    assert [polynomial.monomials(np.zeros((1, 3)), k).shape[1] for k in (1, 2, 3)] == [4, 10, 20]


@pytest.mark.slow
def test_kriging_interpolates_with_little_doubt_and_doubts_where_it_has_no_rows() -> None:
    pytest.importorskip("sklearn", reason="training extra not installed")
    x, y, gate = _data()
    fitted = kriging.fit(x, y, gate, np.arange(len(x)), 0)
    mean, spread = fitted.predict(x)
    np.testing.assert_allclose(mean, y, atol=0.05)
    _, far = fitted.predict(np.full((1, 3), 4.0))
    assert np.all(far > 3 * spread.mean(axis=0))
    back = kriging.KrigingRegressor.from_arrays(fitted.arrays())
    np.testing.assert_allclose(back.predict(x[:5])[0], mean[:5], atol=1e-10)


def test_kriging_in_numpy_is_scikit_learns() -> None:
    pytest.importorskip("sklearn", reason="training extra not installed")
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF

    x, y, gate = _data()
    process = kriging.fit(x, y, gate, np.arange(len(x)), 0).processes[0]
    factor = np.linalg.inv(process.root)
    nugget = np.diag(factor @ factor.T) - 1.0
    reference = GaussianProcessRegressor(RBF(process.lengths), alpha=nugget, optimizer=None)
    order = [int(np.flatnonzero((x == row).all(axis=1))[0]) for row in process.rows]
    reference.fit(process.rows, y[order] / process.deviation)
    at = np.random.default_rng(5).uniform(-1, 1, (20, 3))
    mean, std = reference.predict(at, return_std=True)
    ours, spread = process.predict(at)
    np.testing.assert_allclose(ours, mean * process.deviation, atol=1e-5)
    np.testing.assert_allclose(spread, std * process.deviation, atol=1e-5)
