"""What others ask of the companion."""

from __future__ import annotations

from dataclasses import dataclass, field

from companion.control.survey import Survey
from companion.mavlink.samples import SetAttitudeTarget


@dataclass(frozen=True)
class Requests:
    """An upstream controller's setpoint, the survey, and the wish to stop."""

    upstream: SetAttitudeTarget | None = None
    survey: Survey = field(default_factory=Survey)
    stopping: bool = False
