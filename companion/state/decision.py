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
    """What was decided, and all that a pilot or an analyst wants to know about why.

    Examples
    --------
    >>> import companion, models
    >>> from companion.mavlink.samples import Attitude
    >>> from companion.vehicles import default_vehicle
    >>> config = companion.PipelineConfig(vehicle=default_vehicle(), model=models.load())
    >>> state = companion.initial_state(config)
    >>> level = Attitude(1.0, 1, 1, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), source="ATTITUDE")
    >>> state, decision = companion.step(state, level, config)
    >>> decision.command is None, decision.reasons[0].value
    (True, 'no heartbeat from the autopilot')
    """

    t_s: float
    """Boot time of the autopilot [s]."""
    command: Command | None
    """What is sent; None: nothing."""
    reasons: tuple[Reason, ...]
    """Why the offset is less than all, or nothing is sent."""
    authority: float
    """Share of the offset that is applied, 0 to 1."""
    offset: Offset
    """Applied: after trust, limits, slew and fade."""
    base: BaseSetpoint | None
    """The setpoint that the offset is added to."""
    disturbance: Disturbance | None
    """What ground and wall do, as the model has it."""
    late_s: float = 0.0
    """How late the attitude or position behind it arrived."""
    tuned: HoldTuning | None = None
    """Gains of the hold and their margin; None for an upstream controller."""
    notice: tuple[Notice, float] | None = None
    """The newest notice to the pilot and its time [s]."""
    adaptation: Adaptation | None = None
    """The sizes measured so far."""
