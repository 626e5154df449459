"""The thrust that hovers in free air: learned while the autopilot flies, else what a parameter or the file says."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from models.common.frozen_copy import with_changes

_MEAN_S = 2.0
"""Time constant of the average."""
LEARNED_S = 1.0
"""So much hovering under the autopilot gives a thrust to engage with: to 1 % on both firmwares' recordings."""
HEARD_AGE_S = 1.0
DISAGREEMENT = 0.15
"""Parameter and vehicle file may differ by this share where nothing could be learned."""
_LOW = 0.05
_HIGH = 0.95
"""Thrust outside of this is idling or full power, never hovering."""
_MIN_SHARE = 0.005
"""Of one message in the average: stamps that stand still must not stop the learning."""


@dataclass(frozen=True)
class HoverThrust:
    """From ATTITUDE_TARGET: the average while the autopilot hovered, and what it asks for now."""

    learned: float | None = None
    """Free of what the ground gave."""
    seconds: float = 0.0
    """How long the average has been fed."""
    now: float = math.nan
    """Thrust 0...1 of the newest message."""
    now_s: float = -math.inf


def heard(hover: HoverThrust, t_s: float, thrust: float) -> HoverThrust:
    """Remember the thrust that flies."""
    return with_changes(hover, now=thrust, now_s=t_s)


def learn(hover: HoverThrust, t_s: float, thrust: float, cushion: float) -> HoverThrust:
    """Average the autopilot's own thrust. ``cushion`` is the thrust offset that the surroundings would need now."""
    if not _LOW < thrust < _HIGH:
        return hover
    free = thrust - cushion
    if hover.learned is None:
        return HoverThrust(free, 0.0, thrust, t_s)
    dt = min(max(t_s - hover.now_s, 0.0), 0.1)
    share = max(dt / _MEAN_S, _MIN_SHARE)
    return HoverThrust(
        hover.learned + share * (free - hover.learned), hover.seconds + dt, thrust, t_s
    )


def hover_parameter(parameters: Mapping[str, float]) -> float | None:
    """What the autopilot's own parameter says: MOT_THST_HOVER or MPC_THR_HOVER."""
    return parameters.get("MOT_THST_HOVER", parameters.get("MPC_THR_HOVER"))


def best_hover(hover: HoverThrust, parameters: Mapping[str, float], declared: float) -> float:
    """Learned in flight, else the parameter, else the vehicle file's."""
    if hover.learned is not None and hover.seconds >= LEARNED_S:
        return hover.learned
    named = hover_parameter(parameters)
    if named is None:
        return declared
    return named


def is_known(
    hover: HoverThrust, t_s: float, parameters: Mapping[str, float], declared: float
) -> bool:
    """Whether the hover thrust is good enough to engage with.

    Where the autopilot sends its thrust, that must have been learned: parameters are off by a tenth (ArduPilot) or
    never set (PX4's default is 0.5 on every vehicle). Where it does not, parameter and vehicle file must agree.
    """
    if hover.seconds >= LEARNED_S:
        return True
    if t_s - hover.now_s < HEARD_AGE_S:
        return False
    named = hover_parameter(parameters)
    return named is None or abs(named - declared) <= DISAGREEMENT * declared
