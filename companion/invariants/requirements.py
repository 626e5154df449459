"""The requirements by name, and how often each held; docs/safety.md says what each of them means."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

WIRE = 1e-6
"""Rounding of 32-bit floats, at the size of angles and thrusts."""


class Requirement(Enum):
    """What is required of everything sent; the value is what the report says."""

    LIMITS = "offsets stay inside the limits of the vehicle file"
    SLEW = "offsets move no faster than the slew rates of the vehicle file"
    QUATERNION = "every attitude sent is a finite unit quaternion"
    THRUST = "every thrust sent lies between floor and ceiling"
    INPUT_LOST = "offsets are zero 0.5 s after an input that they need was lost"
    FRESH = "no setpoint is stale, and none is sent a second time"
    ARMED = "no setpoint unless the autopilot says that it is armed"
    MODE = "no setpoint outside GUIDED and OFFBOARD (PX4 before OFFBOARD: no offset and no place)"
    LANDED = (
        "no setpoint while the autopilot says that it stands on the ground, unless range and "
        "rotors contradict it"
    )
    LINK = "no setpoint after the autopilot's heartbeats have stopped"
    DRY_RUN = "a dry run sends no setpoint"
    FORM = (
        "rates are ignored all or none, thrust never; places are finite; addressed to the autopilot"
    )
    DECLARED = "no message outside the declared set; never arms"


@dataclass(slots=True)
class Tally:
    """How often one requirement was looked at, and how often it did not hold."""

    checked: int = 0
    broken: int = 0
    first_s: float = math.nan
    """When it was first broken: seconds since the first message."""
    first: str = ""

    def as_json(self) -> dict[str, Any]:
        """Plain numbers; None where it was never broken."""
        if self.broken:
            first_s = round(self.first_s, 3)
        else:
            first_s = None
        return {
            "checked": self.checked,
            "broken": self.broken,
            "first_s": first_s,
            "first": self.first or None,
        }


@dataclass
class Audit:
    """What has been found so far."""

    requirements: dict[Requirement, Tally] = field(
        default_factory=lambda: {one: Tally() for one in Requirement}
    )
    sent: int = 0
    setpoints: int = 0
    offsets: int = 0
    """How many offsets were seen: in decisions, or four times a second in the messages."""
    now_s: float = 0.0
    """Since the first message."""

    def check(self, requirement: Requirement, holds: bool, text: str) -> None:
        """Count one look at a requirement; ``text`` says what was seen."""
        kept = self.requirements[requirement]
        kept.checked += 1
        if holds:
            return
        if not kept.broken:
            kept.first_s = self.now_s
            kept.first = text
        kept.broken += 1

    @property
    def kept(self) -> bool:
        """Whether every requirement held."""
        return not any(k.broken for k in self.requirements.values())

    def broken(self) -> list[str]:
        """One line for each broken requirement."""
        return [
            f"{p.name.lower()}: {k.broken} of {k.checked}, first at {k.first_s:.2f} s: {k.first}"
            for p, k in self.requirements.items()
            if k.broken
        ]

    def as_json(self) -> dict[str, Any]:
        """Plain numbers."""
        promises = {
            p.name.lower(): {"promise": p.value, **k.as_json()}
            for p, k in self.requirements.items()
        }
        counts = {"sent": self.sent, "setpoints": self.setpoints, "offsets": self.offsets}
        return {"kept": self.kept, **counts, "promises": promises}
