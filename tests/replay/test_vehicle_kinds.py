"""What a log shows of its vehicle: other kinds by name, and never a vehicle that the log does not show."""

import json
from pathlib import Path

import numpy as np
import pytest
from log_writers import BinWriter, UlgWriter, bin_flight, frame, quad_flight, write_tlog

from companion.mavlink.dialect import mavlink
from companion.vehicles import default_vehicle
from replay.cli import main
from replay.flightlog import FlightLog, Series
from replay.sources.choose import chosen
from replay.vehicle.airframe import airframe, what_it_is
from replay.vehicle.kinds import other_kind

T = np.arange(0.0, 40.0, 0.1)


def log_of(
    parameters: dict[str, float] | None = None,
    texts: tuple[str, ...] = (),
    kind: int | None = None,
    moving: int = 4,
) -> FlightLog:
    """A log whose first ``moving`` outputs move."""
    servo = np.zeros((len(T), 16))
    for k in range(moving):
        servo[:, k] = 1500.0 + 100.0 * np.sin(T + k)
    said = tuple((0.0, 6, text) for text in texts)
    return FlightLog(
        path=Path("a.BIN"), system=1, boot=0, start_s=0.0, end_s=40.0, autopilot=3, vehicle_type=kind,
        servo=Series(T, servo), servo_ports={0: Series(T, servo)}, parameters=parameters or {}, texts=said,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("log", "what"),
    [
        (log_of(kind=1), "an aeroplane"),
        (log_of(kind=3), "a coaxial helicopter"),
        (log_of(kind=7), "an airship"),
        (log_of(kind=11), "a boat"),
        (log_of(kind=12), "a submarine"),
        (log_of(kind=21), "a VTOL aeroplane"),
        (log_of({"Q_ENABLE": 1.0}, kind=1), "a VTOL aeroplane"),
        (log_of({"Q_ENABLE": 2.0, "Q_FRAME_CLASS": 1.0}), "a VTOL aeroplane"),
        (log_of({"TECS_CLMB_MAX": 5.0, "Q_ENABLE": 0.0}), "an aeroplane"),
        (log_of({"CRUISE_THROTTLE": 30.0, "FRAME_CLASS": 1.0}), "a rover"),
        (log_of({"CRUISE_THROTTLE": 30.0, "FRAME_CLASS": 2.0}), "a boat"),
        (log_of({"H_RSC_MODE": 3.0, "FRAME_CLASS": 6.0}), "a helicopter"),
        (log_of({"FRAME_CLASS": 11.0}), "a helicopter"),
        (log_of({"FRAME_CLASS": 8.0}), "a single-rotor copter with vanes"),
        (log_of({"FRAME_CLASS": 10.0}), "a bicopter"),
        (log_of(texts=("ArduPlane V4.3.0 (abc)",)), "an aeroplane"),
        (log_of(texts=("ArduRover V4.2.3",)), "a rover"),
        (log_of(texts=("ArduSub V4.1.0",)), "a submarine"),
        (log_of(texts=("APM:Copter V3.3.3", "Frame: HELI")), "a helicopter"),
        (log_of({"CA_AIRFRAME": 3.0}), "a VTOL aeroplane"),
        (log_of({"SYS_AUTOSTART": 2100.0}), "an aeroplane"),
        (log_of({"SYS_AUTOSTART": 3031.0}), "a flying wing"),
        (log_of({"SYS_AUTOSTART": 13012.0}), "a VTOL aeroplane"),
        (log_of({"SYS_AUTOSTART": 2507.0}), "an airship"),
        (log_of({"SYS_AUTOSTART": 50000.0}), "a rover"),
        (log_of({"SYS_AUTOSTART": 60002.0}), "a submarine"),
    ],
)
def test_a_vehicle_that_is_no_multirotor_is_named(log, what):
    found = other_kind(log)
    assert found is not None
    assert found.what == what
    assert what_it_is(log) == f"{what} ({found.said})"


@pytest.mark.parametrize(
    ("log", "what"),
    [
        (log_of({"FRAME_CLASS": 1.0, "FRAME_TYPE": 2.0}), "quad-v"),
        (log_of({"SYS_AUTOSTART": 6001.0}), "hexa-x"),
        (log_of(texts=("ArduCopter V4.5.7", "Frame: Y6/Y6B")), "y6b"),
        (log_of(kind=13), "a hexarotor"),
        (log_of(kind=2), "a quadrotor"),
        (log_of(), "a vehicle that the log does not name"),
        (
            log_of({"FRAME_CLASS": 2.0, "FRAME_TYPE": 1.0}, kind=2),
            "a vehicle of which the log contradicts itself",
        ),
    ],
)
def test_of_a_multirotor_as_much_is_said_as_the_log_shows(log, what):
    assert other_kind(log) is None
    assert what_it_is(log) == what


def test_a_frame_type_that_is_not_known_is_said_and_not_guessed():
    found = airframe(log_of({"FRAME_CLASS": 1.0, "FRAME_TYPE": 21.0}))
    assert (found.name, found.ordered) == ("4 rotors", False)
    assert found.unsure == "FRAME_TYPE 21 of FRAME_CLASS 1 is not known"


def test_a_tricopter_is_drafted_without_a_third_motor():
    parameters = {"FRAME_CLASS": 7.0, "FRAME_TYPE": 0.0}
    parameters |= {
        "SERVO1_FUNCTION": 33.0,
        "SERVO2_FUNCTION": 34.0,
        "SERVO3_FUNCTION": 36.0,
        "SERVO4_FUNCTION": 39.0,
    }
    found = airframe(chosen(log_of(parameters)))
    assert (found.name, dict(found.numbers)) == ("tri", {1: 1, 2: 2, 4: 3})
    assert not found.ordered


# ---------------------------------------------------------------------------------------------------------------------
def said(path: Path, name: str, *parameters: tuple[str, float], **flight) -> Path:
    """A .tlog with parameters."""
    flown = quad_flight(20.0, **flight)
    messages = [
        mavlink.MAVLink_param_value_message(key.encode(), value, 9, len(parameters), k)
        for k, (key, value) in enumerate(parameters)
    ]
    last = flown[-1][0]
    target = path / f"{name}.tlog"
    write_tlog(target, [*flown, *((last + 1 + k, frame(m)) for k, m in enumerate(messages))])
    return target


def bin_log(path: Path, *texts: str, parameters: tuple[tuple[str, float], ...] = ()) -> Path:
    """A .BIN of two seconds with start-up texts and parameters, whose outputs never move."""
    writer = BinWriter()
    writer.kind("ATT", "Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw")
    writer.kind("MSG", "QZ", "TimeUS,Message")
    writer.kind("PARM", "QNf", "TimeUS,Name,Value")
    writer.kind("RCOU", "QHHHH", "TimeUS,C1,C2,C3,C4")
    for text in texts:
        writer.row("MSG", 10_000_000, text)
    for name, value in parameters:
        writer.row("PARM", 10_000_000, name, value)
    for k in range(100):
        stamp = 10_000_000 + 20_000 * k
        writer.row("ATT", stamp, 0.0, 2.0, 0.0, -1.0, 90.0, 90.0)
        writer.row("RCOU", stamp, 1500, 1500, 1500, 1500)
    path.write_bytes(writer.bytes())
    return path


def ulg_log(path: Path, *, system_type: int = 0, vehicle_type: int = 1, vtol: bool = False) -> Path:
    """A .ulg of two seconds whose vehicle_status says what it is."""
    writer = UlgWriter()
    writer.topic("vehicle_attitude", ("float[4]", "q"))
    names = ("arming_state", "nav_state", "system_type", "system_id", "vehicle_type")
    writer.topic("vehicle_status", *[("uint8_t", name) for name in names], ("bool", "is_vtol"))
    writer.subscribe()
    for k in range(100):
        stamp = 20_000_000 + 20_000 * k
        writer.row("vehicle_attitude", stamp, 1.0, 0.0, 0.0, 0.0)
        writer.row("vehicle_status", stamp, 2, 14, system_type, 1, vehicle_type, vtol)
    path.write_bytes(writer.bytes())
    return path


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Logs of many kinds, none of the paper's tandem."""
    said(tmp_path, "plane", kind=1)
    said(tmp_path, "rover", kind=10)
    said(tmp_path, "quadplane", ("Q_ENABLE", 1.0), kind=1)
    said(tmp_path, "quad")
    said(tmp_path, "bench", parked=True)
    said(tmp_path, "wrong_hexa", ("FRAME_CLASS", 2.0), ("FRAME_TYPE", 1.0))
    bin_log(tmp_path / "old_plane.BIN", "ArduPlane V4.3.0")
    bin_log(tmp_path / "boat.BIN", parameters=(("CRUISE_THROTTLE", 30.0), ("FRAME_CLASS", 2.0)))
    bin_log(tmp_path / "still_v.BIN", parameters=(("FRAME_CLASS", 1.0), ("FRAME_TYPE", 2.0)))
    (tmp_path / "nothing.BIN").write_bytes(bin_flight(outputs=False))
    (tmp_path / "may").mkdir()
    said(tmp_path / "may", "quad", ("FRAME_CLASS", 1.0), ("FRAME_TYPE", 3.0))
    ulg_log(tmp_path / "px4_plane.ulg", vehicle_type=2)
    ulg_log(tmp_path / "px4_vtol.ulg", system_type=22, vtol=True)
    return tmp_path


def test_every_log_of_a_folder_is_named_as_what_it_is(folder, capsys):
    assert main(["info", str(folder)]) == 0
    lines = capsys.readouterr().out.splitlines()
    named = {line.partition(": ")[0]: line.partition(": ")[2] for line in lines}
    assert len(lines) == len(named) == 13
    assert default_vehicle().name not in "".join(lines)
    for log, words in (
        ("plane.tlog", "an aeroplane (MAV_TYPE 1), 20 s"),
        ("rover.tlog", "a rover (MAV_TYPE 10)"),
        ("quadplane.tlog", "a VTOL aeroplane (Q_ENABLE 1)"),
        ("quad.tlog", "quad-x, 20 s"),
        ("bench.tlog", "quad-x"),
        ("may/quad.tlog", "quad-h"),
        ("wrong_hexa.tlog", "a vehicle of which the log contradicts itself"),
        ("old_plane.BIN", "an aeroplane ('ArduPlane V4.3.0')"),
        ("boat.BIN", "a boat (parameter CRUISE_THROTTLE)"),
        ("still_v.BIN", "quad-v"),
        ("nothing.BIN", "a vehicle that the log does not name"),
        ("px4_plane.ulg", "an aeroplane (MAV_TYPE 1)"),
        ("px4_vtol.ulg", "a VTOL aeroplane (MAV_TYPE 22)"),
    ):
        assert named[log].startswith(words), named[log]
    assert "can be judged: forces" in named["quad.tlog"]
    assert "cannot be judged: MAV_TYPE 1 is an aeroplane" in named["plane.tlog"]


def test_no_answer_about_a_folder_of_others_names_the_papers_tandem(folder, tmp_path, capsys):
    assert main(["info", str(folder), "--companion", "--json", "-"]) == 0
    told = capsys.readouterr().out
    assert default_vehicle().name not in told
    by_name = {Path(answer["log"]).name: answer for answer in json.loads(told)}
    assert by_name["plane.tlog"]["companion"]["engages"] is False
    assert "aeroplane" in by_name["plane.tlog"]["companion"]["text"]
    for log in sorted(folder.glob("*.*")):
        code = main(["run", str(log), "--json", "-"])
        out = capsys.readouterr()
        assert default_vehicle().name not in out.out + out.err
        assert code in (0, 3)
        assert out.err.count("\n") == (code == 3)


def test_replay_run_of_a_quadrotor_flies_the_draft(folder, capsys):
    assert main(["run", str(folder / "quad.tlog"), "--json", "-"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["vehicle"].startswith("quad-x, drafted from quad.tlog")
    assert report["model"] == "none"
    assert any(note.startswith("assumed: mass_kg") for note in report["notes"])


def test_predict_asks_for_the_vehicle_of_the_model(folder, capsys):
    assert main(["predict", str(folder / "quad.tlog"), "--model", "none"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "--vehicle" in line
