"""The store of a folder, and what it says of every vehicle over time."""

from __future__ import annotations

import csv
import json
import re
import shutil
import sqlite3
import sys
import weakref
from collections.abc import Iterator
from contextlib import ExitStack
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import CHROMIUM, DESKTOP, PHONE, Browser
from log_writers import quad_flight, write_tlog

from companion.vehicles import QUAD
from models.common.errors import ConfigError
from replay.cli import main
from replay.fleet import season_page
from replay.fleet.season import Sized, Wanted, change_of, season
from replay.fleet.season_page import MOST_POINTS, page
from replay.fleet.season_tables import VIEWS
from replay.fleet.store import NAME, SCHEMA, Store

DAY = "2026-05-{:02d}T10:00:00Z"


def answer(
    day: int, *, vehicle: str = "board-A", scale: float = 0.0, **more: Any
) -> dict[str, Any]:
    """What ``replay diagnose`` says of a flight on a day of May, with a thrust scale."""
    size = {"value": scale, "ci95": [scale - 0.01, scale + 0.01], "unit": "1"}
    return {
        "sha256": f"{vehicle}-{day}",
        "log": f"/logs/{vehicle}/{day}.tlog",
        "date": DAY.format(day),
        "date_from": "log",
        "identity": {
            "vehicle": vehicle,
            "board": "A",
            "firmware": "ArduCopter V4.6",
            "frame": "quad-x",
        },
        "verdict": "explained",
        "duration_s": 60.0,
        "axes": {"Fz": {}},
        "effects": [
            {
                "name": "thrust_scale",
                "parameters": {"scale": size},
                "probability": 0.98,
                "explains": 0.5,
                "kept": True,
            }
        ],
        "log_faults": [{"channel": "rpm_1", "what": "stands still"}],
        "version": "1",
        "wall_s": 3.0,
    } | more


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    with ExitStack() as stack:
        yield stack.enter_context(Store.open(tmp_path / NAME, make=True))


def test_an_answer_is_a_row_of_each_table(store: Store) -> None:
    store.add("q", answer(1, scale=0.02))
    (log,) = store.rows("SELECT * FROM logs")
    assert (log["vehicle"], log["verdict"], log["judged_s"]) == ("board-A", "explained", 60.0)
    (effect,) = store.rows("SELECT * FROM effects")
    assert (effect["effect"], effect["value"]) == ("thrust_scale", 0.02)
    (fault,) = store.rows("SELECT * FROM faults")
    assert fault["what"] == "stands still"


def test_a_newer_answer_takes_the_place_of_an_older(store: Store) -> None:
    store.add("q", answer(1, scale=0.02))
    store.add("q", answer(1, scale=0.03, log_faults=[]))
    assert [row["value"] for row in store.rows("SELECT value FROM effects")] == [0.03]
    assert not store.rows("SELECT * FROM faults")


def test_a_store_of_another_schema_is_refused(tmp_path: Path) -> None:
    with Store.open(tmp_path / NAME, make=True):
        pass
    with sqlite3.connect(tmp_path / NAME) as c:
        c.execute("UPDATE meta SET value = '99'")
    with pytest.raises(ConfigError, match=rf"schema 99.* writes {SCHEMA}"), Store.open(tmp_path):
        pass


@pytest.mark.parametrize("content", [None, b"no database at all, but some text"])
def test_what_is_no_store_is_one_line(
    tmp_path: Path, content: bytes | None, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / NAME
    if content is not None:
        file.write_bytes(content)
    assert main(["season", str(tmp_path)]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1
    assert str(tmp_path) in said[0]


def test_a_size_that_changes_is_told_with_the_first_log_that_shows_it(store: Store) -> None:
    for day in range(1, 13):
        store.add("q", answer(day, scale=0.0 if day < 7 else -0.08))
        store.add("q", answer(day, vehicle="board-B"))
    found = season(store)
    first, second = found.vehicles
    (course,) = first.changed
    assert course.change is not None
    assert course.change.since.endswith("/7.tlog")
    assert course.change.before == pytest.approx(0.0, abs=0.005)
    assert course.change.after == pytest.approx(-0.08, abs=0.005)
    assert not second.changed
    assert found.common == ("thrust_scale",)


def test_what_is_new_and_what_cannot_be_judged(store: Store) -> None:
    for day in (1, 2):
        store.add("q", answer(day, effects=[]))
    store.add("q", answer(3))
    store.add("q", answer(4, effects=[], error="no accelerometer"))
    (vehicle,) = season(store).vehicles
    assert vehicle.new == ("thrust_scale",)
    assert vehicle.judged == 3
    assert vehicle.not_judged == (("/logs/board-A/4.tlog", "no accelerometer"),)


def test_one_reason_is_one_line_of_the_text(store: Store) -> None:
    for day in range(1, 5):
        store.add("q", answer(day, effects=[], error="did not fly" if day < 4 else "cut"))
    lines = season(store).as_text().splitlines()
    assert lines[2:] == [
        "  not judged: 3 logs, the latest /logs/board-A/3.tlog: did not fly",
        "  not judged: /logs/board-A/4.tlog: cut",
    ]


def test_one_vehicle_one_effect_or_some_days(store: Store) -> None:
    for day in range(1, 13):
        store.add("q", answer(day, scale=0.0 if day < 7 else -0.08))
        store.add("q", answer(day, vehicle="board-B"))
    (only,) = season(store, Wanted(vehicle="board-B")).vehicles
    assert only.vehicle == "board-B"
    assert not any(v.courses for v in season(store, Wanted(effect="payload")).vehicles)
    some = season(store, Wanted(first=date(2026, 5, 8), last=date(2026, 5, 10)))
    assert [v.judged for v in some.vehicles] == [3, 3]
    assert not some.vehicles[0].changed, "it had changed before"


@pytest.mark.parametrize("view", VIEWS)
def test_every_view_as_csv_and_parquet(store: Store, tmp_path: Path, view: str) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    for day in range(1, 13):
        store.add("q", answer(day, scale=0.0 if day < 7 else -0.08))
    store.add("q", answer(13, effects=[], error="no accelerometer"))
    files = [tmp_path / f"view.{kind}" for kind in ("csv", "parquet")]
    places = ["--view", view, "--csv", str(files[0]), "--parquet", str(files[1])]
    assert main(["season", str(store.path), "--quiet", *places]) == 0
    with files[0].open() as file:
        as_text = list(csv.DictReader(file))
    rows = parquet.read_table(files[1]).to_pylist()
    assert len(rows) == {"sizes": 12, "changes": 1, "vehicles": 1, "unjudged": 1}[view]
    assert [{key: str(value) for key, value in row.items()} for row in rows] == as_text
    assert list(rows[0]) == list(VIEWS[view].columns)


def test_without_pyarrow_csv_is_offered(
    store: Store, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert main(["season", str(store.path), "--parquet", "out.parquet"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "needs the package pyarrow" in line
    assert "--csv" in line


def test_a_day_that_is_none_is_said(store: Store, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["season", str(store.path), "--from", "june"])
    assert "june is no day" in capsys.readouterr().err


def test_the_page_says_what_its_filters_need(store: Store) -> None:
    for day in range(1, 13):
        store.add("q", answer(day, scale=0.0 if day < 7 else -0.08))
    text = page(season(store))
    assert '<section data-vehicle="board-A" data-date="2026-05-12T10:00:00Z">' in text
    assert '<tr data-effect="thrust_scale" data-date="2026-05-07T10:00:00Z">' in text
    assert '<div data-effect="thrust_scale"><figure>' in text
    assert "<option>thrust_scale</option>" in text
    assert "<title>2026-05-07, 7.tlog: -0.08 1, 95 %: -0.09 to -0.07</title>" in text


def test_a_page_of_many_logs_shows_means_of_logs_that_follow_each_other(store: Store) -> None:
    for number in range(MOST_POINTS + 20):
        more = {
            "sha256": str(number),
            "date": f"2026-05-01T00:{number // 60:02d}:{number % 60:02d}Z",
        }
        store.add("q", answer(1, scale=float(number), **more))
    text = page(season(store))
    assert text.count('<g class="dot after">') == MOST_POINTS
    assert "<title>2026-05-01 to 2026-05-01, 2 logs: mean 0.5 1</title>" in text
    assert "means of 2 logs, and where 95 % of these lie" in text


def test_a_page_has_so_many_plots_and_of_the_other_vehicles_the_names(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(season_page, "MOST_PLOTS", 3)
    monkeypatch.setattr(season_page, "MOST_ROWS", 1)
    for vehicle in ("board-A", "board-B", "board-C"):
        for day in range(1, 13):
            changed = vehicle == "board-C" and day >= 7
            store.add("q", answer(day, vehicle=vehicle, scale=-0.08 if changed else 0.0))
    for day in (13, 14):
        store.add("q", answer(day, effects=[], error="no accelerometer", identity={}))
    text = page(season(store))
    shown = re.findall(r'<section data-vehicle="(.*?)"', text)
    assert shown == ["board-C", "board-A"], "what changed first"
    assert "shows one: board-B." in text
    assert "And 1 more: <code>replay season STORE --view unjudged" in text


def test_a_season_holds_one_vehicle_in_memory(store: Store) -> None:
    for vehicle in range(40):
        for day in range(1, 13):
            store.add("q", answer(day, vehicle=f"board-{vehicle:02d}"))
    found = season(store)
    assert len(found.vehicles) == 40
    first = weakref.ref(found.vehicles[0])
    assert first() is None, "nobody keeps it"
    assert [v.vehicle for v in found.vehicles[38:]] == ["board-38", "board-39"]


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
def test_the_filters_of_the_page_in_a_browser(store: Store, tmp_path: Path) -> None:
    for day in range(1, 13):
        store.add("q", answer(day, scale=0.0 if day < 7 else -0.08))
        store.add("q", answer(day, vehicle="board-B"))
    target = tmp_path / "season.html"
    target.write_text(page(season(store)))
    choose = "form.vehicle.value = 'board-B'; form.dispatchEvent(new Event('input'));"
    told = "form.querySelector('output').value"
    with Browser() as browser:
        for size in (PHONE, DESKTOP):
            seen = browser.open(target.as_uri(), size)
            assert seen.width <= size[0]
            assert (seen.console, seen.requests) == ((), ())
            assert browser.value(told) == "2 of 2 vehicles"
            assert browser.value(choose + told) == "1 of 2 vehicles"


def sizes(values: np.ndarray, sd: float) -> list[Sized]:
    return [
        Sized(log=str(i), date="", value=v, low=v - 1.96 * sd, high=v + 1.96 * sd)
        for i, v in enumerate(values.tolist())
    ]


@pytest.mark.parametrize("between", [0.0, 1.0, 3.0])
def test_false_alarms_are_rare(between: float) -> None:
    """Eight parameters on fifty vehicles: at most one alarm is expected."""
    rng = np.random.default_rng(3)
    alarms = 0
    for _ in range(400):
        spread = np.hypot(1.0, between)
        alarms += change_of(sizes(spread * rng.standard_normal(20), 1.0)) is not None
    assert alarms <= 3


def test_a_change_is_found_where_it_was() -> None:
    rng = np.random.default_rng(4)
    right = 0
    for _ in range(50):
        values = rng.standard_normal(20)
        values[9:] += 6.0
        change = change_of(sizes(values, 1.0))
        right += change is not None and change.since == "9"
    assert right >= 45


@pytest.fixture(scope="module")
def answered(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A folder with two logs, a copy of one, and a broken one, diagnosed."""
    folder = tmp_path_factory.mktemp("fleet")
    logs = folder / "logs"
    logs.mkdir()
    for seed in (1, 2):
        write_tlog(logs / f"{seed}.tlog", quad_flight(30.0, seed=seed))
    shutil.copy(logs / "1.tlog", logs / "copy.tlog")
    (logs / "broken.tlog").write_bytes(b"\x00" * 400)
    out = folder / "out"
    assert main(diagnose(logs, out)) == 0
    return logs, out


def diagnose(logs: Path, out: Path, *more: str) -> list[str]:
    command = ["diagnose", str(logs), "--vehicle", str(QUAD), "--model", "none", "--workers", "2"]
    return [*command, "--out", str(out), *more]


@pytest.mark.slow
def test_a_copy_is_counted_once_and_a_moved_archive_is_known(
    answered: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    logs, out = answered
    with Store.open(out) as store:
        assert len(store.rows("SELECT * FROM logs")) == 3
    moved = tmp_path / "archive"
    shutil.copytree(logs, moved)
    assert main(diagnose(moved, out)) == 0
    said = capsys.readouterr()
    assert "3 of them known from before" in said.out
    assert "copy.tlog: is a copy of" in said.err


@pytest.mark.slow
def test_the_season_as_text_json_csv_and_page(
    answered: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, out = answered
    table = tmp_path / "sizes.csv"
    more = ["--csv", str(table), "--report", str(tmp_path), "--json", "-"]
    assert main(["season", str(out), *more]) == 0
    told = json.loads(capsys.readouterr().out)
    (vehicle,) = told["vehicles"]
    assert vehicle["judged"] == 2
    assert len(told["unknown"]) == 1  # the broken one
    with table.open() as file:
        rows = list(csv.DictReader(file))
    assert {row["vehicle"] for row in rows} <= {vehicle["vehicle"]}
    assert vehicle["vehicle"] in (tmp_path / "report.html").read_text()
    assert main(["season", str(out), "--vehicle", "nobody"]) == 2
    assert "nobody" in capsys.readouterr().err


@pytest.mark.slow
def test_a_failure_that_passes_is_asked_again_on_demand(
    answered: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    logs, out = answered
    for file in (out / "results").iterdir():
        content = json.loads(file.read_text())
        if content["log"].endswith("/2.tlog"):
            failed = {"error": "its process died", "passing": True}
            kept = {key: content[key] for key in ("log", "sha256", "version", "date", "date_from")}
            file.write_text(json.dumps(kept | failed))
    assert main(diagnose(logs, out)) == 0
    assert "3 of them known" in capsys.readouterr().out
    assert main(diagnose(logs, out, "--retry")) == 0
    assert "2 of them known" in capsys.readouterr().out
    with Store.open(out) as store:
        assert len(store.rows("SELECT * FROM logs WHERE error IS NULL")) == 2


def test_one_vehicle_with_one_log_is_counted_as_such(store: Store) -> None:
    store.add("q", answer(1))
    head, vehicle = season(store).as_text().splitlines()[:2]
    assert head == "vehicles: 1, logs judged: 1"
    assert "1 logs" not in vehicle
