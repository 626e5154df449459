"""``companion --check``: listens for ten seconds, or reads a log, and says per item whether to fly, and what to set.

Nothing is decided here that flight does not decide: the flight program runs dry on what is heard, and the items are
read off its samples and decisions. No setpoint is sent.
"""

from __future__ import annotations

import math
import shutil
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from statistics import median
from typing import Any

from companion.config import Base, Carrier, PipelineConfig
from companion.control.hover_thrust import DISAGREEMENT, hover_parameter
from companion.control.refusals import LATE_FADE_S
from companion.control.state import Decision, PipelineState
from companion.mavlink.dialect import ID_OF
from companion.mavlink.firmware import Stack, ThrustMeaning, mode_name, needed_parameters, stack_of, thrust_meaning
from companion.mavlink.frames import V2, Counts, Frame, cut, walk
from companion.mavlink.message_filter import OWN_COMPONENT, Intake
from companion.mavlink.message_table import LAYOUTS
from companion.mavlink.range_beams import orientation_direction
from companion.mavlink.samples import (
    Attitude,
    AttitudeTarget,
    LocalPosition,
    Range,
    RangeVerdict,
    Ring,
    RotorSpeeds,
    Sample,
)
from companion.mavlink.stream_rates import message_name
from companion.pipeline import initial_state, step
from models.errors import LogError
from models.frames import GRAVITY
from models.lift_ratio import IN_HOVER
from models.vehicle import Rangefinder
from models.vehicle_plausibility import warnings

LISTEN_S = 10.0
"""Long enough for a heartbeat and a parameter's answer several times over."""
_IN_AIR = 2
"""MAV_LANDED_STATE_IN_AIR."""
_DATE_S = 1_704_067_200.0
"""1 January 2024: a computer whose clock says less has not been set since its start."""
_FREE_BYTES = 1 << 30
"""An hour of flight is recorded in some 200 MB; less than this is said."""
_LEAST_HZ = 5.0
"""Of ranges and rotor speeds: slower, every single reading is too old for the next."""
_RANGE_HZ = 10.0
"""From here on a lost reading is not missed."""
_USABLE = 0.5
"""Share of the readings that must be usable."""
_REACH_M = (1.0, 0.5)
"""A rangefinder must reach this far, and begin this near: the air of ground and wall is felt in between."""
_ALIKE = (0.6, 1.6)
"""Speed of a rotor over the median of all: beyond, a pole count or an ESC number is wrong."""
_POSES = {ID_OF[name]: name for name in ("ODOMETRY", "VISION_POSITION_ESTIMATE", "VICON_POSITION_ESTIMATE")}
"""Poses that a camera sends to the estimator, or that PX4 sends back: never flown by (docs/autopilots.md)."""
_CLIMB_M_S = 0.3
"""Faster than this vertically, it does not hover."""
_SEEN_S = 2.0
"""Hover is judged after so long in the air."""


class Verdict(Enum):
    """What follows."""

    PASS = "pass"
    WARN = "warn"
    FAIL = "fail"


@dataclass(frozen=True)
class Item:
    """One thing that was looked at."""

    name: str
    verdict: Verdict
    text: str
    do: str | None = None
    """What to set or mend."""


@dataclass(frozen=True)
class Setup:
    """What the command line says beside the vehicle."""

    config: PipelineConfig
    vehicle_file: str
    model_note: str | None = None
    record: Path | None = None
    signed: bool = False
    """A signing key is given."""
    live: bool = True
    """False: a log is read."""


@dataclass
class Listener:
    """Hears frames and runs the flight program dry. Also takes a live link's recording (``write``, ``flush``)."""

    config: PipelineConfig
    system: int | None = None
    frames: int = 0
    signed: int = 0
    duration_s: float = 0.0
    arrivals_s: dict[int, list[float]] = field(default_factory=lambda: defaultdict(list))
    """By message id, of the vehicle's messages."""
    late_s: list[float] = field(default_factory=list)
    ranges: dict[int, list[Range]] = field(default_factory=lambda: defaultdict(list))
    """By orientation."""
    poses: set[str] = field(default_factory=set)
    """Names of messages that give a pose and are not flown by."""
    rings: list[Ring] = field(default_factory=list)
    rpm: dict[int, list[float]] = field(default_factory=lambda: defaultdict(list))
    """By ESC, from 1."""
    hover: list[float] = field(default_factory=list)
    """The autopilot's thrust while it hovers."""
    lift: list[float] = field(default_factory=list)
    """Modelled lift over weight while it hovers."""

    def __post_init__(self) -> None:
        self.intake = Intake(self.system)
        self.state: PipelineState = initial_state(self.config)
        self._start_us: int | None = None
        self._climb_m_s = math.inf

    def write(self, arrival_us: int, raw: bytes) -> None:
        """One frame, of either direction."""
        self.hear(arrival_us, cut(raw, 0))

    def flush(self) -> None:
        """Nothing is kept back."""

    def hear(self, arrival_us: int, frame: Frame) -> None:
        """One frame, of either direction."""
        if frame.component == OWN_COMPONENT:
            return
        self._start_us = arrival_us if self._start_us is None else self._start_us
        self.duration_s = max(self.duration_s, (arrival_us - self._start_us) / 1e6)
        self.frames += 1
        self.signed += frame.raw[0] == V2 and bool(frame.raw[2] & 1)
        if frame.id in _POSES:
            self.poses.add(_POSES[frame.id])
        if frame.id not in LAYOUTS:
            return
        sample = self.intake.sample(frame, arrival_us)
        if sample is None:
            return
        if frame.system == self.intake.system:
            self.arrivals_s[frame.id].append(arrival_us / 1e6)
        self._take(sample)
        self.state, decision = step(self.state, sample, self.config)
        if decision is not None:
            self._decided(decision)

    def _take(self, sample: Sample) -> None:
        match sample:
            case Attitude():
                self.late_s.append(sample.late_s)
            case LocalPosition():
                self._climb_m_s = abs(sample.velocity_ned[2])
            case Range():
                self.ranges[sample.orientation].append(sample)
            case Ring():
                self.rings.append(sample)
            case RotorSpeeds():
                for i, rpm in enumerate(sample.rpm):
                    self.rpm[sample.first_esc + i].append(rpm)
            case AttitudeTarget() if self.hovering:
                self.hover.append(sample.thrust)

    @property
    def flying(self) -> bool:
        """Armed and in the air."""
        beat = self.state.heartbeat
        return beat is not None and beat.armed and self.state.air.landed_state in (0, _IN_AIR)

    @property
    def hovering(self) -> bool:
        """In the air, neither climbing nor sinking."""
        return self.flying and self.state.air.landed_state == _IN_AIR and self._climb_m_s < _CLIMB_M_S

    def _decided(self, decision: Decision) -> None:
        if self.hovering and decision.disturbance is not None:
            self.lift.append(decision.disturbance.free_lift_n / (self.config.vehicle.mass_kg * GRAVITY))

    def rate(self, message_id: int) -> float:
        """Messages per second from the first to the last, stamps that repeat counted once; 0 for fewer than two."""
        stamps = sorted(set(self.arrivals_s.get(message_id, ())))
        span = stamps[-1] - stamps[0] if len(stamps) > 1 else 0.0
        return (len(stamps) - 1) / span if span > 0.0 else 0.0


def read_log(path: Path, listener: Listener) -> None:
    """Let ``listener`` hear a .tlog.

    Raises LogError where it cannot be read or holds no MAVLink.
    """
    if path.suffix.lower() != ".tlog":
        raise LogError(f"{path}: --check reads a .tlog or a link")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise LogError(f"{path}: cannot be read ({error.strerror})") from None
    starts, _ = walk(data, Counts(), 8)
    if not starts:
        raise LogError(f"{path}: holds no MAVLink frame: not a .tlog, or damaged throughout")
    for i in starts:
        listener.hear(int.from_bytes(data[i : i + 8], "big"), cut(data, i + 8))


def items(heard: Listener, setup: Setup) -> list[Item]:
    """Everything that was looked at, in the order of the table."""
    out = [*_vehicle_file(setup), *_autopilot(heard, setup)]
    if heard.state.heartbeat is not None:
        checks = (_parameters, _rates, _ranges, _rotors, _hover, _position, _clock)
        out += [item for check in checks for item in check(heard, setup)]
    return [*out, *_signing(heard, setup), *_record(setup)]


def may_fly(found: Iterable[Item]) -> bool:
    """Whether nothing failed."""
    return all(item.verdict is not Verdict.FAIL for item in found)


def as_json(found: list[Item]) -> dict[str, Any]:
    """Plain values."""
    rows = [{"name": i.name, "verdict": i.verdict.value, "text": i.text, "do": i.do} for i in found]
    counts = Counter(i.verdict.value for i in found)
    return {"fly": may_fly(found), **{v.value: counts[v.value] for v in Verdict}, "items": rows}


def as_text(found: list[Item]) -> str:
    """A table for a person."""
    lines = [f"{i.verdict.value:5} {i.name:18} {i.text}" + (f"\n{'':25}-> {i.do}" if i.do else "") for i in found]
    fails = sum(i.verdict is Verdict.FAIL for i in found)
    lines.append("may fly" if not fails else f"do not fly: {fails} of {len(found)} items fail")
    return "\n".join(lines)


def _good(name: str, text: str) -> Item:
    return Item(name, Verdict.PASS, text)


def _odd(name: str, text: str, do: str | None = None) -> Item:
    return Item(name, Verdict.WARN, text, do)


def _bad(name: str, text: str, do: str | None = None) -> Item:
    return Item(name, Verdict.FAIL, text, do)


def _vehicle_file(setup: Setup) -> Iterator[Item]:
    odd = warnings(setup.config.vehicle)
    yield from (_odd("vehicle file", f"{setup.vehicle_file}: {text}") for text in odd)
    if not odd:
        vehicle = setup.config.vehicle
        yield _good("vehicle file", f"{setup.vehicle_file}: {vehicle.name}, {vehicle.mass_kg:g} kg")
    if setup.model_note is not None:
        yield _odd("model", setup.model_note, "train or identify one of this vehicle, and give it with --model")


def _autopilot(heard: Listener, setup: Setup) -> Iterator[Item]:
    beat = heard.state.heartbeat
    if beat is None:
        what = f"{heard.frames} messages but no HEARTBEAT of an autopilot" if heard.frames else "nothing was heard"
        yield _bad("autopilot", what, "check endpoint, baud rate, routing and --target-system")
        return
    stack, mode = stack_of(beat), mode_name(beat)
    if stack is Stack.OTHER:
        yield _bad("autopilot", f"MAV_AUTOPILOT {beat.autopilot} is neither ArduPilot nor PX4")
    else:
        armed = "armed" if beat.armed else "disarmed"
        yield _good("autopilot", f"{stack.name.lower()}, system {heard.intake.system}, {mode}, {armed}")
    if heard.intake.others:
        who = ", ".join(map(str, sorted(heard.intake.others)))
        yield _odd("other autopilots", f"also on the link: system {who}", f"--target-system {heard.intake.system}")
    attitude = setup.config.carrier is Carrier.ATTITUDE
    if stack is Stack.PX4 and attitude and thrust_meaning(beat, heard.state.parameters) is ThrustMeaning.IGNORED:
        yield _bad("vehicle type", f"MAV_TYPE {beat.vehicle_type}: PX4 ignores its thrust", "set MAV_TYPE to 2 (quad)")


def _parameters(heard: Listener, setup: Setup) -> Iterator[Item]:
    beat, known = heard.state.heartbeat, heard.state.parameters
    assert beat is not None
    stack = stack_of(beat)
    if stack is Stack.ARDUPILOT and setup.config.carrier is Carrier.ATTITUDE:
        options = known.get("GUID_OPTIONS")
        if options is None:
            where = "the autopilot answers no PARAM_REQUEST_READ" if setup.live else "the log does not hold it"
            verdict = Verdict.FAIL if setup.live else Verdict.WARN
            yield Item("GUID_OPTIONS", verdict, f"not known: {where}", "look at routing; 8 must be in GUID_OPTIONS")
        elif not int(options) & 8:
            text = f"is {options:g}: thrust would be read as a climb rate"
            yield _bad("GUID_OPTIONS", text, f"set GUID_OPTIONS to {int(options) | 8}")
        else:
            yield _good("GUID_OPTIONS", f"is {options:g}: thrust is thrust")
        timeout = known.get("GUID_TIMEOUT")
        if timeout is not None and timeout > 1.0:
            text = f"is {timeout:g} s: a last attitude would be held that long"
            yield _odd("GUID_TIMEOUT", text, "set GUID_TIMEOUT to 0.5")
        elif timeout is not None:
            yield _good("GUID_TIMEOUT", f"is {timeout:g} s")
    missing = [n for n in needed_parameters(stack) if n not in known and not n.startswith("GUID_")]
    if missing and setup.live:
        yield _odd("parameters", f"not answered: {', '.join(missing)}", "defaults are taken; look at the link's load")


def _rates(heard: Listener, setup: Setup) -> Iterator[Item]:
    vehicle = setup.config.vehicle
    attitude = max(heard.rate(31), heard.rate(30))
    yield _rate("attitude rate", "ATTITUDE_QUATERNION", attitude, 10.0, 25.0)
    if setup.config.base is Base.HOLD:
        yield _rate("position rate", "LOCAL_POSITION_NED", heard.rate(32), 4.5, 20.0)
    if not vehicle.telemetered:
        yield _rate("output rate", "SERVO_OUTPUT_RAW", heard.rate(36), 5.0, 20.0)


def _rate(name: str, message: str, hz: float, least: float, good: float) -> Item:
    do = (
        f"raise the rate of {message} on this port (ArduPilot SRn_*, PX4 MAV_n_MODE and MAV_n_RATE), or the baud "
        "rate; another station may be turning it down"
    )
    text = f"{message} at {hz:.1f} Hz"
    if hz < least:
        return _bad(name, f"{text}, at least {least:g} Hz needed", do)
    return _good(name, text) if hz >= good else _odd(name, f"{text}, {good:g} Hz wanted", do)


def _ranges(heard: Listener, setup: Setup) -> Iterator[Item]:
    declared = setup.config.vehicle.rangefinders
    for sensor in declared:
        if sensor.target != "none":
            yield _ring(heard) if sensor.ring else _range(sensor, heard)
    if heard.rings and not any(sensor.ring for sensor in declared):
        count = len(heard.rings[-1].distances_m)
        yield _odd(
            "ring", f"OBSTACLE_DISTANCE of {count} directions heard, not in the vehicle file",
            f'declare it to see walls: [[rangefinder]] with ring = {count}, target = "wall", position_m = [x, y, z]',
        )  # fmt: skip
    mine = {o for o in heard.ranges for s in declared if _same_way(o, s.orientation)}
    strange = sorted(set(heard.ranges) - mine)
    if strange:
        who = ", ".join(f"{o}" for o in strange)
        yield _odd("other ranges", f"orientation {who} heard, not in the vehicle file", "declare it, or ignore it")


def _same_way(a: int, b: int) -> bool:
    if a == b:
        return True
    one, other = orientation_direction(a), orientation_direction(b)
    return one is not None and other is not None and math.dist(one, other) < 0.2


def _ring(heard: Listener) -> Item:
    """The declared ring."""
    hz = len({r.t_s for r in heard.rings}) / max(heard.duration_s, 1e-3)
    known = [d for ring in heard.rings for d in ring.distances_m if d == d]
    text = f"OBSTACLE_DISTANCE at {hz:.1f} Hz, nearest return {min(known, default=math.nan):.2f} m"
    if known and hz >= _LEAST_HZ:
        return _good("ring", text)
    return _bad("ring", f"{text}; known directions at {_LEAST_HZ:g} Hz needed", "the sensor's driver and its rate")


def _range(sensor: Rangefinder, heard: Listener) -> Item:
    """One declared rangefinder."""
    name = f"range {sensor.orientation}"
    readings = [r for o, rs in heard.ranges.items() if _same_way(o, sensor.orientation) for r in rs]
    if not readings:
        others = ", ".join(map(str, sorted(heard.ranges))) or "none"
        return _bad(
            name, f"no DISTANCE_SENSOR of orientation {sensor.orientation} ({sensor.target}); heard: {others}",
            f"set RNGFNDn_ORIENT (PX4: SENS_*_ROT) to {sensor.orientation}, or correct the vehicle file",
        )  # fmt: skip
    hz = len({r.t_s for r in readings}) / max(heard.duration_s, 1e-3)
    low, high = readings[-1].min_m, readings[-1].max_m
    values = [r.distance_m for r in readings if r.verdict is RangeVerdict.OK]
    shown = f"{median(values):.2f} m" if values else "nothing in reach"
    text = f"to the {sensor.target}: {shown}, limits {low:g} to {high:g} m, {hz:.1f} Hz"
    if hz < _LEAST_HZ:
        return _bad(name, f"{text}; at least {_LEAST_HZ:g} Hz needed", "raise the rate of DISTANCE_SENSOR on this port")
    unusable = _unusable(name, text, readings, heard.flying)
    if unusable is not None:
        return unusable
    if high < _REACH_M[0] or low > _REACH_M[1]:
        return _odd(name, f"{text}: too narrow for ground and wall", "RNGFNDn_MIN and RNGFNDn_MAX")
    good = hz >= _RANGE_HZ
    return _good(name, text) if good else _odd(name, f"{text}; {_RANGE_HZ:g} Hz wanted", "DISTANCE_SENSOR's rate")


def _unusable(name: str, text: str, readings: list[Range], flying: bool) -> Item | None:
    """What is said where most readings cannot be used; None where they can."""
    usable = sum(r.verdict in (RangeVerdict.OK, RangeVerdict.ABOVE_MAX) for r in readings) / len(readings)
    if usable >= _USABLE:
        return None
    worst = Counter(r.verdict.value for r in readings).most_common(1)[0][0]
    if worst == RangeVerdict.BELOW_MIN.value and not flying:
        return _odd(name, f"{text}; below its least distance on the ground", "RNGFNDn_MIN, or a look in hover")
    return _bad(name, f"{text}; {100.0 * (1.0 - usable):.0f} % not usable ({worst})", "RNGFNDn_MIN and RNGFNDn_MAX")


def _rotors(heard: Listener, setup: Setup) -> Iterator[Item]:
    vehicle = setup.config.vehicle
    if not vehicle.telemetered:
        return
    escs = [rotor.esc for rotor in vehicle.rotors if rotor.esc is not None]
    silent = [esc for esc in escs if not heard.rpm.get(esc)]
    if silent:
        there = ", ".join(str(e) for e, v in sorted(heard.rpm.items()) if any(x > 0.0 for x in v)) or "none"
        yield _bad(
            "rotor speeds", f"none from ESC {', '.join(map(str, silent))}; turning: {there}",
            "ESC telemetry: SERVO_BLH_AUTO, SERVO_BLH_BDMASK, SERVO_DSHOT_ESC; or the numbers in the vehicle file",
        )  # fmt: skip
        return
    hz = len(heard.rpm[escs[0]]) / max(heard.duration_s, 1e-3)
    if hz < _LEAST_HZ:
        text = f"{hz:.1f} Hz; at least {_LEAST_HZ:g} Hz needed"
        yield _bad("rotor speeds", text, "the rate of ESC_TELEMETRY or ESC_STATUS")
    elif not heard.flying:
        yield _good("rotor speeds", f"from {len(escs)} ESCs at {hz:.1f} Hz; how they fit the lift is seen in the air")
    else:
        yield _speeds_in_the_air(escs, hz, heard)
        yield from _lift(heard)


def _speeds_in_the_air(escs: list[int], hz: float, heard: Listener) -> Item:
    """Whether every rotor turns, and all about alike."""
    speeds = {esc: median([abs(v) for v in heard.rpm[esc] if not math.isnan(v)] or [0.0]) for esc in escs}
    zero = [esc for esc, rpm in speeds.items() if rpm < 1.0]
    if zero:
        return _bad("rotor speeds", f"ESC {', '.join(map(str, zero))} reads 0 in the air", "its wire or number")
    usual, (low, high) = median(speeds.values()), _ALIKE
    far = [esc for esc, rpm in speeds.items() if not low < rpm / max(usual, 1.0) < high]
    if far:
        shown = ", ".join(f"{esc}: {speeds[esc]:.0f}" for esc in escs)
        return _odd(
            "rotor speeds", f"far from the others: {', '.join(map(str, far))} of {shown} rpm", "poles per motor"
        )
    return _good("rotor speeds", f"{min(speeds.values()):.0f} to {max(speeds.values()):.0f} rpm at {hz:.1f} Hz")


def _lift(heard: Listener) -> Iterator[Item]:
    if len(heard.lift) < _SEEN_S * 10.0:
        return
    lift, (low, high) = median(heard.lift), IN_HOVER
    text = f"by rotor speeds and model the rotors lift {lift:.2f} of the weight in hover"
    if low <= lift <= high:
        yield _good("lift in hover", text)
        return
    poles = "; near 4 or 1/4 the pole count is wrong by two (SERVO_BLH_POLES)"
    yield _bad("lift in hover", text, "mass_kg, rotor_radius_m, ct or --model are of another vehicle" + poles)


def _hover(heard: Listener, setup: Setup) -> Iterator[Item]:
    if setup.config.base is not Base.HOLD:
        return
    declared, named = setup.config.vehicle.hover_thrust, hover_parameter(heard.state.parameters)
    if len(heard.hover) >= _SEEN_S * 5.0:
        seen = median(heard.hover)
        if abs(seen - declared) > DISAGREEMENT * declared:
            text = f"the autopilot hovers at {seen:.2f}, the vehicle file says {declared:.2f}"
            yield _odd("hover thrust", text, f"set hover_thrust = {seen:.2f} in the vehicle file")
        else:
            yield _good("hover thrust", f"{seen:.2f} seen, {declared:.2f} in the vehicle file")
    elif named is not None and abs(named - declared) > DISAGREEMENT * declared:
        text = f"the autopilot's parameter says {named:.2f}, the vehicle file {declared:.2f}: learned in the air"
        yield _odd("hover thrust", text, "MOT_THST_HOVER (MPC_THR_HOVER), or hover_thrust in the vehicle file")
    elif named is not None:
        yield _good("hover thrust", f"{named:.2f} by parameter, {declared:.2f} in the vehicle file")


def _position(heard: Listener, setup: Setup) -> Iterator[Item]:
    if setup.config.base is not Base.HOLD:
        return
    for message_id, component in sorted(heard.intake.not_the_autopilots):
        name = message_name(message_id)
        text = f"{name} of component {component} is left out: only the autopilot's own is flown by"
        yield _odd("position" if "POSITION" in name else "attitude", text)
    if heard.poses and not heard.rate(ID_OF["LOCAL_POSITION_NED"]):
        names = " and ".join(sorted(heard.poses))
        text = f"{names} but no LOCAL_POSITION_NED: the autopilot's estimator does not take that pose"
        yield _bad("position", text, "ArduPilot: VISO_TYPE 1, EK3_SRC1_POSXY 6 and an origin; PX4: EKF2_EV_CTRL 15")
    elif heard.state.estimates.trust.trusted:
        yield _good("position", "trusted by the autopilot")
    else:
        text = "the autopilot does not trust its own position"
        yield _bad("position", text, "wait for GPS, vision or optical flow")


def _clock(heard: Listener, setup: Setup) -> Iterator[Item]:
    late = sorted(heard.late_s)
    if late:
        most = late[min(int(0.95 * len(late)), len(late) - 1)]
        text = f"95 % of attitudes arrive within {1000.0 * most:.0f} ms of the quickest"
        if most > LATE_FADE_S:
            yield _bad("lateness", text, "baud rate, a router in between, or other load on this computer")
        elif most > 0.5 * LATE_FADE_S:
            yield _odd("lateness", text, "baud rate, a router in between, or other load on this computer")
        else:
            yield _good("lateness", text)
    boots = heard.intake.clock.boot
    if boots:
        yield _bad("autopilot's clock", f"went back {boots} times: reboots, or two autopilots of one id")
    if setup.live and time.time() < _DATE_S:
        yield _odd("computer's clock", "is not set: wrong dates, signatures may be refused", "NTP or RTC")


def _signing(heard: Listener, setup: Setup) -> Iterator[Item]:
    if not heard.frames:
        return
    if setup.signed and not heard.signed:
        yield _bad("signing", "a key is given, and nothing heard is signed with it", "--signing-key, or its file")
    elif heard.signed and not setup.signed and setup.live:
        yield _odd("signing", f"{heard.signed} of {heard.frames} frames are signed", "give --signing-key")
    else:
        yield _good("signing", "on" if setup.signed else "off, on both ends")


def _record(setup: Setup) -> Iterator[Item]:
    if not setup.live:
        return
    if setup.record is None:
        yield _odd("record", "this flight would not be recorded", "--record FOLDER")
        return
    folder = setup.record if setup.record.is_dir() else setup.record.parent
    try:
        free = shutil.disk_usage(folder).free
        probe = folder / f".companion-check-{time.monotonic_ns()}"
        probe.touch()
        probe.unlink()
    except OSError as error:
        yield _bad("record", f"{folder}: cannot be written ({error.strerror})", "make the folder, give it to this user")
        return
    text = f"{folder}: {free / (1 << 30):.1f} GiB free"
    yield (_good("record", text) if free > _FREE_BYTES else _odd("record", text, "remove old recordings"))
