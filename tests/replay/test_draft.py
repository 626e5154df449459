"""A vehicle drafted from a log: frame, outputs and thrust of real logs, and what is refused."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from log_writers import QUAD_CT, QUAD_MASS_KG, frame, quad_flight, write_tlog

from companion.mavlink.dialect import mavlink
from companion.vehicles import default_vehicle
from models.common.errors import LogError
from models.vehicle import load_vehicle
from replay import load
from replay.cli import main
from replay.flightlog import EscRecord, FlightLog, Series
from replay.logs import tlog_flightlog
from replay.logs.tlog_flightlog import read as read_log
from replay.sources.choose import chosen
from replay.vehicle.airframe import airframe
from replay.vehicle.draft import draft
from replay.vehicle.given import Given


@dataclass(frozen=True)
class Row:
    """A log, the vehicle file beside it, and what a draft must find; ``hover`` is False where no throttle is logged."""

    log: str
    vehicle: str
    drive: str = "esc"
    spins: bool = True
    hover: bool = True
    thrust: float = 0.03
    """Tolerance of ct or of the throttle curve's lift at hover."""


ROWS = (
    Row("ardupilot/s1_quad3_ground_wall_corner.tlog", "ardupilot/s1_quad3_ground_wall_corner.toml"),
    Row(
        "ardupilot/s4_quad3_attitude_target_corner.tlog",
        "ardupilot/s4_quad3_attitude_target_corner.toml",
    ),
    # MOT_THST_HOVER is 0.39 there, the thrust command 0.44 and the file's number nominal.
    Row(
        "firmware/ardupilot/approach_offsets_off.tlog", "firmware/ardupilot/quad3.toml", hover=False
    ),
    Row("firmware/px4/corner_offsets_off.tlog", "firmware/px4/quad.toml"),
    Row("firmware/px4/gps_lost.tlog", "firmware/px4/quad.toml"),
    Row("firmware/strong_corner/px4_off.tlog", "firmware/strong_corner/px4_quad.toml"),
    Row(
        "measured/nf_baseline_nowind.tlog",
        "measured/neural-fly.toml",
        "servo",
        spins=False,
        thrust=0.05,
    ),
    Row(
        "measured/appius/HIGH_ALTITUDE_V_050.tlog",
        "measured/appius/appius.toml",
        spins=False,
        hover=False,
    ),
    Row("measured/imrc/BL_t06.tlog", "measured/imrc/BL.toml", spins=False, hover=False),
    Row(
        "measured/crazypad/E8_normal_b.tlog",
        "measured/crazypad/E8.toml",
        "servo",
        spins=False,
        thrust=0.05,
    ),
)


def drafted(*paths: Path, **given: float):
    return draft(paths, Given(**given))


@pytest.mark.parametrize("row", ROWS, ids=lambda row: Path(row.log).stem)
def test_a_draft_is_the_vehicle_that_flew(shared_data, row):
    given = load_vehicle(shared_data / row.vehicle)
    made = drafted(
        shared_data / row.log, mass_kg=given.mass_kg, propeller_m=2.0 * given.rotor_radius_m
    ).vehicle
    assert len(made.fans) == len(given.fans)
    assert {getattr(r, row.drive) for r in made.rotors} == {1, 2, 3, 4}
    if row.spins:
        assert {getattr(r, row.drive): r.spin for r in made.rotors} == {
            getattr(r, row.drive): r.spin for r in given.rotors
        }
    if row.hover:
        assert made.hover_thrust == pytest.approx(given.hover_thrust, rel=0.03)
    if made.telemetered:
        assert made.fans[0].ct == pytest.approx(given.fans[0].ct, rel=row.thrust)
    else:
        u = given.hover_thrust

        def lift(t):
            return t.max_thrust_n * ((1.0 - t.expo) * u + t.expo * u * u)

        assert lift(made.throttle) == pytest.approx(lift(given.throttle), rel=row.thrust)


def test_px4_parameters_say_places_and_spins(shared_data):
    (log,) = load(shared_data / "open" / "ulg_pyulog_sample_px4_events_SITL.ulg")
    found = airframe(log)
    assert found.telemetered
    assert dict(found.numbers) == {1: 1, 2: 2, 3: 3, 4: 4}
    assert [m.spin for m in found.motors] == [-1, -1, 1, 1]
    left = found.motors[1]
    assert (left.forward * found.arm_m, left.right * found.arm_m) == pytest.approx(
        (-0.1515, -0.1875), abs=0.001
    )


def test_old_ardupilot_says_its_frame_by_one_parameter(shared_data):
    made = drafted(shared_data / "open" / "bin_dronekit_la_log171.bin", mass_kg=1.5).vehicle
    assert [r.servo for r in made.rotors] == [1, 2, 3, 4]
    assert (made.throttle.pwm_min_us, made.throttle.pwm_max_us) == (1000.0, 1900.0)
    assert made.hover_thrust == pytest.approx(0.40, abs=0.04)


@pytest.mark.parametrize("log", ["null_a", "payload", "wind"])
def test_a_log_of_the_papers_tandem_is_known_by_its_outputs(shared_data, log):
    made = drafted(shared_data / "undeclared" / f"{log}.tlog")
    assert made.vehicle == default_vehicle()


def test_a_vtol_is_refused(shared_data):
    with pytest.raises(LogError, match="MAV_TYPE 22"):
        drafted(shared_data / "open" / "ulg_pyulog_sample_log_small.ulg")


# ---------------------------------------------------------------------------------------------------------------------
T = np.arange(0.0, 40.0, 0.1)


def flown(path="a.BIN", *, outputs=4, escs=0, **more) -> FlightLog:
    """A log whose first ``outputs`` outputs move, and whose first ``escs`` ESCs turn."""
    servo = np.zeros((len(T), 16))
    for k in range(outputs):
        servo[:, k] = 1500.0 + 100.0 * np.sin(T + k)
    speeds = {
        k: EscRecord(Series(T, 5000.0 + 50.0 * np.sin(T + k)[:, None])) for k in range(1, escs + 1)
    }
    ports = {0: Series(T, servo)} if outputs else {}
    log = FlightLog(
        path=Path(path), system=1, boot=0, start_s=0.0, end_s=40.0, servo_ports=ports, escs=speeds
    )
    return chosen(replace(log, **{"vehicle_type": 2, "autopilot": 3, **more}))


def copter(number: int, kind: int, motors: int, first: int = 1) -> dict[str, float]:
    """Parameters of ArduPilot with its motors on the outputs from ``first`` on."""
    return {
        "FRAME_CLASS": float(number), "FRAME_TYPE": float(kind), "MOT_PWM_MIN": 1000.0, "MOT_PWM_MAX": 2000.0,
        **{f"SERVO{first + k}_FUNCTION": 33.0 + k for k in range(motors)},
    }  # fmt: skip


@pytest.mark.parametrize(
    ("number", "kind", "outputs", "name", "fans"),
    [
        (1, 1, 4, "quad-x", 4), (1, 0, 4, "quad-plus", 4), (1, 3, 4, "quad-h", 4), (1, 12, 4, "quad-bf", 4),
        (2, 1, 6, "hexa-x", 6), (3, 1, 8, "octo-x", 8), (4, 1, 8, "octaquad-x", 4), (5, 0, 6, "y6", 3),
    ],
)  # fmt: skip
def test_the_frame_is_that_of_the_parameters(number, kind, outputs, name, fans):
    log = flown(outputs=outputs, vehicle_type=None, parameters=copter(number, kind, outputs))
    found = airframe(log)
    assert (found.name, found.ordered, len(found.motors)) == (name, True, outputs)
    assert len({(m.forward, m.right) for m in found.motors}) == fans


def test_motors_of_px4_may_sit_on_aux_or_on_can():
    for name in ("PWM_AUX_FUNC", "UAVCAN_EC_FUNC"):
        functions = {f"{name}{k}": 100.0 + k - 4 for k in range(5, 9)} | {"PWM_MAIN_FUNC1": 0.0}
        found = airframe(flown(outputs=8, autopilot=12, parameters=functions))
        assert dict(found.numbers) == {1: 5, 2: 6, 3: 7, 4: 8}


def test_speeds_of_as_many_escs_as_motors_are_taken_in_order():
    four = {k + 4: esc for k, esc in flown(escs=4).escs.items()}
    found = airframe(replace(flown(outputs=0), escs=four))
    assert (found.telemetered, dict(found.numbers)) == (True, {1: 5, 2: 6, 3: 7, 4: 8})


def test_a_frame_that_is_not_known_is_judged_by_forces_alone():
    found = airframe(flown(outputs=4, parameters=copter(1, 4, 4)))
    assert (found.ordered, len(found.motors)) == (False, 4)


@pytest.mark.parametrize(
    ("log", "words"),
    [
        (flown(vehicle_type=1), "MAV_TYPE 1 is an aeroplane"),
        (flown(vehicle_type=10), "MAV_TYPE 10 is a rover"),
        (flown(vehicle_type=4), "MAV_TYPE 4 is a helicopter"),
        (flown(vehicle_type=None, parameters=copter(6, 0, 4)), "FRAME_CLASS 6 is a helicopter"),
        (flown(vehicle_type=None, texts=((0.0, 6, "ArduPlane V4.5.7"),)), "ArduPlane"),
        (
            flown(vehicle_type=None, autopilot=12, parameters={"CA_AIRFRAME": 1.0}),
            "CA_AIRFRAME 1 is an aeroplane",
        ),
        (flown(vehicle_type=None, outputs=4, parameters=copter(2, 1, 6)), "output 5 never moves"),
        (flown(outputs=4, parameters=copter(2, 1, 4)), "FRAME_CLASS 2, FRAME_TYPE 1 have 6 motors"),
        (flown(outputs=4, escs=6, parameters=copter(1, 1, 4)), "6 ESCs turn"),
        (flown(vehicle_type=13, parameters=copter(1, 1, 4)), "MAV_TYPE 13"),
        (flown(parameters={**copter(1, 1, 4), "MOT_PWM_MAX": 1520.0}), "MOT_PWM_MAX"),
        (flown(outputs=0), "neither rotor speeds nor outputs"),
    ],
)
def test_what_no_vehicle_can_be_drafted_from_is_refused_in_one_line(log, words):
    with pytest.raises(LogError, match=words) as refused:
        airframe(log)
    assert str(refused.value).startswith("a.BIN: ")
    assert "\n" not in str(refused.value)


# ---------------------------------------------------------------------------------------------------------------------
@pytest.fixture
def log(tmp_path):
    path = tmp_path / "hover.tlog"
    write_tlog(path, quad_flight(60.0))
    return path


def answered(capsys, *arguments) -> dict:
    assert main(["diagnose", *map(str, arguments), "--json", "-"]) == 0
    return json.loads(capsys.readouterr().out)


def test_a_log_is_read_once_for_draft_and_diagnosis(tmp_path, monkeypatch, capsys):
    path = tmp_path / "short.tlog"
    write_tlog(path, quad_flight(20.0))
    read: list[Path] = []

    def counted(log: Path, target_system: int | None) -> list[FlightLog]:
        read.append(log)
        return read_log(log, target_system)

    monkeypatch.setattr(tlog_flightlog, "read", counted)
    answered(capsys, path)
    assert read == [path]


@pytest.mark.slow
def test_a_log_is_answered_without_a_vehicle_file(log, capsys):
    told = answered(capsys, log)
    vehicle = told["vehicle"]
    assert vehicle["drafted"]
    assert {"mass_kg", "rotor_radius_m", "position_m"} <= {f["key"] for f in vehicle["assumed"]}
    assert all(
        f.keys() >= {"key", "value", "from"} for f in (*vehicle["known"], *vehicle["assumed"])
    )
    assert set(told["axes"]) == {"Fx", "Fy", "Fz"}
    assert all(
        axis.keys() >= {"rms_before", "rms_after", "of_weight"} for axis in told["axes"].values()
    )
    assert sum("--mass" in note for note in told["notes"]) == 1


def test_sizes_of_what_is_given_are_those_of_the_vehicle(log, tmp_path, capsys):
    kept = tmp_path / "my.toml"
    told = answered(
        capsys,
        log,
        "--mass",
        QUAD_MASS_KG,
        "--propeller",
        0.28 / 0.0254,
        "--span",
        0.6364,
        "--save-vehicle",
        kept,
    )
    assert "of_weight" not in told["axes"]["Fz"]
    assert {"Mx", "My", "Mz"} <= set(told["axes"])
    made = load_vehicle(kept)
    assert made.fans[0].ct == pytest.approx(QUAD_CT, rel=0.02)
    assert made.assumed == ()
    assert "# " in kept.read_text()
    again = answered(capsys, log, "--vehicle", kept)
    assert again["axes"] == told["axes"]
    assert "vehicle" not in again


def test_a_kept_draft_still_says_what_is_assumed(log, tmp_path, capsys):
    told = answered(capsys, log, "--save-vehicle", tmp_path / "my.toml")
    again = answered(capsys, log, "--vehicle", tmp_path / "my.toml")
    assert again["axes"] == told["axes"]


def test_forces_in_shares_of_the_weight_do_not_depend_on_the_mass(log, capsys):
    light, heavy = (
        answered(capsys, log, "--mass", kg)["axes"]["Fz"]["rms_before"] / kg for kg in (1.0, 5.0)
    )
    assert light == pytest.approx(heavy, rel=0.02)


def framed(path: Path, kind: int, messages=None) -> Path:
    """A log that says its FRAME_TYPE."""
    names = (("FRAME_CLASS", 1.0), ("FRAME_TYPE", float(kind)))
    said = [
        mavlink.MAVLink_param_value_message(name.encode(), value, 9, 2, k)
        for k, (name, value) in enumerate(names)
    ]
    flown = messages or quad_flight(30.0)
    write_tlog(
        path, [*flown, *((flown[-1][0] + 1 + k, frame(message)) for k, message in enumerate(said))]
    )
    return path


def test_two_vehicles_are_refused(tmp_path, capsys):
    paths = [framed(tmp_path / f"{kind}.tlog", kind) for kind in (1, 12)]
    assert main(["diagnose", *map(str, paths)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "two vehicles (quad-x; quad-bf)" in line


def test_a_log_without_parameters_takes_the_frame_of_its_neighbour(log, tmp_path, capsys):
    told = answered(capsys, log, framed(tmp_path / "bf.tlog", 12))
    fact = next(f for f in told["vehicle"]["known"] if f["key"] == "frame")
    assert (fact["value"], fact["from"]) == ("quad-bf", "FRAME_CLASS 1, FRAME_TYPE 12")


@pytest.mark.parametrize("option", [["--mass", "0"], ["--propeller", "-1"], ["--span", "nan"]])
def test_impossible_numbers_are_refused(log, option, capsys):
    assert main(["diagnose", str(log), *option]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert option[0] in line


def test_options_of_a_draft_do_not_go_with_a_vehicle_file(log, tmp_path, capsys):
    assert main(["diagnose", str(log), "--vehicle", str(tmp_path / "v.toml"), "--mass", "3"]) == 2
    assert "--mass" in capsys.readouterr().err


def test_a_log_from_the_bench_lends_its_parameters(log, tmp_path, capsys):
    bench = framed(tmp_path / "bench.tlog", 12, quad_flight(20.0, parked=True))
    told = answered(capsys, bench, log)
    assert next(f for f in told["vehicle"]["known"] if f["key"] == "frame")["value"] == "quad-bf"
    assert [Path(name).name for name in told["logs"]] == [log.name]


@pytest.mark.slow
def test_every_log_of_a_folder_gets_its_own_draft(log, tmp_path, capsys):
    framed(tmp_path / "other.tlog", 12)
    assert (
        main(
            ["diagnose", str(tmp_path), "--out", str(tmp_path / "out"), "--workers", "1", "--quiet"]
        )
        == 0
    )
    answers = [
        json.loads(path.read_text()) for path in (tmp_path / "out" / "results").glob("*.json")
    ]
    frames = {
        fact["value"] for a in answers for fact in a["vehicle"]["known"] if fact["key"] == "frame"
    }
    assert frames == {"quad-x", "quad-bf"}
    assert all(any("--mass" in note for note in a["notes"]) for a in answers)


def test_what_changed_is_asked_of_a_drafted_vehicle(log, tmp_path, capsys):
    write_tlog(tmp_path / "heavier.tlog", quad_flight(60.0, mass_kg=1.3 * QUAD_MASS_KG, seed=2))
    told = answered(capsys, tmp_path / "heavier.tlog", "--since", log, "--mass", QUAD_MASS_KG)
    assert told["vehicle"]["drafted"]
    assert {c["name"] for c in told["changed"]} & {"payload", "thrust_scale"}
