"""Polynomial regression of degree 1 to 5, the simpler of the paper's two rivals, by weighted least squares."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from models.common.frames import Array

DEGREES = (1, 2, 3, 4, 5)


@dataclass(frozen=True)
class PolynomialRegressor:
    """y = sum of coefficients (terms, 6) x monomials of the inputs up to ``degree``.

    ``residual`` shape (6,) is the RMS of the fit on its own rows, the spread it reports.
    """

    degree: int
    coefficients: Array
    residual: Array

    kind = "polynomial"

    def predict(self, x: Array) -> tuple[Array, Array]:
        """Mean and spread, each (n, 6), at inputs (n, 3)."""
        mean: Array = monomials(x, self.degree) @ self.coefficients
        return mean, np.zeros_like(mean) + self.residual

    def arrays(self) -> dict[str, Array]:
        """What weights.npz holds."""
        return {
            "degree": np.array(float(self.degree)),
            "coefficients": self.coefficients,
            "residual": self.residual,
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Array]) -> PolynomialRegressor:
        """Inverse of ``arrays``."""
        return cls(int(arrays["degree"]), arrays["coefficients"], arrays["residual"])


def monomials(x: Array, degree: int) -> Array:
    """All products of inputs (n, k) up to ``degree``, the constant first, shape (n, terms)."""
    inputs = x.shape[1]
    with_one = np.ones((inputs + 1, len(x)))
    with_one[:inputs] = x.T
    products: Array = np.multiply.reduce(with_one[_factors(inputs, degree)])
    return products.T


@cache
def _factors(inputs: int, degree: int) -> NDArray[np.int_]:
    """Factors (degree, terms) of every monomial: numbers of inputs, and ``inputs`` for 1."""
    terms = [(inputs,) * degree]
    for power in range(1, degree + 1):
        ones = (inputs,) * (degree - power)
        for chosen in combinations_with_replacement(range(inputs), power):
            terms.append((*chosen, *ones))
    return np.array(terms).T


def fit(x: Array, y: Array, gate: Array, degree: int) -> PolynomialRegressor:
    """Least squares of gate (n, 6) x polynomial(x) on the increments y (n, 6); inputs x (n, 3) in [-1, 1]."""
    basis = monomials(x, degree)
    coefficients = np.zeros((basis.shape[1], 6))
    for c in range(6):
        gated = basis * gate[:, [c]]
        coefficients[:, c], *_ = np.linalg.lstsq(gated, y[:, c], rcond=None)
    error = gate * (basis @ coefficients) - y
    residual = np.sqrt(np.mean(error**2, axis=0))
    return PolynomialRegressor(degree, coefficients, residual)
