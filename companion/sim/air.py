"""The air around one fan near ground and wall: the closed-form corner law (fidelity 0), disturbed per seed.

Scalar, plain floats: the simulator calls it for every fan at every physics step.
Source of the law: the project's physics notes, section 9 (semi-empirical, anchored on the paper's statements).
"""

from __future__ import annotations

import math
import random
from dataclasses import asdict, dataclass, fields, replace

RPM_HOVER = 4000.0
PAPER_CT = 0.0450662  # T/(rho A Omega^2 R^2) of the paper's coaxial fan: half of 4.6 kg at 4000 rpm
PAPER_CQ = 0.0079722
REYNOLDS_EXPONENT = 0.04


@dataclass(frozen=True)
class LawConstants:
    """Constants of the law: lengths in rotor radii, strengths as shares of free-air thrust (moments: of T0 R)."""

    duct_share: float = 0.40
    rotor_gain: float = 0.60
    rotor_length: float = 0.85
    duct_loss: float = 0.45
    duct_length: float = 0.40
    wall_lift: float = 0.018
    wall_lift_length: float = 0.90
    lip_asymmetry: float = 0.30
    lip_length: float = 1.10
    wall_pull: float = 0.022
    wall_pull_length: float = 0.90
    ridge_height: float = 1.30
    ridge_slope: float = 0.75
    ridge_width: float = 0.45
    ridge_length: float = 1.60
    ridge_lift: float = 0.085
    ridge_tilt: float = 0.90
    ridge_pull: float = 0.012
    cushion_height: float = 0.60
    cushion_length: float = 0.60
    cushion_lift: float = 0.045
    cushion_tilt: float = 0.035
    cushion_pull: float = 0.070
    swirl: float = 0.08
    torque_ground: float = 0.05
    torque_ridge: float = 0.03
    rms_free: float = 0.003
    rms_ground: float = 0.020
    rms_ridge: float = 0.015


NOMINAL = LawConstants()
GROUND_FADE = (3.0, 4.0)  # rotor radii: the paper sees nothing beyond 4 r over ground ...
WALL_FADE = (2.8, 3.8)  # ... and nothing beyond 3.8 r from a wall


@dataclass(frozen=True, slots=True)
class Increments:
    """What the surroundings add, corner frame: forces / T0, moments / (T0 R), ``mz`` / Q0, and rms unsteadiness / T."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    mx: float = 0.0
    my: float = 0.0
    mz: float = 0.0
    rms: float = NOMINAL.rms_free


def _fade(x: float, low: float, high: float) -> float:
    """1 below ``low``, 0 above ``high``, quintic between."""
    if x <= low:
        return 1.0
    if x >= high:
        return 0.0
    t = (x - low) / (high - low)
    return 1.0 - t * t * t * (10.0 - 15.0 * t + 6.0 * t * t)


def increments(c: LawConstants, eta: float, delta: float) -> Increments:
    """The law at height ``eta`` = h/r and wall distance ``delta`` = d/r (either may be inf)."""
    eta, delta = max(eta, 0.3), max(delta, 0.05)
    over_ground, at_wall = _fade(eta, *GROUND_FADE), _fade(delta, *WALL_FADE)
    if over_ground == 0.0 and at_wall == 0.0:
        return Increments(rms=c.rms_free)
    exp = math.exp
    z = x = m = mz = 0.0
    rms = c.rms_free
    if over_ground > 0.0:
        rotor = c.rotor_gain * exp(-eta / c.rotor_length) * over_ground
        duct = -c.duct_loss * exp(-eta / c.duct_length) * over_ground
        z += (1.0 - c.duct_share) * rotor + c.duct_share * duct
        mz += c.torque_ground * exp(-eta / 0.8) * over_ground
        rms += c.rms_ground * exp(-eta) * over_ground
    if at_wall > 0.0:
        z += c.wall_lift * exp(-delta / c.wall_lift_length) * at_wall
        x += c.wall_pull * exp(-delta / c.wall_pull_length) * at_wall
        m += 0.5 * c.duct_share * c.lip_asymmetry * exp(-delta / c.lip_length) * at_wall
        if over_ground > 0.0:
            both = over_ground * at_wall
            offset = math.log(eta / (c.ridge_height + c.ridge_slope * delta)) / c.ridge_width
            ridge = exp(-offset * offset) * exp(-delta / c.ridge_length) * both
            cushion = exp(-eta / c.cushion_height) * exp(-delta / c.cushion_length) * both
            z += c.cushion_lift * cushion - c.ridge_lift * ridge
            x -= c.ridge_pull * ridge + c.cushion_pull * cushion
            m += m * c.ridge_tilt * ridge - c.cushion_tilt * cushion
            mz += c.torque_ridge * ridge
            rms += c.rms_ridge * ridge
    return Increments(x, c.swirl * x, z, -c.swirl * m, m, mz, rms)


@dataclass(frozen=True)
class SurrogateError:
    """How wrong the undisturbed law is about the disturbed one: RMS of the difference / RMS of the truth, per axis."""

    lift: float
    pull: float
    tilt: float


# Where a corner flight goes: rotor radii. inf = ground alone and wall alone belong to it.
_ETAS = (1.0, 1.2, 1.4, 1.7, 2.0, 2.5, 3.0, 3.5, math.inf)
_DELTAS = (0.35, 0.5, 0.75, 1.0, 1.5, 2.0, 2.8, math.inf)


def surrogate_error(truth: LawConstants) -> SurrogateError:
    """Relative error of the undisturbed law over the region of a corner flight."""
    sums = {"x": [0.0, 0.0], "z": [0.0, 0.0], "my": [0.0, 0.0]}
    for eta in _ETAS:
        for delta in _DELTAS:
            a, b = increments(truth, eta, delta), increments(NOMINAL, eta, delta)
            for axis, pair in sums.items():
                true, model = getattr(a, axis), getattr(b, axis)
                pair[0] += (model - true) ** 2
                pair[1] += true * true
    ratio = {axis: math.sqrt(wrong / right) for axis, (wrong, right) in sums.items()}
    return SurrogateError(lift=ratio["z"], pull=ratio["x"], tilt=ratio["my"])


def disturbed(seed: int) -> LawConstants:
    """The law with its constants drawn at random, such that the undisturbed law is wrong by 10 to 30 %.

    Every constant is multiplied by a log-normal factor (sd 0.15; 0.10 for the better-known lengths). A draw is taken
    when lift and tilt are both wrong by 10...30 % and the pull by at most 40 %; seed 0 is not special.
    """
    rng = random.Random(f"air {seed}")
    while True:
        factors = {
            f.name: value * math.exp(rng.gauss(0.0, 0.10 if f.name.endswith(("length", "height")) else 0.15))
            for f in fields(NOMINAL)
            for value in (asdict(NOMINAL)[f.name],)
        }
        truth = replace(NOMINAL, **factors)
        error = surrogate_error(truth)
        if 0.10 <= error.lift <= 0.30 and 0.10 <= error.tilt <= 0.30 and error.pull <= 0.40:
            return truth


class Unsteadiness:
    """Slow random share of thrust per channel: unit-variance first-order noise, correlation time 0.1 s."""

    def __init__(self, seed: str, channels: int, dt: float, tau: float = 0.1) -> None:
        self._rng = random.Random(seed)
        self._keep = math.exp(-dt / tau)
        self._kick = math.sqrt(1.0 - self._keep**2)
        self.values = [0.0] * channels

    def step(self) -> list[float]:
        """Advance by one physics step; the values have unit variance."""
        gauss, keep, kick = self._rng.gauss, self._keep, self._kick
        self.values = [keep * v + kick * gauss(0.0, 1.0) for v in self.values]
        return self.values
