"""Large logs: columns on disk and files that are mapped give the same answers, bit for bit."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from log_writers import EPOCH_US, bin_flight, flight, ulg_flight, write_tlog
from repeat_log import write_repeated

from replay import load, spill
from replay.cli import main
from replay.logs import files
from replay.spill import Spool, blocks, picked, spans, spilled

SHORT = 500
"""Rows of a block: a flight of seconds has many."""


@pytest.fixture
def small_blocks(monkeypatch):
    """All that is done for large logs is done for small ones."""
    monkeypatch.setattr(spill, "_LARGE", 1000)
    monkeypatch.setattr(files, "_MAPPED_FROM", 0)
    monkeypatch.setattr(blocks, "__defaults__", (SHORT,))
    monkeypatch.setattr(spans, "__defaults__", (4 * SHORT,))
    for name in ("tlog", "repeats"):
        monkeypatch.setattr(f"replay.logs.{name}.BLOCK", SHORT)
    for name in ("bin", "ulg", "ulg_repair"):
        monkeypatch.setattr(f"replay.logs.{name}.AT_ONCE", SHORT)
    for name in ("columns", "decided"):
        monkeypatch.setattr(f"replay.export.{name}.BLOCK", SHORT)


def shaken():
    """A flight with what blocks must not change: a stamp out of order, damage, a clock that is set, a second link."""
    messages = list(flight(8.0))
    for k in (100, 101, 102, SHORT - 1, SHORT, 1700):
        messages[k] = (EPOCH_US - 10**9 + k, messages[k][1])
    half = len(messages) // 2
    messages[half:] = [(arrival - 3_600_000_000, raw) for arrival, raw in messages[half:]]
    messages[1200] = (messages[1200][0], messages[1200][1][:-1] + b"?")
    return [message for message in messages for _ in range(2)]


@pytest.fixture(params=["tlog", "shaken", "bin", "ulg"])
def recorded(request, tmp_path):
    kind = request.param
    if kind == "ulg":
        pytest.importorskip("pyulog")
    if kind in ("bin", "ulg"):
        path = tmp_path / f"flight.{kind}"
        path.write_bytes({"bin": bin_flight, "ulg": ulg_flight}[kind](20.0))
        return path
    path = tmp_path / "flight.tlog"
    write_tlog(path, shaken() if kind == "shaken" else flight(20.0))
    return path


def content(value):
    """All arrays and numbers of a log, in order."""
    if isinstance(value, np.ndarray):
        return [(value.dtype, value.shape, value.tobytes())]
    if dataclasses.is_dataclass(value):
        return [content(getattr(value, f.name)) for f in dataclasses.fields(value)]
    if isinstance(value, Mapping):
        return [(key, content(item)) for key, item in value.items()]
    if isinstance(value, tuple | list):
        return [content(item) for item in value]
    return repr(value)


def on_disk(log):
    return isinstance(log.imus[0].specific_force.values.base, np.ndarray) and not (
        log.imus[0].specific_force.values.flags.writeable
    )


def test_columns_on_disk_are_those_of_memory(recorded, request):
    whole = load(recorded)
    request.getfixturevalue("small_blocks")
    parts = load(recorded)
    assert on_disk(parts[0])
    assert not on_disk(whole[0])
    assert content(parts) == content(whole)


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_an_export_by_blocks_is_the_same_file(tmp_path, request, kind):
    if kind == "parquet":
        pytest.importorskip("pyarrow")
    path = tmp_path / "flight.tlog"
    write_tlog(path, flight(12.0))
    outputs = [tmp_path / f"{name}.{kind}" for name in ("whole", "parts")]
    for out in outputs:
        command = ["export", str(path), "--to", kind, "--out", str(out), "--quiet"]
        assert main(command) == 0
        if out is outputs[0]:
            request.getfixturevalue("small_blocks")
    assert outputs[0].read_bytes() == outputs[1].read_bytes()


def test_info_by_blocks_says_the_same(recorded, request, capsys):
    said = []
    for _ in range(2):
        assert main(["info", str(recorded)]) == 0
        said.append(capsys.readouterr().out)
        if len(said) == 1:
            request.getfixturevalue("small_blocks")
    assert said[0] == said[1]


def test_a_px4_log_that_begins_across_two_blocks_is_found(tmp_path, monkeypatch):
    pytest.importorskip("pyulog")
    first = ulg_flight(4.0)
    path = tmp_path / "joined.ulg"
    path.write_bytes(first + ulg_flight(8.0))
    monkeypatch.setattr("replay.logs.ulg.AT_ONCE", len(first) + 3)
    assert len(load(path)) == 2


def test_a_spool_gives_back_its_rows_from_disk(small_blocks):
    rows = np.arange(3000.0).reshape(-1, 3)
    spool = Spool(np.float64, (3,))
    for part in blocks(len(rows), 70):
        spool.append(rows[part])
    array = spool.array()
    assert not array.flags.writeable
    assert np.array_equal(array, rows)
    assert spilled(array) is array
    chosen = rows[:, 0] % 2 == 0
    assert np.array_equal(picked(array, chosen), rows[chosen])
    places = np.array([7, 3, 900])
    assert np.array_equal(picked(array, places), rows[places])


def test_nothing_is_an_empty_array():
    assert Spool(np.float64, (4,)).array().shape == (0, 4)


def test_a_full_disk_leaves_the_rows_in_memory(small_blocks, monkeypatch):
    class Full:
        """Takes so many bytes, then none."""

        def __init__(self):
            self.content = b""

        def write(self, data):
            if len(self.content) > 5000:
                raise OSError(28, "No space left on device")
            self.content += bytes(data[:700])
            return min(len(data), 700)

        def seek(self, _):
            pass

        def read(self, size):
            return self.content[:size]

    monkeypatch.setattr("tempfile.TemporaryFile", lambda **_: Full())
    rows = np.arange(4000.0)
    spool = Spool(np.float64)
    for part in blocks(len(rows), 130):
        spool.append(rows[part])
    array = spool.array()
    assert np.array_equal(array, rows)


@pytest.mark.parametrize("kind", ["tlog", "bin", "ulg"])
def test_a_repeated_flight_is_one_long_flight(tmp_path, kind):
    if kind == "ulg":
        pytest.importorskip("pyulog")
    short = tmp_path / f"short.{kind}"
    if kind == "tlog":
        write_tlog(short, flight(4.0))
    else:
        short.write_bytes({"bin": bin_flight, "ulg": ulg_flight}[kind](4.0))
    long = tmp_path / f"long.{kind}"
    rounds = write_repeated(short, 4 * short.stat().st_size, long)
    (one,) = load(short)
    (many,) = load(long)
    assert rounds >= 3
    assert abs(many.duration_s / (rounds * one.duration_s) - 1.0) < 0.02
    assert len(many.attitude) == pytest.approx(rounds * len(one.attitude), rel=0.02)
    assert Path(long).stat().st_size > 2 * short.stat().st_size
