"""``replay info``: contents, what can be judged, and whether companion would have engaged."""

import json
from dataclasses import replace

import pytest
from log_writers import bin_flight, flight, quad_flight, ulg_flight, write_tlog

from companion.mavlink.wire_frames import cut
from companion.vehicles import QUAD, TANDEM
from replay.cli import main
from replay.flightlog import Interval
from replay.info.info import inspect
from replay.logs.bin_flightlog import read
from replay.logs.formats import load


def info(capsys, *arguments):
    code = main(["info", *map(str, arguments), "--companion", "--json", "-"])
    out = capsys.readouterr()
    return code, json.loads(out.out), out.err


def by_name(boot):
    return {s["name"]: s for s in boot["streams"]}


def judged(boot):
    return {j["question"]: j for j in boot["judges"]}


def test_rates_gaps_and_share_of_good_readings(tmp_path, capsys):
    messages = flight(10.0)
    first = messages[0][0]
    # Two seconds without an attitude.
    lost = [m for m in messages if not (cut(m[1], 0).id == 30 and 4e6 <= m[0] - first < 6e6)]
    write_tlog(tmp_path / "a.tlog", lost)
    code, (answer,), _ = info(capsys, tmp_path / "a.tlog")
    streams = by_name(answer["boots"][0])
    assert code == 0
    assert streams["attitude"]["rate_hz"] == pytest.approx(50.0, abs=0.5)
    assert streams["attitude"]["gaps"] == 1
    assert streams["attitude"]["longest_gap_s"] == pytest.approx(2.0, abs=0.05)
    assert streams["position"]["gaps"] == 0
    assert streams["range right"]["share_good"] == pytest.approx(
        0.9, abs=0.05
    )  # every tenth reads too far
    assert streams["rotor speed 1"]["rate_hz"] == pytest.approx(25.0, abs=1.0)


def test_what_companion_would_have_done(tmp_path, capsys):
    write_tlog(tmp_path / "a.tlog", flight(10.0))
    _, (answer,), _ = info(capsys, tmp_path / "a.tlog", "--vehicle", TANDEM)
    main(["run", str(tmp_path / "a.tlog"), "--vehicle", str(TANDEM), "--json", "-"])
    run = json.loads(capsys.readouterr().out)
    assert answer["companion"]["compensated_s"] == run["compensated_s"]
    assert answer["companion"]["refusals_s"] == run["refusals_s"]
    assert answer["companion"]["engages"] == (run["compensated_s"] > 0.0)


def test_what_is_missing_is_named_with_the_parameter_that_brings_it(tmp_path, capsys):
    write_tlog(tmp_path / "a.tlog", quad_flight(20.0, rpm=False))
    _, (answer,), _ = info(capsys, tmp_path / "a.tlog", "--vehicle", QUAD)
    boot = answer["boots"][0]
    rotors = judged(boot)["thrust of the rotors"]
    assert rotors["answer"] == "partly"
    assert "ESC 1, 2, 3, 4" in rotors["why"]
    assert "SERVO_BLH_AUTO" in rotors["change"]
    assert "[throttle]" in rotors["change"]
    assert "RNGFNDn_ORIENT" in judged(boot)["height over ground"]["change"]
    assert judged(boot)["meaning of thrust"]["answer"] == "no"
    assert "GUID_OPTIONS" in judged(boot)["meaning of thrust"]["why"]


def test_px4_gets_px4_names(tmp_path, capsys):
    (tmp_path / "a.ulg").write_bytes(ulg_flight())
    _, (answer,), _ = info(capsys, tmp_path / "a.ulg")
    change = judged(answer["boots"][0])["thrust of the rotors"]["change"]
    assert "DSHOT_TEL_CFG" in change
    assert "SERVO_BLH" not in change


def test_every_quantity_names_the_message_that_it_came_from(tmp_path, capsys):
    write_tlog(tmp_path / "a.tlog", flight(5.0))
    write_tlog(tmp_path / "px4.tlog", flight(5.0, px4=True))
    _, answers, _ = info(capsys, tmp_path / "a.tlog", tmp_path / "px4.tlog")
    ardupilot, px4 = (by_name(answer["boots"][0]) for answer in answers)
    assert (
        ardupilot["rotor speed 2"]["source"]
        == ardupilot["ESC temperature 2"]["source"]
        == "ESC_TELEMETRY_1_TO_4"
    )
    assert px4["rotor speed 2"]["source"] == "ESC_STATUS"
    assert px4["ESC temperature 2"]["source"] == "ESC_INFO"


def test_a_folder_without_logs_is_one_line_and_nothing_is_said_of_a_vehicle(tmp_path, capsys):
    assert main(["info", str(tmp_path)]) == 3
    out = capsys.readouterr()
    assert out.out == ""
    (line,) = out.err.strip().splitlines()
    assert "holds no log" in line


def test_a_bad_log_does_not_stop_the_others(tmp_path, capsys):
    (tmp_path / "bad.tlog").write_bytes(b"no log at all")
    (tmp_path / "good.BIN").write_bytes(bin_flight())
    code, answers, err = info(capsys, tmp_path / "bad.tlog", tmp_path / "good.BIN")
    assert code == 3
    assert len(err.strip().splitlines()) == 1
    assert "bad.tlog" in err
    assert "error" in answers[0]
    assert by_name(answers[1]["boots"][0])["attitude"]["count"] == 200


def test_a_page_for_a_person(tmp_path, capsys):
    write_tlog(tmp_path / "a.tlog", flight(5.0))
    assert main(["info", str(tmp_path / "a.tlog")]) == 0
    out = capsys.readouterr().out
    assert "50.0 Hz" in out
    assert "companion with" not in out
    assert main(["info", str(tmp_path / "a.tlog"), "--vehicle", str(TANDEM), "--companion"]) == 0
    assert "companion with 'tandem coaxial ducted fan' would" in capsys.readouterr().out


def test_what_flew_is_named_as_drafted_from_the_log(tmp_path, capsys):
    write_tlog(tmp_path / "a.tlog", quad_flight(30.0, rpm=False))
    assert main(["info", str(tmp_path / "a.tlog"), "--json", "-"]) == 0
    (answer,) = json.loads(capsys.readouterr().out)
    assert answer["vehicle"].startswith("quad-x")
    assert answer["companion"] is None
    assert judged(answer["boots"][0])["thrust of the rotors"]["answer"] == "yes"


def test_a_log_of_no_multirotor_is_listed_and_refused(tmp_path, capsys):
    write_tlog(tmp_path / "plane.tlog", quad_flight(20.0, kind=1))
    assert main(["info", str(tmp_path / "plane.tlog"), "--json", "-"]) == 0
    (answer,) = json.loads(capsys.readouterr().out)
    assert "MAV_TYPE 1 is an aeroplane" in answer["refusal"]
    assert by_name(answer["boots"][0])["attitude"]["count"] > 100


def test_attitudes_once_a_second_are_said_to_be_too_slow(tmp_path, capsys):
    slow, last = [], -1
    for stamp, raw in flight(20.0):
        second = (stamp - 1_767_225_600_000_000) // 1_000_000
        if cut(raw, 0).id != 30:
            slow.append((stamp, raw))
        elif second != last:
            last = second
            slow.append((stamp, raw))
    write_tlog(tmp_path / "a.tlog", slow)
    assert main(["run", str(tmp_path / "a.tlog")]) == 0
    out = capsys.readouterr().out
    assert "over 0.0 s" not in out
    assert "attitudes come 1.0 s apart" in out
    assert "  0.0 s  " not in out
    assert main(["info", str(tmp_path / "a.tlog"), "--companion"]) == 0
    assert "attitudes come 1.0 s apart" in capsys.readouterr().out


def test_without_rotor_speeds_and_outputs_both_ways_to_log_thrust_are_said(tmp_path, capsys):
    (tmp_path / "a.BIN").write_bytes(bin_flight(outputs=False))
    _, (answer,), _ = info(capsys, tmp_path / "a.BIN")
    thrust = judged(answer["boots"][0])["thrust of the rotors"]
    assert thrust["answer"] == "no"
    assert "SERVO_BLH_AUTO" in thrust["change"]
    assert "RCOUT (bit 10)" in thrust["change"], "outputs need no other ESCs"


def test_time_armed_is_no_longer_than_the_log(tmp_path):
    """The message of arming may be older than the first attitude."""
    write_tlog(tmp_path / "a.tlog", quad_flight(20.0))
    log = load(tmp_path / "a.tlog")[0]
    too_long = replace(
        log,
        armed=(Interval(log.start_s - 5.0, log.end_s + 5.0, 1),),
        modes=(Interval(log.start_s - 5.0, log.end_s, 5),),
        landed=(Interval(log.start_s - 5.0, log.start_s + 2.0, 1),),
    )
    (boot,) = inspect(log.path, [too_long], None).boots
    assert boot.armed_s == pytest.approx(boot.duration_s)
    assert boot.air_s == pytest.approx(boot.duration_s - 2.0)
    assert sum(boot.modes_s.values()) == pytest.approx(boot.duration_s)


def test_a_folder_gets_one_line_a_log(tmp_path, capsys):
    write_tlog(tmp_path / "a.tlog", quad_flight(20.0))
    write_tlog(tmp_path / "b.tlog", flight(10.0))
    assert main(["info", str(tmp_path)]) == 0
    a, b = capsys.readouterr().out.splitlines()
    assert a.startswith("a.tlog: quad-x, 20 s, ")
    assert "forces (Fx Fy Fz)" in a
    assert b.startswith("b.tlog: quad-x, 10 s, ")


def test_a_log_is_read_once(tmp_path, capsys, monkeypatch):
    path = tmp_path / "flight.bin"
    path.write_bytes(bin_flight(10.0))
    reads = []

    def counted(path, target_system):
        reads.append(path)
        return read(path, target_system)

    monkeypatch.setattr("replay.logs.bin_flightlog.read", counted)
    assert main(["info", str(path)]) == 0
    assert reads == [path]
