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
from models.vehicle_wrench import RPM_TO_RAD_S

SURE = Calibration((0.0,) * 6, (0.0,) * 6, (0.0,) * 6)
"""Of a model that states no scatter of its own."""


class AirModel:
    """What a surrogate is to flight, but for ``query``."""

    effects: tuple[AdoptedEffect, ...] = ()
    calibration = SURE
    method: str

    @property
    def info(self) -> Mapping[str, Any]:
        return {"method": self.method}

    def query(self, h: ArrayLike, d: ArrayLike, rpm: ArrayLike) -> Answer:
        """As a surrogate's."""
        raise NotImplementedError

    def wrench(self, h: ArrayLike, d: ArrayLike, rpm: ArrayLike) -> Array:
        """(..., 6)."""
        return self.query(h, d, rpm).wrench

    def free_air_now(self, rpm: Sequence[float]) -> list[list[float]]:
        """(fans, 6), with neither ground nor wall."""
        far: list[list[float]] = self.wrench(np.inf, np.inf, np.array(rpm)).tolist()
        return far


def free_air(model: Any, rpm: ArrayLike) -> Array:
    """(..., 6), with neither ground nor wall."""
    far = np.full(np.shape(rpm), np.inf)
    wrench: Array = model.query(far, far, rpm).wrench
    return wrench


def as_arrays(*values: ArrayLike) -> tuple[Array, ...]:
    """Of one shape."""
    return np.broadcast_arrays(*(np.asarray(value, float) for value in values))


class TrueModel(AirModel):
    """The simulated air itself, for a fan without the vehicle file's errors."""

    method = "truth"

    def __init__(self, vehicle: Vehicle, law: SurfaceLaw) -> None:
        self._law = law
        self._radius = vehicle.rotor_radius_m
        tip = RPM_TO_RAD_S * self._radius
        self._per_rpm2 = RHO_SEA_LEVEL * vehicle.disc_area_m2 * tip**2
        self._ct = vehicle.fans[0].ct or 0.0
        self._cq = PAPER_CQ if vehicle.fans[0].ct is None else 0.0

    def query(self, h: ArrayLike, d: ArrayLike, rpm: ArrayLike) -> Answer:
        """As a surrogate's."""
        h, d, rpm = as_arrays(h, d, rpm)
        out = np.zeros((*h.shape, 6))
        for index in np.ndindex(h.shape):
            out[index] = self._one(float(h[index]), float(d[index]), float(rpm[index]))
        return Answer(out, np.zeros_like(out), np.ones(h.shape))

    def _one(self, h: float, d: float, rpm: float) -> tuple[float, ...]:
        """T = C_T k n^2 (n / n_hover)^e and Q = C_Q k R n^2, with the law's increments."""
        reynolds = (max(rpm, 1.0) / RPM_HOVER) ** REYNOLDS_EXPONENT
        lift = self._ct * self._per_rpm2 * rpm**2 * reynolds
        arm = lift * self._radius
        torque = self._cq * self._per_rpm2 * rpm**2 * self._radius
        near = self._law.increments(h / self._radius, d / self._radius)
        return (
            lift * near.x,
            lift * near.y,
            lift * (1.0 + near.z),
            arm * near.mx,
            arm * near.my,
            torque * near.mz,
        )


class WarpedModel(AirModel):
    """A model with what it says of ground and wall multiplied, and asked at other distances and with another lift."""

    method = "warped"

    def __init__(
        self,
        inner: Any,
        *,
        gain: float = 1.0,
        nearer: float = 1.0,
        lift: float = 1.0,
    ) -> None:
        self._inner = inner
        self._gain = gain
        self._nearer = nearer
        self._lift = lift

    def query(self, h: ArrayLike, d: ArrayLike, rpm: ArrayLike) -> Answer:
        """As a surrogate's."""
        h, d, rpm = as_arrays(h, d, rpm)
        near = self._inner.query(h * self._nearer, d * self._nearer, rpm)
        far = free_air(self._inner, rpm)
        wrench = self._lift * (far + self._gain * (near.wrench - far))
        return Answer(wrench, near.sigma, near.trust)


class OfThisFan(AirModel):
    """What another fan's model says of ground and wall, in radii and shares of the lift, with this vehicle's lift."""

    method = "of this fan"

    def __init__(self, inner: Any, vehicle: Vehicle, inner_radius_m: float) -> None:
        self._inner = inner
        self._free = empty_model(vehicle)
        self._size = vehicle.rotor_radius_m / inner_radius_m

    def query(self, h: ArrayLike, d: ArrayLike, rpm: ArrayLike) -> Answer:
        """As a surrogate's."""
        h, d, rpm = as_arrays(h, d, rpm)
        there = np.full(h.shape, RPM_HOVER)
        near = self._inner.query(h / self._size, d / self._size, there)
        far = free_air(self._inner, there)
        free = free_air(self._free, rpm)
        arms = np.array([1.0] * 3 + [self._size] * 3)
        share = (near.wrench - far) / far[..., 2:3] * arms
        wrench = free + free[..., 2:3] * share
        return Answer(wrench, np.zeros_like(wrench), near.trust)

    def free_air_now(self, rpm: Sequence[float]) -> list[list[float]]:
        """(fans, 6), with neither ground nor wall."""
        return self._free.free_air_now(rpm)


KINDS = ("right", "default", "corner_cfd", "mirrored", "other", "empty")


def model_of(kind: str, vehicle: Vehicle, law: SurfaceLaw) -> Any:
    """``right``: the air itself; ``default``: the shipped model, 10 to 30 % wrong about it; ``corner_cfd``: the shipped
    model from flow simulation, of another fan; ``mirrored``: the shipped one with the wrong sign; ``other``: of a
    vehicle with fans 1.7 times as large, whose lift is 10 % off and whose ground and wall are half as strong again;
    ``empty``: no model, as flown with ``--model none``."""
    if kind == "right":
        return TrueModel(vehicle, law)
    if kind == "empty":
        return empty_model(vehicle)
    if kind == "corner_cfd":
        return models.load("corner_cfd")
    shipped = models.load()
    if kind == "mirrored":
        return WarpedModel(shipped, gain=-1.0)
    if kind == "other":
        return WarpedModel(shipped, gain=1.5, nearer=0.6, lift=1.1)
    return shipped
