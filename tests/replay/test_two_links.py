"""Two links of one vehicle recorded into one .tlog: every message is taken once."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest
from log_writers import EPOCH_US, flight, frame, write_tlog

from companion.mavlink.dialect import mavlink
from companion.mavlink.wire_frames import cut
from replay.flightlog import FlightLog
from replay.logs.formats import load
from replay.logs.repeats import without_repeats
from replay.logs.tlog import read_tlog

FLIGHT = flight(30.0)
Messages = list[tuple[int, bytes]]


def sent_again(raw: bytes, sequence: int, *, signed: bool = False, v1: bool = False) -> bytes:
    """The same message as another port of the autopilot sends it."""
    link = mavlink.MAVLink(None)
    (message,) = link.parse_buffer(bytearray(raw)) or []
    key = b"k" * 32 if signed else None
    return frame(
        message, message.get_srcSystem(), message.get_srcComponent(), sequence % 256, key=key, v1=v1
    )


def read(path: Path, messages: Messages) -> FlightLog:
    write_tlog(path / "flight.tlog", sorted(messages, key=lambda item: item[0]))
    (log,) = load(path / "flight.tlog")
    return log


def assert_same(log: FlightLog, alone: FlightLog) -> None:
    """Each sample once, at its time."""
    for name in ("attitude", "position", "servo", "battery", "pressure", "thrust_command"):
        ours, theirs = getattr(log, name), getattr(alone, name)
        assert len(ours) == len(theirs), name
        assert np.abs(ours.t_s - theirs.t_s).max() < 0.01, name
        assert np.array_equal(ours.values, theirs.values, equal_nan=True), name
    assert len(log.escs[1].rpm) == len(alone.escs[1].rpm)
    assert np.abs(log.escs[1].rpm.t_s - alone.escs[1].rpm.t_s).max() < 0.01
    assert any("came twice" in note for note in log.summary.notes)


@pytest.fixture(scope="module")
def alone(tmp_path_factory) -> FlightLog:
    log = read(tmp_path_factory.mktemp("alone"), FLIGHT)
    assert not any("came twice" in note for note in log.summary.notes)
    return log


@pytest.mark.parametrize("delay_us", [0, 300, 40_000, 300_000, 2_500_000])
def test_a_second_link_with_another_delay(delay_us, alone, tmp_path):
    assert_same(
        read(tmp_path, [*FLIGHT, *[(arrival + delay_us, raw) for arrival, raw in FLIGHT]]), alone
    )


@pytest.mark.parametrize(
    "options", [{}, {"signed": True}, {"v1": True}], ids=["sequence", "signed", "MAVLink 1"]
)
def test_a_second_link_with_another_sequence_signature_or_version(options, alone, tmp_path):
    messages = [m for m in FLIGHT if cut(m[1], 0).id < 256] if options.get("v1") else FLIGHT
    second = [
        (arrival + 5_000, sent_again(raw, 3 * k, **options))
        for k, (arrival, raw) in enumerate(messages)
    ]
    log = read(tmp_path, [*messages, *second])
    if messages is FLIGHT:
        assert_same(log, alone)
    assert (len(log.attitude), len(log.battery)) == (1500, 60)


def test_links_that_lose_messages_complete_each_other(alone, tmp_path):
    """Each loses a third, with a delay that changes."""
    rng = random.Random(1)
    first = [m for m in FLIGHT if rng.random() < 0.7]
    second = [
        (arrival + rng.randrange(20_000, 200_000), raw)
        for arrival, raw in FLIGHT
        if rng.random() < 0.7
    ]
    log = read(tmp_path, [*first, *second])
    assert 0.85 * 1500 < len(log.attitude) < 0.95 * 1500
    assert len(log.escs[1].rpm) == len(np.unique(log.escs[1].rpm.t_s)) < 0.95 * 750
    assert log.duration_s == pytest.approx(alone.duration_s, abs=0.2)


def test_a_second_link_for_a_part_of_the_flight(alone, tmp_path):
    part = [
        (arrival + 7_000, raw)
        for arrival, raw in FLIGHT
        if EPOCH_US + 10_000_000 < arrival < EPOCH_US + 12_000_000
    ]
    assert_same(read(tmp_path, [*FLIGHT, *part]), alone)


def test_one_link_is_left_alone(tmp_path):
    """Heartbeats and readings that stay the same are no repeats. A frame that comes again now and then is none."""
    path = tmp_path / "flight.tlog"
    write_tlog(path, [*FLIGHT, *FLIGHT[-5:]])
    log = read_tlog(path)
    assert without_repeats(log) == (log, 0)


def test_a_recording_that_was_joined_to_itself_is_two_flights(tmp_path):
    path = tmp_path / "flight.tlog"
    write_tlog(path, [*FLIGHT, *FLIGHT])
    assert [len(log.attitude) for log in load(path)] == [1500, 1500]


def test_two_vehicles_that_send_the_same_are_two(tmp_path):
    path = tmp_path / "flight.tlog"
    write_tlog(path, sorted([*FLIGHT, *flight(30.0, system=7)], key=lambda item: item[0]))
    (log,) = load(path)
    assert len(log.attitude) == 1500
    assert not any("came twice" in note for note in log.summary.notes)
    assert any("also in the log: 7" in note for note in log.summary.notes)
