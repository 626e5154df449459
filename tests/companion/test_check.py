"""``companion --check``: a good vehicle passes; each thing that is wrong fails by name, and says what to set."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from audited import config, fly_audited
from fake_autopilot import FakeAutopilot, free_port
from flight_case import Case, CasePilot
from patience import HANG_S

import models
from companion.check import CheckSetup, Item, Listener, Verdict, items, may_fly, read_log
from companion.cli import main
from companion.config import PipelineConfig
from companion.mavlink.dialect import mavlink
from companion.mavlink.wire_frames import cut
from replay.logs.tlog import read_tlog

Edit = Callable[[Any], bool | None]
OWN = replace(config("tandem"), dry_run=True)


def hover(p: CasePilot) -> Iterator[float]:
    yield from p.take_off(1.5)
    p.judge()
    yield 6.0


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dry run under a simulated ArduPilot, from boot to a hover at 1.5 m."""
    path = tmp_path_factory.mktemp("check") / "hover.tlog"
    fly_audited(
        Case("hover", "hover", hover, parameters={"GUID_TIMEOUT": 0.5}), record=path, dry_run=True
    )
    return path


def listened(
    flight: Path, edits: dict[str, Edit] | None = None, own: PipelineConfig = OWN
) -> Listener:
    """The flight heard, with messages changed."""
    listener, parser, writer = (
        Listener(config=own),
        mavlink.MAVLink(None),
        mavlink.MAVLink(None, 1, 1),
    )
    for arrival_us, raw in read_tlog(flight).frames():
        frame = cut(raw, 0)
        kind = mavlink.mavlink_map.get(frame.id)
        edit = (edits or {}).get("" if kind is None else kind.msgname)
        if edit is not None and frame.component == 1:
            message = parser.parse_buffer(raw)[0]
            if edit(message) is False:
                continue
            frame = cut(bytes(message.pack(writer)), 0)
        listener.hear(arrival_us, frame)
    return listener


@pytest.fixture(scope="module")
def heard(flight: Path) -> Listener:
    """The flight as it is; its items are read off it, and change nothing of it."""
    return listened(flight)


def checked(heard: Listener, **setup: Any) -> dict[str, Item]:
    """The items by name."""
    known = {"config": OWN, "vehicle_file": "vehicle", "live": False, **setup}
    return {item.name: item for item in items(heard, CheckSetup(**known))}


def test_a_good_flight_passes_every_item(heard):
    found = checked(heard)
    assert {name for name, item in found.items() if item.verdict is not Verdict.PASS} == set()
    assert {
        "autopilot",
        "GUID_OPTIONS",
        "range 25",
        "range 2",
        "rotor speeds",
        "lift in hover",
        "hover thrust",
    } <= set(found)


def drop(_: Any) -> bool:
    return False


def set_to(**values: Any) -> Edit:
    def edit(m: Any) -> None:
        for name, value in values.items():
            setattr(m, name, value)

    return edit


def parameter(name: str, value: float) -> Edit:
    def edit(m: Any) -> None:
        if m.param_id == name:
            m.param_value = value

    return edit


def looks_up(m: Any) -> None:
    m.orientation = {25: 24}.get(m.orientation, m.orientation)


def rpm_scaled(*by: float) -> Edit:
    def edit(m: Any) -> None:
        m.rpm = [round(v * f) for v, f in zip(m.rpm, by, strict=True)]

    return edit


def thinned(keep: int) -> Edit:
    seen: list[int] = []

    def edit(_: Any) -> bool:
        seen.append(0)
        return len(seen) % keep == 0

    return edit


WRONG = {
    "no bit 3": ({"PARAM_VALUE": parameter("GUID_OPTIONS", 0.0)}, "GUID_OPTIONS", "fail", "set GUID_OPTIONS to 8"),
    "long timeout": ({"PARAM_VALUE": parameter("GUID_TIMEOUT", 3.0)}, "GUID_TIMEOUT", "warn", "0.5"),
    "no heartbeat": ({"HEARTBEAT": drop}, "autopilot", "fail", "routing"),
    "another firmware": ({"HEARTBEAT": set_to(autopilot=0)}, "autopilot", "fail", None),
    "no position": ({"LOCAL_POSITION_NED": drop}, "position rate", "fail", "LOCAL_POSITION_NED"),
    "slow position": ({"LOCAL_POSITION_NED": thinned(5)}, "position rate", "warn", "LOCAL_POSITION_NED"),
    "slow attitude": ({"ATTITUDE_QUATERNION": thinned(10)}, "attitude rate", "fail", "ATTITUDE_QUATERNION"),
    "down lidar looks up": ({"DISTANCE_SENSOR": looks_up}, "range 25", "fail", "RNGFNDn_ORIENT"),
    "lidar without limits": ({"DISTANCE_SENSOR": set_to(max_distance=50)}, "range 25", "warn", "RNGFNDn_MAX"),
    "lidar in doubt": ({"DISTANCE_SENSOR": set_to(signal_quality=1)}, "range 25", "fail", "RNGFND"),
    "no rotor speeds": ({"ESC_TELEMETRY_1_TO_4": drop}, "rotor speeds", "fail", "SERVO_BLH"),
    "one ESC silent": ({"ESC_TELEMETRY_1_TO_4": rpm_scaled(1, 1, 0, 1)}, "rotor speeds", "fail", "wire"),
    "one pole count": ({"ESC_TELEMETRY_1_TO_4": rpm_scaled(1, 2, 1, 1)}, "rotor speeds", "warn", "poles"),
    "pole counts": ({"ESC_TELEMETRY_1_TO_4": rpm_scaled(2, 2, 2, 2)}, "lift in hover", "fail", "pole"),
    "hover thrust": ({"ATTITUDE_TARGET": set_to(thrust=0.7)}, "hover thrust", "warn", "hover_thrust = 0.70"),
    "no position fix": ({"EKF_STATUS_REPORT": set_to(flags=1)}, "position", "fail", "GPS"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_said_by_name_with_what_to_set(flight, name):
    edits, item, verdict, do = WRONG[name]
    found = checked(listened(flight, edits))
    assert found[item].verdict.value == verdict, found[item]
    assert do is None or do in (found[item].do or "")
    assert verdict != "fail" or not may_fly(found.values())


def test_how_near_a_slow_loop_may_go_to_a_wall_is_said_from_the_parameters(flight):
    own = replace(OWN, model=models.load("corner_cfd"))
    slow = parameter("ATC_INPUT_TC", 0.3)
    heard = listened(flight, {"PARAM_VALUE": slow, "LOCAL_POSITION_NED": thinned(5)}, own)
    item = checked(heard, config=own)["beside a wall"]
    assert item.verdict is Verdict.WARN
    assert "m from a wall, not less" in item.text
    assert item.do is not None
    assert "ATC_INPUT_TC" in item.do


def test_without_a_model_it_says_what_offsets_follow(heard):
    note = "the shipped model is of another fan"
    measured = checked(heard, model_note=note)["model"]
    assert measured.verdict is Verdict.WARN
    assert measured.text.startswith("offsets only where this flight has measured ground and wall")
    without = checked(heard, model_note=note, adapts=False)["model"]
    assert without.text.startswith("no offsets")


def test_a_key_that_nothing_is_signed_with_fails_and_a_record_folder_that_is_none(heard, tmp_path):
    assert checked(heard, signed=True)["signing"].verdict is Verdict.FAIL
    good = checked(heard, live=True, record=tmp_path)
    assert good["record"].verdict is Verdict.PASS
    assert not list(tmp_path.iterdir()), "the probe is gone"
    assert (
        checked(heard, live=True, record=tmp_path / "no" / "f.tlog")["record"].verdict
        is Verdict.FAIL
    )
    assert checked(heard, live=True)["record"].verdict is Verdict.WARN


def test_reading_a_log_is_hearing_it(flight, heard):
    listener = Listener(config=OWN)
    read_log(flight, listener)
    assert checked(listener) == checked(heard)


def test_the_command_reads_a_log(flight, capsys):
    assert main(["--check", str(flight)]) == 0
    assert capsys.readouterr().out.endswith("may fly\n")
    assert main(["--check", "--connect", str(flight), "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["fly"] is True
    assert main(["--check", str(flight.parent / "none.tlog")]) == 3
    assert "none.tlog" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "code"), [(8.0, 0), pytest.param(0.0, 1, marks=pytest.mark.slow)]
)
def test_the_command_listens_to_a_link_and_sends_no_setpoint(options, code):
    # A busy machine needs longer until all is asked for and answered.
    for seconds in (4, 16, 64):
        report, returned = _checked_on_link(options, seconds)
        by_name = {item["name"]: item for item in report["items"]}
        if by_name["GUID_OPTIONS"]["verdict"] == "pass" or code:
            break
    assert by_name["GUID_OPTIONS"]["verdict"] == ("pass" if code == 0 else "fail")
    assert by_name["autopilot"]["verdict"] == "pass"
    if code:
        assert returned == 1
        assert report["fly"] is False


def _checked_on_link(options: float, seconds: int) -> tuple[Any, int]:
    """Report and exit code of a check that listens for so long, to an autopilot with this GUID_OPTIONS."""
    port = free_port()
    listen = ["--connect", f"udp:127.0.0.1:{port}", "--duration", str(seconds), "--json", "-"]
    parameters = {"GUID_OPTIONS": options, "GUID_TIMEOUT": 0.5}
    with FakeAutopilot(port, parameters=parameters) as autopilot:
        run = subprocess.run(
            [sys.executable, "-m", "companion", "--check", *listen],
            capture_output=True,
            text=True,
            timeout=HANG_S,
            check=False,
        )
        assert not autopilot.of_type("SET_ATTITUDE_TARGET")
        assert not autopilot.of_type("SET_POSITION_TARGET_LOCAL_NED")
    return json.loads(run.stdout), run.returncode


def test_nothing_heard_is_a_fault_of_the_link():
    run = subprocess.run(
        [sys.executable, "-m", "companion", "--check", "--connect", f"udp:127.0.0.1:{free_port()}", "--duration", "1"],
        capture_output=True, text=True, timeout=HANG_S, check=False,
    )  # fmt: skip
    assert run.returncode == 4
    assert "nothing was heard" in run.stdout
    assert "do not fly" in run.stdout


def test_poses_of_a_camera_are_named_where_they_are_not_flown_by(flight):
    def found(*, position: bool) -> list[Item]:
        listener, link = Listener(config=OWN), mavlink.MAVLink(None, 1, 197)
        place = mavlink.MAVLink_local_position_ned_message(1000, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0)
        pose = mavlink.MAVLink_vision_position_estimate_message(1000, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0)
        for k, (arrival_us, raw) in enumerate(read_tlog(flight).frames()):
            frame = cut(raw, 0)
            if position or frame.id != 32:
                listener.hear(arrival_us, frame)
            if k % 100 == 99:
                for message in (place, pose):
                    listener.hear(arrival_us, cut(bytes(message.pack(link)), 0))
        return [
            i
            for i in items(listener, CheckSetup(config=OWN, vehicle_file="vehicle", live=False))
            if i.name == "position"
        ]

    left_out, good = found(position=True)
    assert left_out.verdict is Verdict.WARN
    assert "LOCAL_POSITION_NED of component 197" in left_out.text
    assert good.verdict is Verdict.PASS
    _, none = found(position=False)
    assert none.verdict is Verdict.FAIL
    assert "VISION_POSITION_ESTIMATE but no LOCAL_POSITION_NED" in none.text
