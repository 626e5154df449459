"""What the pilot sees: NAMED_VALUE_FLOAT at 4 Hz, STATUSTEXT and a line on stderr where the state changes."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from companion.adaptation import words
from companion.control.authority import Notice, Reason
from companion.estimation.estimator import Seen
from companion.mavlink.firmware import advice, mode_name, stack_of
from companion.mavlink.outgoing import Message, named_value_float
from companion.pipeline import Decision, PipelineState
from companion.telemetry import statustext

_PERIOD_S = 0.25
"""4 Hz: readable, and 1 % of a 57600 baud link for each value."""
_CALM_S = 0.5
"""A state counts once it has lasted this long: a flicker is no message."""
_REPEAT_S = 5.0
"""The same words at most this often."""
_ABOUT_RANGES = {
    Reason.RANGE_MISSING: Seen.MISSING,
    Reason.RANGE_STALE: Seen.STALE,
    Reason.RANGE_LOST: Seen.LOST,
    Reason.RANGE_FROZEN: Seen.FROZEN,
}
_LATENESS = ((Reason.LATE,), (Reason.TOO_LATE,))
_INFO, _WARNING = 6, 4
"""MAV_SEVERITY."""


def named_values(decision: Decision) -> Iterator[tuple[str, float]]:
    """(name of at most 10 characters, value): share cancelled, offsets, distances [m], lift and side force [N]."""
    yield "cc_auth", decision.offset.share
    yield "cc_thrust", decision.offset.thrust
    yield "cc_roll", decision.offset.roll
    yield "cc_pitch", decision.offset.pitch
    if decision.tuned is not None:
        yield "cc_margin", decision.tuned.margin.gain
    disturbance = decision.disturbance
    if disturbance is not None:
        yield "cc_h", _finite(float(np.min(disturbance.h_m)))
        yield "cc_d", _finite(float(np.min(disturbance.d_m)))
        yield "cc_lift", -float(disturbance.wrench[2])
        yield "cc_side", float(np.hypot(disturbance.wrench[0], disturbance.wrench[1]))
        yield "cc_trust", disturbance.trust
    if decision.adaptation is not None:
        yield from words.named_values(decision.adaptation)


def _finite(value: float) -> float:
    """Beyond range is shown as -1: ground stations draw no infinity."""
    return value if np.isfinite(value) else -1.0


class StatusReporter:
    """Decides what to report and when; the caller sends it. Times are the vehicle's boot axis [s]."""

    def __init__(self) -> None:
        self._named_s = -np.inf
        self._said: str | None = None
        self._said_s: dict[str, float] = {}
        self._pending: str | None = None
        self._pending_s = 0.0
        self._advised = self._led = False
        self._noticed: tuple[Notice, float] | None = None
        self._number = 0
        self._shares: dict[str, float] = {}
        """What was last told of a channel's share."""

    def messages(self, state: PipelineState, decision: Decision) -> Iterator[tuple[Message, str | None]]:
        """(message, its text for stderr or None) due at this decision."""
        if decision.t_s - self._named_s >= _PERIOD_S or decision.t_s < self._named_s:
            self._named_s = decision.t_s
            boot_ms = int(max(decision.t_s, 0.0) * 1000.0) & 0xFFFFFFFF
            for name, value in named_values(decision):
                yield named_value_float(boot_ms, name, value), None
        text = self._change(state, decision)
        if text is not None:
            yield from self.tell(text, warning=bool(decision.reasons))
        if decision.notice is not None and decision.notice != self._noticed:
            self._noticed = decision.notice
            yield from self.tell(f"companion: {decision.notice[0].value}")
        if decision.adaptation is not None:
            for size, share, sentence in words.sentences(decision.adaptation, self._shares):
                self._shares[size] = share
                yield from self.tell(f"companion: {sentence}")
        if decision.command is not None and state.hold is not None and not self._led:
            self._led = True
            yield from self.tell("companion: holding; position targets to component 191 move it", warning=False)
        hint = None if self._advised or state.heartbeat is None else advice(stack_of(state.heartbeat), state.parameters)
        if hint is not None:
            self._advised = True
            yield from self.tell(hint)

    def tell(self, text: str, *, warning: bool = True) -> Iterator[tuple[Message, str | None]]:
        """One text for ground station and stderr."""
        self._number = self._number % 65535 + 1
        for place, message in enumerate(statustext.messages(_WARNING if warning else _INFO, text, self._number)):
            yield message, text if place == 0 else None

    def _change(self, state: PipelineState, decision: Decision) -> str | None:
        """The new state in words, once it has lasted half a second, and no more often than every five seconds."""
        words = said_of(state, decision)
        if words == self._said:
            self._pending = None
            return None
        if words != self._pending:
            self._pending, self._pending_s = words, decision.t_s
            return None
        if decision.t_s - self._pending_s < _CALM_S:
            return None
        if 0.0 <= decision.t_s - self._said_s.get(words, -np.inf) < _REPEAT_S:
            return None
        self._said, self._pending = words, None
        self._said_s[words] = decision.t_s
        late = f" ({1000.0 * decision.late_s:.0f} ms)" if decision.reasons[:1] in _LATENESS else ""
        return words + late


def said_of(state: PipelineState, decision: Decision) -> str:
    """The state of the offsets in words: the gravest refusal, and which range or mode it is about."""
    if not decision.reasons:
        return "companion: compensating"
    reason = decision.reasons[0]
    what = reason.value
    seen = _ABOUT_RANGES.get(reason)
    if seen is not None and decision.disturbance is not None:
        disturbance = decision.disturbance
        surfaces = {"the ground": disturbance.ground, "the wall": disturbance.wall, "the ceiling": disturbance.ceiling}
        about = " and ".join(name for name, surface in surfaces.items() if surface.seen is seen)
        what = re.sub("^(range(finder)?)", rf"\1 to {about}", what) if about else what
    if reason is Reason.WRONG_MODE and state.heartbeat is not None:
        what += f" (now {mode_name(state.heartbeat)})"
    return f"companion: no offset, {what}"
