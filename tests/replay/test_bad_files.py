"""Files from the field: packed, cut, joined, stamps of another millennium. One clear line, and the rest is read."""

from __future__ import annotations

import gzip
import json
import struct
from collections.abc import Callable
from pathlib import Path

import pytest
from log_writers import BinWriter, bin_flight, flight, ulg_flight, write_tlog

from replay.cli import main

FAR_US = 25_970_000_000_000_000
"""The year 2793."""


def tlog_bytes() -> bytes:
    """A flight of 4 s."""
    return b"".join(struct.pack(">Q", stamp) + frame for stamp, frame in flight(4.0))


CONTENT: dict[str, Callable[[], bytes]] = {
    ".tlog": tlog_bytes,
    ".bin": bin_flight,
    ".ulg": ulg_flight,
}
every_format = pytest.mark.parametrize("suffix", sorted(CONTENT))


def ask(path: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, dict, list[str]]:
    """Exit code, JSON and stderr lines of ``replay info``."""
    code = main(["info", str(path), "--json", "-"])
    out = capsys.readouterr()
    return code, json.loads(out.out)[0], out.err.strip().splitlines()


@every_format
def test_a_packed_file_under_the_name_of_a_log_says_to_unpack_it(suffix, tmp_path, capsys):
    path = tmp_path / f"flight{suffix}"
    path.write_bytes(gzip.compress(CONTENT[suffix]()))
    code, answer, errors = ask(path, capsys)
    assert code == 3
    assert len(errors) == 1
    assert "compressed (gzip): unpack it first" in errors[0]
    assert "unpack" in answer["error"]


@every_format
@pytest.mark.parametrize("share", [0.05, 0.5, 0.97])
def test_a_cut_file_gives_what_it_holds_or_one_line(suffix, share, tmp_path, capsys):
    data = CONTENT[suffix]()
    path = tmp_path / f"flight{suffix}"
    path.write_bytes(data[: round(share * len(data))])
    code, answer, errors = ask(path, capsys)
    assert (code, len(errors)) in ((0, 0), (3, 1))
    if share > 0.4:
        assert code == 0
        assert answer["boots"][0]["duration_s"] > 1.0


@every_format
def test_two_logs_joined_give_at_least_the_first(suffix, tmp_path, capsys):
    data = CONTENT[suffix]()
    path = tmp_path / f"flight{suffix}"
    path.write_bytes(data + data)
    code, answer, errors = ask(path, capsys)
    assert (code, errors) == (0, [])
    assert answer["boots"][0]["duration_s"] > 3.0
    assert all(boot["duration_s"] < 10.0 for boot in answer["boots"]), (
        "no time is invented between them"
    )


def test_receiver_stamps_of_the_year_2793(tmp_path, capsys):
    """All of them (a clock that was never set), and a single one (damage)."""
    path = tmp_path / "all.tlog"
    write_tlog(path, flight(4.0, arrival_us=FAR_US))
    code, answer, errors = ask(path, capsys)
    assert (code, errors) == (0, [])
    assert answer["boots"][0]["duration_s"] == pytest.approx(3.98)
    data = bytearray(tlog_bytes())
    data[:8] = struct.pack(">Q", FAR_US)
    (tmp_path / "one.tlog").write_bytes(data)
    code, answer, errors = ask(tmp_path / "one.tlog", capsys)
    assert (code, errors) == (0, [])
    assert any("stamps repaired" in note for note in answer["boots"][0]["notes"])
    assert answer["boots"][0]["duration_s"] == pytest.approx(3.98)


def test_a_single_boot_stamp_of_another_millennium_in_a_dataflash_log(tmp_path, capsys):
    w = BinWriter()
    w.kind("ATT", "Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw")
    w.kind("IMU", "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
    for k in range(200):
        us = FAR_US if k == 100 else 10_000_000 + 20_000 * k
        w.row("ATT", us, 0.0, 2.0, 0.0, -1.0, 90.0, 90.0)
        w.row("IMU", us, 0, 0.01, 0.02, 0.03, 0.1, 0.2, -9.8)
    path = tmp_path / "one.bin"
    path.write_bytes(w.bytes())
    code, answer, errors = ask(path, capsys)
    assert (code, errors) == (0, [])
    assert answer["boots"][0]["duration_s"] == pytest.approx(3.98)


def test_a_log_that_does_not_fit_into_memory_is_one_line(tmp_path, capsys, monkeypatch):
    def full(*_: object) -> bytes:
        raise MemoryError

    path = tmp_path / "large.tlog"
    path.write_bytes(tlog_bytes())
    monkeypatch.setattr("replay.logs.tlog.repair_stamps", full)
    for command in ("run", "info", "diagnose"):
        assert main([command, str(path)]) == 3
        (line,) = capsys.readouterr().err.strip().splitlines()
        assert "more memory than there is" in line
