"""Everything that ``step`` remembers between samples: a record for each topic, so that a step copies a small one."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from companion.control.reasons import Notice
from companion.estimation.estimates import Estimates
from companion.estimation.felt import UNFELT, Felt
from companion.state.air import Air
from companion.state.heard import Heard
from companion.state.held import Held
from companion.state.learned import Learned
from companion.state.plant import Plant
from companion.state.requests import Requests
from companion.state.sending import Sending


@dataclass(frozen=True, kw_only=True)
class PipelineState:
    """The state of the pipeline."""

    t_s: float = -math.inf
    """The newest time of any sample: the boot axis now."""
    stamped_s: float = -math.inf
    """The newest of the autopilot's own stamps."""
    estimates: Estimates
    felt: Felt = UNFELT
    """What the accelerometers say of the motion."""
    heard: Heard = field(default_factory=Heard)
    requests: Requests = field(default_factory=Requests)
    air: Air = field(default_factory=Air)
    plant: Plant = field(default_factory=Plant)
    learned: Learned = field(default_factory=Learned)
    held: Held = field(default_factory=Held)
    sending: Sending = field(default_factory=Sending)
    notice: tuple[Notice, float] | None = None
    """The newest notice and its time."""
