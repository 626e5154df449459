"""What the flight program promises of everything it sends, checked on what it heard and what it sent.

One checker for simulated flights, tests and recordings: it takes the frames of both directions in order, as a .tlog
holds them, and where they are at hand the decisions. It knows nothing of the program's state, only of the protocol: a
requirement counts as kept where the messages themselves show it. docs/safety.md says what each requirement means.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

from companion.control.lateness import LATE_FADE_S
from companion.control.reasons import HOLDS_BACK_EVERYTHING
from companion.control.state import Decision
from companion.mavlink import AUTOPILOT_COMPONENT, NO_AUTOPILOT, OWN_COMPONENT, samples
from companion.mavlink.dialect import ID_OF
from companion.mavlink.firmware import Stack, stack_of, takes_setpoints
from companion.mavlink.message_filter import Intake
from companion.mavlink.message_table import LAYOUTS
from companion.mavlink.range_beams import DOWN, dot, orientation_direction
from companion.mavlink.samples import Quaternion, Sample
from companion.mavlink.setpoints import (
    ATTITUDE_IGNORED,
    RATES_IGNORED,
    SET_ATTITUDE_TARGET,
    SET_POSITION_TARGET,
)
from companion.mavlink.wire_frames import Frame, unpacked
from companion.pipeline import MAX_THRUST, MIN_THRUST
from models.common.frames import GRAVITY
from models.vehicle import Limits, Vehicle
from models.vehicle.vehicle import NO_ORIENTATION

_COMMAND_LONG = 76
_SET_MESSAGE_INTERVAL = 511
_NAMED_VALUE_FLOAT = 251
"""MAVLink numbers: a message, the one command in it that is sent, and a message."""
_DECLARED = {
    ID_OF[name]
    for name in (
        "HEARTBEAT",
        "PARAM_REQUEST_READ",
        "COMMAND_LONG",
        "NAMED_VALUE_FLOAT",
        "STATUSTEXT",
        "TIMESYNC",
        "SET_ATTITUDE_TARGET",
        "SET_POSITION_TARGET_LOCAL_NED",
    )
}
_THROTTLE_IGNORED = 64
_ON_GROUND = 1
"""ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE, MAV_LANDED_STATE_ON_GROUND."""

ZERO_AFTER_S = 0.5
"""An offset is zero so long after an input that it needs was lost."""
_PERIOD_S = 0.03
"""One setpoint: what is true at a loss is seen at the next attitude."""
_OLD_S = 0.3
"""A setpoint answers an attitude not older than this."""
_HAND_OVER_S = 1.6
"""At the end the same place (or level) is sent again and again, for a second."""
_LINK_S = 3.6
"""Three seconds without a heartbeat, and half a second of letting go."""
_LEVEL_RAD = math.radians(0.5)
"""Tilt below which a setpoint counts as level."""
_UNIT = 1e-3
"""ArduPilot and PX4 refuse quaternions that are further from 1 than this."""
_NOTHING = 1e-6
"""Offsets below this (of full throttle, rad) are zero."""
_WIRE = 1e-6
"""Rounding of 32-bit floats, at the size of angles and thrusts."""
_SAME_BEAM_COS = 0.98
"""Two beams within 11 degrees look the same way."""
_SLEW_GAP_S = 0.1
"""A longer time between two decisions counts as this."""
_FLIES_SHARE = 0.6
_FLOWN_SHARE = 0.02
_ABOVE_STANDING_M = 0.08
"""Lift, as the square of rotor speeds, that carries a vehicle, of that in flight; share of a new value in its average;
and how much further away the ground is than where the vehicle stood."""


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


@dataclass(slots=True)
class AirEvidence:
    """What range and rotors say about being in the air, beside the autopilot's land detector. Lengths in metres."""

    landed_state: int = 0
    down_m: float = math.nan
    standing_m: float = math.nan
    """What the ground range read as the vehicle stood."""
    rpm2: dict[int, float] = field(default_factory=dict)
    """Square of the newest speed of each ESC."""
    flown_rpm2: float = math.nan
    """Their mean in the air, averaged."""

    def hear_range(self, distance_m: float) -> None:
        """A reading of the ground range."""
        self.down_m = distance_m
        if self.landed_state == _ON_GROUND and not self._turns_as_in_flight:
            self.standing_m = distance_m

    def hear_rotors(self, sample: samples.RotorSpeeds) -> None:
        """Rotor speeds."""
        known = {
            esc: rpm * rpm
            for esc, rpm in enumerate(sample.rpm, sample.first_esc)
            if math.isfinite(rpm)
        }
        self.rpm2 |= known
        if self.landed_state != _ON_GROUND and (mean := self._mean_rpm2) > 0.0:
            if math.isnan(self.flown_rpm2):
                old = mean
            else:
                old = self.flown_rpm2
            self.flown_rpm2 = old + _FLOWN_SHARE * (mean - old)

    @property
    def _mean_rpm2(self) -> float:
        return sum(self.rpm2.values()) / max(len(self.rpm2), 1)

    @property
    def _turns_as_in_flight(self) -> bool:
        return self._mean_rpm2 >= _FLIES_SHARE * self.flown_rpm2  # False while that is not known

    @property
    def contradicts_landing(self) -> bool:
        """Whether it cannot stand on the ground."""
        return self._turns_as_in_flight and self.down_m > self.standing_m + _ABOVE_STANDING_M


@dataclass
class _Heard:
    """What the vehicle said last, on its boot axis [s]."""

    heartbeat: samples.Heartbeat | None = None
    beat_us: int = 0
    """When it arrived."""
    now_s: float = -math.inf
    """Stamp of the newest attitude."""
    basis_s: float = -math.inf
    """Stamp of the attitude, or of the upstream setpoint, that the next setpoint answers."""
    upstream: samples.SetAttitudeTarget | None = None
    inputs_s: dict[str, float] = field(default_factory=dict)
    counts: dict[int, int] = field(default_factory=dict)
    """Telemetry packets of each ESC: one that does not count on repeats an old value."""
    counting: set[int] = field(default_factory=set)
    """ESCs whose counter is known to move: some never do."""
    air: AirEvidence = field(default_factory=AirEvidence)


class Auditor:
    """Takes frames and decisions in order; ``audit`` says how it stands.

    ``vehicle`` None: limits are the defaults of a vehicle file, and only rangefinders as a whole can be missed.
    ``hold`` False: setpoints of an upstream controller are forwarded, whose thrust and positions are its own business.
    """

    def __init__(
        self,
        vehicle: Vehicle | None = None,
        *,
        hold: bool = True,
        dry_run: bool = False,
        system: int | None = None,
    ) -> None:
        self._limits = Limits() if vehicle is None else vehicle.limits
        self._needs = _needed_inputs(vehicle, hold)
        self._vehicle = vehicle
        self._hold = hold
        self._dry_run = dry_run
        self._intake = Intake(system)
        self._heard = _Heard()
        self._start_us: int | None = None
        self._now_us = self._boot = 0
        self._last_stamp_ms: int | None = None
        self._last: Decision | None = None
        self._named: dict[str, float] = {}
        self.audit = Audit()

    # -- what comes in ----------------------------------------------------------------------------------------------

    def frame(self, arrival_us: int, frame: Frame) -> None:
        """One frame of either direction."""
        self._start_us = arrival_us if self._start_us is None else self._start_us
        self._now_us = arrival_us
        if frame.component == OWN_COMPONENT:
            if self._intake.system in (None, frame.system):
                self._own(frame)
            return
        if frame.id not in LAYOUTS:
            return
        sample = self._intake.sample(frame, arrival_us)
        if self._intake.clock.boot != self._boot:
            self._boot = self._intake.clock.boot
            self._heard = _Heard()
            self._last_stamp_ms = None
            self._last = None
        if sample is not None:
            self._take(sample)

    def decision(self, decision: Decision) -> None:
        """What was decided on the frames so far; its offset is then checked exactly and at every setpoint."""
        o = decision.offset
        before = self._last
        self._last = decision
        if decision.command is None:
            return
        self.audit.offsets += 1
        limits = self._limits
        tilt = math.radians(limits.tilt_deg)
        rate = math.radians(limits.slew_tilt_deg_per_s)
        parts = [(o.thrust, limits.thrust), (o.roll, tilt), (o.pitch, tilt)]
        parts += [(a, GRAVITY * math.tan(tilt)) for a in o.acceleration]
        text = (
            f"thrust {o.thrust:+.4f}, roll {math.degrees(o.roll):+.2f}, pitch "
            f"{math.degrees(o.pitch):+.2f} deg"
        )
        self._check(Requirement.LIMITS, all(abs(v) <= most + _WIRE for v, most in parts), text)
        self._check_lost(any(abs(v) > _NOTHING for v, _ in parts), decision.t_s)
        held_back = not HOLDS_BACK_EVERYTHING.isdisjoint(decision.reasons)
        if before is None or before.command is None or held_back:
            return  # what is sent then fades by itself from what was sent last, or is nobody's to obey
        dt = min(max(decision.t_s - before.t_s, 0.0), _SLEW_GAP_S)
        b = before.offset
        moves = (
            (o.thrust - b.thrust, limits.slew_thrust_per_s),
            (o.roll - b.roll, rate),
            (o.pitch - b.pitch, rate),
        )
        inside = all(abs(move) <= most * dt + _WIRE for move, most in moves)
        moved = ", ".join(f"{move:+.4f}" for move, _ in moves)
        self._check(Requirement.SLEW, inside, f"thrust, roll, pitch moved {moved} in {dt:.3f} s")

    def _take(self, sample: Sample) -> None:
        heard = self._heard
        match sample:
            case samples.Heartbeat() if (
                sample.component == AUTOPILOT_COMPONENT and sample.autopilot != NO_AUTOPILOT
            ):
                heard.heartbeat = sample
                heard.beat_us = self._now_us
            case samples.LandedState():
                heard.air.landed_state = sample.landed_state
            case samples.Attitude():
                heard.now_s = heard.basis_s = sample.t_s
                heard.inputs_s["attitude"] = sample.t_s
                if sample.late_s <= LATE_FADE_S:
                    heard.inputs_s["timely telemetry"] = sample.t_s
            case samples.LocalPosition():
                heard.inputs_s["position"] = sample.t_s
            case samples.SetAttitudeTarget():
                heard.upstream = sample
                heard.basis_s = sample.t_s
            case samples.Range() if sample.verdict in (
                samples.RangeVerdict.OK,
                samples.RangeVerdict.ABOVE_MAX,
            ):
                for name in self._beams(sample):
                    heard.inputs_s[name] = sample.t_s
                sees = (
                    sample.verdict is samples.RangeVerdict.OK and sample.direction_frd is not None
                )
                if sees and dot(sample.direction_frd or DOWN, DOWN) > _SAME_BEAM_COS:
                    heard.air.hear_range(sample.distance_m)
            case samples.Ring() if any(not math.isnan(distance) for distance in sample.distances_m):
                heard.inputs_s[f"rangefinder {NO_ORIENTATION}"] = heard.inputs_s["rangefinders"] = (
                    sample.t_s
                )
            case samples.RotorSpeeds():
                heard.air.hear_rotors(sample)
                for name in self._rotors(sample):
                    heard.inputs_s[name] = sample.t_s
            case samples.ServoOutput():
                heard.inputs_s["servo outputs"] = sample.t_s

    def _beams(self, sample: samples.Range) -> Iterator[str]:
        yield "rangefinders"
        if self._vehicle is None or sample.direction_frd is None:
            return
        for sensor in self._vehicle.rangefinders:
            beam = orientation_direction(sensor.orientation)
            if beam is not None and dot(beam, sample.direction_frd) > _SAME_BEAM_COS:
                yield f"rangefinder {sensor.orientation}"

    def _rotors(self, sample: samples.RotorSpeeds) -> Iterator[str]:
        yield "rotor speeds"
        counts = sample.count or (None,) * len(sample.rpm)
        for esc, (rpm, count) in enumerate(zip(sample.rpm, counts, strict=True), sample.first_esc):
            before = self._heard.counts.get(esc)
            if before is not None and before != count:
                self._heard.counting.add(esc)
            if count is not None:
                self._heard.counts[esc] = count
            repeated = count is not None and before == count and esc in self._heard.counting
            if math.isfinite(rpm) and not repeated:
                yield f"rotor speed {esc}"

    # -- what goes out ----------------------------------------------------------------------------------------------

    def _own(self, frame: Frame) -> None:
        self.audit.sent += 1
        if frame.id == SET_ATTITUDE_TARGET:
            self._attitude(unpacked(frame.id, frame.payload))
        elif frame.id == SET_POSITION_TARGET:
            self._position(unpacked(frame.id, frame.payload))
        elif frame.id == _NAMED_VALUE_FLOAT:
            _, value, name = unpacked(frame.id, frame.payload)
            self._named_value(name.rstrip(b"\0").decode("ascii", "replace"), value)
        asks = (
            frame.id != _COMMAND_LONG
            or unpacked(frame.id, frame.payload)[7] == _SET_MESSAGE_INTERVAL
        )
        text = f"message {frame.id}, {frame.payload[:33].hex()}"
        self._check(Requirement.DECLARED, frame.id in _DECLARED and asks, text)

    def _attitude(self, fields: tuple[Any, ...]) -> None:
        stamp_ms, q, thrust, (system, component, mask) = (
            fields[0],
            fields[1:5],
            fields[8],
            fields[9:12],
        )
        size = math.sqrt(sum(c * c for c in q))
        proper = abs(size - 1.0) <= _UNIT
        rates_only = bool(mask & ATTITUDE_IGNORED)
        self._check(Requirement.QUATERNION, proper or rates_only, f"|q| = {size:g}")
        low, high = (MIN_THRUST, MAX_THRUST) if self._hold else (0.0, 1.0)
        self._check(Requirement.THRUST, low - _WIRE <= thrust <= high + _WIRE, f"thrust {thrust:g}")
        whole = mask & RATES_IGNORED in (0, RATES_IGNORED) and not mask & _THROTTLE_IGNORED
        formed = whole and self._addressed(system, component)
        self._check(Requirement.FORM, formed, f"mask {mask}, to {system}/{component}")
        level = proper and _tilt(q) <= _LEVEL_RAD
        if self._hold:
            bare = level
        else:
            bare = self._is_upstreams(q, thrust)
        self._setpoint(bare, f"attitude tilted by {math.degrees(_tilt(q)):.1f} deg")
        self._fresh(stamp_ms, level)
        if not self._hold:
            self._beside_upstream(q, thrust)

    def _position(self, fields: tuple[Any, ...]) -> None:
        stamp_ms, place, (system, component) = fields[0], fields[1:4], fields[13:15]
        finite = all(math.isfinite(v) for v in fields[1:12])
        self._check(
            Requirement.FORM, finite and self._addressed(system, component), f"place {place}"
        )
        self._setpoint(False, f"a place to fly to, {place[0]:.2f} {place[1]:.2f} {place[2]:.2f}")
        self._check(
            Requirement.FRESH,
            self._age_s(stamp_ms) <= _HAND_OVER_S,
            f"{self._age_s(stamp_ms):.2f} s old",
        )

    def _setpoint(self, bare: bool, what: str) -> None:
        """``bare``: carries no offset and no place, only "stay as you are"."""
        self.audit.setpoints += 1
        heard = self._heard
        beat = self._heard.heartbeat
        if self._dry_run:
            self._check(Requirement.DRY_RUN, False, what)
        self._check(Requirement.ARMED, beat is not None and beat.armed, what)
        waiting = stack_of(beat) is Stack.PX4 and bare
        if beat is None:
            mode = "no heartbeat yet"
        else:
            mode = f"mode {beat.custom_mode:#x}"
        self._check(Requirement.MODE, takes_setpoints(beat) or waiting, f"{what} in {mode}")
        standing = heard.air.landed_state == _ON_GROUND and not heard.air.contradicts_landing
        self._check(Requirement.LANDED, not standing, what)
        # By arrival where the first one came before the vehicle's clock was known.
        if beat is None:
            age_s = math.inf
        else:
            age_s = min(heard.now_s - beat.t_s, (self._now_us - heard.beat_us) / 1e6)
        self._check(
            Requirement.LINK, age_s <= _LINK_S, f"{what}, {age_s:.1f} s after the last heartbeat"
        )

    def _fresh(self, stamp_ms: int, level: bool) -> None:
        age_s = self._age_s(stamp_ms)
        last = self._last_stamp_ms
        again = last is not None and _ms_between(last, stamp_ms) <= 0
        self._last_stamp_ms = stamp_ms if not again else last
        if level:  # the end of a hold where places are not taken
            self._check(Requirement.FRESH, age_s <= _HAND_OVER_S, f"{age_s:.2f} s old")
        else:
            words = f"stamped {stamp_ms / 1000.0:.3f} s, {age_s:.2f} s old" + (
                ", a second time" if again else ""
            )
            self._check(Requirement.FRESH, age_s <= _OLD_S and not again, words)

    def _age_s(self, stamp_ms: int) -> float:
        if math.isinf(self._heard.basis_s):
            return math.inf
        return abs(_ms_between(stamp_ms, round(self._heard.basis_s * 1000.0))) / 1000.0

    def _is_upstreams(self, q: Quaternion, thrust: float) -> bool:
        sent = self._heard.upstream
        return (
            sent is not None
            and _angle(q, sent.q_ned_frd) <= _LEVEL_RAD
            and abs(thrust - sent.thrust) <= _UNIT
        )

    def _beside_upstream(self, q: Quaternion, thrust: float) -> None:
        """What is forwarded differs from what upstream sent by no more than the limits."""
        upstream = self._heard.upstream
        limits = self._limits
        if upstream is None or upstream.type_mask & ATTITUDE_IGNORED:
            return
        angle = _angle(q, upstream.q_ned_frd)
        change = thrust - upstream.thrust
        most = math.sqrt(2.0) * math.radians(limits.tilt_deg) + _LEVEL_RAD
        inside = angle <= most and abs(change) <= limits.thrust + _UNIT
        self._check(
            Requirement.LIMITS,
            inside,
            f"{math.degrees(angle):.2f} deg and {change:+.3f} from upstream's",
        )

    def _named_value(self, name: str, value: float) -> None:
        """The offsets as telemetry has them; thrust, roll and pitch come one after the other."""
        if name not in ("cc_thrust", "cc_roll", "cc_pitch"):
            return
        self._named[name] = value
        if name == "cc_thrust":
            most = self._limits.thrust
        else:
            most = math.radians(self._limits.tilt_deg)
        self._check(Requirement.LIMITS, abs(value) <= most + _WIRE, f"{name} {value:+.4f}")
        if name == "cc_pitch":
            self.audit.offsets += self._last is None
            self._check_lost(
                any(abs(v) > _NOTHING for v in self._named.values()), self._heard.now_s
            )

    def _check_lost(self, offset: bool, t_s: float) -> None:
        if not offset:
            self.audit.requirements[Requirement.INPUT_LOST].checked += 1
            return
        late = {name: t_s - self._heard.inputs_s.get(name, -math.inf) for name in self._needs}
        silent = {name: age for name, age in late.items() if age > ZERO_AFTER_S + _PERIOD_S}
        words = ", ".join(f"{name} silent for {age:.2f} s" for name, age in silent.items())
        self._check(Requirement.INPUT_LOST, not silent, words)

    def _addressed(self, system: int, component: int) -> bool:
        return component == AUTOPILOT_COMPONENT and system == (self._intake.system or system)

    def _check(self, requirement: Requirement, holds: bool, text: str) -> None:
        kept = self.audit.requirements[requirement]
        kept.checked += 1
        if holds:
            return
        if not kept.broken:
            kept.first_s = (self._now_us - (self._start_us or 0)) / 1e6
            kept.first = text
        kept.broken += 1


def _needed_inputs(vehicle: Vehicle | None, hold: bool) -> tuple[str, ...]:
    """Names of what an offset needs."""
    out = ["attitude", "timely telemetry", *(["position"] if hold else [])]
    if vehicle is None:
        return (*out, "rangefinders")
    out += [
        f"rangefinder {r.orientation}"
        for r in vehicle.rangefinders
        if r.target in ("ground", "wall")
    ]
    if not vehicle.telemetered:
        return (*out, "servo outputs")
    return (*out, *(f"rotor speed {rotor.esc}" for rotor in vehicle.rotors))


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
