"""What adaptation may do about what it learns, and every number of it."""

from __future__ import annotations

from argparse import ArgumentTypeError
from dataclasses import dataclass
from enum import Enum


class Adapt(Enum):
    """What the sizes that are measured in flight do to the offsets."""

    OFF = "off"
    """Nothing is measured."""
    FULL = "full"
    """Offsets follow the measured sizes, up to ``AdaptTuning.most`` of the model's."""


def read_adapt(text: str) -> Adapt:
    """The value of ``--adapt``, for argparse."""
    if text == "gate":
        raise ArgumentTypeError("gate is not available; use full, which measures the same, or off")
    try:
        return Adapt(text)
    except ValueError:
        raise ArgumentTypeError(f"invalid choice: '{text}' (choose from {', '.join(m.value for m in Adapt)})") from None


@dataclass(frozen=True, slots=True)
class AdaptTuning:
    """Numbers of the adaptation; SI. Where no source stands beside a number it is a choice of this project."""

    block_s: float = 0.2
    """Measured and modelled wrench are averaged over this: the one filter that both go through."""
    least_samples: int = 4
    """Of the accelerometer in a block: 20 Hz, as diagnosis asks for moments."""
    imu_gap_s: float = 0.1
    """A longer silence of the accelerometer starts a new block."""
    imu_lag_s: float = 0.03
    """The accelerometer is delayed by this, which is how late rotor speeds are (``Tuning.rotor_delay_s``)."""
    lag_doubt_s: float = 0.03
    """What may be left of that: a modelled wrench that changes quickly is trusted less."""
    alike: float = 2.0
    """Variance of a block's noise over that of its differences: errors of neighbours are alike. Chosen such that the
    90 % intervals of simulated flights cover (docs/lab/adaptation.md)."""
    alike_near: float = 4.0
    """The same for the map, which is wrong by what bilinear cells cannot follow, too."""
    noise_mean_s: float = 20.0
    """Over which the noise of an axis is averaged."""
    force_floor: float = 0.003
    """Least noise of a block, of the weight: a third of a centi-g of an accelerometer's drift."""
    moment_floor: float = 0.001
    """The same, of the weight times the farthest fan's arm."""
    free_air_s: float = 0.5
    """Where only steady sizes are seen they are looked at so often: every third block."""
    robust_sigmas: float = 2.5
    """A residual counts no more than this many standard deviations (Huber 1964, Ann. Math. Statist. 35, 73)."""
    surprised_blocks: int = 4
    """After so many of them in a row to one side something has jumped: a load, a gust front."""
    excited: float = 0.2
    """A size learns from an axis where its prior's sd would move the axis by this share of the axis' noise."""
    pause_s: float = 0.6
    """After a reason not to learn has gone: what it did to the filters of ranges and rotors has gone too."""
    airborne_s: float = 2.0
    near_wall_m: float = 0.03
    """Lip to wall: nearer, it may touch."""
    near_ground_radii: float = 0.1
    """The same for the ground, in rotor radii, as in diagnosis."""
    reach_radii: float = 4.0
    """So far ground and wall reach (Ai et al. 2020): nearer, a model without them explains nothing."""
    clipped_m_s2: float = 60.0
    """Of an accelerometer: a bump, or the end of its scale."""
    tilt_cos: float = 0.87
    """Cosine of 30 degrees: beyond, nobody hovers."""
    external_share: float = 0.40
    """Of the weight: more force than this that is not the rotors' is a hand or a surface."""
    nothing: float = 0.05
    """A smaller share of the model is none."""
    most: float = 1.5
    """Of the model's wrench, in any channel."""
    give_1_s: float = 0.25
    """How fast a channel's share may grow: from nothing to all in four seconds, slower than the hold's integrators."""
    take_1_s: float = 1.0
    """How fast it may shrink: a fade like others (``Tuning.fade_in_s``)."""
    form: float = 0.5
    """A model whose size is wrong is wrong in form too: sd of the gain from place to place, by its distance from 1."""
    map_sd: tuple[float, float, float] = (0.05, 0.012, 0.05)
    """Prior sd of what is measured of lift, pull (of a fan's thrust) and tilt (of that times the radius) without a
    model, within two rotor radii: half of the largest that is published (Ai et al. 2020; docs/lab/adaptation.md)."""
    left_sd: tuple[float, float, float] = (0.015, 0.004, 0.015)
    """The same of what a right model leaves: its law is 10 to 30 % off."""
    ground_sd: float = 1.0
    """Prior sd of the ground's lift in Cheeseman and Bennett's; its mean is 0, so that nothing is applied unseen."""
    drift: float = 0.3
    """Change of gain, ground's lift and map in a minute, of their prior sd."""
    calm_wind: float = 0.25
    """Change of the wind in a minute while the pull is judged, of what it may change otherwise: a gust is a jump."""
    odds: float = 1.0
    """Of a model against none before any flight that was saved with it."""
    another_day: float = 0.5
    """Sd of a map, gain or ground's lift that was saved, of the prior's."""
    evidence: float = 0.5
    """Of a block's log likelihood: neighbours are alike."""
    most_log_odds: float = 4.0
    """Bound of the odds, so that a model that was contradicted can come back: 0.02 to 0.98."""
    map_1_s: float = 0.02
    """How fast what is applied of the map may change, of a fan's thrust: 0.08 in four seconds, as shares grow."""
    heavy: float = 0.3
    """Prior sd of a gain on the model: its law is that of another fan in another place. 10 to 30 % is what the built-in
    vehicle's air differs by (docs/lab/simulator.md)."""
