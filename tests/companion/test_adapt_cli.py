"""--adapt of ``replay run`` and of ``companion``."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from adapt_flights import fly
from test_adapt_bad_input import VEHICLE, low_hover

import models
from companion.cli import main as companion
from companion.config import PipelineConfig
from replay.cli import main as replay


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recorded flight into the ground effect, without adaptation."""
    path = tmp_path_factory.mktemp("log") / "low.tlog"
    fly(low_hover(), PipelineConfig(vehicle=VEHICLE, model=models.load()), 24.0, record=path)
    return path


def ran(log: Path, *options: str) -> dict[str, object]:
    out = log.parent / "out.json"
    assert replay(["run", str(log), "--quiet", "--json", str(out), *options]) == 0
    told: dict[str, object] = json.loads(out.read_text())
    return told


@pytest.mark.slow
def test_replay_says_what_would_have_been_learned(log):
    assert "adapted" not in ran(log, "--adapt", "off")
    sizes = ran(log)["adapted"]
    assert ran(log, "--adapt", "full")["adapted"] == sizes
    assert sizes["ground_lift"].keys() == {"value", "sd", "unit"}
    assert sizes["ground_lift"]["sd"] < 0.2
    assert abs(sizes["thrust_scale"]["value"] - 1.0) < 0.05


@pytest.mark.slow
def test_the_text_names_sizes_and_what_is_compensated(log, capsys):
    assert replay(["run", str(log), "--adapt", "full"]) == 0
    told = capsys.readouterr().out
    assert "sizes, measured over" in told
    assert "ground_lift" in told
    assert "compensated" in told


@pytest.mark.slow
def test_a_folder_of_logs_is_measured_too(log, tmp_path, capsys):
    out = str(tmp_path / "folder")
    assert (
        replay(["run", str(log.parent), "--adapt", "full", "--out", out, "--json", "-", "--quiet"])
        == 0
    )
    told = json.loads(capsys.readouterr().out)
    (one,) = [row for row in told["logs"] if row["log"].endswith("low.tlog")]
    assert "ground_lift" in one["adapted"]


@pytest.mark.parametrize("command", [replay, companion])
@pytest.mark.parametrize(("mode", "said"), [("gate", "use full"), ("some", "off, full")])
def test_another_mode_is_refused_by_name_in_one_line(capsys, command, mode, said):
    where = ["run", "any.tlog"] if command is replay else ["--connect", "sim:hover"]
    with pytest.raises(SystemExit) as left:
        command([*where, "--adapt", mode])
    assert left.value.code == 2
    words = capsys.readouterr().err
    assert mode in words
    assert said in words
    assert words.count("\n") == 1
