"""The fan far from everything: lift over rotor speed, and the other components as shares of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.dataset import DataSet
from models.errors import ModelError
from models.wrench import Array

HORIZONTAL = np.array([True, True, False, True, True, False])
"""Components that name a horizontal direction: a fan that sees no wall has none to prefer."""

# Horizontal components without a wall above this share of their largest value are taken as the fan's own, not as noise.
ASYMMETRY_SHARE = 0.02
OUTER_SHARE = 0.9


@dataclass(frozen=True)
class FreeAir:
    """Free-air law of one fan.

    lift = ``lift_n`` (rpm / ``rpm_ref``)^(2 + ``exponent``): the paper's C_T = T/(rho A Omega^2 R^2), eq. 1, with a
    Reynolds exponent, needing neither R nor rho because both are constant over a data set. ``share`` shape (6,) is the
    wrench over the lift [1 or m]; share[2] = 1. ``scatter`` shape (6,) is the RMS of the data about the law, same unit.
    Increments near ground and wall are divided by this lift: F/lift = C/C_T, the coefficient up to one constant.
    """

    lift_n: float
    rpm_ref: float
    exponent: float
    share: tuple[float, ...]
    scatter: tuple[float, ...]
    origin: str
    """``free-air rows`` or, where the data set has none, ``outermost rows``."""

    def lift(self, rpm: ArrayLike) -> Array:
        """Lift [N], shape of ``rpm``; 0 at rest, NaN for a negative speed."""
        speed = np.asarray(rpm, dtype=float) / self.rpm_ref
        with np.errstate(invalid="ignore"):
            return np.where(speed < 0.0, np.nan, self.lift_n * np.abs(speed) ** (2.0 + self.exponent))

    def wrench(self, rpm: ArrayLike) -> Array:
        """Wrench (..., 6) in free air, corner frame."""
        return np.asarray(self.lift(rpm)[..., None] * np.asarray(self.share))


def fit(data: DataSet, axisymmetric: bool) -> FreeAir:
    """Fit the law on the free-air rows; without any, on the outermost rows, which then define 'far away'."""
    rows, origin = free_rows(data)
    rpm, wrench = data.rpm[rows], data.wrench[rows]
    lift = wrench[:, 2]
    if np.any(lift <= 0.0):
        worst = int(np.argmin(lift))
        raise ModelError(
            f"data set {data.source}: free-air lift must be positive (Fz is up in the corner frame), "
            f"not {lift[worst]:g} N at {rpm[worst]:g} rpm"
        )
    rpm_ref = float(np.exp(np.mean(np.log(rpm))))
    x, y = np.log(rpm / rpm_ref), np.log(lift / (rpm / rpm_ref) ** 2)
    exponent = float(x @ y / (x @ x)) if np.ptp(rpm) > 1e-6 * rpm_ref else 0.0
    lift_n = float(np.exp(np.mean(y - exponent * x)))
    ratio = wrench / (lift_n * (rpm / rpm_ref) ** (2.0 + exponent))[:, None]
    share = ratio.mean(axis=0)
    share[2] = 1.0
    if axisymmetric:
        share[HORIZONTAL] = 0.0
    scatter = np.sqrt(np.mean((ratio - share) ** 2, axis=0))
    return FreeAir(lift_n, rpm_ref, exponent, tuple(share.tolist()), tuple(scatter.tolist()), origin)


def free_rows(data: DataSet) -> tuple[NDArray[np.bool_], str]:
    """Mask (n,) of the rows that stand for free air, and their name."""
    free = data.free_air
    if free.any():
        return free, "free-air rows"
    far = np.ones(len(data), dtype=bool)
    for distance in (data.h, data.d):
        far &= distance >= OUTER_SHARE * distance.max() if np.isfinite(distance.max()) else np.isinf(distance)
    if not far.any():
        reach = np.hypot(np.minimum(data.h, 1e3), np.minimum(data.d, 1e3))
        far = reach >= OUTER_SHARE * reach.max()
    return far, "outermost rows"


def is_axisymmetric(data: DataSet) -> bool:
    """True where rows without a wall have no horizontal force or moment beyond noise, or there are no such rows.

    Physics has it so for one fan (the X-Z mirror plane becomes every vertical plane); a tilted fan breaks it.
    """
    alone = np.isinf(data.d)
    if not alone.any():
        return True
    scale = np.abs(data.wrench[:, HORIZONTAL]).max(axis=0)
    own = np.abs(data.wrench[alone][:, HORIZONTAL].mean(axis=0))
    return bool(np.all(own <= ASYMMETRY_SHARE * np.maximum(scale, 1e-9)))
