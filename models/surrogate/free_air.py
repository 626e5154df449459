"""The fan far from everything: lift over rotor speed, and the other components as shares of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.common.errors import ModelError
from models.common.frames import AXES, Array, Mask
from models.dataset import DataSet, place_means

HORIZONTAL = np.array([True, True, False, True, True, False])
"""Components that name a horizontal direction: a fan that sees no wall has none to prefer."""

# A horizontal component that stands at all places without a wall is the fan's own (it is tilted) where it is above this
# share of its largest value, else an offset of the data; it stands if its mean is this many standard errors from zero.
ASYMMETRY_SHARE = 0.05
SIGNIFICANT = 4.0
# Without free-air rows those beyond this share of the largest distances are taken for it.
OUTER_SHARE = 0.9


@dataclass(frozen=True, kw_only=True)
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
        lift = self.lift_n * np.abs(speed) ** (2.0 + self.exponent)
        return np.where(speed < 0.0, np.nan, lift)

    def wrench(self, rpm: ArrayLike) -> Array:
        """Wrench (..., 6) in free air, corner frame."""
        return np.asarray(self.lift(rpm)[..., None] * np.asarray(self.share))


def fit(data: DataSet) -> FreeAir:
    """Fit the law on the free-air rows; without any, on the outermost rows, which then define 'far away'."""
    rows, origin = free_rows(data)
    rpm = data.rpm[rows]
    wrench = data.wrench[rows]
    lift = wrench[:, 2]
    if np.any(lift <= 0.0):
        worst = int(np.argmin(lift))
        raise ModelError(
            f"data set {data.source}: free-air lift must be positive (Fz is up in the corner "
            f"frame), not {lift[worst]:g} N at {rpm[worst]:g} rpm"
        )
    rpm_ref = float(np.exp(np.mean(np.log(rpm))))
    speed = rpm / rpm_ref
    x = np.log(speed)
    y = np.log(lift / speed**2)
    exponent = 0.0
    if np.ptp(rpm) > 1e-6 * rpm_ref:
        exponent = float(x @ y / (x @ x))
    lift_n = float(np.exp(np.mean(y - exponent * x)))
    lift_of_rows = lift_n * (data.rpm / rpm_ref) ** (2.0 + exponent)
    ratio = data.wrench / lift_of_rows[:, None]
    share = ratio[rows].mean(axis=0)
    share[2] = 1.0
    own, _ = _standing(data, ratio)
    share[HORIZONTAL & ~own] = 0.0
    scatter = np.sqrt(np.mean((ratio[rows] - share) ** 2, axis=0))
    return FreeAir(
        lift_n=lift_n,
        rpm_ref=rpm_ref,
        exponent=exponent,
        share=tuple(share.tolist()),
        scatter=tuple(scatter.tolist()),
        origin=origin,
    )


def level(data: DataSet) -> DataSet:
    """The data less a small horizontal offset that stands at all places without a wall, as a lopsided mesh leaves it.

    Physics has none there. It is taken off everywhere, as a share of the lift; ``notes`` says so. What a tilted fan has
    of its own stays, and so does noise: one noisy place subtracted everywhere would shift all.
    """
    lift = fit(data).lift(data.rpm)[:, None]
    _, offset = _standing(data, data.wrench / lift)
    if not offset.any():
        return data
    named = ", ".join(f"{AXES[c]} {offset[c]:.2g}" for c in np.flatnonzero(offset))
    note = (
        f"offset over free-air lift at all places without a wall, subtracted everywhere: {named} "
        "(N or N m per N)"
    )
    return replace(data, wrench=data.wrench - lift * offset, notes=(*data.notes, note))


def _standing(data: DataSet, ratio: Array) -> tuple[Mask, Array]:
    """Which horizontal components (6,) the fan has of itself, and the offset (6,) of those it has not."""
    mean = np.zeros(6)
    error = np.zeros(6)
    alone = np.isinf(data.d)
    if alone.any():
        mean, error = mean_over_places(ratio[alone], data.h[alone])
    stands = HORIZONTAL & (np.abs(mean) > np.maximum(SIGNIFICANT * error, 1e-9))
    own = stands & (np.abs(mean) > ASYMMETRY_SHARE * np.abs(ratio).max(axis=0))
    return own, np.where(stands & ~own, mean, 0.0)


def mean_over_places(ratio: Array, place: Array | NDArray[np.intp]) -> tuple[Array, Array]:
    """Mean (6,) of ``ratio`` (n, 6), and its standard error, rows of one ``place`` (n,) counting as one."""
    _, place = np.unique(place, return_inverse=True)
    means = place_means(ratio, place)
    error = np.zeros(6)
    if len(means) > 1:
        error = means.std(axis=0, ddof=1) / np.sqrt(len(means))
    return means.mean(axis=0), error


def free_rows(data: DataSet) -> tuple[Mask, str]:
    """Mask (n,) of the rows that stand for free air, and their name."""
    free = data.free_air
    if free.any():
        return free, "free-air rows"
    far = np.ones(len(data), dtype=bool)
    for distance in (data.h, data.d):
        # An infinite largest distance is reached by infinite ones alone.
        far &= distance >= OUTER_SHARE * distance.max()
    if not far.any():
        reach = np.hypot(np.minimum(data.h, 1e3), np.minimum(data.d, 1e3))
        far = reach >= OUTER_SHARE * reach.max()
    return far, "outermost rows"


def is_axisymmetric(law: FreeAir, live: Mask) -> bool:
    """True where no live horizontal component is non-zero in free air: then only a wall can cause any.

    Physics has it so for one fan (the X-Z mirror plane becomes every vertical plane), whatever the data say over bare
    ground; a tilted fan breaks it.
    """
    return not np.any(np.asarray(law.share)[HORIZONTAL & live])
