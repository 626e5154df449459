"""The air around one fan near ground and wall: the simulated vehicle's truth, different from what the model believes.

Scalar, plain floats: the simulator calls it for every fan at every physics step.

The default model is trained on ``models/corner_law.py``. A truth with the same formulas would flatter it, so this one
shares neither formulas nor constants with it, only the facts that both have to respect (lift over ground, attraction
and tilt to the wall, loss of lift where the flow off the wall is drawn in again, nothing beyond the cut-offs):

- over ground Hayden's fit of helicopters in hover, T/T0 = (1 + 0.152/eta^2)^(2/3), in place of an exponential (J. S.
  Hayden, "The effect of the ground on helicopter hovering power required", 32nd AHS Forum, 1976, constant power);
- near a wall and in the trapped air algebraic decay 1/(1 + (x/L)^2), in place of exponentials;
- the re-ingestion ridge is a hyperbolic secant over the logarithm of the height, in place of a Gaussian, and lies
  elsewhere;
- the thrust coefficient grows otherwise with the Reynolds number.

``disturbed(seed)`` redraws its constants as well. Sizes are engineering estimates: no measurement of this fan exists.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from models.common.frames import Array
from models.corner_law import ClosedForm

RPM_HOVER = 4000.0
"""Rotor speed at which the paper's vehicle hovers."""
PAPER_CT = 0.0450662
"""T/(rho A Omega^2 R^2) of the paper's coaxial fan: half of 4.6 kg at 4000 rpm."""
PAPER_CQ = 0.0079722
"""Q/(rho A Omega^2 R^3) of one rotor of it: an engineering estimate."""
REYNOLDS_EXPONENT = 0.055
"""Growth of C_T with rotor speed, a power of it: an engineering estimate, other than the surrogate's."""
RMS_FREE = 0.003
"""Unsteadiness of a free fan, of its lift."""
GROUND_FADE = (3.1, 4.0)  # rotor radii: the paper sees nothing beyond 4 r over ground ...
WALL_FADE = (2.7, 3.8)  # ... and nothing beyond 3.8 r from a wall


@dataclass(frozen=True, slots=True, kw_only=True)
class Increments:
    """What the surroundings add, corner frame: forces / T0, moments / (T0 R), ``mz`` / Q0, and rms unsteadiness / T."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    mx: float = 0.0
    my: float = 0.0
    mz: float = 0.0
    rms: float = RMS_FREE


class SurfaceLaw(Protocol):
    """What ground and wall do to one fan: the world that a simulated flight takes place in."""

    def increments(self, eta: float, delta: float) -> Increments:
        """At height ``eta`` = h/R and lip-to-wall distance ``delta`` = d/R (either may be inf: none there)."""
        ...


def _fade(x: float, low: float, high: float) -> float:
    """1 below ``low``, 0 above ``high``, half a cosine between."""
    if x <= low:
        return 1.0
    if x >= high:
        return 0.0
    return 0.5 + 0.5 * math.cos(math.pi * (x - low) / (high - low))


def _decay(x: float, length: float) -> float:
    return 1.0 / (1.0 + (x / length) ** 2)


@dataclass(frozen=True, kw_only=True)
class LawConstants:
    """Constants of the law: lengths in rotor radii, strengths as shares of free-air thrust (moments: of T0 R).

    ``ground_curve`` is Hayden's; all others are engineering estimates (see the head of this file).
    """

    ground_gain: float = 1.15
    ground_curve: float = 0.152
    intake_loss: float = 0.032
    """Loss of lift where the ground blocks the duct's outflow."""
    intake_length: float = 0.65
    wall_lift: float = 0.015
    wall_pull: float = 0.019
    wall_reach: float = 0.88
    tilt: float = 0.056
    tilt_reach: float = 1.05
    ridge_height: float = 1.18
    ridge_slope: float = 0.82
    ridge_width: float = 0.36
    ridge_reach: float = 1.75
    ridge_lift: float = 0.074
    ridge_tilt: float = 0.80
    ridge_pull: float = 0.010
    trapped_length: float = 0.68
    """Air trapped between ground, wall and fan."""
    trapped_lift: float = 0.055
    trapped_tilt: float = 0.042
    trapped_pull: float = 0.082
    side_share: float = 0.068
    """Side force and moment per lateral ones."""
    torque_ground: float = 0.042
    torque_length: float = 0.70
    torque_ridge: float = 0.024
    rms_free: float = RMS_FREE
    rms_ground: float = 0.017
    rms_ridge: float = 0.013

    def increments(self, eta: float, delta: float) -> Increments:
        """The law at height ``eta`` = h/r and wall distance ``delta`` = d/r (either may be inf)."""
        eta = max(eta, 0.6)
        delta = max(delta, 0.05)
        over_ground = _fade(eta, *GROUND_FADE)
        at_wall = _fade(delta, *WALL_FADE)
        if over_ground == 0.0 and at_wall == 0.0:
            return Increments(rms=self.rms_free)
        z = x = m = mz = 0.0
        rms = self.rms_free
        if over_ground > 0.0:
            hayden = (1.0 + self.ground_curve / eta**2) ** (2.0 / 3.0)
            z += self.ground_gain * (hayden - 1.0) * over_ground
            z -= self.intake_loss * _decay(eta, self.intake_length) ** 2 * over_ground
            mz += self.torque_ground * _decay(eta, self.torque_length) * over_ground
            rms += self.rms_ground * _decay(eta, 1.0) * over_ground
        if at_wall > 0.0:
            near = _decay(delta, self.wall_reach) * at_wall
            z += self.wall_lift * near
            x += self.wall_pull * near
            m += self.tilt * _decay(delta, self.tilt_reach) * at_wall
            if over_ground > 0.0:
                both = over_ground * at_wall
                ridge_at = self.ridge_height + self.ridge_slope * delta
                offset = math.log(eta / ridge_at) / self.ridge_width
                ridge = _decay(delta, self.ridge_reach) / math.cosh(min(abs(offset), 50.0)) * both
                narrow = _decay(eta, self.trapped_length) * _decay(delta, self.trapped_length)
                trapped = narrow**2 * both
                z += self.trapped_lift * trapped - self.ridge_lift * ridge
                x -= self.ridge_pull * ridge + self.trapped_pull * trapped
                m += m * self.ridge_tilt * ridge - self.trapped_tilt * trapped
                mz += self.torque_ridge * ridge
                rms += self.rms_ridge * ridge
        y = self.side_share * x
        mx = -self.side_share * m
        return Increments(x=x, y=y, z=z, mx=mx, my=m, mz=mz, rms=rms)


NOMINAL = LawConstants()


@dataclass(frozen=True)
class LawError:
    """How wrong one law is about another: RMS of the difference over RMS of the truth, by axis."""

    lift: float
    pull: float
    tilt: float

    @staticmethod
    def of(believed: ArrayLike, true: ArrayLike) -> LawError:
        """From (lift, pull, tilt) at the same places, shape (n, 3)."""
        said = np.asarray(believed)
        real = np.asarray(true)
        wrong = np.sum((real - said) ** 2, axis=0)
        shares = np.sqrt(wrong / np.sum(real**2, axis=0))
        return LawError(*shares.tolist())


_ETAS = (1.0, 1.2, 1.4, 1.7, 2.0, 2.5, 3.0, 3.5, math.inf)
_DELTAS = (0.35, 0.5, 0.75, 1.0, 1.5, 2.0, 2.8, math.inf)
CORNER_PLACES = tuple(product(_ETAS, _DELTAS))
"""(h/R, d/R) where a corner flight goes; ground alone and wall alone belong to it."""


@lru_cache(maxsize=1)
def _closed_form() -> Array:
    """Lift, pull and tilt that the law behind the default model says at ``CORNER_PLACES``."""
    law = ClosedForm()
    eta, delta = np.array(CORNER_PLACES).T
    wrench = law.wrench(eta * law.radius_m, delta * law.radius_m, RPM_HOVER)
    free_n = float(law.lift(RPM_HOVER))
    lift = wrench[:, 2] / free_n - 1.0
    pull = wrench[:, 0] / free_n
    tilt = wrench[:, 4] / (free_n * law.radius_m)
    return np.stack([lift, pull, tilt], axis=1)


def closed_form_error(truth: SurfaceLaw) -> LawError:
    """Of the law behind the default model, over ``CORNER_PLACES``."""
    real = [truth.increments(eta, delta) for eta, delta in CORNER_PLACES]
    return LawError.of(_closed_form(), [(i.z, i.x, i.my) for i in real])


def disturbed(seed: int) -> LawConstants:
    """The law with its constants drawn at random, such that the default model's law is wrong by 10 to 30 %.

    Every constant is multiplied by a log-normal factor (sd 0.12; 0.08 for the better-known lengths). A draw is taken
    when lift and tilt are both wrong by 10...30 % and the pull by at most 40 %; seed 0 is not special.
    """
    rng = random.Random(f"air {seed}")
    lengths = ("length", "height", "reach")
    while True:
        constants = {}
        for name, value in vars(NOMINAL).items():
            sd = 0.08 if name.endswith(lengths) else 0.12
            constants[name] = value * math.exp(rng.gauss(0.0, sd))
        truth = LawConstants(**constants)
        error = closed_form_error(truth)
        wrong_enough = min(error.lift, error.tilt) >= 0.10
        if wrong_enough and max(error.lift, error.tilt) <= 0.30 and error.pull <= 0.40:
            return truth


class Unsteadiness:
    """Slow random share of thrust per channel: unit-variance first-order noise, correlation time 0.1 s."""

    def __init__(self, seed: str, channels: int, dt: float, tau: float = 0.1) -> None:
        self._rng = random.Random(seed)
        self._tau = tau
        self.values = [0.0] * channels
        self.change_step(dt)

    def change_step(self, dt: float) -> None:
        """Steps of another length [s] from here on."""
        self._keep = math.exp(-dt / self._tau)
        self._kick = math.sqrt(1.0 - self._keep**2)

    def step(self) -> list[float]:
        """Advance by one physics step; the values have unit variance."""
        gauss = self._rng.gauss
        keep = self._keep
        kick = self._kick
        self.values = [keep * v + kick * gauss(0.0, 1.0) for v in self.values]
        return self.values
