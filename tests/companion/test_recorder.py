"""Recordings: never overwritten, readable to the last byte, and never a reason to stop flying."""

from __future__ import annotations

import errno
import io
import os
import signal
import subprocess
import sys
import textwrap
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace

import pytest

from companion.mavlink import tlog_writer
from companion.mavlink.dialect import mavlink
from companion.mavlink.tlog_writer import Recorder
from models.common.errors import ConfigError
from replay.logs.tlog import read_tlog

BEAT = mavlink.MAVLink_heartbeat_message(2, 3, 128, 4, 4, 3).pack(mavlink.MAVLink(None, 1, 1))
RECORD_BYTES = 8 + len(BEAT)


def fill(recorder: Recorder, frames: int) -> None:
    for k in range(frames):
        recorder.write(1_700_000_000_000_000 + 1000 * k, BEAT)


def test_an_existing_file_is_never_overwritten(tmp_path: Path):
    path = tmp_path / "flight.tlog"
    for frames in (3, 5, 7):
        with closing(Recorder(path)) as recorder:
            fill(recorder, frames)
    sizes = {p.name: len(read_tlog(p)) for p in tmp_path.iterdir()}
    assert sizes == {"flight.tlog": 3, "flight-2.tlog": 5, "flight-3.tlog": 7}


@pytest.mark.parametrize("name", ["", "{date}_{boot}.tlog", "garden_{date}.tlog"])
def test_a_folder_or_a_template_names_by_date_and_boot(tmp_path: Path, name: str, monkeypatch):
    boot = tmp_path / "boot_id"
    boot.write_text("0123abcd-ef\n")
    monkeypatch.setattr(tlog_writer, "_BOOT_ID", boot)
    folder = tmp_path / "flights"
    folder.mkdir()
    for _ in range(2):  # within the same second
        with closing(Recorder(folder / name)) as recorder:
            fill(recorder, 1)
    names = sorted(p.name for p in folder.iterdir())
    assert len(names) == 2
    assert all(
        ("0123abcd" in n) == (name != "garden_{date}.tlog") and n.endswith(".tlog") for n in names
    )


def test_a_folder_that_does_not_exist_is_a_wrong_argument(tmp_path: Path):
    with pytest.raises(ConfigError, match="flight"):
        Recorder(tmp_path / "nowhere" / "flight.tlog")


@pytest.mark.parametrize("number", [errno.EROFS, errno.EACCES, errno.ENOSPC])
def test_a_folder_that_takes_nothing_is_said_once_and_the_flight_goes_on(
    tmp_path: Path, number: int, monkeypatch
):
    def refuse(*_: object) -> int:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(tlog_writer.io, "FileIO", refuse)
    said: list[str] = []
    with closing(Recorder(tmp_path / "f.tlog", say=said.append)) as recorder:
        fill(recorder, 5)
        recorder.flush()
    assert len(said) == 1
    assert os.strerror(number) in said[0]
    assert recorder.as_json() == {"files": [], "bytes": 0, "stopped": os.strerror(number)}


class FullDisk(io.FileIO):
    """Takes some bytes, then half a frame, as a disk does that runs full."""

    room = 3 * RECORD_BYTES + 10

    def write(self, data) -> int:  # type: ignore[override]
        part = data[: max(self.room, 0)]
        self.room -= len(part)
        return super().write(part)


def test_a_disk_that_runs_full_ends_the_recording_with_a_whole_frame(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(tlog_writer.io, "FileIO", FullDisk)
    said: list[str] = []
    with closing(Recorder(tmp_path / "f.tlog", say=said.append)) as recorder:
        fill(recorder, 10)
    assert len(said) == 1
    assert "full" in said[0]
    assert (tmp_path / "f.tlog").stat().st_size == 3 * RECORD_BYTES
    assert read_tlog(tmp_path / "f.tlog").report.truncated_bytes == 0


def test_nobody_who_uses_it_as_a_library_is_written_to(tmp_path: Path, monkeypatch, caplog, capfd):
    monkeypatch.setattr(tlog_writer.io, "FileIO", FullDisk)
    with closing(Recorder(tmp_path / "f.tlog")) as recorder:
        fill(recorder, 10)
    assert "the disk is full" in caplog.text
    assert capfd.readouterr() == ("", "")


def test_it_stops_before_it_fills_the_disk(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(tlog_writer.shutil, "disk_usage", lambda _: SimpleNamespace(free=10 << 20))
    said: list[str] = []
    with closing(Recorder(tmp_path / "f.tlog", said.append)) as recorder:
        fill(recorder, 2)
        recorder.flush()
        fill(recorder, 2)
    assert len(said) == 1
    assert len(read_tlog(tmp_path / "f.tlog")) == 2


def test_every_byte_before_a_kill_is_readable(tmp_path: Path):
    script = """
        import os, signal, sys
        from pathlib import Path
        from companion.mavlink.tlog_writer import Recorder
        recorder = Recorder(Path(sys.argv[1]))
        for k in range(1000):
            recorder.write(1_700_000_000_000_000 + k, bytes.fromhex(sys.argv[2]))
        os.kill(os.getpid(), signal.SIGKILL)
    """
    path = tmp_path / "f.tlog"
    killed = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script), str(path), BEAT.hex()], check=False
    )
    assert killed.returncode == -signal.SIGKILL
    log = read_tlog(path)
    assert len(log) == 1000
    assert log.report.truncated_bytes == 0
