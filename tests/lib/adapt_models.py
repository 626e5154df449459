"""Models that are right, wrong or of another vehicle about the simulated air: what adaptation is judged with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import models
from companion.sim.air import PAPER_CQ, REYNOLDS_EXPONENT, RPM_HOVER, SurfaceLaw
from models.common.frames import Array
from models.effects.adopted_effect import AdoptedEffect
from models.surrogate.empty import empty_model
from models.surrogate.fan_surrogate import Answer, Calibration
from models.vehicle import RHO_SEA_LEVEL, Vehicle

SURE = Calibration((0.0,) * 6, (0.0,) * 6, (0.0,) * 6)
"""Of a model that states no scatter of its own."""


class TrueModel:
    """The simulated air itself, for a fan without the vehicle file's errors."""

    effects: tuple[AdoptedEffect, ...] = ()
    calibration = SURE

    def __init__(self, vehicle: Vehicle, law: SurfaceLaw) -> None:
        self.info: Mapping[str, Any] = {"method": "truth"}
        self._law, self._radius = law, vehicle.rotor_radius_m
        self._per_rpm2 = (
            RHO_SEA_LEVEL
            * vehicle.disc_area_m2
            * (2.0 * np.pi / 60.0 * vehicle.rotor_radius_m) ** 2
        )
        self._ct = vehicle.fans[0].ct or 0.0
        self._torque = vehicle.fans[0].ct is None

    def query(self, h: ArrayLike, d: ArrayLike, rpm: ArrayLike) -> Answer:
        """As a surrogate's."""
        h, d, rpm = np.broadcast_arrays(
            np.asarray(h, float), np.asarray(d, float), np.asarray(rpm, float)
        )
        out = np.zeros((*h.shape, 6))
        for index in np.ndindex(h.shape):
            speed = float(rpm[index])
            lift = (
                self._ct
                * self._per_rpm2
                * speed**2
                * (max(speed, 1.0) / RPM_HOVER) ** REYNOLDS_EXPONENT
            )
            inc = self._law.increments(
                float(h[index]) / self._radius, float(d[index]) / self._radius
            )
            arm = lift * self._radius
            torque = PAPER_CQ * self._per_rpm2 * speed**2 * self._radius * self._torque
            out[index] = (
                lift * inc.x, lift * inc.y, lift * (1.0 + inc.z), arm * inc.mx, arm * inc.my, torque * inc.mz,
            )  # fmt: skip
        return Answer(out, np.zeros_like(out), np.ones(h.shape))

    def wrench(self, h: ArrayLike, d: ArrayLike, rpm: ArrayLike) -> Array:
        """(..., 6)."""
        return self.query(h, d, rpm).wrench

    def free_air_now(self, rpm: Sequence[float]) -> list[list[float]]:
        """(fans, 6), with neither ground nor wall."""
        far: list[list[float]] = self.query(np.inf, np.inf, np.array(rpm)).wrench.tolist()
        return far


class WarpedModel:
    """A model with what it says of ground and wall multiplied, and asked at other distances and with another lift."""

    effects: tuple[AdoptedEffect, ...] = ()
    calibration = SURE

    def __init__(
        self, inner: Any, *, gain: float = 1.0, nearer: float = 1.0, lift: float = 1.0
    ) -> None:
        self.info: Mapping[str, Any] = {"method": "warped"}
        self._inner, self._gain, self._nearer, self._lift = inner, gain, nearer, lift

    def query(self, h: ArrayLike, d: ArrayLike, rpm: ArrayLike) -> Answer:
        """As a surrogate's."""
        near = self._inner.query(np.asarray(h) * self._nearer, np.asarray(d) * self._nearer, rpm)
        far = self._inner.query(
            np.full(np.shape(h), np.inf), np.full(np.shape(d), np.inf), rpm
        ).wrench
        wrench = self._lift * (far + self._gain * (near.wrench - far))
        return Answer(wrench, near.sigma, near.trust)

    def wrench(self, h: ArrayLike, d: ArrayLike, rpm: ArrayLike) -> Array:
        """(..., 6)."""
        return self.query(h, d, rpm).wrench

    def free_air_now(self, rpm: Sequence[float]) -> list[list[float]]:
        """(fans, 6), with neither ground nor wall."""
        far: list[list[float]] = self.query(np.inf, np.inf, np.array(rpm)).wrench.tolist()
        return far


class OfThisFan:
    """What another fan's model says of ground and wall, in radii and shares of the lift, with this vehicle's lift."""

    effects: tuple[AdoptedEffect, ...] = ()
    calibration = SURE

    def __init__(self, inner: Any, vehicle: Vehicle, inner_radius_m: float) -> None:
        self.info: Mapping[str, Any] = {"method": "of this fan"}
        self._inner, self._free, self._size = (
            inner,
            empty_model(vehicle),
            vehicle.rotor_radius_m / inner_radius_m,
        )

    def query(self, h: ArrayLike, d: ArrayLike, rpm: ArrayLike) -> Answer:
        """As a surrogate's."""
        h, d, rpm = np.broadcast_arrays(
            np.asarray(h, float), np.asarray(d, float), np.asarray(rpm, float)
        )
        there = np.full(h.shape, RPM_HOVER)
        near = self._inner.query(h / self._size, d / self._size, there)
        far = self._inner.query(np.full(h.shape, np.inf), np.full(h.shape, np.inf), there).wrench
        free = self._free.query(np.full(h.shape, np.inf), np.full(h.shape, np.inf), rpm).wrench
        share = (
            (near.wrench - far)
            / far[..., 2:3]
            * np.array([1.0, 1.0, 1.0, self._size, self._size, self._size])
        )
        wrench = free + free[..., 2:3] * share
        return Answer(wrench, np.zeros_like(wrench), near.trust)

    def wrench(self, h: ArrayLike, d: ArrayLike, rpm: ArrayLike) -> Array:
        """(..., 6)."""
        return self.query(h, d, rpm).wrench

    def free_air_now(self, rpm: Sequence[float]) -> list[list[float]]:
        """(fans, 6), with neither ground nor wall."""
        return self._free.free_air_now(rpm)


KINDS = ("right", "default", "corner_cfd", "mirrored", "other")


def model_of(kind: str, vehicle: Vehicle, law: SurfaceLaw) -> Any:
    """``right``: the air itself; ``default``: the shipped model, 10 to 30 % wrong about it; ``corner_cfd``: the shipped
    model from flow simulation, of another fan; ``mirrored``: the shipped one with the wrong sign; ``other``: of a
    vehicle with fans 1.7 times as large, whose lift is 10 % off and whose ground and wall are half as strong again."""
    if kind == "right":
        return TrueModel(vehicle, law)
    if kind == "corner_cfd":
        return models.load("corner_cfd")
    shipped = models.load()
    if kind == "mirrored":
        return WarpedModel(shipped, gain=-1.0)
    if kind == "other":
        return WarpedModel(shipped, gain=1.5, nearer=0.6, lift=1.1)
    return shipped
