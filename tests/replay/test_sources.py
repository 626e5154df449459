"""Which of several instances each quantity is read from: the one rule, and what it chooses on made-up logs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from log_writers import BinWriter, UlgWriter, bin_flight, frame, heartbeat, write_tlog

from companion.mavlink.dialect import mavlink
from models.common.errors import ConfigError
from replay import load
from replay.cli import main
from replay.flightlog import FlightLog, ImuRecord, Lane, Series, Stated
from replay.sources.candidates import Candidate, pick
from replay.sources.choose import chosen

T = np.arange(0.0, 20.0, 0.05)
NEVER = np.full(len(T), np.nan)


def series(*columns: np.ndarray | float, source: str = "") -> Series:
    return Series(T, np.stack([np.broadcast_to(c, T.shape) for c in columns], axis=1), source)


def log(**columns) -> FlightLog:
    return FlightLog(path=Path("a.BIN"), system=1, boot=0, start_s=0.0, end_s=20.0, **columns)


def choice(of: FlightLog, quantity: str, **settings: str):
    found = chosen(of, settings)
    return next((c for c in found.sources if c.quantity == quantity), None)


# --- the rule ---------------------------------------------------------------------------------------------------------


def test_the_one_that_is_asked_for_comes_before_all_others():
    some = [Candidate(name="a"), Candidate(name="b", fault="dead")]
    assert pick("battery", some, Stated("a", "X"), "b").chosen == "b"
    assert pick("battery", some, wanted="2").chosen == "b"
    with pytest.raises(ConfigError, match=r"battery=c: .* it has: a, b"):
        pick("battery", some, wanted="c")


def test_the_autopilot_is_believed_unless_its_instance_is_dead():
    alive = [Candidate(name="a", agreement=1.0), Candidate(name="b")]
    found = pick("imu", alive, Stated("b", "XKF4.PI"))
    assert (found.chosen, found.others, found.why) == (
        "b",
        ("a",),
        "the autopilot uses it (XKF4.PI)",
    )
    dead = [Candidate(name="a"), Candidate(name="b", fault="reads 0")]
    assert pick("imu", dead, Stated("b", "XKF4.PI")).chosen == "a"


def test_among_those_that_are_alive_the_best_agreement_decides_and_else_the_order():
    some = [
        Candidate(name="a", agreement=0.1, because="it moves"),
        Candidate(name="b", agreement=1.0, because="it moves"),
    ]
    assert pick("imu", some).chosen == "b"
    alike = [Candidate(name="a", agreement=0.8), Candidate(name="b", agreement=1.0)]
    assert pick("imu", alike).chosen == "a"
    assert pick("imu", [Candidate(name="a", fault="dead")]) is None


# --- batteries --------------------------------------------------------------------------------------------------------
PACK = series(16.4 - 0.04 * T, 20.0 + np.sin(T))
RAIL = series(5.1, 0.5)


@pytest.mark.parametrize(
    "other",
    [RAIL, series(0.02, 0.0), series(0.02, NEVER), series(NEVER, NEVER), series(NEVER, 15.0)],
)
@pytest.mark.parametrize("first", [True, False])
def test_the_battery_is_the_pack_whichever_comes_first(other, first):
    found = {"BAT 0": PACK, "BAT 1": other} if first else {"BAT 0": other, "BAT 1": PACK}
    read = chosen(log(batteries=found))
    assert np.nanmedian(read.battery.values[:, 0]) == pytest.approx(16.0, abs=0.1)


def test_without_currents_the_battery_is_the_one_that_sags():
    rail, pack = series(5.1 + 0.001 * np.sin(T), NEVER), series(16.4 - 0.04 * T, NEVER)
    found = choice(log(batteries={"BAT 0": rail, "BAT 1": pack}), "battery")
    assert (found.chosen, found.why) == ("BAT 1", "it sags the most in flight")


def test_two_packs_that_share_the_load_are_read_as_the_first():
    found = choice(
        log(batteries={"BAT 0": PACK, "BAT 1": series(16.3 - 0.04 * T, 22.0)}), "battery"
    )
    assert found.chosen == "BAT 0"


def test_the_battery_that_scales_the_motors_is_the_one_in_use():
    two = log(
        batteries={"BAT 0": PACK, "BAT 1": series(16.3 - 0.04 * T, 22.0)},
        parameters={"MOT_BAT_IDX": 1.0},
    )
    assert choice(two, "battery").why == "the autopilot uses it (MOT_BAT_IDX)"


@pytest.mark.filterwarnings("error")
def test_a_damaged_power_of_a_battery_is_left_out_in_silence():
    current = np.where(T < 1.0, np.inf, 22.0)
    voltage = np.where(T < 1.0, 0.0, 16.3 - 0.04 * T)
    found = {"BAT 0": series(voltage, current), "BAT 1": series(16.3 + 0.0 * T, 1e308)}
    assert choice(log(batteries=found), "battery").chosen == "BAT 0"


def test_a_log_whose_batteries_are_all_dead_has_none():
    assert chosen(log(batteries={"BAT 0": series(0.02, 0.0)})).battery is None


# --- inertial sensors -------------------------------------------------------------------------------------------------
TURNS = 0.3 * np.sin(2.0 * T)
ROLL = 0.15 * (1.0 - np.cos(2.0 * T))
ATTITUDE = series(np.cos(ROLL / 2.0), np.sin(ROLL / 2.0), 0.0, 0.0)


def imu(name: str, gyro, down: float = -9.8, **more) -> ImuRecord:
    force = series(0.01 * np.sin(9.0 * T), 0.0, down, source=name)
    return ImuRecord(
        source=name,
        specific_force=force,
        gyro=series(gyro, 0.0, 0.0),
        force_step=0.0,
        clipped=0,
        **more,
    )


@pytest.mark.parametrize(
    ("dead", "parameters"),
    [
        (imu("IMU", 0.0, down=0.0), {}),
        (imu("IMU", 0.0), {}),
        (imu("IMU", TURNS, down=-0.3), {}),
        (imu("IMU", NEVER, down=np.nan), {}),
        (imu("IMU", TURNS), {"INS_USE": 0.0}),
        (imu("IMU", TURNS, healthy=False), {}),
    ],
    ids=["zeros", "gyro frozen", "a thirtieth of g", "no number", "not used", "unhealthy"],
)
def test_a_dead_imu_is_left_aside(dead, parameters):
    good = imu("IMU:1", TURNS, instance=1)
    read = chosen(log(imus=(dead, good), attitude=ATTITUDE, parameters=parameters))
    assert read.imus[0].source == "IMU:1"
    assert {i.source for i in read.imus} == {"IMU", "IMU:1"}


def test_of_two_good_imus_the_first_or_the_one_in_use_is_read():
    two = (imu("IMU", TURNS), imu("IMU:1", TURNS, instance=1))
    assert chosen(log(imus=two, attitude=ATTITUDE)).imus[0].source == "IMU"
    used = log(
        imus=two, attitude=ATTITUDE, stated={"imu": Stated("IMU:1", "XKF4.PI, EK3_IMU_MASK")}
    )
    assert chosen(used).imus[0].source == "IMU:1"
    assert chosen(used, {"imu": "IMU"}).imus[0].source == "IMU"


def test_where_every_imu_is_dead_they_stay_so_that_their_fault_can_be_said():
    assert chosen(log(imus=(imu("IMU", 0.0, down=0.0),))).imus[0].source == "IMU"


# --- estimator, barometer ---------------------------------------------------------------------------------------------
def test_the_lane_is_the_one_that_was_primary():
    lanes = {
        f"XKF1 core {k}": Lane(position=series(k, 0.0, -2.0), velocity=series(0.0, 0.0, 0.0))
        for k in range(2)
    }
    assert chosen(log(lanes=lanes)).position.values[0, 0] == 0.0
    primary = log(lanes=lanes, stated={"position": Stated("XKF1 core 1", "XKF4.PI")})
    assert chosen(primary).position.values[0, 0] == 1.0


def test_the_filter_is_the_one_that_the_autopilot_flies_with():
    lanes = {
        name: Lane(series(k, 0.0, 0.0), None)
        for k, name in enumerate(("XKF1 core 0", "NKF1 core 0"))
    }
    assert chosen(log(lanes=lanes, parameters={"AHRS_EKF_TYPE": 2.0})).position.values[0, 0] == 1.0


@pytest.mark.parametrize("dead", [series(0.0, 20.0), series(NEVER, 20.0), series(1e7, 20.0)])
def test_a_dead_barometer_is_left_aside(dead):
    read = chosen(
        log(
            pressures={"BARO 0": dead, "BARO 1": series(1e5, 25.0)},
            parameters={"BARO_PRIMARY": 0.0},
        )
    )
    assert read.pressure.values[0, 0] == 1e5


# --- outputs ----------------------------------------------------------------------------------------------------------
FLIGHT = 1500.0 + 80.0 * np.sin(T)
THRUST = series(0.5 + 0.1 * np.sin(T))


def port(*columns) -> Series:
    return series(*columns, *[0.0] * (16 - len(columns)))


def functions(pattern: str, first: int = 1) -> dict[str, float]:
    return {pattern.format(first + k): 101.0 + k for k in range(4)}


MOTORS = port(*[FLIGHT] * 4)
IDLE = port(*[900.0] * 4)
GIMBAL = port(*[1500.0 + 300.0 * np.cos(0.7 * T)] * 2)


@pytest.mark.parametrize(
    ("ports", "parameters", "used"),
    [
        ({0: IDLE, 1: MOTORS}, functions("PWM_AUX_FUNC{}"), 1),
        ({0: GIMBAL, 1: MOTORS}, functions("PWM_AUX_FUNC{}"), 1),
        ({0: MOTORS, 1: GIMBAL}, functions("PWM_MAIN_FUNC{}"), 0),
        ({0: IDLE, 1: GIMBAL, 2: MOTORS}, functions("UAVCAN_EC_FUNC{}"), 2),
        ({0: MOTORS}, functions("PWM_AUX_FUNC{}"), 0),
        ({0: GIMBAL, 1: MOTORS}, {}, 1),
        ({0: MOTORS, 1: GIMBAL}, {}, 0),
        ({0: IDLE, 1: MOTORS}, functions("PWM_MAIN_FUNC{}") | functions("PWM_AUX_FUNC{}"), 1),
    ],
)
def test_the_port_is_the_one_with_the_motors(ports, parameters, used):
    read = chosen(log(servo_ports=ports, parameters=parameters, thrust_command=THRUST))
    assert read.motor_outputs.port == used
    assert read.servo is ports[used]
    if parameters:
        assert read.motor_outputs.numbers == {1: 1, 2: 2, 3: 3, 4: 4}


def test_motors_behind_servos_keep_their_outputs():
    outputs = port(1500.0, 1500.0, *[FLIGHT] * 4)
    read = chosen(log(servo_ports={0: outputs}, parameters=functions("PWM_MAIN_FUNC{}", 3)))
    assert read.motor_outputs.numbers == {1: 3, 2: 4, 3: 5, 4: 6}


def test_where_no_output_moves_the_motors_are_read_from_what_was_asked_of_them():
    asked = replace(MOTORS, source="actuator_motors")
    read = chosen(log(servo_ports={0: IDLE}, motor_commands=asked, thrust_command=THRUST))
    assert read.servo is asked
    assert (
        choice(log(servo_ports={0: IDLE}, motor_commands=asked), "outputs").why
        == "no output of a port moves"
    )


# --- readers ----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", ["Inst", "Instance"])
def test_batteries_of_a_dataflash_log_are_read_apart(tmp_path, name):
    path = tmp_path / "a.bin"
    w = BinWriter()
    w.kind("ATT", "Qfff", "TimeUS,Roll,Pitch,Yaw")
    w.kind("BAT", "QBff", f"TimeUS,{name},Volt,Curr")
    for k in range(200):
        us = 10_000_000 + 20_000 * k
        w.row("ATT", us, 0.0, 0.0, 0.0)
        w.row("BAT", us, 0, 5.1, 0.5)
        w.row("BAT", us + 40, 1, 16.0, 20.0)
    path.write_bytes(w.bytes())
    (read,) = load(path)
    assert read.battery.values[:, 0] == pytest.approx(16.0)
    assert len(read.battery) == 200


def test_the_primary_core_of_a_dataflash_log_names_lane_and_imu(tmp_path):
    path = tmp_path / "a.bin"
    w = BinWriter()
    w.kind("ATT", "Qfff", "TimeUS,Roll,Pitch,Yaw")
    w.kind("IMU", "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
    w.kind("XKF1", "QBffffff", "TimeUS,C,VN,VE,VD,PN,PE,PD")
    w.kind("XKF4", "QBb", "TimeUS,C,PI")
    w.kind("PARM", "QNf", "TimeUS,Name,Value")
    w.row("PARM", 10_000_000, "EK3_IMU_MASK", 3.0)
    for k in range(200):
        us = 10_000_000 + 20_000 * k
        w.row("ATT", us, 0.0, 0.0, 0.0)
        for core in (0, 1):
            w.row("IMU", us, core, 0.0, 0.0, 0.0, 0.0, 0.0, -9.8)
            w.row("XKF1", us, core, 0.0, 0.0, 0.0, float(core), 0.0, -2.0)
            w.row("XKF4", us, core, 1)
    path.write_bytes(w.bytes())
    (read,) = load(path)
    assert read.position.values[0, 0] == 1.0
    assert read.imus[0].source == "IMU:1"


def test_outputs_beyond_the_fourteenth_are_read_from_the_messages_that_hold_them(tmp_path):
    path = tmp_path / "a.bin"
    w = BinWriter()
    w.kind("ATT", "Qfff", "TimeUS,Roll,Pitch,Yaw")
    w.kind("RCOU", "Q" + "H" * 14, "TimeUS," + ",".join(f"C{k}" for k in range(1, 15)))
    w.kind("RCO2", "QHHHH", "TimeUS,C15,C16,C17,C18")
    for k in range(200):
        us = 10_000_000 + 20_000 * k
        w.row("ATT", us, 0.0, 0.0, 0.0)
        w.row("RCOU", us, *range(1001, 1015))
        w.row("RCO2", us, 1015, 1016, 1017 + k, 1018)
    path.write_bytes(w.bytes())
    (read,) = load(path)
    assert read.servo_ports[0].values[50].tolist() == list(range(1001, 1017))
    assert read.servo_ports[1].values[50, 1] == 1018.0


def test_batteries_of_a_telemetry_log_are_read_apart(tmp_path):
    messages = []
    for k in range(200):
        ms = 40_000 + 20 * k
        when = 1_767_225_600_000_000 + 20_000 * k
        messages.append((when, frame(mavlink.MAVLink_attitude_message(ms, 0, 0, 0, 0, 0, 0))))
        for number, cell in ((0, 12), (1, 4000)):
            cells = [cell] * 4 + [65535] * 6
            battery = mavlink.MAVLink_battery_status_message(
                number, 0, 1, 2500, cells, 1500, -1, -1, 80
            )
            messages.append((when, frame(battery)))
        if k % 50 == 0:
            messages.append((when, frame(heartbeat())))
    write_tlog(tmp_path / "a.tlog", messages)
    (read,) = load(tmp_path / "a.tlog")
    assert read.battery.values[:, 0] == pytest.approx(16.0)


def test_a_battery_of_px4_that_is_not_connected_is_no_battery(tmp_path):
    w = UlgWriter()
    w.topic("vehicle_attitude", ("float[4]", "q"))
    for k in range(2):
        w.topic(
            f"battery_status:{k}",
            ("float", "voltage_v"),
            ("float", "current_a"),
            ("bool", "connected"),
        )
    w.topic("actuator_motors", ("float[12]", "control"))
    w.subscribe()
    for k in range(100):
        us = 20_000_000 + 20_000 * k
        w.row("vehicle_attitude", us, 1.0, 0.0, 0.0, 0.0)
        w.row("battery_status:0", us, 12.0, 30.0, False)
        w.row("battery_status:1", us, 16.0, 20.0, True)
        w.row("actuator_motors", us, *[0.5] * 4, *[np.nan] * 8)
    (tmp_path / "a.ulg").write_bytes(w.bytes())
    (read,) = load(tmp_path / "a.ulg")
    assert read.battery.values[:, 0] == pytest.approx(16.0)
    assert read.servo.values[0, :5].tolist() == [1500.0] * 4 + [0.0]


# --- commands ---------------------------------------------------------------------------------------------------------
def test_info_says_what_was_read_and_set_overrules_it(tmp_path, capsys):
    path = tmp_path / "a.bin"
    path.write_bytes(bin_flight(4.0))
    assert main(["info", str(path), "--json", "-"]) == 0
    said = json.loads(capsys.readouterr().out)[0]
    assert said["source"]["position"] == {
        "chosen": "XKF1 core 0",
        "others": ["XKF1 core 1"],
        "why": "the first of those that are alike",
    }
    assert main(["info", str(path), "--set", "position=2"]) == 0
    assert (
        "read from position: XKF1 core 1, not XKF1 core 0: set by --set" in capsys.readouterr().out
    )


@pytest.mark.parametrize(
    ("pair", "says"),
    [
        ("battery=9", "no such instance"),
        ("battery", "must be QUANTITY=NAME"),
        ("sails=1", "no such quantity; known: battery, imu"),
    ],
)
def test_a_wrong_set_is_one_line(tmp_path, capsys, pair, says):
    path = tmp_path / "a.bin"
    path.write_bytes(bin_flight(4.0))
    assert main(["info", str(path), "--set", pair]) == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1
