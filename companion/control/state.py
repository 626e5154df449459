"""What ``step`` remembers between samples, and what it says about a decision."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from companion.adaptation.adapt import Adaptation
from companion.control.attitude_response import AttitudeResponse
from companion.control.compensation import Offset, Offsets
from companion.control.engagement import Balance, Engagement
from companion.control.hand_over import HandOver
from companion.control.hover_thrust import HoverThrust
from companion.control.landed import Airborne
from companion.control.plant import AttitudeLoop, HoldTuning, Timing
from companion.control.position_hold import BaseSetpoint, Hold
from companion.control.position_target import Target
from companion.control.reasons import Notice, Reason
from companion.control.survey import Survey
from companion.control.swing_detector import SwingDetector
from companion.control.wall_guard import WallAhead
from companion.disturbance.records import Disturbance
from companion.estimation.estimates import Estimates
from companion.estimation.height_drift import NO_DRIFT, HeightDrift
from companion.estimation.wall_drift import NO_WALL_DRIFT, WallDrift
from companion.mavlink.samples import Heartbeat, SetAttitudeTarget
from companion.mavlink.setpoints import Command

_NO_BALANCE = Balance()
_NO_RESPONSE = AttitudeResponse()
_NO_AIR = Airborne()
_NO_OFFSETS = Offsets()


@dataclass(frozen=True, kw_only=True)
class PipelineState:
    """Everything remembered between samples."""

    estimates: Estimates
    t_s: float = -math.inf
    """The newest time of any sample: the boot axis now."""
    stamped_s: float = -math.inf
    """The newest of the autopilot's own stamps."""
    heartbeat: Heartbeat | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)
    hover: HoverThrust = field(default_factory=HoverThrust)
    air: Airborne = _NO_AIR
    engagement: Engagement = field(default_factory=Engagement)
    balance: Balance = _NO_BALANCE
    timing: Timing = field(default_factory=Timing)
    response: AttitudeResponse = _NO_RESPONSE
    loop: AttitudeLoop = field(default_factory=AttitudeLoop)
    """How the attitude answers, as far as known."""
    tuned: HoldTuning | None = None
    tuned_s: float = -math.inf
    swing: SwingDetector = field(default_factory=SwingDetector)
    upstream: SetAttitudeTarget | None = None
    hold: Hold | None = None
    left: tuple[Target, float] | None = None
    """Where a hold was to stay that was let go while nobody else took over, and when."""
    drift: HeightDrift = NO_DRIFT
    """Of the autopilot's height against the ground range, while the hold flies."""
    wall_drift: WallDrift = NO_WALL_DRIFT
    """Of its position against the wall range, while the hold flies."""
    wall_ahead: WallAhead | None = None
    """A wall that the held vehicle is driven to."""
    last: BaseSetpoint | None = None
    """What was sent last, offsets included."""
    hand_over: HandOver | None = None
    offsets: Offsets = _NO_OFFSETS
    decided_s: float = -math.inf
    disturbance: Disturbance | None = None
    disturbance_s: float = -math.inf
    """When it was computed: after a position, so that an attitude is answered without waiting for the model."""
    lift_share: float = 1.0
    """Modelled free-air lift over the weight, averaged while the vehicle flies."""
    late_since_s: float = math.inf
    """Since when attitude or position have been too late to fly on; inf while they are not."""
    survey: Survey = field(default_factory=Survey)
    stopping: bool = False
    notice: tuple[Notice, float] | None = None
    """The newest notice and its time."""
    adaptation: Adaptation | None = None
    """The sizes measured in flight; None where nothing is to be measured."""


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
