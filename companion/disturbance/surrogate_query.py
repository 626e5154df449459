"""One query of the surrogate for every fan, and what the surroundings add to free air."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from companion.disturbance.fan_query import FanQuery
from companion.disturbance.stable_gain import STIFFNESS_STEP_M
from models.surrogate.fan_surrogate import FanSurrogate

Wrenches = list[list[float]]
"""(fans, 6), corner frame."""


class SurrogateAnswer(NamedTuple):
    """What the surrogate says of every fan."""

    lift_n: list[float]
    """At the lead of thrust."""
    wrenches: Wrenches
    """At the lead of tilt."""
    pull_change_n: float
    """By how much the wall pulls all fans less, a step further off."""
    trust: list[float]
    """At the lead of thrust, 0...1."""


def surrogate_answer(
    model: FanSurrogate, at_thrust_lead: FanQuery, at_tilt_lead: FanQuery
) -> SurrogateAnswer:
    """The answer to one query, shape (rows, fans).

    Rows: at the lead of thrust, of tilt, and, beside a wall, a step further off it at the lead of tilt.
    """
    h = [at_thrust_lead.h_m, at_tilt_lead.h_m]
    d = [at_thrust_lead.d_m, at_tilt_lead.d_m]
    beside_wall = min(at_tilt_lead.d_m) < math.inf
    if beside_wall:
        h = [*h, at_tilt_lead.h_m]
        d = [*d, tuple([d_m + STIFFNESS_STEP_M for d_m in at_tilt_lead.d_m])]
    answer = model.query(np.array(h), np.array(d), np.array(at_thrust_lead.rpm))
    pulls = answer.wrench[:, :, 0].sum(axis=1)
    if beside_wall:
        pull_change_n = float(pulls[1] - pulls[2])
    else:
        pull_change_n = 0.0
    return SurrogateAnswer(
        lift_n=answer.wrench[0, :, 2].tolist(),
        wrenches=answer.wrench[1].tolist(),
        pull_change_n=pull_change_n,
        trust=answer.trust[0].tolist(),
    )


def above_free_air(answer: SurrogateAnswer, free: Wrenches) -> Wrenches:
    """(fans, 6), corner frame: what the surroundings add to free air ``free`` (fans, 6)."""
    out = []
    for fan, lift, alone in zip(answer.wrenches, answer.lift_n, free, strict=True):
        added = [near - far for near, far in zip(fan, alone, strict=True)]
        added[2] = lift - alone[2]
        out.append(added)
    return out
