"""What ``replay diagnose`` makes of logs that lack something, are damaged, or hold more than one flight. Simulated."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from log_writers import EPOCH_US, bin_flight, quad_flight, write_tlog

from companion.vehicles import QUAD
from models.vehicle import Rotor, Throttle, load_vehicle
from replay.cli import main
from replay.flightlog import FlightLog, Series
from replay.residual.rotor_faults import copies

THRUST_TO_MASS = {"payload", "thrust_scale", "air_density"}
THROTTLE = """
[throttle]
max_thrust_n = 14.709975
expo = 0.0
pwm_min_us = 1100
pwm_max_us = 1900
voltage_v = 16.0
"""


class Told:
    """Exit code, the lines on stderr, and the JSON answer (empty where none was written)."""

    def __init__(self, code: int, lines: list[str], answer: dict[str, Any]) -> None:
        self.code, self.lines, self.answer = code, lines, answer

    @property
    def names(self) -> set[str]:
        return {e["name"] for e in self.answer["effects"]}

    @property
    def notes(self) -> str:
        return "\n".join(self.answer["notes"])


@pytest.fixture
def ask(tmp_path, capsys):
    """Write logs (messages or bytes, by name), diagnose them together, and give what was told."""

    def asked(logs, *options: str, vehicle: Path | str = str(QUAD)) -> Told:
        for name, content in logs.items():
            if isinstance(content, bytes):
                (tmp_path / name).write_bytes(content)
            else:
                write_tlog(tmp_path / name, content)
        target = tmp_path / "answer.json"
        target.unlink(missing_ok=True)
        arguments = [
            *(str(tmp_path / name) for name in logs),
            "--vehicle",
            str(vehicle),
            "--model",
            "none",
        ]
        code = main(["diagnose", *arguments, "--json", str(target), "--quiet", *options])
        lines = capsys.readouterr().err.splitlines()
        assert "Traceback" not in "".join(lines)
        return Told(code, lines, json.loads(target.read_text()) if target.exists() else {})

    return asked


def refused(told: Told, *words: str) -> None:
    """Exit code 3 and one line that says all of this."""
    assert told.code == 3
    assert told.answer == {}
    (line,) = told.lines
    for word in words:
        assert word in line, line


@pytest.mark.slow
def test_a_flight_with_nothing_wrong_is_answered_nothing_missing(ask):
    told = ask({"good.tlog": quad_flight()})
    assert (told.code, told.lines, told.answer["verdict"]) == (0, [], "nothing_missing")
    assert told.answer["duration_s"] == pytest.approx(40.0, abs=1.0)


def test_what_a_declared_rangefinder_never_saw_is_said(ask):
    told = ask({"blind.tlog": quad_flight()})
    assert "no range to the ground in the log" in told.notes
    assert "no range to the wall in the log" in told.notes
    assert "ceiling" not in told.notes


def test_no_imu_is_refused_and_says_which_message_to_log(ask):
    refused(ask({"a.tlog": quad_flight(imu=False)}), "a.tlog", "HIGHRES_IMU", "RAW_IMU")


def test_neither_rotor_speeds_nor_outputs_is_refused(ask):
    refused(ask({"a.tlog": quad_flight(rpm=False, servo=False)}), "a.tlog", "ESC_TELEMETRY")


def test_no_rotor_speeds_is_refused_and_names_the_way_by_servo_outputs(ask, tmp_path):
    log = {"a.tlog": quad_flight(rpm=False)}
    refused(ask(log), "a.tlog", "ESC 1, 2, 3, 4", "[throttle]")
    vehicle = tmp_path / "by_servo.toml"
    vehicle.write_text(QUAD.read_text().replace("esc =", "servo =") + THROTTLE)
    told = ask(log, vehicle=vehicle)
    assert told.code == 0
    assert told.answer["verdict"] == "nothing_missing"
    assert set(told.answer["axes"]) == {"Fx", "Fy", "Fz"}
    assert any("copies of one number" in f["what"] for f in told.answer["log_faults"])
    refused(
        ask({"b.tlog": quad_flight(servo=False)}, vehicle=vehicle), "b.tlog", "SERVO_OUTPUT_RAW"
    )


def test_twenty_seconds_are_answered_six_are_not(ask):
    told = ask({"a.tlog": quad_flight(20.0)})
    assert (told.code, told.answer["verdict"]) == (0, "nothing_missing")
    assert told.answer["duration_s"] == pytest.approx(20.0, abs=1.0)
    refused(ask({"b.tlog": quad_flight(6.0)}), "b.tlog", "only 5.", "8 s")


def test_a_log_just_too_short_is_not_rounded_up_to_what_is_needed(ask):
    told = ask({"b.tlog": quad_flight(7.8)})
    refused(told, "b.tlog", "only 7.", "8 s are needed")
    assert "gaps" not in told.lines[0]  # it has none


@pytest.mark.slow
def test_every_start_of_a_vehicle_is_a_flight_of_its_own(ask):
    first, second = quad_flight(30.0), quad_flight(30.0, 3_000, EPOCH_US + 36_000_000, seed=3)
    told = ask({"a.tlog": [*first, *second]})
    assert (told.code, told.answer["verdict"]) == (0, "nothing_missing")
    assert told.answer["duration_s"] == pytest.approx(60.0, abs=2.0)
    assert "started 2 times" in told.notes
    # A short flight counts beside a long one; one that is hardly any is left out.
    told = ask({"c.tlog": [*first, *quad_flight(6.0, 3_000, EPOCH_US + 36_000_000)]})
    assert (told.code, told.answer["duration_s"]) == (0, pytest.approx(36.0, abs=1.5))
    short = quad_flight(3.0, 3_000, EPOCH_US + 36_000_000)
    told = ask({"b.tlog": [*first, *short]})
    assert (told.code, told.answer["duration_s"]) == (0, pytest.approx(30.0, abs=1.0))
    assert "left out" in told.notes


def test_a_clipped_axis_is_not_judged_and_the_answer_says_so(ask):
    told = ask({"a.tlog": quad_flight(clip_m_s2=10.3)})
    assert told.code == 0
    assert "Fz" not in told.answer["axes"]
    assert "accelerometer z clipped at 10.3" in told.notes
    assert not told.names & THRUST_TO_MASS


def test_of_two_vehicles_the_one_that_flies_is_read(ask):
    both = sorted([*quad_flight(parked=True), *quad_flight(38.0, system=7, mass_kg=3.9)])
    told = ask({"a.tlog": both})
    assert told.code == 0
    assert told.names <= THRUST_TO_MASS
    assert told.names
    assert "system 7 chosen" in told.notes
    refused(ask({"a.tlog": both}, "--target-system", "1"), "a.tlog", "on the ground")


@pytest.mark.slow
def test_of_two_vehicles_that_fly_the_option_to_choose_is_named(ask):
    both = sorted([*quad_flight(), *quad_flight(38.0, system=7, mass_kg=3.9)])
    told = ask({"a.tlog": both})
    assert (told.code, told.answer["verdict"]) == (0, "nothing_missing")
    assert "more than one of them flies" in told.notes
    assert "--target-system" in told.notes
    told = ask({"a.tlog": both}, "--target-system", "7")
    assert told.names <= THRUST_TO_MASS
    assert told.names
    refused(
        ask({"a.tlog": both}, "--target-system", "9"),
        "a.tlog",
        "no vehicle with system id 9",
        "1, 7",
    )


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.8, 1.3])
def test_a_mass_that_is_off_is_found_as_thrust_to_mass(ask, factor):
    told = ask({"a.tlog": quad_flight(mass_kg=factor * 3.0)})
    assert (told.code, told.answer["verdict"]) == (0, "explained")
    assert told.names <= THRUST_TO_MASS
    (aliases,) = told.answer["aliases"]
    assert len(set(aliases) & THRUST_TO_MASS) >= 2
    fz = told.answer["axes"]["Fz"]
    assert fz["rms_after"] < 0.05 * fz["rms_before"]


def test_a_truncated_file_gives_what_it_holds_and_says_that_it_was_cut(ask, tmp_path):
    data = write_tlog(tmp_path / "whole.tlog", quad_flight())
    told = ask({"a.tlog": data[: int(0.6 * len(data)) + 3]})
    assert (told.code, told.answer["verdict"]) == (0, "nothing_missing")
    assert told.answer["duration_s"] == pytest.approx(24.0, abs=1.0)
    assert "cut off" in told.notes


def test_damage_in_the_middle_is_read_around(ask, tmp_path):
    data = bytearray(write_tlog(tmp_path / "whole.tlog", quad_flight()))
    data[60_000:64_000] = bytes(4_000)
    told = ask({"a.tlog": bytes(data)})
    assert (told.code, told.answer["verdict"]) == (0, "nothing_missing")
    assert "bytes skipped" in told.notes


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("empty.tlog", b"", "is empty"),
        ("empty.BIN", b"", "is empty"),
        ("empty.ulg", b"", "is empty"),
        ("text.tlog", b"time,force\n0,1\n" * 200, "no MAVLink frame"),
        ("text.bin", b"time,force\n0,1\n" * 200, "dataflash"),
        ("text.ulg", b"time,force\n0,1\n" * 200, "PX4 log"),
        ("table.csv", b"time,force\n0,1\n", "known: .tlog, .bin, .ulg"),
        ("cut.bin", bin_flight()[:3000], "cut.bin"),
    ],
)
def test_what_is_no_log_is_refused_in_one_line(ask, name, content, words):
    refused(ask({name: content}), name, words)


def test_a_bad_log_among_good_ones_is_left_out_and_named(ask):
    good = {"a.tlog": quad_flight(), "b.tlog": quad_flight(seed=2)}
    told = ask(
        {"empty.tlog": b"", **good, "blind.tlog": quad_flight(imu=False), "text.csv": b"a,b\n"}
    )
    assert (told.code, told.lines) == (0, [])
    assert [Path(p).name for p in told.answer["logs"]] == ["a.tlog", "b.tlog"]
    for name in ("empty.tlog", "blind.tlog", "text.csv"):
        assert any(note.startswith("left out") and name in note for note in told.answer["notes"])
    refused(ask({"empty.tlog": b"", "text.csv": b"a,b\n"}), "empty.tlog", "is empty")


def test_a_gyro_too_slow_for_moments_leaves_the_forces_and_says_so(ask):
    told = ask({"a.tlog": quad_flight(60.0, rate_hz=10)})
    assert told.code == 0
    assert set(told.answer["axes"]) == {"Fx", "Fy", "Fz"}
    assert "too slow for moments (20 Hz needed)" in told.notes
    refused(ask({"b.tlog": quad_flight(60.0, rate_hz=3)}), "b.tlog", "too slow for forces", "4 Hz")


def test_a_vehicle_that_never_left_the_ground_is_not_judged(ask):
    refused(ask({"a.tlog": quad_flight(parked=True)}), "a.tlog", "on the ground")
    refused(ask({"b.tlog": quad_flight(landed=True)}), "b.tlog", "on the ground")


def test_numbers_that_are_none_are_left_out(ask):
    told = ask({"a.tlog": quad_flight(nan_share=0.05)})
    assert (told.code, told.answer["verdict"]) == (0, "nothing_missing")
    assert told.answer["duration_s"] == pytest.approx(40.0, abs=2.0)
    refused(ask({"b.tlog": quad_flight(nan_share=1.0)}), "b.tlog")


@pytest.mark.parametrize(
    ("line", "instead", "words"),
    [
        ("mass_kg = 3.0", "", "mass_kg"),
        ("mass_kg = 3.0", "mass_kg = -3.0", "mass_kg"),
        ("mass_kg = 3.0", "mass_kg = 3.0\nwings = 2", "wings"),
        ("mass_kg = 3.0", "mass_kg = ", "vehicle.toml"),
        ("ct = 0.0140", "", "ct"),
    ],
)
def test_a_wrong_vehicle_file_is_refused_by_the_name_of_its_key(
    ask, tmp_path, line, instead, words
):
    vehicle = tmp_path / "vehicle.toml"
    vehicle.write_text(QUAD.read_text().replace(line, instead))
    told = ask({"a.tlog": b""}, vehicle=vehicle)
    assert told.code == 2
    assert words in told.lines[0]
    assert len(told.lines) == 1
    assert ask({"a.tlog": b""}, vehicle=tmp_path / "none.toml").code == 2


def test_a_vehicle_with_other_rotors_than_the_log_is_refused_by_their_number(ask, tmp_path):
    vehicle = tmp_path / "vehicle.toml"
    vehicle.write_text(QUAD.read_text().replace("esc = 4", "esc = 9"))
    refused(ask({"a.tlog": quad_flight(15.0)}, vehicle=vehicle), "a.tlog", "ESC 9")


def test_a_model_that_is_none_is_refused_before_any_log_is_read(ask, tmp_path):
    told = ask({"a.tlog": b""}, "--model", str(tmp_path / "nowhere"))
    assert (told.code, len(told.lines)) == (2, 1)
    assert "nowhere" in told.lines[0]


def test_a_place_that_cannot_be_written_is_refused_before_any_log_is_read(ask, tmp_path):
    (tmp_path / "taken").write_text("")
    folder, file, absent = (
        str(tmp_path),
        str(tmp_path / "taken"),
        str(tmp_path / "absent" / "a.json"),
    )
    for option, target in (
        ("--json", folder),
        ("--json", absent),
        ("--save-model", file),
        ("--save-model", file + "/model"),
        ("--report", file),
    ):
        told = ask({"a.tlog": b""}, option, target)
        assert (told.code, len(told.lines)) == (2, 1), option
        assert option in told.lines[0]
        assert target in told.lines[0]


def test_an_interrupt_exits_with_130_and_writes_nothing(ask, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("replay.diagnosis.diagnose.build_record", interrupted)
    told = ask({"a.tlog": quad_flight(15.0)})
    assert (told.code, told.lines, told.answer) == (130, [], {})


@pytest.mark.slow
def test_one_flight_gives_a_candidate_two_confirm_it_and_their_numbers_are_pooled(ask):
    one, other = quad_flight(30.0, mass_kg=3.3), quad_flight(60.0, mass_kg=3.3, seed=3)
    single = [ask({"one.tlog": one}).answer, ask({"other.tlog": other}).answer]
    both = ask({"one.tlog": one, "other.tlog": other}).answer
    for answer, status in ((single[0], "candidate"), (single[1], "candidate"), (both, "confirmed")):
        assert answer["verdict"] == "explained"
        (effect,) = answer["effects"]
        assert effect["name"] in THRUST_TO_MASS
        assert effect["status"] == status
    assert [Path(p).name for p in both["logs"]] == ["one.tlog", "other.tlog"]
    counts = [answer["samples"] for answer in single]
    assert both["samples"] == sum(counts)
    assert both["duration_s"] == pytest.approx(sum(answer["duration_s"] for answer in single))
    # RMS over all samples: the longer flight counts for more.
    for key in ("rms_before", "rms_after"):
        squares = [answer["axes"]["Fz"][key] ** 2 for answer in single]
        pooled = (sum(n * s for n, s in zip(counts, squares, strict=True)) / sum(counts)) ** 0.5
        assert both["axes"]["Fz"][key] == pytest.approx(pooled, rel=1e-2)
    shares = [answer["effects"][0]["explains"] for answer in single]
    assert min(shares) - 1e-6 <= both["effects"][0]["explains"] <= max(shares) + 1e-6


@pytest.mark.slow
def test_the_same_logs_with_the_amended_model_lack_nothing(ask, tmp_path):
    """Diagnose, adopt, diagnose: a fixed point, with one name for what thrust and mass have in common."""
    logs = {
        "one.tlog": quad_flight(30.0, mass_kg=3.3),
        "other.tlog": quad_flight(60.0, mass_kg=3.3, seed=3),
    }
    first = ask(logs, "--save-model", str(tmp_path / "amended")).answer
    assert len(first["effects"]) == 1
    again = ask(logs, "--model", str(tmp_path / "amended")).answer
    assert again["effects"] == []
    assert again["verdict"] == "nothing_missing"


def test_a_second_flight_without_the_effect_leaves_it_a_candidate(ask):
    told = ask({"heavy.tlog": quad_flight(mass_kg=3.3), "light.tlog": quad_flight(seed=3)})
    (effect,) = told.answer["effects"]
    assert effect["status"] == "candidate"


def test_a_model_of_another_fan_is_said_first(ask):
    told = ask({"a.tlog": quad_flight(20.0)}, "--model", "default")
    assert told.code == 0
    first = told.answer["log_faults"][0]
    assert first["channel"] == "model"
    assert "rotor radius 0.165 m in the model, 0.14 m in the vehicle file" in first["what"]
    assert any("times the lift that flew" in fault["what"] for fault in told.answer["log_faults"])


def test_without_a_name_such_a_vehicle_is_diagnosed_without_model(tmp_path, capsys):
    write_tlog(tmp_path / "a.tlog", quad_flight(20.0))
    target = tmp_path / "answer.json"
    arguments = [
        "diagnose",
        str(tmp_path / "a.tlog"),
        "--vehicle",
        str(QUAD),
        "--json",
        str(target),
    ]
    assert main(arguments) == 0
    answer = json.loads(target.read_text())
    assert answer["log_faults"] == []
    assert "another fan" in answer["notes"][0]
    assert "another fan" in capsys.readouterr().out
    assert (
        main(
            [
                "run",
                str(tmp_path / "a.tlog"),
                "--vehicle",
                str(QUAD),
                "--json",
                str(target),
                "--quiet",
            ]
        )
        == 0
    )
    report = json.loads(target.read_text())
    assert report["model"] == "none"
    assert "another fan" in report["notes"][0]


def test_a_vehicle_file_whose_lift_did_not_fly_is_said(ask, tmp_path):
    strong = tmp_path / "strong.toml"
    strong.write_text(QUAD.read_text().replace("ct = 0.0140", "ct = 0.0400"))
    told = ask({"a.tlog": quad_flight(20.0)}, vehicle=strong)
    assert told.answer["log_faults"][0]["channel"] == "vehicle file"


def test_outputs_that_are_not_sent_or_never_fly_warn_of_nothing(recwarn):
    """A PX4 log may hold outputs that are NaN in every row; on a bench nothing flies."""
    outputs = Series(np.arange(50) / 10.0, np.full((50, 16), np.nan))
    log = FlightLog(path=Path("x"), system=1, boot=0, start_s=0.0, end_s=5.0, servo=outputs)
    quad = load_vehicle(QUAD)
    by_servo = tuple(
        replace(f, rotors=tuple(Rotor(r.spin, servo=r.esc) for r in f.rotors)) for f in quad.fans
    )
    ctx = SimpleNamespace(
        vehicle=replace(
            quad,
            fans=by_servo,
            throttle=Throttle(
                max_thrust_n=10.0, expo=1.0, pwm_min_us=1000.0, pwm_max_us=2000.0, voltage_v=16.0
            ),
        )
    )
    assert copies(log, ctx, SimpleNamespace(), np.ones(50, bool)) == []
    alike = replace(log, servo=Series(outputs.t_s, np.full((50, 16), 1500.0)))
    still = SimpleNamespace(gyro=np.zeros((50, 3)))
    assert copies(alike, ctx, still, np.zeros(50, bool)) != []
    assert not [w for w in recwarn if issubclass(w.category, RuntimeWarning)]
