"""What adaptation remembers from one sample to the next. Plain data."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from companion.adaptation import judge
from companion.adaptation.apply import Applied
from companion.adaptation.block import AXES, Block
from companion.adaptation.channel import Channel
from companion.adaptation.gates import NO_IMU
from companion.adaptation.sizes import LIFT, Size, SizeEstimate, Sizes, channels, estimates
from companion.disturbance.records import Disturbance
from models.common.frames import Array, Rows

MODELS = ("lift_model", "pull_model", "tilt_model")
"""Names of the probabilities that the model is right in a channel, and not only none."""


@dataclass(frozen=True, kw_only=True)
class Adaptation:
    """All that is remembered of sizes."""

    table: tuple[Size, ...]
    sizes: Sizes
    channels: tuple[Channel, ...]
    """Lift, pull and tilt."""
    judged: tuple[judge.Belief, ...]
    """What is believed of each."""
    believed: Applied
    """Both hypotheses' mean: gains on the model's lift, pull and tilt, and what is measured beside."""
    wanted: Applied
    """What follows from it."""
    applied: Applied
    """What offsets follow: on its way to that."""
    variance: Array
    """(5,): what an axis' residual scatters by from one block to the next."""
    learned: tuple[bool, ...]
    """Whether a channel was ever excited."""
    of_walls: tuple[bool, ...] = ()
    """Which of the adopted effects with a size say nothing of ground and wall together."""
    block: Block | None = None
    full: tuple[Block, Disturbance, Rows] | None = None
    """What ``learn`` is to take in: a block, the surroundings and the rotation FRD -> NED at its end."""
    innovation: Array | None = None
    """(5,): of the newest block."""
    modelled: Array | None = None
    """(5,): of the newest block."""
    surprised: tuple[int, ...] = (0,) * AXES
    """For how many blocks in a row each axis has been far off to one side."""
    source: str = ""
    """The accelerometer that is listened to: the first that speaks."""
    heard_s: float = -math.inf
    paused: str | None = NO_IMU
    """Why nothing is learned now, as the pilot reads it."""
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

    def estimates(self) -> dict[str, SizeEstimate]:
        """Every size by its name; then the ground's lift where no model is believed, and how far a model is."""
        out = estimates(self.table, self.sizes)
        out["cheeseman_bennett"] = SizeEstimate(
            *judge.ground_measured(self.channels[LIFT], self.judged[LIFT]), "1"
        )
        for name, judged in zip(MODELS, self.judged, strict=True):
            p = judged.probability
            out[name] = SizeEstimate(p, math.sqrt(p * (1.0 - p)), "probability")
        return out

    def share_by_name(self) -> dict[str, float]:
        """The share of the model's wrench that is compensated, by the size it follows."""
        return {
            self.table[k].name: share
            for k, share in zip(channels(self.table), self.shares, strict=True)
        }

    def as_json(self) -> dict[str, Any]:
        """``{name: {"value", "sd", "unit"}}``."""
        return {
            name: {"value": round(e.value, 4), "sd": round(e.sd, 4), "unit": e.unit}
            for name, e in self.estimates().items()
        }
