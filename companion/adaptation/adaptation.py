"""What adaptation remembers of the sizes that it measures, from one sample of the accelerometer to the next."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

from companion.adaptation import judge
from companion.adaptation import residual as block_of
from companion.adaptation.apply import Applied
from companion.adaptation.near_map import NearField
from companion.adaptation.pause import Pause
from companion.adaptation.sizes import LIFT, Estimate, Size, Sizes, channels, told
from companion.estimation.disturbance import Disturbance
from models.frames import Array, Rows

MODELS = ("lift_model", "pull_model", "tilt_model")
"""Names of the probabilities that the model is right in a channel, and not only none."""


@dataclass(frozen=True)
class Noise:
    """What an axis' residual scatters by from one block to the next: variance (5,), and the newest innovations (5,)."""

    variance: Array
    innovation: Array | None = None


class FullBlock(NamedTuple):
    """A block that is full, with the surroundings and the rotation FRD -> NED at its end."""

    block: block_of.Block
    here: Disturbance
    rotation: Rows


class ModelAverage(NamedTuple):
    """Both hypotheses' mean: gains on the model's lift, pull and tilt, and what is measured beside."""

    gains: tuple[float, ...]
    near: NearField


@dataclass(frozen=True)
class Adaptation:
    """All that is remembered of sizes."""

    table: tuple[Size, ...]
    sizes: Sizes
    channels: tuple[judge.Channel, ...]
    """Lift, pull and tilt."""
    judged: tuple[judge.Belief, ...]
    """What is believed of each."""
    believed: ModelAverage
    wanted: Applied
    """What follows from it."""
    applied: Applied
    """What offsets follow: on its way to that."""
    noise: Noise
    learned: tuple[bool, ...]
    """Whether a channel was ever excited."""
    block: block_of.Block | None = None
    full: FullBlock | None = None
    """What ``learn`` is to take in."""
    modelled: Array | None = None
    """(5,): of the newest block."""
    surprised: tuple[int, ...] = (0,) * block_of.AXES
    """For how many blocks in a row each axis has been far off to one side."""
    source: str = ""
    """The accelerometer that is listened to: the first that speaks."""
    heard_s: float = -math.inf
    paused: Pause | None = Pause.NO_IMU
    paused_s: float = -math.inf
    """When a reason not to learn last held."""
    clear: Disturbance | None = None
    """The newest surroundings among which something may be learned: looked at once."""
    updated_s: float = -math.inf
    learned_s: float = 0.0
    """Time of flight that was learned from."""

    @property
    def shares(self) -> tuple[float, ...]:
        """Of the model's lift, pull, tilt and of every adopted effect with a size: what is compensated."""
        return self.applied.shares

    def told(self) -> dict[str, Estimate]:
        """Every size by its name; then the ground's lift where no model is believed, and how far a model is."""
        out = told(self.table, self.sizes)
        out["cheeseman_bennett"] = Estimate(*judge.ground_measured(self.channels[LIFT], self.judged[LIFT]), "1")
        for name, judged in zip(MODELS, self.judged, strict=True):
            p = judged.probability
            out[name] = Estimate(p, math.sqrt(p * (1.0 - p)), "probability")
        return out

    def share_by_name(self) -> dict[str, float]:
        """The share of the model's wrench that is compensated, by the size it follows."""
        return {self.table[k].name: share for k, share in zip(channels(self.table), self.shares, strict=True)}

    def as_json(self) -> dict[str, Any]:
        """``{name: {"value", "sd", "unit"}}``."""
        return {
            name: {"value": round(e.value, 4), "sd": round(e.sd, 4), "unit": e.unit} for name, e in self.told().items()
        }
