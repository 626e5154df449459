"""Logs of any length: blocks and pieces hold what the whole log holds, memory is that of a block, boots cost what they
hold."""

import csv
import itertools
import json
import tracemalloc
from types import SimpleNamespace

import numpy as np
import pytest
from log_writers import EPOCH_US, BinWriter, bin_flight, flight, ulg_flight, write_tlog
from whole_tlog import read_tlog

from companion.vehicles import TANDEM
from models.errors import LogError
from replay.cli import main
from replay.diagnosis.stretches import MOST_S, Stretches
from replay.export.tables import Tables
from replay.logs import tlog_blocks, ulg
from replay.logs.bin_flightlog import pieces as read_bin
from replay.logs.formats import load, read_pieces
from replay.logs.tlog import Tlog
from replay.logs.tlog_blocks import TlogFile
from replay.logs.tlog_flightlog import pieces, read

MINUTES = flight(120.0)
SMALL = 256 * 1024
"""A block of some sixteen seconds, its margin half of that."""


@pytest.fixture
def minute(tmp_path):
    path = tmp_path / "minute.tlog"
    write_tlog(path, MINUTES)
    return path


@pytest.fixture
def three_boots(tmp_path):
    """60 s, 5 s and 30 s, and a ground station's frames between."""
    path = tmp_path / "boots.tlog"
    first = flight(60.0, start_ms=500_000)
    then = flight(5.0, start_ms=3_000, arrival_us=EPOCH_US + 80_000_000)
    last = flight(30.0, start_ms=2_000, arrival_us=EPOCH_US + 100_000_000)
    write_tlog(path, [*first, *then, *last])
    return path


def test_blocks_give_every_frame_once_in_order(minute):
    file = TlogFile(minute, SMALL)
    assert len(list(file.blocks())) > 6
    assert list(file.frames()) == MINUTES
    assert len(file) == len(MINUTES)
    assert file.report == read_tlog(minute).report


def test_damage_between_and_inside_blocks_is_counted_once(minute):
    data = bytearray(minute.read_bytes())
    for at in range(30_000, len(data), 41_000):
        data[at : at + 3] = b"\xfd\xfe\x00"
    minute.write_bytes(bytes(data[:-5]))
    whole, blocks = read_tlog(minute), TlogFile(minute, SMALL)
    assert [raw for _, raw in blocks.frames()] == [raw for _, raw in whole.frames()]
    arrival = np.array([at for at, _ in blocks.frames()])
    assert np.abs(arrival - whole.arrival_us).max() <= 1  # a repaired stamp is interpolated, and rounded
    assert blocks.report == whole.report
    assert whole.report.bad_crc
    assert whole.report.truncated_bytes


def test_a_file_that_begins_with_garbage_is_read_behind_it(minute):
    minute.write_bytes(bytes(300_000) + minute.read_bytes())
    assert list(TlogFile(minute, SMALL).frames()) == list(read_tlog(minute).frames())


def test_garbage_of_many_blocks_is_no_log(tmp_path):
    path = tmp_path / "garbage.tlog"
    path.write_bytes(np.random.default_rng(1).bytes(1_000_000))
    with pytest.raises(LogError, match="no MAVLink frame"):
        TlogFile(path, SMALL)


def joined(parts, name):
    series = [getattr(p, name) for p in parts]
    return np.concatenate([s.t_s for s in series]), np.concatenate([s.values for s in series])


@pytest.mark.parametrize("name", ["attitude", "rates", "position", "velocity", "servo", "attitude_target"])
def test_pieces_hold_what_the_whole_boot_holds(minute, name):
    (whole,) = read(minute)
    parts = [piece.own() for piece in pieces(minute, None, SMALL)]
    assert len(parts) > 6
    assert {p.boot for p in parts} == {0}
    t, values = joined(parts, name)
    assert np.array_equal(t, getattr(whole, name).t_s)
    assert np.array_equal(values, getattr(whole, name).values)


def test_pieces_hold_every_reading_of_ranges_rotors_and_accelerometer(minute):
    (whole,) = read(minute)
    parts = [piece.own() for piece in pieces(minute, None, SMALL)]
    assert sum(len(p.imus[0].specific_force) for p in parts) == len(whole.imus[0].specific_force)
    assert sum(len(p.escs[3].rpm) for p in parts) == len(whole.escs[3].rpm)
    down = [p.beam("down") for p in parts]
    assert sum(len(b.distance) for b in down) == len(whole.beam("down").distance)
    assert all(len(b.verdicts) == len(b.distance) for b in down)
    # Unstamped messages are placed by arrival, by what a piece knows of the delays.
    rotor = np.concatenate([p.escs[3].rpm.t_s for p in parts])
    assert np.abs(rotor - whole.escs[3].rpm.t_s).max() < 0.003
    assert sum(p.duration_s for p in parts) == pytest.approx(whole.duration_s, abs=0.001)
    assert sum(p.summary.frames for p in parts) == whole.summary.frames
    assert all(p.parameters == whole.parameters for p in parts)
    assert sum(i.end_s - i.start_s for p in parts for i in p.armed) == pytest.approx(
        sum(i.end_s - i.start_s for i in whole.armed), abs=0.01
    )


@pytest.mark.parametrize("size", [SMALL, 3 * SMALL])
def test_pieces_of_several_boots(three_boots, size):
    whole = load(three_boots)
    parts = [piece.own() for piece in pieces(three_boots, None, size)]
    assert [key for key, _ in itertools.groupby(p.boot for p in parts)] == [0, 1, 2]
    for log in whole:
        own = [p for p in parts if p.boot == log.boot]
        assert np.array_equal(joined(own, "attitude")[0], log.attitude.t_s)
        assert (own[0].start_s, own[-1].end_s) == (log.start_s, log.end_s)


def test_the_wrap_of_the_boot_clock_is_undone_over_blocks(tmp_path):
    path = tmp_path / "wrap.tlog"
    wrap = 2**32
    early = flight(30.0, start_ms=wrap - 30_020)
    late = flight(30.0, start_ms=0, arrival_us=EPOCH_US + 30_000_000)
    write_tlog(path, [*early, *late])
    (whole,) = read(path)
    parts = [piece.own() for piece in pieces(path, None, SMALL)]
    assert {p.boot for p in parts} == {0}
    assert np.array_equal(joined(parts, "attitude")[0], whole.attitude.t_s)
    assert parts[-1].end_s > wrap / 1000.0


def test_a_stretch_without_the_vehicle_is_no_end(tmp_path):
    path = tmp_path / "gap.tlog"
    ground = flight(40.0, arrival_us=EPOCH_US + 20_000_000, system=255)
    after = flight(20.0, start_ms=100_000, arrival_us=EPOCH_US + 60_000_000)
    write_tlog(path, [*flight(20.0), *ground, *after])
    parts = [piece.own() for piece in pieces(path, 1, SMALL)]
    assert {p.boot for p in parts} == {0}
    assert sum(len(p.attitude) for p in parts if p.attitude is not None) == 2000


@pytest.fixture
def small_blocks(monkeypatch):
    monkeypatch.setattr(tlog_blocks, "BLOCK_BYTES", SMALL)


@pytest.mark.slow
def test_an_export_in_pieces_is_the_export_of_the_whole(three_boots, tmp_path, monkeypatch):
    whole, parts = tmp_path / "whole.csv", tmp_path / "parts.csv"
    command = ["export", str(three_boots), "--to", "csv", "--quiet"]
    assert main([*command, "--out", str(whole)]) == 0
    monkeypatch.setattr(tlog_blocks, "BLOCK_BYTES", SMALL)
    assert main([*command, "--out", str(parts)]) == 0
    with whole.open() as one, parts.open() as other:
        rows, again = list(csv.DictReader(one)), list(csv.DictReader(other))
    assert again[0].keys() == rows[0].keys()
    stamped = ("attitude_qx", "down_m", "range_down_m", "servo_2")

    def table(read):
        return [(r["boot"], round(float(r["time_s"]), 6), *(r[n] for n in stamped)) for r in read if r["attitude_qx"]]

    assert table(again) == table(rows)


@pytest.mark.slow
def test_info_and_replay_of_pieces_say_what_they_say_of_the_whole(three_boots, tmp_path, monkeypatch):
    def answers():
        out = []
        for command, *options in (("info", "--companion", "--vehicle", str(TANDEM)), ("run",)):
            target = tmp_path / f"{command}.json"
            assert main([command, str(three_boots), *options, "--quiet", "--json", str(target)]) == 0
            out.append(json.loads(target.read_text()))
        return out

    (info,), run = answers()
    monkeypatch.setattr(tlog_blocks, "BLOCK_BYTES", SMALL)
    (info_parts,), run_parts = answers()
    assert run_parts == run
    assert info_parts["companion"] == info["companion"]
    for one, other in zip(info_parts["boots"], info["boots"], strict=True):
        assert {s["name"]: s["count"] for s in one["streams"]} == {s["name"]: s["count"] for s in other["streams"]}
        assert [(j["question"], j["answer"]) for j in one["judges"]] == [
            (j["question"], j["answer"]) for j in other["judges"]
        ]
        assert one["duration_s"] == pytest.approx(other["duration_s"], abs=0.01)
        assert one["modes_s"] == pytest.approx(other["modes_s"], abs=0.05)


def peak(work):
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.fixture
def lengths(tmp_path):
    """Logs of a minute and of four."""
    short, long = tmp_path / "short.tlog", tmp_path / "long.tlog"
    write_tlog(short, flight(60.0))
    write_tlog(long, flight(240.0))
    return short, long


def frames(path):
    for _ in TlogFile(path).frames():
        pass


def in_pieces(path):
    for piece in read_pieces(path):
        piece.own()


def exported(path):
    target = path.with_suffix(".csv")
    main(["export", str(path), "--to", "csv", "--no-decisions", "--quiet", "--out", str(target)])


@pytest.mark.slow
@pytest.mark.parametrize("work", [frames, in_pieces, exported])
def test_memory_does_not_grow_with_the_log(lengths, work, small_blocks, tmp_path):
    short, long = lengths
    write_tlog(tmp_path / "tiny.tlog", flight(2.0))
    work(tmp_path / "tiny.tlog")  # imports and caches
    assert peak(lambda: work(long)) < 1.25 * peak(lambda: work(short))


@pytest.mark.slow
def test_a_long_log_is_not_kept_by_the_export(lengths, small_blocks):
    tables = Tables(lengths[1])
    assert len(list(tables)) == len(list(tables)) > 6


@pytest.mark.slow
def test_boots_cost_what_they_hold(tmp_path, monkeypatch):
    """Frames that are looked at, for a hundred boots of two seconds against twenty-five: four times as many."""
    looked_at = 0
    find = Tlog.indices

    def indices(self, *arguments):
        nonlocal looked_at
        looked_at += len(self)
        return find(self, *arguments)

    monkeypatch.setattr(Tlog, "indices", indices)
    work = []
    for boots in (25, 100):
        path = tmp_path / f"{boots}.tlog"
        write_tlog(
            path,
            [item for k in range(boots) for item in flight(2.0, start_ms=5_000, arrival_us=EPOCH_US + 10_000_000 * k)],
        )
        looked_at = 0
        assert len(load(path)) == boots
        work.append(looked_at)
    assert work[1] < 5 * work[0]


@pytest.fixture
def dataflash(tmp_path):
    path = tmp_path / "long.bin"
    path.write_bytes(bin_flight(120.0))
    return path


@pytest.mark.parametrize("name", ["attitude", "position", "servo", "battery"])
def test_pieces_of_a_dataflash_log_hold_what_it_holds(dataflash, name):
    (whole,) = load(dataflash)
    parts = [piece.own() for piece in read_bin(dataflash, None, SMALL)]
    assert len(parts) > 5
    t, values = joined(parts, name)
    assert np.array_equal(t, getattr(whole, name).t_s)
    assert np.array_equal(values, getattr(whole, name).values)
    assert sum(len(p.escs[2].rpm) for p in parts) == len(whole.escs[2].rpm)
    assert sum(p.summary.frames for p in parts) == whole.summary.frames
    assert all(p.parameters == whole.parameters for p in parts)
    assert sum(i.end_s - i.start_s for p in parts for i in p.armed) == pytest.approx(2.0)
    assert sum(i.end_s - i.start_s for p in parts for i in p.modes) == pytest.approx(whole.duration_s)


def decided(path, tmp_path):
    target = tmp_path / "run.json"
    assert main(["run", str(path), "--quiet", "--json", str(target)]) == 0
    return json.loads(target.read_text())


@pytest.mark.slow
def test_a_dataflash_log_in_pieces_is_decided_on_as_the_whole(dataflash, tmp_path, monkeypatch):
    whole = decided(dataflash, tmp_path)
    monkeypatch.setattr(tlog_blocks, "BLOCK_BYTES", SMALL)
    assert len(list(read_pieces(dataflash))) > 5
    assert decided(dataflash, tmp_path) == whole


@pytest.mark.slow
def test_the_memory_of_a_run_does_not_grow_with_a_dataflash_log(dataflash, small_blocks, tmp_path):
    short = tmp_path / "short.bin"
    short.write_bytes(bin_flight(60.0))
    decided(short, tmp_path)  # imports and caches
    assert peak(lambda: decided(dataflash, tmp_path)) < 1.25 * peak(lambda: decided(short, tmp_path))


def test_joined_dataflash_logs_are_flights_of_their_own(tmp_path):
    path = tmp_path / "joined.bin"
    path.write_bytes(bin_flight(4.0) + bin_flight(8.0))
    first, second = load(path)
    assert (first.boot, second.boot) == (0, 1)
    assert (round(first.duration_s, 2), round(second.duration_s, 2)) == (3.98, 7.98)
    assert (len(first.attitude), len(second.attitude)) == (200, 400)


def test_a_message_that_is_declared_anew_is_read_by_its_new_declaration(tmp_path):
    w = BinWriter()
    w.kind("ATT", "Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw")
    for k in range(100):
        w.row("ATT", 10_000_000 + 20_000 * k, 0.0, 2.0, 0.0, -1.0, 90.0, 90.0)
    again = BinWriter()
    again.kind("ATT", "Qcccccc", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw")
    for k in range(100, 200):
        again.row("ATT", 10_000_000 + 20_000 * k, 0, 200, 0, -100, 9000, 9000)
    path = tmp_path / "anew.bin"
    path.write_bytes(w.bytes() + again.bytes()[89:])  # without what begins a log
    (log,) = load(path)
    assert len(log.attitude) == 200
    assert np.allclose(log.attitude.values, log.attitude.values[0])


@pytest.mark.parametrize("minutes", [100, 150, 1200])
def test_a_diagnosis_takes_stretches_from_all_of_a_long_log(minutes):
    own = Stretches()
    for k in range(minutes // 30):
        if own.wants_next():
            own.add(SimpleNamespace(seconds=1800.0, name=k))
    names = [r.name for r in own.records]
    assert sum(r.seconds for r in own.records) <= MOST_S
    assert names[0] == 0
    assert len(set(np.diff(names))) == 1
    assert names[-1] + names[1] >= minutes // 30
    assert bool(own.notes()) == (minutes > 120)


def test_joined_px4_logs_are_flights_of_their_own(tmp_path):
    pytest.importorskip("pyulog")
    path = tmp_path / "joined.ulg"
    path.write_bytes(ulg_flight(4.0) + ulg_flight(8.0))
    first, second = load(path)
    assert (first.boot, second.boot) == (0, 1)
    assert (len(first.attitude), len(second.attitude)) == (200, 400)
    assert first.summary.bytes == second.summary.bytes == path.stat().st_size


@pytest.fixture
def ulog(tmp_path, monkeypatch):
    pytest.importorskip("pyulog")
    monkeypatch.setattr(ulg, "PIECE_S", 15.0)
    monkeypatch.setattr(ulg, "MARGIN_S", 3.0)
    path = tmp_path / "long.ulg"
    path.write_bytes(ulg_flight(40.0))
    return path


@pytest.mark.parametrize("name", ["attitude", "position", "servo", "battery"])
def test_pieces_of_a_px4_log_hold_what_it_holds(ulog, name):
    (whole,) = load(ulog)
    parts = [piece.own() for piece in read_pieces(ulog)]
    assert len(parts) == 3
    t, values = joined(parts, name)
    assert np.array_equal(t, getattr(whole, name).t_s)
    assert np.array_equal(values, getattr(whole, name).values, equal_nan=True)
    assert sum(p.duration_s for p in parts) == pytest.approx(whole.duration_s)
    assert all(p.parameters == whole.parameters for p in parts)


def test_a_px4_log_in_pieces_is_decided_on_as_the_whole(ulog, tmp_path, monkeypatch):
    parts = decided(ulog, tmp_path)
    monkeypatch.setattr(ulg, "PIECE_S", 1e6)
    assert len(list(read_pieces(ulog))) == 1
    assert decided(ulog, tmp_path) == parts


def test_a_px4_log_that_does_not_fit_into_memory_is_refused_with_the_numbers(ulog, monkeypatch, capsys):
    monkeypatch.setattr(ulg, "free_bytes", lambda: 1_000_000.0)
    assert main(["info", str(ulog)]) == 3
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "needs some 2 MB of memory to be read" in line
    assert "1 MB are free" in line


def test_a_cut_dataflash_log_says_so(tmp_path):
    path = tmp_path / "cut.bin"
    path.write_bytes(bin_flight(4.0)[:-7])
    (log,) = load(path)
    assert any("cut off" in note for note in log.summary.notes)


@pytest.mark.parametrize(("arrival_us", "told"), [(25_970_000_000_000_000, "year 2792"), (5_000_000, "year 1970")])
def test_stamps_of_another_century_are_one_line_and_everything_is_read(tmp_path, arrival_us, told):
    path = tmp_path / "future.tlog"
    write_tlog(path, flight(5.0, arrival_us=arrival_us))
    (log,) = load(path)
    assert len(log.attitude) == 250
    assert log.start_s == pytest.approx(40.0)
    (note,) = log.summary.notes
    assert told in note
