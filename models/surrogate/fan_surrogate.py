"""The surrogate of one fan: free-air law, gated increments from a regressor, calibrated spread, trust."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from models.common.errors import ModelError
from models.common.frames import Array
from models.effects import get
from models.effects.adopted_effect import AdoptedEffect
from models.surface_map import LawCorrection
from models.surrogate.coordinates import Coordinates
from models.surrogate.domain import Domain
from models.surrogate.free_air import FreeAir

if TYPE_CHECKING:
    from models.common.pages.shown import ShownPage

# Points computed at once: bounds the memory.
CHUNK = 65536

_GROUP = np.array([0, 0, 1, 2, 2, 3])
"""Components that are of one kind: Fx Fy, Fz, Mx My, Mz."""


class Regressor(Protocol):
    """What the increments over their gate are computed by: nets, kriging or a polynomial."""

    kind: str

    def predict(self, x: Array) -> tuple[Array, Array]:
        """Mean and spread, each (n, 6), at inputs (n, 3)."""

    def arrays(self) -> dict[str, Array]:
        """What weights.npz holds."""


class Answer(NamedTuple):
    """One query: ``wrench`` and ``sigma`` (..., 6) in N and N m, corner frame; ``trust`` (...) in 0...1."""

    wrench: Array
    sigma: Array
    trust: Any


@dataclass(frozen=True)
class Calibration:
    """Turns the spread of the members into a standard deviation: sqrt((gain x spread)^2 + floor^2), each shape (6,).

    Fitted on rows that a member had not seen. ``floor`` is in increments (wrench over free-air lift), ``size`` the RMS
    of the increments of the data, against which the spread lowers trust.
    """

    gain: tuple[float, ...]
    floor: tuple[float, ...]
    size: tuple[float, ...]


@dataclass(eq=False, repr=False, kw_only=True)
class FanSurrogate:
    """One fan's wrench over (h, d, rpm), corner frame: lift(rpm) x (free-air share + gate(h, d) x increment(x)).

    Corner frame: X to the wall, Z up. All methods take the same three arrays, which broadcast:

    - ``h``: height of the fan's reference point above the ground [m], ``inf`` where there is none,
    - ``d``: distance of its lip from the wall [m], ``inf`` where there is none,
    - ``rpm``: rotor speed [1/min].

    Exactly the free-air wrench far from both, exactly zero at rest; NaN or a negative speed or distance gives NaN with
    trust 0. Nearer than the data the nearest data hold; outside their rotor speeds the coefficients do, under the lift
    law. ``models.load`` and ``models.train`` make one.
    """

    free_air_law: FreeAir
    coordinates: Coordinates
    regressor: Regressor
    calibration: Calibration
    domain: Domain
    effects: tuple[AdoptedEffect, ...] = ()
    """What a diagnosis has added: name and parameters, SI."""
    info: Mapping[str, Any] = field(default_factory=dict)
    """Everything else model.json says: method, data, metrics, fidelity."""

    def __post_init__(self) -> None:
        if "fan" in self.info:
            return
        for effect in self.effects:
            if get(effect.name).in_flight.of_model is not None:
                raise ModelError(
                    f"{effect.name} needs the fan's radius; diagnose the logs again and save the "
                    "model"
                )

    @cached_property
    def _corrections(self) -> list[LawCorrection]:
        out = []
        for effect in self.effects:
            correct = get(effect.name).in_flight.of_model
            if correct is not None:
                out.append(correct(effect.parameters, self.info["fan"]["radius_m"]))
        return out

    @cached_property
    def _scales(self) -> tuple[Array, Array, Array, Array]:
        """Share of the lift, gain and squared floor of the spread, and what a squared spread takes of trust; (6,)."""
        law = self.free_air_law
        c = self.calibration
        # Doubt is the mean over level forces, lift, tilting moments and torque of (spread / size of the increments)^2.
        # A component that symmetry keeps small is measured by the size of its group: its own size is mostly noise.
        size2 = np.bincount(_GROUP, np.asarray(c.size) ** 2)
        doubt = 1.0 / np.maximum(size2, 1e-24)[_GROUP] / len(size2)
        return (
            np.asarray(law.share),
            np.asarray(c.gain),
            np.maximum(c.floor, law.scatter) ** 2,
            doubt,
        )

    def with_effects(
        self, effects: tuple[AdoptedEffect, ...], info: Mapping[str, Any] | None = None
    ) -> FanSurrogate:
        """The same surrogate with these adopted effects, and ``info`` in place of its own where given."""
        return replace(self, effects=effects, info=self.info if info is None else info)

    def wrench(self, h: ArrayLike, d: ArrayLike, rpm: ArrayLike) -> Array:
        """Total wrench of the fan.

        Parameters
        ----------
        h, d : array_like
            Height and wall distance [m]; ``inf`` where there is none.
        rpm : array_like
            Rotor speed [1/min].

        Returns
        -------
        ndarray (..., 6)
            Force [N] and moment [N m], corner frame. NaN where an input is not a number or below zero.

        Examples
        --------
        >>> import models, numpy as np
        >>> models.load().wrench(np.inf, np.inf, [3000.0, 4000.0]).shape
        (2, 6)
        """
        return self.query(h, d, rpm).wrench

    def predict(self, h: ArrayLike, d: ArrayLike, rpm: ArrayLike) -> Array:
        """The same as ``wrench``, by the name that estimators have for it.

        Parameters
        ----------
        h, d : array_like
            Height and wall distance [m]; ``inf`` where there is none.
        rpm : array_like
            Rotor speed [1/min].

        Returns
        -------
        ndarray (..., 6)
            Force [N] and moment [N m], corner frame.

        Examples
        --------
        >>> import models
        >>> bool((models.load().predict(0.3, 0.2, rpm=0.0) == 0.0).all())
        True
        """
        return self.wrench(h, d, rpm)

    def plot(self, rpm: float | None = None) -> ShownPage:
        """Lift, pull and moment over height and over distance.

        Parameters
        ----------
        rpm : float or None
            Rotor speed [1/min]. None: 4000.

        Returns
        -------
        ShownPage
            A notebook shows it; ``save(FILE)`` writes it as HTML.

        Examples
        --------
        >>> import models
        >>> models.load().plot().save("fan.html").name
        'fan.html'
        """
        from models.surrogate.pictures import surfaces

        return surfaces(self, rpm)

    def __repr__(self) -> str:
        method = self.info.get("method", self.regressor.kind)
        rows = self.info.get("data", {}).get("rows")
        radius = self.info.get("fan", {}).get("radius_m")
        parts = [f"method={method!r}"]
        if rows is not None:
            parts.append(f"rows={rows}")
        if radius is not None:
            parts.append(f"rotor_radius_m={radius:g}")
        parts.append(f"effects={[e.name for e in self.effects]}")
        return f"FanSurrogate({', '.join(parts)})"

    def _repr_html_(self) -> str:
        return self.plot()._repr_html_()

    def trust(self, h: ArrayLike, d: ArrayLike, rpm: ArrayLike) -> Array:
        """How far the answer is to be believed.

        Parameters
        ----------
        h, d : array_like
            Height and wall distance [m]; ``inf`` where there is none.
        rpm : array_like
            Rotor speed [1/min].

        Returns
        -------
        ndarray (...)
            1 inside the data, 0 far outside them; lowered by the spread.

        Examples
        --------
        >>> import models
        >>> models.load().trust([0.3, 0.3], [0.2, 0.2], [4000.0, 40000.0]).round(1).tolist()
        [1.0, 0.0]
        """
        return np.asarray(self.query(h, d, rpm).trust)

    def free_air(self, rpm: ArrayLike) -> Array:
        """Wrench (..., 6) with neither ground nor wall."""
        return self.free_air_law.wrench(rpm)

    def free_air_now(self, rpm: Sequence[float]) -> list[list[float]]:
        """Free-air wrench (6) at some speeds, in plain floats."""
        out: list[list[float]] = self.free_air(rpm).tolist()
        return out

    def query(self, h: ArrayLike, d: ArrayLike, rpm: ArrayLike) -> Answer:
        """Wrench, standard deviation and trust at once.

        Parameters
        ----------
        h, d : array_like
            Height and wall distance [m]; ``inf`` where there is none.
        rpm : array_like
            Rotor speed [1/min].

        Returns
        -------
        Answer
            ``wrench`` and ``sigma`` (..., 6) [N, N m], corner frame; ``trust`` (...) from 0 to 1.

        Examples
        --------
        >>> import models
        >>> answer = models.load().query(h=[0.3, 0.6], d=0.2, rpm=4000.0)
        >>> answer.wrench.shape, answer.sigma.shape, answer.trust.shape
        ((2, 6), (2, 6), (2,))
        """
        shape = np.broadcast(h, d, rpm).shape
        n = math.prod(shape)
        # Filling an array broadcasts as numpy's broadcast_to does, which keeps some memory of each call.
        places = np.empty((3, *shape))
        places[0] = h
        places[1] = d
        places[2] = rpm
        h, d, rpm = places.reshape(3, n)
        if n <= CHUNK:
            wrench, sigma, trust = self._batch(h, d, rpm)
        else:
            parts = [slice(start, start + CHUNK) for start in range(0, n, CHUNK)]
            answers = [self._batch(h[part], d[part], rpm[part]) for part in parts]
            wrench, sigma, trust = map(np.concatenate, zip(*answers, strict=True))
        for correction in self._corrections:
            wrench, trust = correction.amended(h, d, wrench, self.free_air(rpm), trust)
        return Answer(wrench.reshape(*shape, 6), sigma.reshape(*shape, 6), trust.reshape(shape))

    def _batch(self, h: Array, d: Array, rpm: Array) -> tuple[Array, Array, Array]:
        least = np.minimum(np.minimum(h, d), rpm)
        unknown = ~((least >= 0.0) & (rpm < np.inf))
        some_unknown = unknown.any()
        if some_unknown:
            h = np.where(unknown, np.inf, h)
            d = np.where(unknown, np.inf, d)
            rpm = np.where(unknown, 0.0, rpm)
        x, gate = self.coordinates.inputs(h, d, rpm)
        lift = self.free_air_law.lift(rpm)[:, None]
        mean, spread = self.regressor.predict(x)
        share, gain, floor2, doubt = self._scales
        spread *= gate * gain
        spread *= spread
        wrench = lift * (gate * mean + share)
        sigma = lift * np.sqrt(spread + floor2)
        trust = self.domain.trust(x, h, d, rpm) / (1.0 + spread @ doubt)
        if some_unknown:
            wrench[unknown] = np.nan
            sigma[unknown] = np.nan
            trust[unknown] = 0.0
        return wrench, sigma, trust
