"""``--watch``: only what is new is said, and the exit code says whether it matters."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest
from log_writers import quad_flight, write_tlog

from companion.vehicles import QUAD
from replay.cli import main
from replay.fleet import watch as watch_module
from replay.fleet.store import NAME, Store

LONG_AGO_S = 1_700_000_000


def look(logs: Path, out: Path, *more: str) -> int:
    command = ["diagnose", str(logs), "--vehicle", str(QUAD), "--model", "none", "--watch"]
    return main([*command, "--out", str(out), *more])


def fly(logs: Path, number: int) -> None:
    path = logs / f"{number}.tlog"
    write_tlog(path, quad_flight(30.0, seed=number))
    os.utime(path, (LONG_AGO_S, LONG_AGO_S))


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    folder = tmp_path / "logs"
    folder.mkdir()
    return folder


def test_watch_is_of_a_folder(logs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fly(logs, 1)
    assert main(["diagnose", str(logs / "1.tlog"), "--watch"]) == 2
    assert "--watch: is of a folder" in capsys.readouterr().err
    assert main(["diagnose", str(logs), "--watch", "-5"]) == 2
    assert "--watch -5" in capsys.readouterr().err


def test_an_empty_folder_and_a_log_still_written_are_nothing_new(
    logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert look(logs, tmp_path / "out") == 0
    write_tlog(logs / "now.tlog", quad_flight(30.0))
    assert look(logs, tmp_path / "out") == 0
    assert capsys.readouterr().out == ""


@pytest.mark.slow
def test_a_log_is_said_once(logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    fly(logs, 1)
    assert look(logs, out) == 0
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith(str(logs / "1.tlog"))
    assert look(logs, out) == 0
    said = capsys.readouterr()
    assert (said.out, said.err) == ("", "")
    (logs / "broken.tlog").write_bytes(b"\x00" * 400)
    os.utime(logs / "broken.tlog", (LONG_AGO_S, LONG_AGO_S))
    assert look(logs, out) == 3
    assert "broken.tlog: " in capsys.readouterr().out
    assert look(logs, out, "--json", "-") == 0
    assert json.loads(capsys.readouterr().out)["logs"] == []


@pytest.mark.slow
def test_a_change_is_said_once_with_exit_code_1(
    logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    fly(logs, 1)
    assert look(logs, out) == 0
    capsys.readouterr()

    def answered(a: Any, folder: Path, options: Any, paths: Any) -> Any:
        """Twelve more flights of another vehicle, as an answer has them; half of them with less thrust."""
        found = real(a, folder, options, paths)
        with Store.open(out / NAME) as store:
            for day in range(1, 13):
                store.add("q", flight_of(day, 0.0 if day < 7 else -0.08))
        return found

    real = watch_module.answer_folder
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(watch_module, "answer_folder", answered)
        assert look(logs, out) == 1
        (line,) = capsys.readouterr().out.splitlines()
        assert line.startswith("board-A: thrust_scale scale 0 -> -0.08 1 since /logs/7.tlog")
        assert look(logs, out) == 0
        assert capsys.readouterr().out == ""


def flight_of(day: int, scale: float) -> dict[str, Any]:
    size = {"value": scale, "ci95": [scale - 0.01, scale + 0.01], "unit": "1"}
    effect = {"name": "thrust_scale", "parameters": {"scale": size}, "kept": True}
    return {
        "sha256": str(day),
        "log": f"/logs/{day}.tlog",
        "date": f"2026-05-{day:02d}T10:00:00Z",
        "identity": {"vehicle": "board-A"},
        "verdict": "explained",
        "effects": [effect],
    }
