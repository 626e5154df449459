"""What ``step`` says about a decision."""

from __future__ import annotations

from typing import NamedTuple

from companion.adaptation.adaptation import Adaptation
from companion.control.compensation import Offset
from companion.control.plant import HoldTuning
from companion.control.position_hold import BaseSetpoint
from companion.control.reasons import Notice, Reason
from companion.disturbance.records import Disturbance
from companion.mavlink.setpoints import Command


class Decision(NamedTuple):
    """What was decided at ``t_s``, and all that a pilot or an analyst wants to know about why."""

    t_s: float
    command: Command | None
    reasons: tuple[Reason, ...]
    authority: float
    offset: Offset
    """Applied: after trust, limits, slew and fade."""
    base: BaseSetpoint | None
    disturbance: Disturbance | None
    late_s: float = 0.0
    """How late the attitude or position behind it arrived."""
    tuned: HoldTuning | None = None
    """Gains of the hold and their margin; None for an upstream controller."""
    notice: tuple[Notice, float] | None = None
    adaptation: Adaptation | None = None
    """The sizes measured so far."""
