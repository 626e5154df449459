"""The walk: every good frame, nothing else, whatever happened to the file."""

import random
import struct
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from log_writers import EPOCH_US, flight, frame, heartbeat, record, write_tlog
from pymavlink import mavutil

from companion.mavlink.dialect import mavlink
from companion.mavlink.message_table import LAYOUTS, columns
from companion.mavlink.wire_frames import cut
from models.common.errors import LogError
from replay.logs.tlog import read_tlog, repair_stamps
from replay.logs.tlog_vehicle import choose

FLIGHT = flight(4.0)


@pytest.fixture
def flown(tmp_path):
    path = tmp_path / "flight.tlog"
    write_tlog(path, FLIGHT)
    return read_tlog(path)


def test_frames_and_stamps_come_back(flown):
    assert list(flown.frames()) == FLIGHT
    assert flown.report.notes() == []
    assert flown.counts()[(1, 1, 30)] == 200


def same(a, b):
    return a == b or (a != a and b != b)


def test_columns_equal_what_pymavlink_decodes(flown):
    reader = mavutil.mavlink_connection(str(flown.path), dialect="ardupilotmega")
    theirs = {}
    while (message := reader.recv_match()) is not None:
        theirs.setdefault(message.get_type(), []).append(message)
    for message_id, layout in LAYOUTS.items():
        index = flown.indices(message_id)
        assert len(index) == len(theirs.get(layout.name, []))
        if not len(index):
            continue
        records = flown.records(message_id, index)
        for name in records.dtype.names:
            for ours, message in zip(records[name], theirs[layout.name], strict=True):
                value = getattr(message, name)
                if isinstance(value, str):
                    assert bytes(ours).rstrip(b"\0").decode() == value
                else:
                    assert np.array_equal(
                        np.asarray(ours, float), np.asarray(value, float), equal_nan=True
                    ), name
        assert set(columns(layout, records)) == {q.name for q in layout.quantities}


def test_both_protocol_versions_signed_and_unknown_frames(tmp_path):
    attitude = mavlink.MAVLink_attitude_message(1000, 0.1, 0, 0, 0, 0, 0)
    unknown = bytearray(frame(attitude))
    unknown[7:10] = (99_999).to_bytes(3, "little")
    frames = [
        frame(attitude), frame(attitude, v1=True), frame(attitude, key=b"k" * 32), bytes(unknown), frame(heartbeat()),
    ]  # fmt: skip
    path = tmp_path / "mixed.tlog"
    write_tlog(path, [(EPOCH_US + i, f) for i, f in enumerate(frames)])
    log = read_tlog(path)
    assert [f for _, f in log.frames()] == frames
    assert log.message_id.tolist() == [30, 30, 30, 99_999, 0]
    assert log.report.unknown == 1


@pytest.mark.parametrize("cut", [1, 7, 8, 9, 15, 17, 18, 30])
def test_a_cut_tail_costs_the_last_frame_only(tmp_path, cut):
    path = tmp_path / "cut.tlog"
    data = write_tlog(path, FLIGHT)
    path.write_bytes(data[:-cut])
    log = read_tlog(path)
    assert list(log.frames()) == FLIGHT[:-1]
    assert log.report.truncated_bytes == 8 + len(FLIGHT[-1][1]) - cut


def test_magic_bytes_inside_a_stamp_do_not_derail(tmp_path):
    path = tmp_path / "fd.tlog"
    stamps = [
        0x00FDFDFDFDFDFDFD,
        0x00FEFEFEFEFEFEFE,
        EPOCH_US + 2,
        EPOCH_US + 3,
        EPOCH_US + 4,
        EPOCH_US + 5,
    ]
    path.write_bytes(b"noise" + b"".join(record(s, FLIGHT[i][1]) for i, s in enumerate(stamps)))
    assert [f for _, f in read_tlog(path).frames()] == [FLIGHT[i][1] for i in range(6)]


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 2**31), st.integers(1, 255)), min_size=1, max_size=12))
def test_damage_costs_the_frames_it_hits_and_no_other(tmp_path_factory, flips):
    path = tmp_path_factory.mktemp("damage") / "d.tlog"
    messages = FLIGHT[:200]
    data = bytearray(b"".join(record(a, f) for a, f in messages))
    starts = np.cumsum([0, *[8 + len(f) for _, f in messages]])
    hit = set()
    for place, mask in flips:
        place %= len(data)
        data[place] ^= mask
        k = int(np.searchsorted(starts, place, side="right")) - 1
        if place >= starts[k] + 8:
            hit.add(k)
    path.write_bytes(data)
    try:
        found = [f for _, f in read_tlog(path).frames()]
    except LogError:
        found = []
    sound = [f for k, (_, f) in enumerate(messages) if k not in hit]
    # A flip in a length or id may also cost nothing; what is undamaged is always found, in order.
    walk = iter(found)
    assert all(any(f == g for g in walk) for f in sound)


@settings(max_examples=100, deadline=None)
@given(st.binary(min_size=1, max_size=2000))
def test_no_bytes_crash_the_walk(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("noise") / "n.tlog"
    path.write_bytes(data)
    try:
        read_tlog(path)
    except LogError as error:
        assert "\n" not in str(error)  # noqa: PT017 - noise may also hold a frame


def test_impossible_stamps_are_repaired_and_real_gaps_kept():
    true = EPOCH_US + np.arange(1000) * 10_000
    true[400:] += 19_000_000  # the link was gone for 19 s
    stamps = true.copy()
    for k, value in (
        (10, 0),
        (200, 2**62),
        (399, EPOCH_US - 10**9),
        (401, 25_980_000_000_000_000),
        (999, 5),
    ):
        stamps[k] = value
    repaired, count, set_back = repair_stamps(stamps)
    assert count == 5
    assert set_back == 0
    wrong = np.abs(repaired - true)
    assert wrong[[10, 200, 401]].max() <= 10_000
    untouched = np.setdiff1d(np.arange(1000), [10, 200, 399, 401, 999])
    assert (wrong[untouched] == 0).all()


def test_a_clock_that_was_set_back_for_good_is_reported_not_repaired():
    stamps = EPOCH_US + np.arange(1000) * 10_000
    stamps[500:] -= 3_600_000_000
    repaired, count, set_back = repair_stamps(stamps)
    assert (count, set_back) == (0, 1)
    assert np.array_equal(repaired, stamps)


@pytest.mark.parametrize("place", [0, -1])
@pytest.mark.parametrize(("moved_s", "repaired"), [(0.8, 0), (-0.8, 1), (5.0e9, 1)])
def test_a_pause_after_the_first_frame_or_before_the_last_is_no_damage(
    tmp_path, place, moved_s, repaired
):
    """``moved_s``: away from the others in time, or (below 0) past them."""
    messages = list(FLIGHT)
    arrival_us, raw = messages[place]
    messages[place] = (round(arrival_us + moved_s * 1e6 * (1 if place else -1)) % 2**64, raw)
    path = tmp_path / "pause.tlog"
    write_tlog(path, messages)
    assert read_tlog(path).report.stamps_repaired == repaired


def test_vehicles_are_told_from_ground_stations_and_from_each_other(tmp_path):
    other = flight(1.0, system=7)
    station = [(EPOCH_US, frame(heartbeat(autopilot=8), 255, 190))]
    camera = [(EPOCH_US, frame(heartbeat(autopilot=8), 1, 100))]
    path = tmp_path / "two.tlog"
    write_tlog(path, sorted([*FLIGHT, *other, *station, *camera]))
    log = read_tlog(path)
    choice = choose(log)
    assert (choice.system, choice.others) == (1, (7,))
    assert "--target-system" in choice.notes()[0]
    assert choose(log, 7).system == 7
    with pytest.raises(LogError, match="no vehicle with system id 9; it holds 1, 7"):
        choose(log, 9)


def test_without_a_heartbeat_the_attitude_tells_and_without_both_nothing_does(tmp_path):
    path = tmp_path / "quiet.tlog"
    write_tlog(path, [(a, f) for a, f in FLIGHT if cut(f, 0).id != 0])
    assert not choose(read_tlog(path)).heartbeat
    write_tlog(path, [(EPOCH_US, frame(heartbeat(autopilot=8), 255, 190))])
    with pytest.raises(LogError, match="no vehicle"):
        choose(read_tlog(path))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda p: None, "cannot be read"),
        (lambda p: p.write_bytes(b""), "is empty"),
        (lambda p: p.mkdir(), "is a directory"),
        (lambda p: p.write_bytes(random.Random(0).randbytes(100_000)), "no MAVLink frame"),
        (lambda p: p.write_bytes(b"hello"), "no MAVLink frame"),
    ],
)
def test_what_is_no_log_is_one_line(tmp_path, make, words):
    path = tmp_path / "x.tlog"
    make(path)
    with pytest.raises(LogError, match=words) as caught:
        read_tlog(path)
    assert str(path) in str(caught.value)
    assert caught.value.exit_code == 3


def test_memory_stays_below_eight_times_the_file(tmp_path):
    path = tmp_path / "long.tlog"
    size = len(write_tlog(path, flight(60.0)))
    tracemalloc.start()
    log = read_tlog(path)
    tables = [columns(layout, log.records(i, log.indices(i))) for i, layout in LAYOUTS.items()]
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert tables
    assert peak <= 8 * size


def test_stamps_are_big_endian():
    assert record(1, b"x") == struct.pack(">Q", 1) + b"x"


def test_same_good_frames_as_pymavlink_on_a_damaged_recording(tmp_path, shared_data):
    """60 flipped bytes in a real recording: every frame pymavlink believes is found here too."""
    rng = random.Random(3)
    data = bytearray(
        (shared_data / "ardupilot" / "s4_quad3_attitude_target_corner.tlog").read_bytes()[:400_000]
    )
    for _ in range(60):
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    path = tmp_path / "hurt.tlog"
    path.write_bytes(data)
    log = read_tlog(path)
    reader = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    theirs = []
    while (message := reader.recv_match()) is not None:
        if message.get_type() != "BAD_DATA":
            theirs.append(bytes(message.get_msgbuf()))
    ours = {f for _, f in log.frames()}
    assert ours.issuperset(theirs)
    assert log.report.stamps_repaired > 0
    assert np.diff(log.arrival_us).min() > -1_000_000
