"""``replay diagnose --since``: what changed on a vehicle since flights that were good, and since which log."""

from __future__ import annotations

import json
import shutil
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from noise_records import noise_record

from companion.vehicles import default_vehicle
from models.effects import get
from replay.change_point import change_of_names
from replay.changes.changes import Baseline, Change, changes, learn
from replay.changes.since import ChangeReport, by_date, page
from replay.cli import main
from replay.residual.record import Record


def flight(seed: int, *effects: tuple[str, tuple[float, ...], tuple[float, ...]]) -> Record:
    """Sixty seconds of noise with effects of the catalogue: name, shape, coefficients."""
    record = noise_record(seed, 60.0, 0.3)
    felt = record.residual.copy()
    for name, shape, coefficients in effects:
        wrench = get(name).regressors(record.context, shape)
        felt += np.nan_to_num(wrench[..., : len(coefficients)] @ np.array(coefficients))
    return replace(record, residual=felt, name=f"{seed}")


HEAVY = ("thrust_scale", (), (-0.06,))
"""What the vehicle always had: not declared, and no change."""


@pytest.fixture(scope="module")
def good() -> Baseline:
    return learn([flight(21, HEAVY), flight(22, HEAVY)])


def names(good: Baseline, today: Record) -> list[str]:
    return [c.name for c in changes(good, today)]


@pytest.mark.slow
def test_what_the_vehicle_always_had_is_no_change(good: Baseline) -> None:
    assert {e.name for e in good.found} <= {"thrust_scale", "payload"}
    assert names(good, flight(23, HEAVY)) == []


def test_weather_is_no_change(good: Baseline) -> None:
    assert names(good, flight(24, HEAVY, ("wind", (0.0,), (0.8, -0.5, 0.0, 0.0)))) == []


@pytest.mark.slow
def test_a_weak_fan_is_the_first_cause(good: Baseline) -> None:
    (change,) = changes(good, flight(25, HEAVY, ("fan_imbalance", (2.0,), (-0.2,))))
    assert change.name == "fan_imbalance"
    sizes = {e.name: e for e in change.estimates}
    assert sizes["fan"].value == 2.0
    assert sizes["scale"].ci95[0] < -0.2 < sizes["scale"].ci95[1]


@pytest.mark.slow
def test_a_moved_battery_is_named(good: Baseline) -> None:
    (change,) = changes(good, flight(26, HEAVY, ("cg_offset", (), (0.04, 0.0))))
    assert "cg_offset" in (change.name, *change.aliases)


def test_a_change_is_there_from_the_log_since_which_most_show_it() -> None:
    assert change_of_names([False, False, True, True, False, True]) == 2
    assert change_of_names([False, True, False, False]) is None
    assert change_of_names([True]) == 0


def test_the_answer_as_json_text_and_page(good: Baseline) -> None:
    today = flight(25, HEAVY, ("fan_imbalance", (2.0,), (-0.2,)))
    (change,) = changes(good, today)
    assert isinstance(change, Change)
    answer = ChangeReport(good, ((today, (change,)),), (replace(change, since=today.name),), ())
    (entry,) = json.loads(json.dumps(answer.as_json(), allow_nan=False))["changed"]
    assert {"name", "since", "parameters", "probability"} <= set(entry)
    assert entry["since"] == today.name
    assert "fan_imbalance since" in answer.as_text()
    html = page(answer, default_vehicle())
    assert f"<h1>Fan imbalance changed since {today.name}</h1>" in html
    nothing = ChangeReport(good, ((today, ()),), (), ())
    assert nothing.as_json()["changed"] == []
    assert nothing.as_text().startswith("nothing changed")
    assert "<h1>Nothing changed</h1>" in page(nothing, default_vehicle())


def test_logs_are_put_in_order_of_their_dates(tmp_path: Path) -> None:
    late, early, undated = (tmp_path / name for name in ("a.tlog", "b.tlog", "c.tlog"))
    late.write_bytes(struct.pack(">Q", 1_700_000_000_000_000))
    early.write_bytes(struct.pack(">Q", 1_600_000_000_000_000))
    undated.write_bytes(struct.pack(">Q", 10))
    assert by_date([late, early]) == [early, late]
    assert by_date([late, early, undated]) == [late, early, undated]


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str]:
    code = main(["diagnose", "--quiet", *arguments])
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    return code, lines[0]


def test_bad_input_is_one_line_with_its_exit_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    empty, other = tmp_path / "empty.tlog", tmp_path / "other.tlog"
    empty.write_bytes(b"")
    other.write_bytes(b"\0")
    assert refused(capsys, str(empty), "--since", str(other))[0] == 3
    assert refused(capsys, str(empty), "--since", str(tmp_path / "none.tlog"))[0] == 3
    assert refused(capsys, str(empty), "--since", str(empty)) == (
        2, f"replay: {empty}: is one of the good flights of --since; name another log",
    )  # fmt: skip
    assert refused(capsys, str(tmp_path), "--since", "two")[0] == 2
    assert refused(capsys, str(tmp_path), "--since", "2")[0] == 2
    assert refused(capsys, str(empty), "--since", str(other), "--test", str(other))[0] == 2


@pytest.mark.slow
def test_a_cut_blade_is_found_against_healthy_flights(shared_data: Path, tmp_path: Path) -> None:
    folder = shared_data / "measured" / "crazypad"
    if not folder.is_dir():
        pytest.skip("no measured flights")
    good = [str(folder / f"E8_normal_{day}.tlog") for day in "bc"]
    command = [
        "--vehicle",
        str(folder / "E8.toml"),
        "--model",
        "none",
        "--quiet",
        "--json",
        str(tmp_path / "a.json"),
    ]
    cut = folder / "E8_cut_M3_4mm_3.5mm_39.5mm.tlog"
    assert main(["diagnose", str(cut), "--since", *good, *command]) == 0
    first = json.loads((tmp_path / "a.json").read_text())["changed"][0]
    assert first["name"] == "fan_imbalance"
    assert first["parameters"]["fan"]["value"] == 3.0
    assert -0.35 < first["parameters"]["scale"]["value"] < -0.1
    healthy = tmp_path / "logs"
    healthy.mkdir()
    for i, name in enumerate(("E8_normal_b.tlog", "E8_normal_c.tlog")):
        shutil.copy(folder / name, healthy / f"{i}.tlog")
    assert main(["diagnose", str(healthy), "--since", "1", *command]) == 0
    assert json.loads((tmp_path / "a.json").read_text())["changed"] == []
