"""--adapt and --save-model: of ``replay run`` and of ``companion``; saved sizes are the next flight's priors."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from adapt_flights import fly
from test_adapt_bad_input import VEHICLE, low_hover

import models
from companion.cli import main as companion
from companion.config import PipelineConfig
from models.errors import ConfigError
from replay.cli import main as replay


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recorded flight into the ground effect, without adaptation."""
    path = tmp_path_factory.mktemp("log") / "low.tlog"
    fly(low_hover(), PipelineConfig(VEHICLE, models.load()), 24.0, record=path)
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


def test_the_text_names_sizes_and_what_is_compensated(log, capsys):
    assert replay(["run", str(log), "--adapt", "full"]) == 0
    told = capsys.readouterr().out
    assert "sizes, measured over" in told
    assert "ground_lift" in told
    assert "compensated" in told


@pytest.mark.slow
def test_saved_sizes_are_loaded_with_the_flights_they_came_from(log, tmp_path):
    first = ran(log, "--adapt", "full", "--save-model", str(tmp_path / "m"))["adapted"]
    model = models.load(tmp_path / "m")
    assert model.info["sizes_from"] == ["low.tlog"]
    assert model.info["sizes"]["ground_lift"] == first["ground_lift"]
    assert "wind_north" not in model.info["sizes"]
    again = ran(log, "--adapt", "full", "--model", str(tmp_path / "m"), "--save-model", str(tmp_path / "n"))["adapted"]
    assert again["ground_lift"]["sd"] <= first["ground_lift"]["sd"]
    assert models.load(tmp_path / "n").info["sizes_from"] == ["low.tlog", "low.tlog"]


@pytest.mark.slow
def test_a_folder_of_logs_is_measured_too(log, tmp_path, capsys):
    out = str(tmp_path / "folder")
    assert replay(["run", str(log.parent), "--adapt", "full", "--out", out, "--json", "-", "--quiet"]) == 0
    told = json.loads(capsys.readouterr().out)
    (one,) = [row for row in told["logs"] if row["log"].endswith("low.tlog")]
    assert "ground_lift" in one["adapted"]


@pytest.mark.parametrize("command", [replay, companion])
@pytest.mark.parametrize(("mode", "said"), [("gate", "use full"), ("some", "off, full")])
def test_another_mode_is_refused_by_name_in_one_line(log, capsys, command, mode, said):
    where = ["run", str(log)] if command is replay else ["--connect", "sim:hover"]
    with pytest.raises(SystemExit) as left:
        command([*where, "--adapt", mode])
    assert left.value.code == 2
    words = capsys.readouterr().err
    assert mode in words
    assert said in words
    assert words.count("\n") == 1


@pytest.mark.parametrize(
    "command",
    [
        lambda log, out: replay(["run", str(log), "--adapt", "off", "--save-model", out]),
        lambda log, out: replay(["run", str(log.parent), "--adapt", "full", "--save-model", out]),
    ],
    ids=["replay with --adapt off", "replay of a folder"],
)
def test_save_model_is_refused_where_it_would_save_nothing(log, tmp_path, capsys, command):
    assert command(log, str(tmp_path / "m")) == ConfigError.exit_code == 2
    assert "--save-model" in capsys.readouterr().err
    assert not (tmp_path / "m").exists()


def test_a_model_with_a_damaged_size_is_refused_before_flight(log, tmp_path, capsys):
    ran(log, "--adapt", "full", "--save-model", str(tmp_path / "m"))
    manifest = json.loads((tmp_path / "m" / "model.json").read_text())
    manifest["sizes"]["wall_pull"]["sd"] = "little"
    (tmp_path / "m" / "model.json").write_text(json.dumps(manifest))
    capsys.readouterr()
    assert replay(["run", str(log), "--adapt", "full", "--model", str(tmp_path / "m")]) == 2
    assert "sizes.wall_pull" in capsys.readouterr().err
