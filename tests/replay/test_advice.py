"""Advice and errors speak the language of the log: its messages, its firmware's parameters, the right direction."""

from pathlib import Path

import numpy as np
import pytest
from log_writers import bin_flight, quad_flight, ulg_flight, write_tlog

from companion.vehicles import QUAD, TANDEM
from models.common.errors import LogError
from models.vehicle import load_vehicle
from replay.cli import main
from replay.flightlog import FlightLog, Series
from replay.info.abilities import abilities
from replay.residual.motion import read_motion
from replay.vehicle.airframe import airframe

T = np.arange(0.0, 40.0, 0.02)
MAVLINK_ONLY = ("HIGHRES_IMU", "RAW_IMU", "ATTITUDE", "ESC_TELEMETRY", "ESC_STATUS", "SERVO_OUTPUT_RAW", "PARAM_VALUE",
                "LOCAL_POSITION_NED", "DISTANCE_SENSOR", "HEARTBEAT")  # fmt: skip


def log_of(name: str, autopilot: int = 3, **more) -> FlightLog:
    """A log with an attitude alone."""
    upright = np.tile([1.0, 0.0, 0.0, 0.0], (len(T), 1))
    attitude = Series(T, upright)
    return FlightLog(
        path=Path(name),
        system=1,
        boot=0,
        start_s=0.0,
        end_s=40.0,
        autopilot=autopilot,
        vehicle_type=2,
        **({"attitude": attitude} | more),
    )


def why_not(act) -> str:
    with pytest.raises(LogError) as refused:
        act()
    return str(refused.value)


@pytest.mark.parametrize(
    ("name", "imu", "attitude", "speeds", "outputs"),
    [
        (
            "a.tlog",
            "HIGHRES_IMU, RAW_IMU or SCALED_IMU",
            "ATTITUDE",
            "ESC_TELEMETRY",
            "SERVO_OUTPUT_RAW",
        ),
        ("a.BIN", "no IMU", "no ATT:", "ESC or RPM", "RCOU"),
        ("a.ulg", "sensor_combined", "vehicle_attitude", "esc_status", "actuator_outputs"),
    ],
)
def test_what_is_missing_has_the_name_that_it_has_in_this_format(
    name, imu, attitude, speeds, outputs
):
    vehicle = load_vehicle(QUAD)
    bare = log_of(name)
    refusals = [why_not(lambda: read_motion(bare, vehicle)), why_not(lambda: airframe(bare))]
    assert imu in refusals[0]
    assert speeds in refusals[1]
    assert outputs in refusals[1]
    moved = log_of(name, attitude=None, imus=(object(),))
    refusals.append(why_not(lambda: read_motion(moved, vehicle)))
    assert attitude in refusals[2]
    if not name.endswith(".tlog"):
        lacking = " ".join(line.partition("recorded by")[0] for line in refusals)
        assert not [word for word in MAVLINK_ONLY if word in lacking]


@pytest.mark.parametrize(
    ("name", "setting"),
    [("a.tlog", "SRx_"), ("a.BIN", "LOG_BITMASK"), ("a.ulg", "SDLOG_PROFILE with bit 0 (default)")],
)
def test_what_is_missing_is_said_with_the_setting_that_records_it(name, setting):
    vehicle = load_vehicle(QUAD)
    autopilot = 12 if name.endswith(".ulg") else 3
    bare = log_of(name, autopilot)
    assert setting in why_not(lambda: read_motion(bare, vehicle))
    unturned = log_of(name, autopilot, attitude=None, imus=(object(),))
    assert setting in why_not(lambda: read_motion(unturned, vehicle))


def test_missing_speeds_and_outputs_of_a_vehicle_file_have_the_names_of_the_format(
    tmp_path, capsys
):
    (tmp_path / "a.BIN").write_bytes(bin_flight(40.0, outputs=False))
    assert main(["diagnose", str(tmp_path / "a.BIN"), "--vehicle", str(QUAD)]) == 3
    line = capsys.readouterr().err
    assert "no rotor speed of ESC 1, 2, 3, 4 (ESC or RPM)" in line


def test_what_a_replay_lacks_has_the_names_of_the_format(tmp_path, capsys):
    (tmp_path / "a.ulg").write_bytes(ulg_flight())
    assert main(["run", str(tmp_path / "a.ulg"), "--vehicle", str(TANDEM)]) == 0
    told = capsys.readouterr().out
    assert "esc_status" in told
    assert "ESC_TELEMETRY" not in told


# ---------------------------------------------------------------------------------------------------------------------
def advice(log: FlightLog, question: str) -> tuple[str, str]:
    found = next(a for a in abilities(log, None) if a.question == question)
    return found.why, found.change


@pytest.mark.parametrize(
    ("name", "autopilot"),
    [("a.tlog", 3), ("a.BIN", 3), ("a.ulg", 12), ("b.tlog", 12), ("c.tlog", 0)],
)
def test_advice_for_a_range_names_the_direction_that_is_asked_about(name, autopilot):
    log = log_of(name, autopilot)
    ceiling = advice(log, "ceiling")[1]
    assert "24 up" in ceiling
    assert "25" not in ceiling
    ground = advice(log, "height over ground")[1]
    assert "25 down" in ground
    assert "24" not in ground
    wall = advice(log, "distance to a wall")[1]
    assert all(turned in wall for turned in ("0 ahead", "2 right", "4 back", "6 left"))
    assert "25" not in wall


@pytest.mark.parametrize(
    ("known", "old", "new"),
    [
        ({"texts": ((0.0, 6, "ArduCopter V4.6.3"),)}, True, False),
        ({"texts": ((0.0, 6, "ArduCopter V4.7.0-beta2"),)}, False, True),
        ({"parameters": {"SR0_EXTRA1": 4.0}}, True, False),
        ({"parameters": {"MAV1_EXTRA1": 4.0}}, False, True),
        ({}, True, True),
    ],
)
def test_stream_rates_have_the_names_of_the_firmware(known, old, new):
    change = advice(log_of("a.tlog", **known), "forces (Fx Fy Fz)")[1]
    assert ("SRx_" in change, "MAVx_" in change) == (old, new)


@pytest.mark.parametrize(
    ("known", "words"),
    [
        (
            {"texts": ((0.0, 6, "APM:Copter V3.3.3 (acf16c4e)"),)},
            "ArduCopter 3.3 has no GUID_OPTIONS",
        ),
        ({"texts": ((0.0, 6, "ArduCopter V4.0.7"),)}, "ArduCopter 4.0 has no GUID_OPTIONS"),
        ({"parameters": {"FRAME": 1.0}}, "ArduCopter before 3.5 has no GUID_OPTIONS"),
    ],
)
@pytest.mark.parametrize("name", ["a.BIN", "a.tlog"])
def test_a_firmware_without_guid_options_is_not_called_a_cut_file(known, words, name):
    why, change = advice(log_of(name, **known), "meaning of thrust")
    assert words in why
    assert "cut" not in change


def test_a_list_of_parameters_without_guid_options_says_since_when_it_is_there():
    parameters = {"FRAME_CLASS": 1.0, "FRAME_TYPE": 1.0}
    _, change = advice(log_of("a.BIN", parameters=parameters), "meaning of thrust")
    assert "from 4.1 on" in change
    new = {"texts": ((0.0, 6, "ArduCopter V4.5.7"),)}
    _, change = advice(log_of("a.BIN", **new), "meaning of thrust")
    assert "cut?" in change


# ---------------------------------------------------------------------------------------------------------------------
def test_a_drafted_answer_says_nothing_of_another_vehicles_fan(tmp_path, capsys):
    write_tlog(tmp_path / "a.tlog", quad_flight(40.0))
    for command in (["diagnose"], ["run"], ["info", "--companion"]):
        assert main([*command, str(tmp_path / "a.tlog")]) == 0
        told = capsys.readouterr().out
        assert "another fan" not in told
        assert "shipped" not in told
