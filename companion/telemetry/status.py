"""What the pilot sees: NAMED_VALUE_FLOAT at 2 Hz, STATUSTEXT and a line on stderr where the state changes."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterator

from companion.adaptation import words
from companion.control.reasons import REASON_OF_SIGHT, Notice, Reason
from companion.mavlink.firmware import advice, mode_name
from companion.mavlink.outgoing import Message, named_value_float, statustext
from companion.state.decision import Decision
from companion.state.pipeline_state import PipelineState

_PERIOD_S = 0.5
"""2 Hz: readable, and half a percent of a 57600 baud link for each value."""
_CALM_S = 0.5
"""A state counts once it has lasted this long: a flicker is no message."""
_REPEAT_S = 5.0
"""The same words at most this often, and a change of lesser refusals alone."""
_LESSER_CALM_S = 2.0
"""Lesser refusals count once they have lasted this long."""
_SIGHT_OF_REASON = {reason: seen for seen, reason in REASON_OF_SIGHT.items()}
_LATENESS = ((Reason.LATE,), (Reason.TOO_LATE,))
_SENDER = "companion: "
_LESSER = "; also: "
"""A ground station shows the sender by itself."""
_CHUNK = 50
"""Bytes of text in one STATUSTEXT."""
_INFO = 6
_WARNING = 4
"""MAV_SEVERITY."""


def named_values(decision: Decision) -> Iterator[tuple[str, float]]:
    """(name of at most 10 characters, value): share cancelled, offsets, distances [m], lift and side force [N].

    ``cc_roll`` and ``cc_pitch`` are in rad (MAVLink's unit of angles), ``roll_deg`` and ``pitch_deg`` of the summary
    in degrees; ``cc_thrust`` is a share of full throttle.
    """
    yield "cc_auth", decision.offset.share
    yield "cc_thrust", decision.offset.thrust
    yield "cc_roll", decision.offset.roll
    yield "cc_pitch", decision.offset.pitch
    if decision.tuned is not None:
        yield "cc_margin", decision.tuned.margin.gain
    disturbance = decision.disturbance
    if disturbance is not None:
        yield "cc_h", _finite(min(disturbance.h_m))
        yield "cc_d", _finite(min(disturbance.d_m))
        yield "cc_lift", -disturbance.wrench[2]
        yield "cc_side", math.hypot(*disturbance.wrench[:2])
        yield "cc_trust", disturbance.trust
    if decision.adaptation is not None:
        yield from words.named_values(decision.adaptation)


def _finite(value: float) -> float:
    """Beyond range is shown as -1: ground stations draw no infinity."""
    if math.isfinite(value):
        return value
    return -1.0


class StatusReporter:
    """Decides what to report and when; the caller sends it. Times are the vehicle's boot axis [s]."""

    def __init__(self) -> None:
        self._named_s = -math.inf
        self._said: tuple[str, str] | None = None
        """The gravest refusal, and all of them, as last said."""
        self._any_said_s = -math.inf
        self._said_s: dict[str, float] = {}
        self._pending: str | None = None
        self._pending_s = 0.0
        self._advised = self._led = False
        self._noticed: tuple[Notice, float] | None = None
        self._number = 0
        self._shares: dict[str, float] = {}
        """What was last reported of a channel's share."""

    def messages(
        self, state: PipelineState, decision: Decision, *, excused: bool = False
    ) -> Iterator[tuple[Message, str | None]]:
        """(message, its text for stderr or None) due at this decision; ``excused``: its state is not to be said yet."""
        if decision.t_s - self._named_s >= _PERIOD_S or decision.t_s < self._named_s:
            self._named_s = decision.t_s
            boot_ms = int(max(decision.t_s, 0.0) * 1000.0) & 0xFFFFFFFF
            for name, value in named_values(decision):
                yield named_value_float(boot_ms, name, value), None
        if excused or _lifts_off(state, decision):
            text = None
        else:
            text = self._change(state, decision)
        if text is not None:
            yield from self.tell(text, warning=bool(decision.reasons))
        if decision.notice is not None and decision.notice != self._noticed:
            self._noticed = decision.notice
            yield from self.tell(f"companion: {_noticed(decision.notice[0], state, decision)}")
        if decision.adaptation is not None:
            for size, share, sentence in words.sentences(decision.adaptation, self._shares):
                self._shares[size] = share
                yield from self.tell(f"companion: {sentence}")
        if decision.command is not None and state.held.hold is not None and not self._led:
            self._led = True
            yield from self.tell(
                "companion: holding; position targets to component 191 move it", warning=False
            )
        if self._advised:
            hint = None
        else:
            hint = advice(state.heard.stack, state.heard.parameters)
        if hint is not None:
            self._advised = True
            yield from self.tell(hint)

    def tell(self, text: str, *, warning: bool = True) -> Iterator[tuple[Message, str | None]]:
        """One text for stderr; for the ground station without the sender's name, what matters most as the first text.

        PX4 loses the end of a long text: the gravest refusal fits into one message or two, and the others follow.
        """
        if warning:
            severity = _WARNING
        else:
            severity = _INFO
        said = text
        for part in text.removeprefix(_SENDER).split(_LESSER):
            self._number = self._number % 65535 + 1
            for message in text_messages(severity, part, self._number):
                yield message, said or None
                said = ""

    def _change(self, state: PipelineState, decision: Decision) -> str | None:
        """The new state in words, once it has lasted half a second, and no more often than every five seconds.

        A change of lesser refusals alone waits longer: it changes nothing in what is flown.
        """
        gravest, words = said_of(state, decision)
        if self._said == (gravest, words):
            self._pending = None
            return None
        graver = self._said is None or gravest != self._said[0]
        if graver:
            awaited = gravest
        else:
            awaited = words
        t_s = decision.t_s
        if awaited != self._pending:
            self._pending = awaited
            self._pending_s = t_s
            return None
        if t_s - self._pending_s < (_CALM_S if graver else _LESSER_CALM_S):
            return None
        if graver:
            last_s = self._said_s.get(words, -math.inf)
        else:
            last_s = self._any_said_s
        if 0.0 <= t_s - last_s < _REPEAT_S:
            return None
        self._said = (gravest, words)
        self._pending = None
        self._said_s[words] = self._any_said_s = t_s
        if decision.reasons[:1] in _LATENESS:
            late = f" ({1000.0 * decision.late_s:.0f} ms)"
        else:
            late = ""
        return words.replace(gravest, gravest + late, 1)


def _noticed(notice: Notice, state: PipelineState, decision: Decision) -> str:
    """A notice in words, with its figures."""
    text: str = notice.value
    if notice is Notice.WALL_LEAST and decision.tuned is not None:
        target_wall_m = max(state.held.target_wall_m, 0.0)
        return text.format(least=decision.tuned.least_wall_m, target=target_wall_m)
    return text


def chunks(text: str) -> list[str]:
    """``text`` as it is, or in pieces of 50 characters that end between words; all but the last are filled with spaces.

    Ground stations join the pieces as they are, and take a piece that is not full for the last one.
    """
    plain = text.encode("ascii", "replace").decode("ascii")
    if len(plain) <= _CHUNK:
        return [plain]
    whole = textwrap.wrap(" ".join(plain.split()), _CHUNK - 1, break_on_hyphens=False) or [""]
    return [*(piece.ljust(_CHUNK) for piece in whole[:-1]), whole[-1]]


def text_messages(severity: int, text: str, number: int) -> list[Message]:
    """The STATUSTEXT messages of one text of any length. ``number`` 1...65535 tells texts of several apart."""
    pieces = chunks(text)
    if len(pieces) <= 1:
        number = 0
    return [statustext(severity, piece, number, place) for place, piece in enumerate(pieces)]


def _lifts_off(state: PipelineState, decision: Decision) -> bool:
    """Whether it is still open if the vehicle flies: the first second in the air, or of hearing it fly."""
    return Reason.LANDED in decision.reasons and state.air.airborne.since_s < math.inf


def said_of(state: PipelineState, decision: Decision) -> tuple[str, str]:
    """The state of the offsets in words: with the gravest refusal alone, and with all of them, the gravest first."""
    if not decision.reasons:
        return "companion: compensating", "companion: compensating"
    gravest, *lesser = (_words(reason, state, decision) for reason in decision.reasons)
    alone = f"companion: no offset, {gravest}"
    return alone, f"{alone}{_LESSER}{'; '.join(lesser)}" if lesser else alone


def _words(reason: Reason, state: PipelineState, decision: Decision) -> str:
    """One refusal, and which range or mode it is about."""
    what: str = reason.value
    seen = _SIGHT_OF_REASON.get(reason)
    if seen is not None and decision.disturbance is not None:
        disturbance = decision.disturbance
        surfaces = {
            "the ground": disturbance.ground,
            "the wall": disturbance.wall,
            "the ceiling": disturbance.ceiling,
        }
        about = " and ".join(name for name, surface in surfaces.items() if surface.seen is seen)
        if about:
            what = re.sub("^(range(finder)?)", rf"\1 to {about}", what)
    if reason is Reason.HEIGHT_DRIFTS:
        what = what.replace("drifts", f"drifts {abs(state.held.drift.rate_m_s):.1f} m/s")
    if (
        reason is Reason.NOT_ARMED
        and state.air.airborne.since_s < math.inf
        and state.air.airborne.carried_s == decision.t_s
    ):
        what += ", though the vehicle flies: nothing is sent, take over"
    if reason is Reason.WRONG_MODE and state.heard.heartbeat is not None:
        what += f" (now {mode_name(state.heard.heartbeat)})"
    return what
