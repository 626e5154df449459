"""What does not change during a flight: vehicle, model and interface.

The numbers of estimator, hold and offsets stand beside the code that uses them. Where no source stands beside a number
it is a choice of this project; what it was measured with is in docs/lab/hold.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import NamedTuple

from companion.adapt_options import Adapt
from companion.survey_box import SurveyBox
from models.common.frames import GRAVITY
from models.surrogate.fan_surrogate import FanSurrogate
from models.vehicle import Vehicle


class Carrier(Enum):
    """How an offset travels to the autopilot."""

    ATTITUDE = "attitude"
    ACCELERATION = "acceleration"


class Base(Enum):
    """Whose setpoint the offset is added to."""

    HOLD = "hold"
    UPSTREAM = "upstream"


class OffsetBounds(NamedTuple):
    """Of an offset, or of its change in a second: thrust as a share of full throttle, tilt and acceleration."""

    thrust: float
    tilt_rad: float
    acceleration_m_s2: float


@dataclass(frozen=True, kw_only=True)
class PipelineConfig:
    """Everything ``step`` needs besides state and sample.

    Parameters
    ----------
    vehicle : Vehicle
        What flies.
    model : FanSurrogate
        Of its fans.
    base : Base
        Whose setpoint the offset is added to: of the own hold, or of an upstream controller.
    carrier : Carrier
        How it travels: as an attitude with thrust, or as an acceleration.
    dry_run : bool
        Decide, and send nothing.
    offsets : bool
        False flies the bare hold: for comparison only.
    survey : SurveyBox or None
        The hold is moved through this box once it flies.
    adapt : Adapt
        What the sizes measured in flight do to the offsets.

    Examples
    --------
    >>> import companion, models
    >>> from companion.vehicles import default_vehicle
    >>> config = companion.PipelineConfig(vehicle=default_vehicle(), model=models.load())
    >>> config.most_offset.thrust
    0.1
    """

    vehicle: Vehicle
    model: FanSurrogate
    base: Base = Base.HOLD
    carrier: Carrier = Carrier.ATTITUDE
    dry_run: bool = False
    offsets: bool = True
    survey: SurveyBox | None = None
    adapt: Adapt = Adapt.OFF

    @cached_property
    def most_offset(self) -> OffsetBounds:
        """How far an offset may go."""
        limits = self.vehicle.limits
        tilt = math.radians(limits.tilt_deg)
        return OffsetBounds(limits.thrust, tilt, GRAVITY * math.tan(tilt))

    @cached_property
    def offset_rates(self) -> OffsetBounds:
        """How fast an offset may change."""
        limits = self.vehicle.limits
        tilt = math.radians(limits.slew_tilt_deg_per_s)
        return OffsetBounds(limits.slew_thrust_per_s, tilt, GRAVITY * tilt)
