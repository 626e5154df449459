"""``companion --check``: listens for ten seconds, or reads a log, and says per item whether to fly, and what to set.

Nothing is decided here that flight does not decide: the flight program runs dry on what is heard, and the items are
read off its samples and decisions. No setpoint is sent.
"""

from __future__ import annotations

import math
import os
import shutil
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from statistics import median
from typing import Any

from companion.config import Base, Carrier, PipelineConfig
from companion.control.hover_thrust import DISAGREEMENT, LEARNED_S, hover_parameter
from companion.control.lateness import LATE_FADE_S
from companion.control.plant import Source, declared_loop, tune
from companion.control.wall_stability import beside_wall
from companion.disturbance.wall_law import hovering, wall_law
from companion.mavlink import OWN_COMPONENT, samples
from companion.mavlink.dialect import ID_OF
from companion.mavlink.file_frames import STAMP_BYTES, cut_file
from companion.mavlink.firmware import (
    Stack,
    ThrustMeaning,
    mode_name,
    needed_parameters,
    stack_of,
    thrust_meaning,
)
from companion.mavlink.message_filter import Intake
from companion.mavlink.message_table import LAYOUTS
from companion.mavlink.range_beams import orientation_direction
from companion.mavlink.samples import RangeVerdict, Sample
from companion.mavlink.wire_frames import V2, Counts, Frame, cut
from companion.pipeline import initial_state, step
from companion.state.pipeline_state import PipelineState
from models.common.errors import LogError
from models.common.frames import GRAVITY
from models.vehicle import Rangefinder
from models.vehicle.lift_ratio import IN_HOVER
from models.vehicle.plausibility import warnings

LISTEN_S = 10.0
"""Long enough for a heartbeat and a parameter's answer several times over."""
_IN_AIR = 2
"""MAV_LANDED_STATE_IN_AIR."""
_FREE_BYTES = 1 << 30
"""An hour of flight is recorded in some 200 MB; less than this is said."""
_LEAST_HZ = 5.0
"""Of ranges and rotor speeds: slower, every single reading is too old for the next."""
_RANGE_HZ = 10.0
"""From here on a lost reading is not missed."""
_NEAR_WALL_M = 0.15
"""Work at a wall is so near."""
_LOW_RADII = 2.0
"""Near the ground a wall's pull may grow faster: there it is looked at too."""
_USABLE = 0.5
"""Share of the readings that must be usable."""
_REACH_M = (1.0, 0.5)
"""A rangefinder must reach this far, and begin this near: the air of ground and wall is felt in between."""
_BEFORE_4_7 = "before ArduPilot 4.7:"
"""Release notes of 4.7: limits in metres have other names than those in centimetres."""
_ALIKE = (0.6, 1.6)
"""Speed of a rotor over the median of all: beyond, a pole count or an ESC number is wrong."""
_POSES = {
    ID_OF[name]: name
    for name in ("ODOMETRY", "VISION_POSITION_ESTIMATE", "VICON_POSITION_ESTIMATE")
}
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


_WARN = Verdict.WARN
_FAIL = Verdict.FAIL


@dataclass(frozen=True)
class Item:
    """One thing that was looked at."""

    name: str
    verdict: Verdict
    text: str
    do: str | None = None
    """What to set or mend."""


@dataclass(frozen=True, kw_only=True)
class CheckSetup:
    """What the command line says beside the vehicle."""

    config: PipelineConfig
    vehicle_file: str
    model_note: str | None = None
    adapts: bool = True
    """Whether the flight measures ground and wall (``--adapt full``)."""
    record: Path | None = None
    signed: bool = False
    """A signing key is given."""
    live: bool = True
    """False: a log is read."""


@dataclass(kw_only=True)
class Listener:
    """Hears frames and runs the flight program dry. Also takes a live link's recording (``write``, ``flush``)."""

    config: PipelineConfig
    system: int | None = None
    frames: int = 0
    signed: int = 0
    samples: dict[type[Sample], list[Any]] = field(default_factory=lambda: defaultdict(list))
    """What the vehicle sent, by kind."""
    poses: set[str] = field(default_factory=set)
    """Names of messages that give a pose and are not flown by."""
    lift: list[float] = field(default_factory=list)
    """Modelled lift over weight while it hovers."""

    def __post_init__(self) -> None:
        self.intake = Intake(self.system)
        self.state: PipelineState = initial_state(self.config)

    def write(self, arrival_us: int, raw: bytes) -> None:
        """One frame, of either direction."""
        self.hear(arrival_us, cut(raw, 0))

    def flush(self) -> None:
        """Nothing is kept back."""

    def hear(self, arrival_us: int, frame: Frame) -> None:
        """One frame, of either direction."""
        if frame.component == OWN_COMPONENT:
            return
        self.frames += 1
        self.signed += frame.raw[0] == V2 and bool(frame.raw[2] & 1)
        if frame.id in _POSES:
            self.poses.add(_POSES[frame.id])
        if frame.id in LAYOUTS:
            sample = self.intake.sample(frame, arrival_us)
        else:
            sample = None
        if sample is None:
            return
        self.samples[type(sample)].append(sample)
        self.state, decision = step(self.state, sample, self.config)
        if decision is not None and decision.disturbance is not None and self.hovering:
            self.lift.append(
                decision.disturbance.free_lift_n / (self.config.vehicle.mass_kg * GRAVITY)
            )

    @property
    def flying(self) -> bool:
        """Armed and in the air."""
        beat = self.state.heard.heartbeat
        return (
            beat is not None and beat.armed and self.state.air.airborne.landed_state in (0, _IN_AIR)
        )

    @property
    def hovering(self) -> bool:
        """In the air, neither climbing nor sinking."""
        places = self.samples[samples.LocalPosition]
        steady = bool(places) and abs(places[-1].velocity_ned[2]) < _CLIMB_M_S
        return steady and self.flying and self.state.air.airborne.landed_state == _IN_AIR


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
    found = cut_file(data, Counts(), STAMP_BYTES)
    if not found.start.size:
        raise LogError(f"{path}: holds no MAVLink frame: not a .tlog, or damaged throughout")
    for i in found.start.tolist():
        listener.hear(int.from_bytes(data[i - STAMP_BYTES : i], "big"), cut(data, i))


def items(heard: Listener, setup: CheckSetup) -> list[Item]:
    """Everything that was looked at, in the order of the table."""
    out = [*_vehicle_file(setup), *_autopilot(heard, setup)]
    if heard.state.heard.heartbeat is not None:
        checks = (_parameters, _rates, _ranges, _rotors, _hover, _position, _wall, _clock)
        out += [item for check in checks for item in check(heard, setup)]
    return [*out, *_signing(heard, setup), *_record(setup)]


def may_fly(found: Iterable[Item]) -> bool:
    """Whether nothing failed."""
    return all(item.verdict is not Verdict.FAIL for item in found)


def silent(heard: Listener) -> bool:
    """Whether no autopilot was heard at all: that is a fault of the link, not of the vehicle."""
    return heard.state.heard.heartbeat is None


def as_json(found: list[Item]) -> dict[str, Any]:
    """Plain values."""
    rows = [{"name": i.name, "verdict": i.verdict.value, "text": i.text, "do": i.do} for i in found]
    counts = Counter(i.verdict.value for i in found)
    return {"fly": may_fly(found), **{v.value: counts[v.value] for v in Verdict}, "items": rows}


def as_text(found: list[Item]) -> str:
    """A table for a person."""
    lines = []
    for i in found:
        lines.append(
            f"{i.verdict.value:5} {i.name:18} {i.text}" + (f"\n{'':25}-> {i.do}" if i.do else "")
        )
    fails = sum(i.verdict is Verdict.FAIL for i in found)
    lines.append("may fly" if not fails else f"do not fly: {fails} of {len(found)} items fail")
    return "\n".join(lines)


Fault = tuple[bool, Verdict, str, str | None]
"""Whether it holds, what follows, what is said of it, and what to do."""


def _judged(name: str, text: str, *faults: Fault) -> Item:
    """The first fault that holds; a pass where none does."""
    for holds, verdict, more, do in faults:
        if holds:
            return Item(name, verdict, text + more, do)
    return Item(name, Verdict.PASS, text)


def _vehicle_file(setup: CheckSetup) -> Iterator[Item]:
    vehicle = setup.config.vehicle
    odd = warnings(setup.config.vehicle)
    for text in odd or [f"{vehicle.name}, {vehicle.mass_kg:g} kg"]:
        yield Item("vehicle file", _WARN if odd else Verdict.PASS, f"{setup.vehicle_file}: {text}")
    if setup.model_note is not None:
        if setup.adapts:
            what = "offsets only where this flight has measured ground and wall"
        else:
            what = "no offsets"
        yield Item(
            "model",
            _WARN,
            f"{what}: no model of this vehicle ({setup.model_note})",
            "fly --survey BOX with --record FILE, then replay diagnose FILE --save-model DIR, and "
            "give --model DIR (docs/survey.md)",
        )


def _autopilot(heard: Listener, setup: CheckSetup) -> Iterator[Item]:
    beat = heard.state.heard.heartbeat
    if beat is None:
        if heard.frames:
            what = f"{heard.frames} messages but no HEARTBEAT of an autopilot"
        else:
            what = "nothing was heard"
        yield Item(
            "autopilot", _FAIL, what, "check endpoint, baud rate, routing and --target-system"
        )
        return
    stack = stack_of(beat)
    if beat.armed:
        armed = "armed"
    else:
        armed = "disarmed"
    yield _judged(
        "autopilot",
        f"{stack.name.lower()}, system {heard.intake.system}, {mode_name(beat)}, {armed}",
        (
            stack is Stack.OTHER,
            _FAIL,
            f": MAV_AUTOPILOT {beat.autopilot} is neither ArduPilot nor PX4",
            None,
        ),
    )
    if heard.intake.others:
        who = ", ".join(map(str, sorted(heard.intake.others)))
        yield Item("other autopilots", _WARN, f"also on the link: system {who}", "--target-system")
    attitude = setup.config.carrier is Carrier.ATTITUDE
    if attitude and thrust_meaning(beat, heard.state.heard.parameters) is ThrustMeaning.IGNORED:
        text = f"MAV_TYPE {beat.vehicle_type}: PX4 ignores its thrust"
        yield Item("vehicle type", _FAIL, text, "set MAV_TYPE to 2 (quad)")


def _parameters(heard: Listener, setup: CheckSetup) -> Iterator[Item]:
    beat = heard.state.heard.heartbeat
    known = heard.state.heard.parameters
    assert beat is not None
    stack = stack_of(beat)
    if stack is Stack.ARDUPILOT and setup.config.carrier is Carrier.ATTITUDE:
        options = known.get("GUID_OPTIONS")
        timeout = known.get("GUID_TIMEOUT")
        if options is None:
            if setup.live:
                where = "the autopilot answers no PARAM_REQUEST_READ"
            else:
                where = "the log does not hold it"
            if setup.live:
                verdict = _FAIL
            else:
                verdict = _WARN
            yield Item(
                "GUID_OPTIONS",
                verdict,
                f"not known: {where}",
                "look at routing; 8 must be in GUID_OPTIONS",
            )
        else:
            bits = int(options)
            do = f"set GUID_OPTIONS to {bits | 8}"
            fault = (not bits & 8, _FAIL, ": thrust would be read as a climb rate", do)
            yield _judged("GUID_OPTIONS", f"is {bits}", fault)
        if timeout is not None:
            fault = (
                timeout > 1.0,
                _WARN,
                ": a last attitude would be held that long",
                "set GUID_TIMEOUT to 0.5",
            )
            yield _judged("GUID_TIMEOUT", f"is {timeout:g} s", fault)
    missing = [n for n in needed_parameters(stack) if n not in known and not n.startswith("GUID_")]
    if missing and setup.live:
        do = "defaults are taken; look at the link's load"
        yield Item("parameters", _WARN, f"not answered: {', '.join(missing)}", do)


def _hz(samples: Iterable[Sample]) -> float:
    """Samples per second from the first to the last, stamps that repeat counted once; 0 for fewer than two."""
    stamps = {sample.t_s for sample in samples}
    if stamps:
        span = max(stamps) - min(stamps)
    else:
        span = 0.0
    if span > 0.0:
        return (len(stamps) - 1) / span
    return 0.0


def _rates(heard: Listener, setup: CheckSetup) -> Iterator[Item]:
    attitudes = Counter(sample.source for sample in heard.samples[samples.Attitude]).most_common(1)
    hz = _hz(a for a in heard.samples[samples.Attitude] if a.source == attitudes[0][0])
    yield _rate("attitude rate", "ATTITUDE_QUATERNION", hz, 10.0, 25.0)
    if setup.config.base is Base.HOLD:
        yield _rate(
            "position rate",
            "LOCAL_POSITION_NED",
            _hz(heard.samples[samples.LocalPosition]),
            4.5,
            20.0,
        )
    if not setup.config.vehicle.telemetered:
        yield _rate(
            "output rate", "SERVO_OUTPUT_RAW", _hz(heard.samples[samples.ServoOutput]), 5.0, 20.0
        )


def _rate(name: str, message: str, hz: float, least: float, good: float, text: str = "") -> Item:
    do = (
        f"raise the rate of {message} on this port (ArduPilot SRn_*, PX4 MAV_n_MODE and "
        "MAV_n_RATE), or the baud rate; another station may be turning it down"
    )
    return _judged(
        name,
        f"{text}{message} at {hz:.1f} Hz",
        (hz < least, _FAIL, f", at least {least:g} Hz needed", do),
        (hz < good, _WARN, f", {good:g} Hz wanted", do),
    )


def _ranges(heard: Listener, setup: CheckSetup) -> Iterator[Item]:
    declared = setup.config.vehicle.rangefinders
    rings = heard.samples[samples.Ring]
    for sensor in declared:
        if sensor.target != "none" and not sensor.ring:
            yield _range(sensor, heard)
    if any(sensor.ring for sensor in declared):
        known = []
        for ring in rings:
            for d in ring.distances_m:
                if not math.isnan(d):
                    known.append(d)
        text = f"nearest return {min(known, default=math.nan):.2f} m, "
        yield _rate(
            "ring", "OBSTACLE_DISTANCE", _hz(rings) if known else 0.0, _LEAST_HZ, _LEAST_HZ, text
        )
    elif rings:
        count = len(rings[-1].distances_m)
        yield Item(
            "ring",
            _WARN,
            f"OBSTACLE_DISTANCE of {count} directions heard, not in the vehicle file",
            f'declare it to see walls: [[rangefinder]] with ring = {count}, target = "wall", '
            "position_m = [x, y, z]",
        )


def _same_way(a: int, b: int) -> bool:
    one = orientation_direction(a)
    other = orientation_direction(b)
    return a == b or (one is not None and other is not None and math.dist(one, other) < 0.2)


def _range(sensor: Rangefinder, heard: Listener) -> Item:
    """One declared rangefinder."""
    name = f"range {sensor.orientation}"
    readings = [
        r for r in heard.samples[samples.Range] if _same_way(r.orientation, sensor.orientation)
    ]
    if not readings:
        others = (
            ", ".join(map(str, sorted({r.orientation for r in heard.samples[samples.Range]})))
            or "none"
        )
        return Item(
            name,
            _FAIL,
            f"no DISTANCE_SENSOR of orientation {sensor.orientation} ({sensor.target}); heard: "
            f"{others}",
            f"set RNGFNDn_ORIENT (PX4: SENS_*_ROT) to {sensor.orientation}, or correct the "
            "vehicle file",
        )
    low = readings[-1].min_m
    high = readings[-1].max_m
    values = [r.distance_m for r in readings if r.verdict is RangeVerdict.OK]
    if values:
        shown = f"{median(values):.2f} m"
    else:
        shown = "nothing in reach"
    text = f"to the {sensor.target}: {shown}, limits {low:g} to {high:g} m, "
    slow = _rate(name, "DISTANCE_SENSOR", _hz(readings), _LEAST_HZ, _RANGE_HZ, text)
    if slow.verdict is _FAIL:
        return slow
    verdicts = Counter(r.verdict for r in readings)
    usable = (verdicts[RangeVerdict.OK] + verdicts[RangeVerdict.ABOVE_MAX]) / len(readings)
    worst = verdicts.most_common(1)[0][0]
    standing = worst is RangeVerdict.BELOW_MIN and not heard.flying
    limits = f"RNGFNDn_MIN and RNGFNDn_MAX ({_BEFORE_4_7} RNGFNDn_MIN_CM and RNGFNDn_MAX_CM)"
    useless = usable < _USABLE
    narrow = high < _REACH_M[0] or low > _REACH_M[1]
    found = _judged(
        name,
        text + f"{100.0 * usable:.0f} % usable",
        (
            useless and standing,
            _WARN,
            ": below its least distance on the ground",
            f"RNGFNDn_MIN ({_BEFORE_4_7} RNGFNDn_MIN_CM), or a look in hover",
        ),
        (useless, _FAIL, f": {worst.value}", limits),
        (narrow, _WARN, ": too narrow for ground and wall", limits),
    )
    if found.verdict is Verdict.PASS:
        return slow
    return found


def _rotors(heard: Listener, setup: CheckSetup) -> Iterator[Item]:
    vehicle = setup.config.vehicle
    if not vehicle.telemetered:
        return
    rpm: dict[int, list[float]] = defaultdict(list)
    for sample in heard.samples[samples.RotorSpeeds]:
        for i, value in enumerate(sample.rpm):
            rpm[sample.first_esc + i].append(abs(value))
    escs = [rotor.esc for rotor in vehicle.rotors if rotor.esc is not None]
    speeds = {}
    for esc in escs:
        speeds[esc] = median([v for v in rpm[esc] if not math.isnan(v)] or [0.0])
    silent = [str(esc) for esc in escs if not rpm[esc]]
    there = ", ".join(str(e) for e, v in sorted(rpm.items()) if any(x > 0.0 for x in v)) or "none"
    zero = [str(esc) for esc in escs if speeds[esc] < 1.0]
    usual, (low, high) = max(median(speeds.values()), 1.0), _ALIKE
    far = [f"{esc}: {rpm:.0f}" for esc, rpm in speeds.items() if not low < rpm / usual < high]
    hz = _hz(
        s
        for s in heard.samples[samples.RotorSpeeds]
        if s.first_esc <= escs[0] < s.first_esc + len(s.rpm)
    )
    telemetry = (
        "ESC telemetry: SERVO_BLH_AUTO, SERVO_BLH_BDMASK, SERVO_DSHOT_ESC; or the numbers in the "
        "vehicle file"
    )
    yield _judged(
        "rotor speeds",
        f"{len(escs)} ESCs at {hz:.1f} Hz",
        (bool(silent), _FAIL, f": none from ESC {', '.join(silent)}; turning: {there}", telemetry),
        (
            hz < _LEAST_HZ,
            _FAIL,
            f"; at least {_LEAST_HZ:g} Hz needed",
            "the rate of ESC_TELEMETRY or ESC_STATUS",
        ),
        (
            heard.flying and bool(zero),
            _FAIL,
            f": ESC {', '.join(zero)} reads 0 in the air",
            "its wire or number",
        ),
        (
            heard.flying and bool(far),
            _WARN,
            f": far from {usual:.0f} rpm: {', '.join(far)}",
            "poles per motor",
        ),
    )
    if len(heard.lift) >= _SEEN_S * 10.0:
        lift, (low, high) = median(heard.lift), IN_HOVER
        do = (
            "mass_kg, rotor_radius_m, ct or --model are of another vehicle; near 4 or 1/4 the "
            "pole count is wrong by two (SERVO_BLH_POLES)"
        )
        text = f"by rotor speeds and model the rotors lift {lift:.2f} of the weight in hover"
        yield _judged("lift in hover", text, (not low <= lift <= high, _FAIL, "", do))


def _hover(heard: Listener, setup: CheckSetup) -> Iterator[Item]:
    hover = heard.state.learned.hover
    declared = setup.config.vehicle.hover_thrust
    flown = hover.seconds >= LEARNED_S
    if flown:
        theirs = hover.learned
    else:
        theirs = hover_parameter(heard.state.heard.parameters)
    if setup.config.base is Base.HOLD and theirs is not None:
        text = (
            f"{theirs:.2f} {'flown' if flown else 'by parameter'}, {declared:.2f} in the vehicle "
            "file"
        )
        do = f"set hover_thrust = {theirs:.2f} in the vehicle file, or the autopilot's parameter"
        fault = (abs(theirs - declared) > DISAGREEMENT * declared, _WARN, "", do)
        yield _judged("hover thrust", text, fault)


def _position(heard: Listener, setup: CheckSetup) -> Iterator[Item]:
    if setup.config.base is not Base.HOLD:
        return
    for message_id, component in sorted(heard.intake.not_the_autopilots):
        name = LAYOUTS[message_id].name
        text = f"{name} of component {component} is left out: only the autopilot's own is flown by"
        yield Item("position" if "POSITION" in name else "attitude", _WARN, text)
    if heard.poses and not heard.samples[samples.LocalPosition]:
        names = " and ".join(sorted(heard.poses))
        text = (
            f"{names} but no LOCAL_POSITION_NED: the autopilot's estimator does not take that pose"
        )
        do = "ArduPilot: VISO_TYPE 1, EK3_SRC1_POSXY 6 and an origin; PX4: EKF2_EV_CTRL 15"
        yield Item("position", _FAIL, text, do)
    else:
        trusted = heard.state.estimates.trust.trusted
        text = f"{'trusted' if trusted else 'not trusted'} by the autopilot"
        yield _judged(
            "position", text, (not trusted, _FAIL, "", "wait for GPS, vision or optical flow")
        )


def _wall(heard: Listener, setup: CheckSetup) -> Iterator[Item]:
    """How near to a wall the hold may go: by the loop that was measured, or by the parameters."""
    if setup.config.base is not Base.HOLD:
        return
    state = heard.state
    loop = state.plant.loop
    if loop.source is not Source.MEASURED:
        loop = declared_loop(state.heard.stack, state.heard.parameters)
    tuned = tune(loop, state.plant.timing)
    heights = (math.inf, _LOW_RADII * setup.config.vehicle.rotor_radius_m)
    laws = [wall_law(setup.config, hovering(setup.config, height_m)) for height_m in heights]
    least_m = max([beside_wall(tuned, law).least_wall_m for law in laws])
    if least_m == 0.0:
        yield Item("beside a wall", Verdict.PASS, "the hold is stable at any distance")
        return
    text = f"this attitude loop can hold {least_m:.2f} m from a wall, not less"
    do = "a quicker attitude loop (ATC_INPUT_TC, MC_ROLL_P, MC_PITCH_P), or positions more often"
    yield _judged("beside a wall", text, (least_m > _NEAR_WALL_M, _WARN, "", do))


def _clock(heard: Listener, setup: CheckSetup) -> Iterator[Item]:
    late = sorted(sample.late_s for sample in heard.samples[samples.Attitude])
    if late:
        most = late[min(int(0.95 * len(late)), len(late) - 1)]
        text = f"95 % of attitudes arrive within {1000.0 * most:.0f} ms of the quickest"
        do = "baud rate, a router in between, or other load on this computer"
        faults = ((most > LATE_FADE_S, _FAIL, "", do), (most > 0.5 * LATE_FADE_S, _WARN, "", do))
        yield _judged("lateness", text, *faults)
    boots = heard.intake.clock.boot
    if boots:
        yield Item(
            "autopilot's clock",
            _FAIL,
            f"went back {boots} times: reboots, or two autopilots of one id",
        )


def _signing(heard: Listener, setup: CheckSetup) -> Iterator[Item]:
    if heard.frames:
        mine = setup.signed
        theirs = heard.signed
        yield _judged(
            "signing",
            f"{theirs} of {heard.frames} frames are signed",
            (mine and not theirs, _FAIL, ", and a key is given", "--signing-key, or its file"),
            (
                bool(theirs) and not mine and setup.live,
                _WARN,
                ", and no key is given",
                "give --signing-key",
            ),
        )


def _record(setup: CheckSetup) -> Iterator[Item]:
    if not setup.live:
        return
    if setup.record is None:
        yield Item("record", _WARN, "this flight would not be recorded", "--record FOLDER")
        return
    if setup.record.is_dir():
        folder = setup.record
    else:
        folder = setup.record.parent
    writable = folder.is_dir() and os.access(folder, os.W_OK)
    if writable:
        free = shutil.disk_usage(folder).free
    else:
        free = 0
    yield _judged(
        "record",
        f"{folder}: {free / (1 << 30):.1f} GiB free",
        (not writable, _FAIL, ": cannot be written", "make the folder, give it to this user"),
        (free < _FREE_BYTES, _WARN, "", "remove old recordings"),
    )
