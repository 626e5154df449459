"""Checks of the setpoints: their form, when they may be sent at all, and that none is old or sent twice."""

from __future__ import annotations

import math
from typing import Any

from companion.invariants.air_evidence import ON_GROUND
from companion.invariants.heard import Heard
from companion.invariants.requirements import WIRE, Audit, Requirement
from companion.mavlink import AUTOPILOT_COMPONENT
from companion.mavlink.firmware import Stack, stack_of, takes_setpoints
from companion.mavlink.message_filter import Intake
from companion.mavlink.samples import Quaternion
from companion.mavlink.setpoints import ATTITUDE_IGNORED, RATES_IGNORED
from companion.pipeline import MAX_THRUST, MIN_THRUST
from models.vehicle import Limits, Vehicle

_THROTTLE_IGNORED = 64
"""ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE."""
_OLD_S = 0.3
"""A setpoint answers an attitude not older than this."""
_HAND_OVER_S = 1.6
"""At the end the same place (or level) is sent again and again, for a second."""
_HAND_OVER_PX4_S = 6.6
"""The same of a place for PX4: beside a wall for six seconds (flight.hand_over)."""
_LINK_S = 3.6
"""Three seconds without a heartbeat, and half a second of letting go."""
_LEVEL_RAD = math.radians(0.5)
"""Tilt below which a setpoint counts as level."""
_UNIT = 1e-3
"""ArduPilot and PX4 refuse quaternions that are further from 1 than this."""


class SetpointChecks:
    """Looks at every attitude and every place that is sent.

    ``hold`` False: setpoints of an upstream controller are forwarded, whose thrust and positions are its own business.
    """

    def __init__(
        self, audit: Audit, intake: Intake, vehicle: Vehicle | None, *, hold: bool, dry_run: bool
    ) -> None:
        self._audit = audit
        self._intake = intake
        self._limits = Limits() if vehicle is None else vehicle.limits
        self._hold = hold
        self._dry_run = dry_run
        self._last_stamp_ms: int | None = None

    def start_over(self) -> None:
        """The vehicle has rebooted: stamps begin anew."""
        self._last_stamp_ms = None

    def attitude(self, fields: tuple[Any, ...], heard: Heard, arrival_us: int) -> None:
        """A SET_ATTITUDE_TARGET, by its fields in the order of the wire."""
        stamp_ms = fields[0]
        q = fields[1:5]
        thrust = fields[8]
        system, component, mask = fields[9:12]
        size = math.sqrt(sum(c * c for c in q))
        proper = abs(size - 1.0) <= _UNIT
        rates_only = bool(mask & ATTITUDE_IGNORED)
        self._audit.check(Requirement.QUATERNION, proper or rates_only, f"|q| = {size:g}")
        if self._hold:
            inside = MIN_THRUST - WIRE <= thrust <= MAX_THRUST + WIRE
        else:
            inside = 0.0 - WIRE <= thrust <= 1.0 + WIRE
        self._audit.check(Requirement.THRUST, inside, f"thrust {thrust:g}")
        whole = mask & RATES_IGNORED in (0, RATES_IGNORED) and not mask & _THROTTLE_IGNORED
        formed = whole and self._addressed(system, component)
        self._audit.check(Requirement.FORM, formed, f"mask {mask}, to {system}/{component}")
        level = proper and _tilt(q) <= _LEVEL_RAD
        if self._hold:
            bare = level
        else:
            bare = _is_upstreams(heard, q, thrust)
        text = f"attitude tilted by {math.degrees(_tilt(q)):.1f} deg"
        self._check_allowed(bare, text, heard, arrival_us)
        self._check_fresh(stamp_ms, level, heard)
        if not self._hold:
            self._check_beside_upstream(q, thrust, heard)

    def position(self, fields: tuple[Any, ...], heard: Heard, arrival_us: int) -> None:
        """A SET_POSITION_TARGET_LOCAL_NED, by its fields in the order of the wire."""
        north, east, down = fields[1:4]
        system, component = fields[13:15]
        finite = all(math.isfinite(v) for v in fields[1:12])
        formed = finite and self._addressed(system, component)
        self._audit.check(Requirement.FORM, formed, f"place {(north, east, down)}")
        text = f"a place to fly to, {north:.2f} {east:.2f} {down:.2f}"
        self._check_allowed(False, text, heard, arrival_us)
        age_s = _age_s(fields[0], heard)
        if stack_of(heard.heartbeat) is Stack.PX4:
            most_s = _HAND_OVER_PX4_S
        else:
            most_s = _HAND_OVER_S
        self._audit.check(Requirement.FRESH, age_s <= most_s, f"{age_s:.2f} s old")

    def _check_allowed(self, bare: bool, what: str, heard: Heard, arrival_us: int) -> None:
        """``bare``: carries no offset and no place, only "stay as you are"."""
        audit = self._audit
        beat = heard.heartbeat
        audit.setpoints += 1
        if self._dry_run:
            audit.check(Requirement.DRY_RUN, False, what)
        audit.check(Requirement.ARMED, beat is not None and beat.armed, what)
        waiting = stack_of(beat) is Stack.PX4 and bare
        if beat is None:
            mode = "no heartbeat yet"
            age_s = math.inf
        else:
            mode = f"mode {beat.custom_mode:#x}"
            # By arrival where the first one came before the vehicle's clock was known.
            age_s = min(heard.now_s - beat.t_s, (arrival_us - heard.beat_us) / 1e6)
        audit.check(Requirement.MODE, takes_setpoints(beat) or waiting, f"{what} in {mode}")
        standing = heard.air.landed_state == ON_GROUND and not heard.air.contradicts_landing
        audit.check(Requirement.LANDED, not standing, what)
        text = f"{what}, {age_s:.1f} s after the last heartbeat"
        audit.check(Requirement.LINK, age_s <= _LINK_S, text)

    def _check_fresh(self, stamp_ms: int, level: bool, heard: Heard) -> None:
        age_s = _age_s(stamp_ms, heard)
        last = self._last_stamp_ms
        again = last is not None and _ms_between(last, stamp_ms) <= 0
        if not again:
            self._last_stamp_ms = stamp_ms
        if level:  # the end of a hold where places are not taken
            self._audit.check(Requirement.FRESH, age_s <= _HAND_OVER_S, f"{age_s:.2f} s old")
            return
        words = f"stamped {stamp_ms / 1000.0:.3f} s, {age_s:.2f} s old"
        if again:
            words += ", a second time"
        self._audit.check(Requirement.FRESH, age_s <= _OLD_S and not again, words)

    def _check_beside_upstream(self, q: Quaternion, thrust: float, heard: Heard) -> None:
        """What is forwarded differs from what upstream sent by no more than the limits."""
        upstream = heard.upstream
        if upstream is None or upstream.type_mask & ATTITUDE_IGNORED:
            return
        angle = _angle(q, upstream.q_ned_frd)
        change = thrust - upstream.thrust
        most = math.sqrt(2.0) * math.radians(self._limits.tilt_deg) + _LEVEL_RAD
        inside = angle <= most and abs(change) <= self._limits.thrust + _UNIT
        text = f"{math.degrees(angle):.2f} deg and {change:+.3f} from upstream's"
        self._audit.check(Requirement.LIMITS, inside, text)

    def _addressed(self, system: int, component: int) -> bool:
        return component == AUTOPILOT_COMPONENT and system == (self._intake.system or system)


def _is_upstreams(heard: Heard, q: Quaternion, thrust: float) -> bool:
    """Whether this is what upstream sent, as it was."""
    sent = heard.upstream
    return (
        sent is not None
        and _angle(q, sent.q_ned_frd) <= _LEVEL_RAD
        and abs(thrust - sent.thrust) <= _UNIT
    )


def _age_s(stamp_ms: int, heard: Heard) -> float:
    """How far a setpoint's stamp is off what it answers."""
    if math.isinf(heard.basis_s):
        return math.inf
    return abs(_ms_between(stamp_ms, round(heard.basis_s * 1000.0))) / 1000.0


def _ms_between(first: int, second: int) -> int:
    """``second`` - ``first``, of 32-bit milliseconds that wrap."""
    return (second - first + 0x80000000) % 0x100000000 - 0x80000000


def _tilt(q: Quaternion) -> float:
    """Angle [rad] between the body's down axis and the world's."""
    _, x, y, _ = q
    return math.acos(max(-1.0, min(1.0, 1.0 - 2.0 * (x * x + y * y))))


def _angle(a: Quaternion, b: Quaternion) -> float:
    """Angle [rad] between two attitudes."""
    return 2.0 * math.acos(min(1.0, abs(sum(x * y for x, y in zip(a, b, strict=True)))))
