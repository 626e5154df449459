"""``replay export``: every sample where it was, units beside it, Parquet and CSV alike."""

import csv
import sys

import numpy as np
import pytest
from log_writers import EPOCH_US, bin_flight, flight, write_tlog

from replay.cli import main
from replay.logs.formats import load


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "flight.tlog"
    write_tlog(path, flight(4.0))
    return path


def test_parquet_holds_every_sample_at_its_stamp_with_its_unit(log, tmp_path, capsys):
    parquet = pytest.importorskip(
        "pyarrow.parquet", reason="pyarrow is not installed (extra: export)"
    )
    target = tmp_path / "out.parquet"
    assert main(["export", str(log), "--to", "parquet", "--out", str(target)]) == 0
    assert "out.parquet" in capsys.readouterr().out
    table = parquet.read_table(target)
    assert table.schema.field("range_down_m").metadata[b"unit"] == b"m"
    assert table.schema.field("rpm_1").metadata[b"unit"] == b"1/min"
    assert all(field.metadata[b"unit"] for field in table.schema)
    (boot,) = load(log)
    t = table["time_s"].to_numpy()
    assert (np.diff(t) > 0.0).all()
    for name, series, column in (
        ("down_m", boot.position, 2),
        ("range_down_m", boot.beam("down").good, 0),
        ("rpm_3", boot.escs[3].rpm, 0),
        ("az_m_s2", boot.imus[0].specific_force, 2),
        ("battery_voltage_v", boot.battery, 0),
    ):
        values = table[name].to_numpy(zero_copy_only=False)
        known = ~np.isnan(values)
        np.testing.assert_array_equal(t[known], series.t_s)
        np.testing.assert_array_equal(values[known], series.values[:, column])


def test_csv_says_the_same(log, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["export", str(log), "--to", "csv", "--quiet"]) == 0
    with open("flight.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    (boot,) = load(log)
    heights = [(float(r["time_s"]), float(r["range_down_m"])) for r in rows if r["range_down_m"]]
    good = boot.beam("down").good
    np.testing.assert_allclose(heights, np.column_stack([good.t_s, good.values[:, 0]]), rtol=1e-9)


def test_a_column_that_one_boot_lacks_is_empty_there(tmp_path):
    path = tmp_path / "two.tlog"
    without = [
        (t, raw)
        for t, raw in flight(3.0, start_ms=5_000, arrival_us=EPOCH_US + 60_000_000)
        if raw[7] != 132
    ]
    write_tlog(path, flight(4.0, start_ms=5_500) + without)
    assert (
        main(
            [
                "export",
                str(path),
                "--to",
                "csv",
                "--no-decisions",
                "--quiet",
                "--out",
                str(tmp_path / "a.csv"),
            ]
        )
        == 0
    )
    with open(tmp_path / "a.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["boot"] for row in rows} == {"1", "2"}
    assert {row["boot"] for row in rows if row["range_down_m"]} == {"1"}


def test_bin_logs_and_bad_arguments(tmp_path, capsys):
    path = tmp_path / "a.BIN"
    path.write_bytes(bin_flight())
    assert main(["export", str(path), "--to", "csv", "--out", str(tmp_path / "b.csv")]) == 0
    assert main(["export", str(path), "--to", "csv", "--out", str(tmp_path / "no" / "b.csv")]) == 2
    assert main(["export", str(tmp_path / "none.tlog"), "--to", "csv"]) == 3
    assert len(capsys.readouterr().err.strip().splitlines()) == 2


def test_without_pyarrow_csv_is_offered(log, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert main(["export", str(log), "--to", "parquet", "--out", str(tmp_path / "x.parquet")]) == 2
    assert "--to csv" in capsys.readouterr().err
