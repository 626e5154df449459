"""Parameters of a log: as they were at take-off, what was changed in flight, and lists that did not arrive whole."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from log_writers import BinWriter, UlgWriter, flight, frame, write_tlog

from companion.mavlink.dialect import mavlink
from replay import load
from replay.flightlog import Interval, ParameterChange
from replay.logs.parameters import change_notes, in_force, take_off
from replay.residual.reassigned import motors_reassigned
from replay.vehicle.airframe import airframe

SET = [
    (0.0, "SERVO1_FUNCTION", 33.0),
    (0.0, "SERVO2_FUNCTION", 34.0),
    (20.0, "SERVO1_FUNCTION", 0.0),
]


def test_the_values_at_take_off_are_the_vehicles():
    values, changes = in_force(SET, 10.0)
    assert values == {"SERVO1_FUNCTION": 33.0, "SERVO2_FUNCTION": 34.0}
    assert changes == (ParameterChange(20.0, "SERVO1_FUNCTION", 33.0, 0.0),)


def test_what_is_set_before_take_off_counts_and_what_first_comes_in_flight_too():
    values, changes = in_force(
        [(0.0, "A", 1.0), (5.0, "A", 2.0), (20.0, "B", 3.0), (21.0, "B", 3.0)], 10.0
    )
    assert values == {"A": 2.0, "B": 3.0}
    assert changes == ()


def test_a_vehicle_that_never_armed_has_its_last_values():
    assert take_off(()) == math.inf
    assert take_off((Interval(3.0, 9.0, 1),)) == 3.0
    assert in_force(SET, math.inf)[0]["SERVO1_FUNCTION"] == 0.0


def test_changes_are_one_note_without_what_the_autopilot_counts():
    changes = [ParameterChange(20.0 + k, f"P{k}", 1.0, 2.0) for k in range(8)]
    (note,) = change_notes([ParameterChange(1.0, "STAT_RUNTIME", 1.0, 2.0), *changes])
    assert note.startswith("changed in flight: P0 from 1 to 2 at 20 s, ")
    assert "and 2 more" in note
    assert "STAT" not in note


def bin_log(path):
    w = BinWriter()
    w.kind("ATT", "Qfff", "TimeUS,Roll,Pitch,Yaw")
    w.kind("ARM", "QB", "TimeUS,ArmState")
    w.kind("PARM", "QNf", "TimeUS,Name,Value")
    for number in range(1, 5):
        w.row("PARM", 9_000_000, f"SERVO{number}_FUNCTION", 32.0 + number)
    w.row("ARM", 10_000_000, 1)
    for k in range(200):
        w.row("ATT", 10_000_000 + 20_000 * k, 0.0, 0.0, 0.0)
        if k == 100:
            w.row("PARM", 12_000_000, "SERVO1_FUNCTION", 1.0)
    path.write_bytes(w.bytes())


def ulg_log(path):
    w = UlgWriter()
    w.topic("vehicle_attitude", ("float[4]", "q"))
    w.topic("vehicle_status", ("uint8_t", "arming_state"))
    w.parameter("PWM_MAIN_FUNC1", 101.0)
    w.subscribe()
    for k in range(200):
        w.row("vehicle_attitude", 10_000_000 + 20_000 * k, 1.0, 0.0, 0.0, 0.0)
        w.row("vehicle_status", 10_000_000 + 20_000 * k, 2)
        if k == 100:
            w.parameter("PWM_MAIN_FUNC1", 0.0)
    path.write_bytes(w.bytes())


def tlog_log(path):
    messages = flight(4.0)
    begin = messages[0][0]
    for us, value in ((500_000, 33.0), (2_000_000, 1.0)):
        message = mavlink.MAVLink_param_value_message(b"SERVO1_FUNCTION", value, 9, 900, 0)
        messages.append((begin + us, frame(message)))
    write_tlog(path, sorted(messages))


@pytest.mark.parametrize(
    ("suffix", "write", "name", "at_first"),
    [
        ("bin", bin_log, "SERVO1_FUNCTION", 33.0),
        ("ulg", ulg_log, "PWM_MAIN_FUNC1", 101.0),
        ("tlog", tlog_log, "SERVO1_FUNCTION", 33.0),
    ],
)
def test_every_format_knows_what_was_changed_in_flight(tmp_path, suffix, write, name, at_first):
    path = tmp_path / f"a.{suffix}"
    write(path)
    (log,) = load(path)
    assert log.parameters[name] == at_first
    (change,) = log.parameter_changes
    assert (change.name, change.before) == (name, at_first)
    assert any("changed in flight" in note for note in log.summary.notes)
    t = np.linspace(log.start_s, log.end_s, 50)
    lost = motors_reassigned(log, t)
    assert not lost[t < change.t_s].any()
    assert lost[t > change.t_s].all()


def test_motors_whose_parameters_did_not_arrive_have_their_own_numbers(tmp_path):
    path = tmp_path / "a.tlog"
    tlog_log(path)
    (log,) = load(path)
    assert log.parameters_expected == 900
    frame_of = airframe(replace(log, vehicle_type=2))
    assert dict(frame_of.numbers) == {1: 1, 2: 2, 3: 3, 4: 4}
