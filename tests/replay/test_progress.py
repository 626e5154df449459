"""A run whose output is redirected says how far it is, also while one log takes long."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from log_writers import quad_flight, write_tlog

from companion.vehicles import QUAD
from replay import progress
from replay.cli import main
from replay.progress import Progress

OFTEN_S = 0.05


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "SAY_EVERY_S", OFTEN_S)


def slow() -> Iterator[str]:
    yield "good"
    time.sleep(6.0 * OFTEN_S)
    yield "bad"


@pytest.mark.usefixtures("impatient")
def test_lines_come_while_one_log_takes_long(capsys: pytest.CaptureFixture[str]) -> None:
    seen = list(Progress(what="logs", total=2).counted(slow(), failed=lambda one: one == "bad"))
    assert seen == ["good", "bad"]
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) > 2
    assert all(line.startswith("replay: 1 of 2 logs, ") for line in lines)
    assert "none done for" in lines[-1]


@pytest.mark.usefixtures("impatient")
def test_quiet_is_quiet(capsys: pytest.CaptureFixture[str]) -> None:
    list(Progress(what="logs", total=2, quiet=True).counted(slow(), failed=bool))
    assert capsys.readouterr().err == ""


def test_time_left_is_by_what_this_run_did() -> None:
    seconds = iter([0.0, 300.0, 300.0, 310.0, 400.0])
    run = Progress(what="logs", total=20, done=10, now=lambda: next(seconds))
    for _ in run.counted(["a", "b"], failed=lambda one: one == "b"):
        pass
    assert run.line() == "12 of 20 logs, 1 failed, about 21 min left"
    assert run.line() == "12 of 20 logs, 1 failed, none done for 1.7 min"


@pytest.mark.slow
@pytest.mark.usefixtures("impatient")
def test_one_log_says_what_is_done_with_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "a.tlog"
    write_tlog(log, quad_flight(30.0, seed=1))
    command = ["diagnose", str(log), "--vehicle", str(QUAD), "--model", "none"]
    assert main(command) == 0
    assert "judges the logs, 0.0 min so far" in capsys.readouterr().err
    assert main([*command, "--quiet"]) == 0
    assert capsys.readouterr().err == ""
