"""The receiver's clock of a .tlog is set, stands still or is damaged: the autopilot's boot time stays the truth."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from log_writers import EPOCH_US, flight, frame, heartbeat, write_tlog

from companion.mavlink import OWN_COMPONENT
from companion.mavlink.dialect import mavlink
from models.common.errors import LogError
from replay.cli import main
from replay.flightlog import FlightLog
from replay.logs.formats import load
from replay.logs.timeline import steady
from replay.logs.tlog import read_tlog

SECONDS, START_S = 30.0, 40.0
MIDDLE_US = EPOCH_US + 15_000_000
HOUR_US, DAY_US = 3_600_000_000, 86_400_000_000
Messages = Sequence[tuple[int, bytes]]


def read(path: Path, messages: Messages) -> FlightLog:
    """The only boot of a .tlog of these messages."""
    write_tlog(path / "flight.tlog", messages)
    (log,) = load(path / "flight.tlog")
    return log


def set_by(*steps: tuple[int, int]) -> Callable[[int], int]:
    """A clock that is set by so many microseconds at such times [us of a clock that is never set]."""
    return lambda arrival_us: (
        arrival_us + sum(by_us for at_us, by_us in steps if arrival_us >= at_us)
    )


def assert_whole(log: FlightLog) -> None:
    """Every sample of the flight is there, at its time."""
    assert (log.start_s, log.end_s) == pytest.approx((START_S, START_S + SECONDS - 0.02))
    assert log.attitude is not None
    assert len(log.attitude) == 1500
    speeds = log.escs[1].rpm
    assert speeds is not None
    assert len(speeds) == 750
    assert np.abs(speeds.t_s - (START_S + 0.04 * np.arange(750))).max() < 0.025, (
        "within the stamped neighbours"
    )
    assert log.battery is not None
    assert len(log.battery) == 60
    assert np.abs(log.battery.t_s - (START_S + 0.5 * np.arange(60))).max() < 0.025
    assert [(i.start_s, i.end_s) for i in log.armed] == [
        pytest.approx((START_S, log.end_s), abs=0.025)
    ]


@pytest.mark.parametrize(
    "steps",
    [
        [(MIDDLE_US, -60_000_000)],
        [(MIDDLE_US, -HOUR_US)],
        [(MIDDLE_US, -1_000_000)],
        [(MIDDLE_US, -60_000_000), (MIDDLE_US + 5_000_000, -60_000_000)],
        [(MIDDLE_US, -60_000_000), (MIDDLE_US + 5_000_000, 60_000_000)],
        [(MIDDLE_US, 1_000_000)],
        [(MIDDLE_US, 60_000_000)],
        [(MIDDLE_US, 60_000_000), (MIDDLE_US + 12_000_000, -60_000_000)],
        [(MIDDLE_US, DAY_US)],
        [(EPOCH_US + 200_000, 20 * 365 * DAY_US)],
        [(EPOCH_US + 29_500_000, -HOUR_US)],
    ],
    ids=[
        "back a minute", "back an hour", "back a second", "back twice", "back and ahead", "ahead a second",
        "ahead a minute", "ahead and back", "ahead a day", "set from 1970 at the start", "back at the end",
    ],
)  # fmt: skip
def test_a_clock_that_is_set_in_flight_moves_no_sample(steps, tmp_path):
    moved = set_by(*steps)
    log = read(tmp_path, [(moved(arrival_us), raw) for arrival_us, raw in flight(SECONDS)])
    assert_whole(log)
    (clock,) = [source for source in log.sources if source.quantity == "clock"]
    assert clock.chosen == "time_boot_ms of the autopilot"
    assert f"moved against it {len(steps)} times" in clock.why
    said = any("the receiver's clock was set" in note for note in log.summary.notes)
    # A link that is late by a second, for good, looks the same.
    assert said == any(by_us < 0 or by_us > 10_000_000 for _, by_us in steps)
    assert not any("boot stamps" in note for note in log.summary.notes)


@pytest.mark.parametrize(
    "clock",
    [
        lambda _: EPOCH_US,
        lambda us: EPOCH_US + (us - EPOCH_US) // 10,
        lambda us: EPOCH_US + 10 * (us - EPOCH_US),
    ],
    ids=["stands still", "a simulator at ten times real time", "a simulator at a tenth"],
)
def test_a_clock_that_runs_wrong_moves_no_sample_far(clock, tmp_path):
    log = read(tmp_path, [(clock(arrival_us), raw) for arrival_us, raw in flight(SECONDS)])
    assert len(log.attitude) == 1500
    speeds = log.escs[1].rpm
    assert len(speeds) > 0.98 * 750
    true_s = START_S + 0.04 * np.linspace(0, 749, len(speeds))
    assert np.abs(speeds.t_s - true_s).max() < 0.35


def test_a_link_that_stalls_and_catches_up_is_no_step_of_the_clock(tmp_path):
    """Nothing arrives for four seconds, then all of it. What a ground station sent meanwhile keeps its place."""

    def late(arrival_us: int) -> int:
        return max(arrival_us, MIDDLE_US + 4_000_000) if arrival_us >= MIDDLE_US else arrival_us

    command = mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 7, (1, 0, 0, 0), 0, 0, 0, 0.5)
    sent = [(MIDDLE_US + 1_000_000, frame(command, 255, 190))]
    messages = [(late(arrival_us), raw) for arrival_us, raw in flight(SECONDS)]
    log = read(tmp_path, sorted([*messages, *sent], key=lambda item: item[0]))
    assert len(log.attitude) == 1500
    assert log.commands.t_s == pytest.approx([START_S + 16.0], abs=0.01)
    assert not any("clock" in note for note in log.summary.notes)


def test_another_component_keeps_its_place_across_a_step(tmp_path):
    """A rangefinder of a companion computer with a boot clock of its own, which restarts in flight."""

    def reading(k: int) -> bytes:
        stamp_ms = 777_000 + 20 * k if k < 1000 else 20 * (k - 1000) + 20
        return frame(
            mavlink.MAVLink_distance_sensor_message(stamp_ms, 5, 800, 77, 0, 4, 24, 0), 1, 158
        )

    sensor = [(EPOCH_US + 20_000 * k + 2_500, reading(k)) for k in range(1500)]
    messages = sorted([*flight(SECONDS), *sensor], key=lambda item: item[0])
    moved = set_by((MIDDLE_US, -60_000_000))
    log = read(tmp_path, [(moved(arrival_us), raw) for arrival_us, raw in messages])
    assert_whole(log)
    up = log.beam("up")
    assert len(up.distance) > 1400
    late_s = up.distance.t_s[-100:] - (START_S + 0.02 * np.arange(1400, 1500))
    assert np.abs(late_s).max() < 0.01


def test_a_reboot_in_flight_with_a_step_of_the_clock(tmp_path):
    first = flight(5.0, start_ms=100_000)
    second = flight(5.0, start_ms=3_000, arrival_us=EPOCH_US + 6_000_000 - HOUR_US)
    write_tlog(tmp_path / "two.tlog", [*first, *second])
    one, two = load(tmp_path / "two.tlog")
    assert (one.start_s, one.duration_s) == pytest.approx((100.0, 4.98))
    assert (two.start_s, two.duration_s) == pytest.approx((3.0, 4.98))
    assert np.abs(two.escs[1].rpm.t_s - (3.0 + 0.04 * np.arange(125))).max() < 0.025


def test_a_wrap_of_the_boot_clock_with_a_step_of_the_receivers(tmp_path):
    wrap = 2**32
    early = flight(15.0, start_ms=wrap - 15_020)
    late = flight(15.0, start_ms=0, arrival_us=EPOCH_US + 15_000_000 - HOUR_US)
    log = read(tmp_path, [*early, *late])
    assert log.duration_s == pytest.approx(30.0, abs=0.1)
    assert len(log.attitude) == 1500


def test_a_gap_of_a_minute_is_a_gap(tmp_path):
    after = flight(15.0, start_ms=115_000, arrival_us=EPOCH_US + 75_000_000)
    log = read(tmp_path, [*flight(15.0), *after])
    assert log.duration_s == pytest.approx(90.0, abs=0.1)
    assert len(log.attitude) == 1500
    assert np.diff(log.escs[1].rpm.t_s).max() == pytest.approx(60.0, abs=0.1)
    assert not any("clock" in note for note in log.summary.notes)


def test_two_autopilots_with_the_same_number_are_refused(tmp_path):
    other = flight(SECONDS, start_ms=500_000, arrival_us=EPOCH_US + 7_000)
    path = tmp_path / "both.tlog"
    write_tlog(path, sorted([*flight(SECONDS), *other], key=lambda item: item[0]))
    with pytest.raises(LogError, match="two autopilots send as system 1"):
        load(path)


def test_a_few_damaged_boot_stamps_are_no_second_autopilot(tmp_path):
    messages = list(flight(4.0))
    wrong = frame(mavlink.MAVLink_attitude_message(5, 0, 0, 0, 0, 0, 0))
    messages += [(EPOCH_US + 1_000_000 * k, wrong) for k in range(1, 4)]
    messages.append((EPOCH_US, frame(heartbeat())))
    assert read(tmp_path, sorted(messages)).end_s == pytest.approx(43.98)


def test_a_replay_of_a_ground_stations_log_is_not_late_after_a_step(tmp_path, capsys):
    answers = []
    for clock in (int, set_by((MIDDLE_US, DAY_US)), set_by((MIDDLE_US, -HOUR_US))):
        path = tmp_path / "flight.tlog"
        write_tlog(path, [(clock(arrival_us), raw) for arrival_us, raw in flight(SECONDS)])
        assert main(["run", str(path), "--json", "-", "--quiet"]) == 0
        answers.append(json.loads(capsys.readouterr().out))
    for what in ("refusals_s", "decisions"):
        unmoved, ahead, back = (answer[what] for answer in answers)
        assert unmoved == ahead == back


def test_a_recording_of_the_companion_is_replayed_with_the_stamps_it_has(tmp_path):
    own = [(EPOCH_US, frame(heartbeat(autopilot=8), 1, OWN_COMPONENT))]
    moved = set_by((MIDDLE_US, DAY_US))
    path = tmp_path / "flight.tlog"
    write_tlog(path, [*own, *[(moved(arrival_us), raw) for arrival_us, raw in flight(SECONDS)]])
    log = read_tlog(path)
    assert steady(log, 1) is log
