"""Logs of any length: a diagnosis takes them in stretches, and boots cost what they hold."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from log_writers import EPOCH_US, BinWriter, bin_flight, flight, ulg_flight, write_tlog

from models.common.errors import LogError
from replay import flightlog
from replay.diagnosis.stretches import MOST_S, Stretches
from replay.logs import memory
from replay.logs.formats import load
from replay.logs.tlog import Tlog


@pytest.fixture(params=["tlog", "bin", "ulg"])
def long(request, tmp_path, monkeypatch):
    """Forty seconds, and stretches of fifteen at most."""
    if request.param == "ulg":
        pytest.importorskip("pyulog")
    monkeypatch.setattr(flightlog, "_STRETCH_S", 15.0)
    monkeypatch.setattr(flightlog, "_ONE_STRETCH_BYTES", 0)
    path = tmp_path / f"long.{request.param}"
    if request.param == "tlog":
        write_tlog(path, flight(40.0))
    else:
        path.write_bytes({"bin": bin_flight, "ulg": ulg_flight}[request.param](40.0))
    (log,) = load(path)
    return log


def test_stretches_hold_every_sample_once(long):
    parts = list(long.stretches())
    assert len(parts) == 3
    for name in ("attitude", "rates", "position", "velocity", "servo", "battery"):
        series = [getattr(part, name) for part in parts]
        whole = getattr(long, name)
        assert np.array_equal(np.concatenate([s.t_s for s in series]), whole.t_s)
        assert np.array_equal(
            np.concatenate([s.values for s in series]), whole.values, equal_nan=True
        )
    assert sum(len(p.imus[0].specific_force) for p in parts) == len(long.imus[0].specific_force)
    for number, esc in long.escs.items():
        assert sum(len(p.escs[number].rpm) for p in parts) == len(esc.rpm)
    for beam in long.beams:
        own = [
            b
            for p in parts
            for b in p.beams
            if (b.sensor_id, b.name) == (beam.sensor_id, beam.name)
        ]
        assert sum((b.verdicts for b in own), ()) == beam.verdicts
        assert sum(len(b.distance) for b in own) == len(beam.distance)


def test_stretches_share_the_time_and_know_the_parameters(long):
    parts = list(long.stretches())
    assert (parts[0].start_s, parts[-1].end_s) == (long.start_s, long.end_s)
    assert sum(p.duration_s for p in parts) == pytest.approx(long.duration_s)
    assert all(p.parameters == long.parameters for p in parts)
    for name in ("armed", "modes"):
        seconds = [sum(i.end_s - i.start_s for i in getattr(p, name)) for p in (*parts, long)]
        assert sum(seconds[:-1]) == pytest.approx(seconds[-1])
    assert sum((p.texts for p in parts), ()) == long.texts


def test_a_log_that_is_no_longer_is_one_stretch(long, monkeypatch):
    monkeypatch.setattr(flightlog, "_STRETCH_S", 41.0)
    assert list(long.stretches()) == [long]
    monkeypatch.setattr(flightlog, "_STRETCH_S", 15.0)
    monkeypatch.setattr(flightlog, "_ONE_STRETCH_BYTES", long.summary.bytes)
    assert list(long.stretches()) == [long]


def test_the_wrap_of_the_boot_clock_is_undone(tmp_path):
    path = tmp_path / "wrap.tlog"
    wrap = 2**32
    early = flight(30.0, start_ms=wrap - 30_020)
    late = flight(30.0, start_ms=0, arrival_us=EPOCH_US + 30_000_000)
    write_tlog(path, [*early, *late])
    (whole,) = load(path)
    assert len(whole.attitude) == 3000
    assert whole.duration_s == pytest.approx(60.0, abs=0.1)
    assert whole.end_s > wrap / 1000.0


def test_a_time_without_the_vehicle_is_no_end(tmp_path):
    path = tmp_path / "gap.tlog"
    ground = flight(40.0, arrival_us=EPOCH_US + 20_000_000, system=255)
    after = flight(20.0, start_ms=100_000, arrival_us=EPOCH_US + 60_000_000)
    write_tlog(path, [*flight(20.0), *ground, *after])
    (log,) = load(path, 1)
    assert len(log.attitude) == 2000


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
            [
                item
                for k in range(boots)
                for item in flight(2.0, start_ms=5_000, arrival_us=EPOCH_US + 10_000_000 * k)
            ],
        )
        looked_at = 0
        assert len(load(path)) == boots
        work.append(looked_at)
    assert work[1] < 5 * work[0]


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


def test_a_cut_dataflash_log_says_so(tmp_path):
    path = tmp_path / "cut.bin"
    path.write_bytes(bin_flight(4.0)[:-7])
    (log,) = load(path)
    assert any("cut off" in note for note in log.summary.notes)


@pytest.mark.parametrize("arrival_us", [25_970_000_000_000_000, 5_000_000])
def test_stamps_of_another_century_hinder_nothing(tmp_path, arrival_us):
    path = tmp_path / "future.tlog"
    write_tlog(path, flight(5.0, arrival_us=arrival_us))
    (log,) = load(path)
    assert len(log.attitude) == 250
    assert log.start_s == pytest.approx(40.0)
    assert not log.summary.notes


@pytest.mark.parametrize("suffix", [".tlog", ".bin", ".ulg"])
def test_a_log_for_which_memory_is_too_small_is_refused_before_it_is_read(
    suffix, tmp_path, monkeypatch
):
    """Two gigabytes that take no place on the disk."""
    path = tmp_path / f"huge{suffix}"
    with path.open("wb") as file:
        file.truncate(2_000_000_000)
    monkeypatch.setattr("replay.logs.files.free_bytes", lambda: 4e9)
    monkeypatch.setattr(Path, "read_bytes", lambda _: pytest.fail("was read"))
    with pytest.raises(
        LogError, match="2 GB of log need some 6 GB of memory, 4 GB are free: cut it into parts"
    ):
        load(path)


def test_memory_is_that_of_the_container_and_of_the_process(tmp_path, monkeypatch):
    assert 1e8 < memory.free_bytes() < 1e14
    (tmp_path / "memory.max").write_text("3000000000\n")
    (tmp_path / "memory.current").write_text("2500000000\n")
    (tmp_path / "memory.stat").write_text("anon 1\ninactive_file 400000000\n")
    monkeypatch.setattr(memory, "_GROUP", tmp_path)
    monkeypatch.setattr(memory, "_MEMORY", tmp_path / "none")
    assert memory.free_bytes() == 900_000_000
    (tmp_path / "memory.max").write_text("max\n")
    assert memory.free_bytes() > 900_000_000
