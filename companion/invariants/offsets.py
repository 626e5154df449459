"""Checks of the offsets: limits, slew rates, and that they are gone when an input is lost."""

from __future__ import annotations

import math

from companion.control.compensation import Offset
from companion.control.reasons import HOLDS_BACK_EVERYTHING
from companion.invariants.heard import Heard, needed_inputs
from companion.invariants.requirements import WIRE, Audit, Requirement
from companion.state.decision import Decision
from models.common.frames import GRAVITY
from models.vehicle import Limits, Vehicle

ZERO_AFTER_S = 0.5
"""An offset is zero so long after an input that it needs was lost."""
_PERIOD_S = 0.03
"""One setpoint: what is true at a loss is seen at the next attitude."""
_SLEW_GAP_S = 0.1
"""A longer time between two decisions counts as this."""
_NOTHING = 1e-6
"""Offsets below this (of full throttle, rad) are zero."""


class OffsetChecks:
    """Looks at every decision where there are any, and at the offsets that telemetry names."""

    def __init__(self, audit: Audit, vehicle: Vehicle | None, *, hold: bool) -> None:
        self._audit = audit
        self._limits = Limits() if vehicle is None else vehicle.limits
        self._needs = needed_inputs(vehicle, hold)
        self._last: Decision | None = None
        self._named: dict[str, float] = {}

    def start_over(self) -> None:
        """The vehicle has rebooted: no decision came before."""
        self._last = None

    def decision(self, decision: Decision, heard: Heard) -> None:
        """A decision is checked exactly."""
        before = self._last
        self._last = decision
        if decision.command is None:
            return
        self._audit.offsets += 1
        self._check_limits(decision.offset)
        self._check_lost(_is_offset(decision.offset), decision.t_s, heard)
        held_back = not HOLDS_BACK_EVERYTHING.isdisjoint(decision.reasons)
        if before is None or before.command is None or held_back:
            return  # what is sent then fades by itself from what was sent last, or is nobody's to obey
        dt = min(max(decision.t_s - before.t_s, 0.0), _SLEW_GAP_S)
        self._check_slew(before.offset, decision.offset, dt)

    def named_value(self, name: str, value: float, heard: Heard) -> None:
        """The offsets as telemetry has them; thrust, roll and pitch come one after the other."""
        if name not in ("cc_thrust", "cc_roll", "cc_pitch"):
            return
        self._named[name] = value
        if name == "cc_thrust":
            most = self._limits.thrust
        else:
            most = math.radians(self._limits.tilt_deg)
        inside = abs(value) <= most + WIRE
        self._audit.check(Requirement.LIMITS, inside, f"{name} {value:+.4f}")
        if name == "cc_pitch":
            self._audit.offsets += self._last is None
            there = any(abs(v) > _NOTHING for v in self._named.values())
            self._check_lost(there, heard.now_s, heard)

    def _check_limits(self, offset: Offset) -> None:
        tilt = math.radians(self._limits.tilt_deg)
        level = GRAVITY * math.tan(tilt)
        inside = (
            abs(offset.thrust) <= self._limits.thrust + WIRE
            and abs(offset.roll) <= tilt + WIRE
            and abs(offset.pitch) <= tilt + WIRE
            and all(abs(a) <= level + WIRE for a in offset.acceleration)
        )
        text = (
            f"thrust {offset.thrust:+.4f}, roll {math.degrees(offset.roll):+.2f}, pitch "
            f"{math.degrees(offset.pitch):+.2f} deg"
        )
        self._audit.check(Requirement.LIMITS, inside, text)

    def _check_slew(self, before: Offset, after: Offset, dt_s: float) -> None:
        rate = math.radians(self._limits.slew_tilt_deg_per_s)
        moves = (
            (after.thrust - before.thrust, self._limits.slew_thrust_per_s),
            (after.roll - before.roll, rate),
            (after.pitch - before.pitch, rate),
        )
        inside = all(abs(move) <= most * dt_s + WIRE for move, most in moves)
        moved = ", ".join(f"{move:+.4f}" for move, _ in moves)
        text = f"thrust, roll, pitch moved {moved} in {dt_s:.3f} s"
        self._audit.check(Requirement.SLEW, inside, text)

    def _check_lost(self, there: bool, t_s: float, heard: Heard) -> None:
        """``there``: an offset is applied at ``t_s``."""
        if not there:
            self._audit.check(Requirement.INPUT_LOST, True, "")
            return
        late = {name: t_s - heard.inputs_s.get(name, -math.inf) for name in self._needs}
        silent = {name: age for name, age in late.items() if age > ZERO_AFTER_S + _PERIOD_S}
        words = ", ".join(f"{name} silent for {age:.2f} s" for name, age in silent.items())
        self._audit.check(Requirement.INPUT_LOST, not silent, words)


def _is_offset(offset: Offset) -> bool:
    values = (offset.thrust, offset.roll, offset.pitch, *offset.acceleration)
    return any(abs(v) > _NOTHING for v in values)
