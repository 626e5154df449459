"""The surrogate of one fan: free-air law, gated increments from a regressor, calibrated spread, trust."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from models.frames import Array
from models.surrogate.coordinates import Coordinates
from models.surrogate.domain import Domain
from models.surrogate.free_air import HORIZONTAL, FreeAir
from models.surrogate.net_ensemble import NetEnsemble

# Points computed at once: bounds the memory.
CHUNK = 65536
# Up to this many points, plain floats for what is a number a point are quicker than arrays throughout.
FEW = 32
_multiply, _sqrt = np.multiply, np.sqrt
# A named tuple made without its own constructor, which takes twice as long.
_answer = tuple.__new__
_NUMBERS = frozenset({float, int, np.float64})


class Regressor(Protocol):
    """What the increments over their gate are computed by: nets, kriging or a polynomial."""

    kind: str

    def predict(self, x: Array) -> tuple[Array, Array]:
        """Mean and spread, each (n, 6), at inputs (n, 3)."""
        ...

    def arrays(self) -> dict[str, Array]:
        """What weights.npz holds."""
        ...


class Answer(NamedTuple):
    """One query: ``wrench`` and ``sigma`` (..., 6) in N and N m, corner frame; ``trust`` (...) in 0...1."""

    wrench: Array
    sigma: Array
    trust: Any


@dataclass(frozen=True)
class AdoptedEffect:
    """An effect that the diagnosis found missing and added: its catalogue name and fitted parameters, SI."""

    name: str
    parameters: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Calibration:
    """Turns the spread of the members into a standard deviation: sqrt((gain x spread)^2 + floor^2), each shape (6,).

    Fitted on rows that a member had not seen. ``floor`` is in increments (wrench over free-air lift), ``size`` the RMS
    of the increments of the data, against which the spread lowers trust.
    """

    gain: tuple[float, ...]
    floor: tuple[float, ...]
    size: tuple[float, ...]


class FanSurrogate:
    """One fan's wrench over (h, d, rpm), corner frame: lift(rpm) x (free-air share + gate(h, d) x increment(x)).

    h, d in m (``inf``: no ground, no wall), rpm of the fan; all broadcast. Exactly the free-air wrench far from both,
    exactly zero at rest; NaN or a negative speed or distance gives NaN with trust 0. Nearer than the data the nearest
    data hold; outside their rotor speeds the coefficients do, under the lift law. Single floats take a fast path.
    """

    def __init__(
        self,
        free_air: FreeAir,
        coordinates: Coordinates,
        regressor: Regressor,
        calibration: Calibration,
        domain: Domain,
        *,
        effects: tuple[AdoptedEffect, ...] = (),
        info: Mapping[str, Any] | None = None,
    ) -> None:
        self.free_air_law = free_air
        self.coordinates = coordinates
        self.regressor = regressor
        self.calibration = calibration
        self.domain = domain
        self.effects = effects
        self.info: Mapping[str, Any] = dict(info or {})
        """Everything else model.json says: method, data, metrics, fidelity."""
        self._share = np.asarray(free_air.share)
        self._gain = np.asarray(calibration.gain)
        self._floor = np.maximum(np.asarray(calibration.floor), np.asarray(free_air.scatter))
        self._floor2 = self._floor**2
        self._gain2 = self._gain**2
        # Doubt is the mean over components of (spread / size of the increments)^2.
        self._per_size2 = 1.0 / np.maximum(np.asarray(calibration.size), 1e-12) ** 2 / 6.0
        # One point, see _point: [s L, w L, s^2 L^2, w^2 L^2, L, L^2] @ gates, with gates s(urface) and w(all) and lift
        # L, gives the factors of mean (6) and variance (6), then what is added to each: share L and floor^2 L^2.
        wall = (HORIZONTAL & coordinates.axisymmetric).astype(float)
        self._gates = np.zeros((6, 24))
        self._gates[:2, :6] = 1.0 - wall, wall
        self._gates[2:4, 6:12] = self._gain2 * (1.0 - wall), self._gain2 * wall
        self._gates[4, 12:18] = self._share
        self._gates[5, 18:] = self._floor2
        self._per_size2_of_variance = np.concatenate([np.zeros(6), self._per_size2])
        self._six, terms, self._buffer = np.empty(6), np.empty(24), np.empty(12)
        self._terms, self._factors, self._added = terms, terms[:12], terms[12:]
        c = coordinates
        self._bounds = (c.h_near, c.h_far, c.d_near, c.d_far, c.rpm_low, c.rpm_high)
        self._lift_n, self._rpm_ref, self._power = free_air.lift_n, free_air.rpm_ref, 2.0 + free_air.exponent
        self._nets = regressor if isinstance(regressor, NetEnsemble) else None

    def with_effects(self, effects: tuple[AdoptedEffect, ...], info: Mapping[str, Any] | None = None) -> FanSurrogate:
        """The same surrogate with these adopted effects, and ``info`` in place of its own where given."""
        return FanSurrogate(
            self.free_air_law,
            self.coordinates,
            self.regressor,
            self.calibration,
            self.domain,
            effects=effects,
            info=self.info if info is None else info,
        )

    def wrench(self, h: ArrayLike, d: ArrayLike, rpm: ArrayLike) -> Array:
        """Total wrench (..., 6) of the fan in N and N m, corner frame."""
        return self.query(h, d, rpm).wrench

    def sigma(self, h: ArrayLike, d: ArrayLike, rpm: ArrayLike) -> Array:
        """Standard deviation (..., 6) of ``wrench`` in N and N m."""
        return self.query(h, d, rpm).sigma

    def trust(self, h: ArrayLike, d: ArrayLike, rpm: ArrayLike) -> Array:
        """How far the answer is to be believed (...): 1 inside the data, 0 far outside them; lowered by the spread."""
        return np.asarray(self.query(h, d, rpm).trust)

    def free_air(self, rpm: ArrayLike) -> Array:
        """Wrench (..., 6) with neither ground nor wall."""
        return self.free_air_law.wrench(rpm)

    def free_air_now(self, rpm: Sequence[float]) -> list[list[float]]:
        """Free-air wrench (6) at some speeds, in plain floats; to the last bit what ``query`` gives far from both."""
        if self._nets is None:
            far: list[list[float]] = self.query(math.inf, math.inf, np.array(rpm)).wrench.tolist()
            return far
        share = self.free_air_law.share
        lifts = [self._lift_n * (speed / self._rpm_ref) ** self._power for speed in rpm]
        return [[lift * part for part in share] for lift in lifts]

    def query(self, h: ArrayLike, d: ArrayLike, rpm: ArrayLike) -> Answer:
        """Wrench, spread and trust at once: one pass through the regressor."""
        if type(h) is type(d) is type(rpm) is float or (
            type(h) in _NUMBERS and type(d) in _NUMBERS and type(rpm) in _NUMBERS
        ):
            return self._point(h, d, rpm)  # type: ignore[arg-type]
        arrays = [np.asarray(v, dtype=float) for v in (h, d, rpm)]
        shape = np.broadcast_shapes(*(a.shape for a in arrays))
        n = math.prod(shape)
        # Adding zeros broadcasts as numpy's broadcast_to does, which keeps some memory of each call.
        h, d, rpm = ((a if a.shape == shape else a + np.zeros(shape)).ravel() for a in arrays)
        if 0 < n <= FEW and self._nets is not None:
            wrench, sigma, trust = self._few(h, d, rpm, self._nets)
            return Answer(wrench.reshape(*shape, 6), sigma.reshape(*shape, 6), trust.reshape(shape))
        wrench, sigma, trust = np.empty((n, 6)), np.empty((n, 6)), np.empty(n)
        for start in range(0, n, CHUNK):
            part = slice(start, start + CHUNK)
            wrench[part], sigma[part], trust[part] = self._batch(h[part], d[part], rpm[part])
        return Answer(wrench.reshape(*shape, 6), sigma.reshape(*shape, 6), trust.reshape(shape))

    def _batch(self, h: Array, d: Array, rpm: Array) -> tuple[Array, Array, Array]:
        known = (h >= 0.0) & (d >= 0.0) & (rpm >= 0.0) & (rpm < np.inf)
        h, d, rpm = np.where(known, h, np.inf), np.where(known, d, np.inf), np.where(known, rpm, 0.0)
        x, gate = self.coordinates.inputs(h, d, rpm)
        lift = self.free_air_law.lift(rpm)[:, None]
        mean, spread = self.regressor.predict(x)
        spread *= gate * self._gain
        spread *= spread
        wrench = lift * (gate * mean + self._share)
        sigma = lift * np.sqrt(spread + self._floor2)
        trust = self.domain.trust(x, h, d, rpm) / (1.0 + spread @ self._per_size2)
        wrench[~known] = np.nan
        sigma[~known] = np.nan
        return wrench, sigma, np.where(known, trust, 0.0)

    def _point(self, h: float, d: float, rpm: float) -> Answer:
        if not (h >= 0.0 and d >= 0.0 and 0.0 <= rpm < np.inf):
            return Answer(np.full(6, np.nan), np.full(6, np.nan), 0.0)
        nets = self._nets
        if nets is None:
            one = self._batch(np.array([h]), np.array([d]), np.array([float(rpm)]))
            return Answer(one[0][0], one[1][0], float(one[2][0]))
        xh, xd, xr, surface, wall = self._located(h, d, rpm)
        lift = self._lift_n * (rpm / self._rpm_ref) ** self._power
        six, surface_lift, wall_lift = self._six, surface * lift, wall * lift
        six[0] = surface_lift
        six[1] = wall_lift
        six[2] = surface_lift * surface_lift
        six[3] = wall_lift * wall_lift
        six[4] = lift
        lift2 = lift * lift
        six[5] = lift2
        # Mean and variance, wrench and sigma side by side in one array of 12: each operation serves both.
        six.dot(self._gates, self._terms)
        both = _multiply(nets.point(xh, xd, xr), self._factors, self._buffer)
        doubt = float(both.dot(self._per_size2_of_variance))
        out = both + self._added
        sigma = out[6:]
        _sqrt(sigma, sigma)
        trust = self.domain.point(xh, xd, h, d, rpm)
        if lift2 > 0.0:
            trust *= lift2 / (lift2 + doubt)
        return _answer(Answer, (out[:6], sigma, trust))

    def _located(self, h: float, d: float, rpm: float) -> tuple[float, float, float, float, float]:
        """Inputs of the nets and the gates of surface and wall at one point: ``Coordinates.inputs`` in plain floats."""
        h_near, h_far, d_near, d_far, rpm_low, rpm_high = self._bounds
        th = (h - h_near) / (h_far - h_near) if h_near < h < h_far else _outside(h, h_near, h_far)
        td = (d - d_near) / (d_far - d_near) if d_near < d < d_far else _outside(d, d_near, d_far)
        xr = 0.0
        if rpm_low < rpm_high:
            held = rpm_low if rpm < rpm_low else rpm_high if rpm > rpm_high else rpm
            xr = 2.0 * (held - rpm_low) / (rpm_high - rpm_low) - 1.0
        uh, ud = 1.0 - th, 1.0 - td
        ah, ad = 1.0 - th * th, 1.0 - td * td
        wall = ad * ad * ad
        surface = 1.0 - (1.0 - ah * ah * ah) * (1.0 - wall)
        return 1.0 - 2.0 * uh * uh, 1.0 - 2.0 * ud * ud, xr, surface, wall

    def _few(self, h: Array, d: Array, rpm: Array, nets: NetEnsemble) -> tuple[Array, Array, Array]:
        """``_point`` at some points at once: what is a number each in plain floats, what is twelve in one product."""
        n = len(h)
        x, six, where = [], [], []
        for h_m, d_m, speed in zip(h.tolist(), d.tolist(), rpm.tolist(), strict=True):
            known = h_m >= 0.0 and d_m >= 0.0 and 0.0 <= speed < math.inf
            if not known:
                h_m, d_m, speed = math.inf, math.inf, 0.0
            xh, xd, xr, surface, wall = self._located(h_m, d_m, speed)
            lift = self._lift_n * (speed / self._rpm_ref) ** self._power
            lift2, surface_lift, wall_lift = lift * lift, surface * lift, wall * lift
            x.append((xh, xd, xr, 1.0))
            six.append((surface_lift, wall_lift, surface_lift * surface_lift, wall_lift * wall_lift, lift, lift2))
            where.append((known, self.domain.point(xh, xd, h_m, d_m, speed), lift2))
        terms = np.array(six) @ self._gates
        both = nets.few(np.array(x)) * terms[:, :12]
        doubts = (both @ self._per_size2_of_variance).tolist()
        both += terms[:, 12:]
        _sqrt(both[:, 6:], both[:, 6:])
        trust = np.empty(n)
        for i, ((known, near, lift2), doubt) in enumerate(zip(where, doubts, strict=True)):
            trust[i] = near * (lift2 / (lift2 + doubt) if lift2 > 0.0 else 1.0) if known else 0.0
            if not known:
                both[i] = np.nan
        return both[:, :6], both[:, 6:], trust


def _outside(value: float, low: float, high: float) -> float:
    """``coordinates.unit`` of a number at or beyond its bounds."""
    if high <= low:
        return 1.0 if value > high else 0.5
    return 0.0 if value <= low else 1.0
