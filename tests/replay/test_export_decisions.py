"""``replay export`` with decisions: the same in CSV, Parquet and MCAP, and as the pipeline of flight made them."""

import csv
import errno
import json
import sys

import numpy as np
import pytest
from log_writers import EPOCH_US, bin_flight, flight, write_tlog

import models
from companion.adapt_options import Adapt
from companion.config import PipelineConfig
from companion.vehicles import TANDEM, default_vehicle
from models.common.extras import how_to_install
from replay.cli import main
from replay.export import files
from replay.export.columns import recorded
from replay.logs.formats import load
from replay.logs.tlog import read_tlog
from replay.rerun.harness import Replay
from replay.rerun.log_samples import samples


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "flight.tlog"
    write_tlog(path, flight(12.0))
    return path


@pytest.fixture(scope="module")
def csv_file(tmp_path_factory):
    """The same log as CSV, to be read by tests, not changed."""
    path = tmp_path_factory.mktemp("csv") / "flight.tlog"
    write_tlog(path, flight(12.0))
    return exported(path, "csv")


@pytest.fixture
def mcap_reader():
    return pytest.importorskip("mcap.reader", reason="mcap is not installed (extra: export)")


def exported(log, to, *options):
    target = log.with_suffix(f".{to}")
    vehicle = ["--vehicle", str(TANDEM)]
    assert (
        main(["export", str(log), "--to", to, "--out", str(target), "--quiet", *vehicle, *options])
        == 0
    )
    return target


def rows_of(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def messages_of(reader, path):
    with path.open("rb") as file:
        for schema, channel, message in reader.make_reader(file).iter_messages(
            log_time_order=False
        ):
            yield schema, channel, message, json.loads(message.data)


def decided(log):
    replay = Replay(
        PipelineConfig(
            vehicle=default_vehicle(), model=models.load(), dry_run=True, adapt=Adapt.FULL
        )
    )
    frames = read_tlog(log).frames() if log.suffix == ".tlog" else None
    return list(replay.decisions(frames) if frames else replay.decisions_on(samples(load(log)[0])))


def test_every_decision_stands_at_its_time_as_the_pipeline_made_it(log, csv_file):
    rows = {float(r["time_s"]): r for r in rows_of(csv_file)}
    decisions = decided(log)
    assert len(decisions) > 500
    assert any(d.offset.thrust for d in decisions)
    for d in decisions:
        row = rows[float(f"{d.t_s:.10g}")]
        got = [
            float(row[n])
            for n in ("offset_thrust", "offset_roll_rad", "offset_pitch_rad", "authority")
        ]
        np.testing.assert_allclose(
            got, [d.offset.thrust, d.offset.roll, d.offset.pitch, d.authority], rtol=1e-8
        )
        assert row["refusals"] == ("; ".join(r.value for r in d.reasons) or "none")
        if row["model_fz_n"]:
            assert float(row["model_fz_n"]) == pytest.approx(d.disturbance.wrench[2], rel=1e-8)
            assert float(row["used_h_m"]) == pytest.approx(min(d.disturbance.h_m), rel=1e-8)
    sizes = [r for r in rows.values() if r["size_ground_lift"]]
    told = decisions[-1].adaptation.estimates()["ground_lift"]
    assert float(sizes[-1]["size_ground_lift"]) == pytest.approx(told.value, rel=1e-8)
    assert float(sizes[-1]["size_ground_lift_sd"]) == pytest.approx(told.sd, rel=1e-8)


def test_without_a_vehicle_file_decisions_are_of_the_drafted_vehicle_and_that_is_said(
    log, tmp_path, capsys
):
    target = tmp_path / "drafted.csv"
    assert main(["export", str(log), "--to", "csv", "--out", str(target)]) == 0
    told = capsys.readouterr().out
    assert "note: assumed: mass_kg" in told
    assert default_vehicle().name not in told


def test_a_dataflash_log_has_decisions_too(tmp_path):
    path = tmp_path / "a.BIN"
    path.write_bytes(bin_flight())
    rows = [r for r in rows_of(exported(path, "csv")) if r["refusals"]]
    decisions = decided(path)
    assert [r["refusals"] for r in rows] == [
        "; ".join(x.value for x in d.reasons) or "none" for d in decisions
    ]


def test_csv_loads_as_plotjuggler_reads_it(csv_file):
    """One header line of distinct names, as many cells in every line, time as a number that never falls."""
    with csv_file.open(newline="") as file:
        header, *lines = csv.reader(file)
    assert len(set(header)) == len(header)
    assert all(len(line) == len(header) for line in lines)
    assert (np.diff([float(line[header.index("time_s")]) for line in lines]) > 0.0).all()
    for k, name in enumerate(header):
        if name != "refusals":
            assert all(np.isfinite(float(line[k])) for line in lines if line[k])


def test_mcap_says_what_the_csv_says(log, csv_file, mcap_reader):
    rows = rows_of(csv_file)
    got, last = {}, 0
    for schema, channel, message, content in messages_of(mcap_reader, exported(log, "mcap")):
        assert schema.encoding == "jsonschema"
        assert channel.message_encoding == "json"
        assert message.log_time >= last
        last = message.log_time
        if channel.topic != "/tf":
            assert set(content) <= set(json.loads(schema.data)["properties"])
            got.setdefault(message.log_time, {}).update(content)
    expected = {}
    for row in rows:
        cells = {n: v for n, v in row.items() if v and n != "time_s"}
        expected[round(float(row["time_s"]) * 1e9)] = cells
    assert list(got) == list(expected)
    for time, cells in expected.items():
        assert {n: v if isinstance(v, str) else f"{v:.10g}" for n, v in got[time].items()} == cells


def test_parquet_has_refusals_as_text(log, csv_file):
    parquet = pytest.importorskip(
        "pyarrow.parquet", reason="pyarrow is not installed (extra: export)"
    )
    table = parquet.read_table(exported(log, "parquet"))
    assert [x or "" for x in table["refusals"].to_pylist()] == [
        r["refusals"] for r in rows_of(csv_file)
    ]
    assert table.schema.metadata[b"vehicle"] == default_vehicle().name.encode()


def test_later_boots_come_later_in_mcap(tmp_path, mcap_reader):
    path = tmp_path / "two.tlog"
    write_tlog(path, flight(5.0) + flight(3.0, start_ms=5_000, arrival_us=EPOCH_US + 60_000_000))
    times, boots = [], []
    for _, channel, message, content in messages_of(mcap_reader, exported(path, "mcap")):
        times.append(message.log_time)
        if channel.topic == "/decision":
            boots.append(content["boot"])
    assert sorted(times) == times
    assert sorted(boots) == boots
    assert set(boots) == {1, 2}


def test_a_log_without_attitude_has_no_decisions(tmp_path, mcap_reader, capsys):
    path = tmp_path / "still.tlog"
    write_tlog(path, [(t, raw) for t, raw in flight(4.0) if raw[7] not in (30, 31)])
    assert not any(c.name == "attitude_qw" for c in recorded(load(path)[0]))
    assert "refusals" not in rows_of(exported(path, "csv"))[0]
    topics = {
        channel.topic for _, channel, _, _ in messages_of(mcap_reader, exported(path, "mcap"))
    }
    assert "/position" in topics
    assert not topics & {"/decision", "/model", "/sizes"}


def test_no_decisions_leaves_them_out(log):
    assert "refusals" not in rows_of(exported(log, "csv", "--no-decisions"))[0]


def test_a_missing_library_is_one_line(log, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    assert main(["export", str(log), "--to", "mcap", "--out", str(tmp_path / "x.mcap")]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert how_to_install("export") in line
    assert not list(tmp_path.glob("*x.mcap*"))


@pytest.mark.parametrize("to", ["csv", "parquet", "mcap"])
def test_a_bad_target_is_one_line_and_leaves_nothing(log, tmp_path, to, capsys):
    pytest.importorskip({"parquet": "pyarrow", "mcap": "mcap"}.get(to, "csv"))
    (tmp_path / "taken").mkdir()
    for target in (tmp_path / "none" / "x", tmp_path / "taken"):
        assert main(["export", str(log), "--to", to, "--out", str(target), "--no-decisions"]) == 2
        (line,) = capsys.readouterr().err.strip().splitlines()
        assert "cannot be written" in line
    assert sorted(p.name for p in tmp_path.iterdir()) == ["flight.tlog", "taken"]


@pytest.mark.parametrize("to", ["csv", "parquet", "mcap"])
def test_a_full_disk_keeps_the_file_that_was_there(log, tmp_path, to, capsys, monkeypatch):
    pytest.importorskip({"parquet": "pyarrow", "mcap": "mcap"}.get(to, "csv"))
    target = tmp_path / "x"
    target.write_text("before")

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(files.LogTable, "values", full)
    assert main(["export", str(log), "--to", to, "--out", str(target), "--no-decisions"]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "No space left on device" in line
    assert sorted(p.name for p in tmp_path.iterdir()) == ["flight.tlog", "x"]
    assert target.read_text() == "before"
