"""Everything that ``step`` remembers between samples: a record for each topic, so that a step copies a small one."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from companion.control.reasons import Notice
from companion.estimation.estimates import Estimates
from companion.estimation.felt_motion import UNFELT, Felt
from companion.state.air import Air
from companion.state.heard import Heard
from companion.state.held import Held
from companion.state.learned import Learned
from companion.state.plant import Plant
from companion.state.requests import Requests
from companion.state.sending import Sending


@dataclass(frozen=True, kw_only=True)
class PipelineState:
    """Everything that ``step`` remembers. Times are boot times of the autopilot [s].

    Examples
    --------
    >>> import companion, models
    >>> from companion.mavlink.samples import Pressure
    >>> from companion.vehicles import default_vehicle
    >>> config = companion.PipelineConfig(vehicle=default_vehicle(), model=models.load())
    >>> heard = Pressure(2.0, 1, 1, pressure_pa=101325.0, temperature_c=15.0, source="SCALED_PRESSURE")
    >>> state, _ = companion.step(companion.initial_state(config), heard, config)
    >>> state.t_s
    2.0
    """

    t_s: float = -math.inf
    """The newest time of any sample: the boot axis now."""
    stamped_s: float = -math.inf
    """The newest of the autopilot's own stamps."""
    estimates: Estimates
    """The newest attitude, position, ranges and speeds."""
    felt: Felt = UNFELT
    """What the accelerometers say of the motion."""
    heard: Heard = field(default_factory=Heard)
    """The autopilot's mode and parameters."""
    requests: Requests = field(default_factory=Requests)
    """What others ask for."""
    air: Air = field(default_factory=Air)
    """Whether it flies, and what ground and wall do."""
    plant: Plant = field(default_factory=Plant)
    """How the vehicle answers, and the gains chosen for it."""
    learned: Learned = field(default_factory=Learned)
    """What the flight has shown of this vehicle on this day."""
    held: Held = field(default_factory=Held)
    """The hold and its surroundings."""
    sending: Sending = field(default_factory=Sending)
    """The newest setpoint and its offsets."""
    notice: tuple[Notice, float] | None = None
    """The newest notice and its time."""
