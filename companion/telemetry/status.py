"""What the pilot sees: NAMED_VALUE_FLOAT at 4 Hz, STATUSTEXT and a line on stderr where the state changes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from companion.control.authority import Notice, Reason
from companion.mavlink.firmware import advice, mode_name, stack_of
from companion.pipeline import Decision, PipelineState

_PERIOD_S = 0.25
_CALM_S = 0.5
_INFO, _WARNING = 6, 4


def named_values(decision: Decision) -> Iterator[tuple[str, float]]:
    """(name of at most 10 characters, value): cancelled share 0...1, offsets, distances [m], lift and side push [N]."""
    yield "cc_auth", decision.offset.share
    yield "cc_thrust", decision.offset.thrust
    yield "cc_roll", decision.offset.roll
    yield "cc_pitch", decision.offset.pitch
    if decision.tuned is not None:
        yield "cc_margin", decision.tuned.margin.gain
    push = decision.push
    if push is not None:
        yield "cc_h", _finite(float(np.min(push.h_m)))
        yield "cc_d", _finite(float(np.min(push.d_m)))
        yield "cc_lift", -float(push.wrench[2])
        yield "cc_side", float(np.hypot(push.wrench[0], push.wrench[1]))
        yield "cc_trust", push.trust


def _finite(value: float) -> float:
    """Beyond range is shown as -1: ground stations draw no infinity."""
    return value if np.isfinite(value) else -1.0


class StatusReporter:
    """Decides what to tell and when; the caller sends it. Times are the vehicle's boot axis [s]."""

    def __init__(self) -> None:
        self._named_s = -np.inf
        self._said: tuple[Reason, ...] | None = None
        self._pending: tuple[Reason, ...] | None = None
        self._pending_s = 0.0
        self._advised = False
        self._noticed: tuple[Notice, float] | None = None

    def messages(self, mav: Any, state: PipelineState, decision: Decision) -> Iterator[tuple[Any, str | None]]:
        """(MAVLink message, its text for stderr or None) due at this decision."""
        if decision.t_s - self._named_s >= _PERIOD_S or decision.t_s < self._named_s:
            self._named_s = decision.t_s
            boot_ms = int(max(decision.t_s, 0.0) * 1000.0) & 0xFFFFFFFF
            for name, value in named_values(decision):
                yield mav.named_value_float_encode(boot_ms, name.encode(), value), None
        text = self._change(state, decision)
        if text is not None:
            yield mav.statustext_encode(_INFO if not decision.reasons else _WARNING, text[:50].encode()), text
        if decision.notice is not None and decision.notice != self._noticed:
            self._noticed = decision.notice
            words = f"companion: {decision.notice[0].value}"
            yield mav.statustext_encode(_WARNING, words[:50].encode()), words
        hint = None if self._advised or state.heartbeat is None else advice(stack_of(state.heartbeat), state.parameters)
        if hint is not None:
            self._advised = True
            yield mav.statustext_encode(_WARNING, hint[:50].encode()), hint

    def _change(self, state: PipelineState, decision: Decision) -> str | None:
        """The new state in words, once it has lasted half a second."""
        if decision.reasons == self._said:
            self._pending = None
            return None
        if decision.reasons != self._pending:
            self._pending, self._pending_s = decision.reasons, decision.t_s
            return None
        if decision.t_s - self._pending_s < _CALM_S:
            return None
        self._said, self._pending = decision.reasons, None
        if not decision.reasons:
            return "companion: compensating"
        mode = "" if state.heartbeat is None or decision.reasons[0] is not Reason.WRONG_MODE else (
            f" (now {mode_name(state.heartbeat)})"
        )  # fmt: skip
        return f"companion: no offset, {decision.reasons[0].value}{mode}"
