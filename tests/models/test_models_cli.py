"""The ``models`` command: as a user meets it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from log_writers import write_data_set

import models.training
from models import cli, dataset
from models.common.frames import AXES
from models.corner_law import ClosedForm
from models.training.train import METHODS


@pytest.fixture
def csv(tmp_path: Path) -> Path:
    data = ClosedForm().data_set()
    keep = (np.random.default_rng(0).random(len(data)) < 0.2) | data.free_air
    write_data_set(tmp_path / "fan.csv", data.take(keep))
    return tmp_path / "fan.csv"


def test_train_writes_a_model_and_the_json_of_the_documents(
    csv: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = csv.parent / "model"
    argv = [
        "train",
        "--data",
        str(csv),
        "--method",
        "polynomial",
        "--out",
        str(out),
        "--seed",
        "3",
        "--json",
        "-",
    ]
    assert cli.main(argv) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["method"] == "polynomial"
    assert report["seed"] == 3
    assert report["rows"] == len(dataset.read(csv))
    assert report["seconds"] > 0
    for part in ("train", "test"):
        assert set(report[part]) == set(AXES)
        assert set(report[part]["Fx"]) == {"r2", "mse"}
    manifest = json.loads((out / "model.json").read_text())
    assert manifest["schema"] == 1
    assert manifest["data"]["sha256"] == dataset.read(csv).sha256
    assert manifest["metrics"]["test"] == report["test"]
    assert models.load(out).wrench(0.2, 0.2, 4000.0).shape == (6,)


def test_query_prints_the_wrench_of_a_model(csv: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = str(csv.parent / "model")
    assert (
        cli.main(["train", "--data", str(csv), "--method", "polynomial", "--out", out, "--quiet"])
        == 0
    )
    assert capsys.readouterr().out == ""
    assert cli.main(["query", out, "--h", "0.2", "--d", "inf", "--rpm", "4000", "--json", "-"]) == 0
    answer = json.loads(capsys.readouterr().out)
    expected = models.load(out).query(0.2, float("inf"), 4000.0)
    assert [answer["wrench"][a] for a in AXES] == expected.wrench.tolist()
    assert answer["d_m"] == "inf"
    assert 0.0 <= answer["trust"] <= 1.0


def test_query_asks_the_shipped_model_by_default(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["query", "--h", "inf", "--d", "inf", "--rpm", "0"]) == 0
    assert "trust" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["query", "--h", "nan", "--d", "1", "--rpm", "4000"], "--h nan"),
        (["query", "--h", "1", "--d", "-1", "--rpm", "4000"], "--d -1"),
        (["query", "--h", "1", "--d", "1", "--rpm", "inf"], "--rpm inf"),
        (["query", "/nowhere", "--h", "1", "--d", "1", "--rpm", "1"], "/nowhere/model.json"),
        (["query", "/a", "--model", "/b", "--h", "1", "--d", "1", "--rpm", "1"], "differ"),
        (["train", "--data", "/none.csv", "--method", "bp", "--out", "/tmp/never"], "/none.csv"),
        (
            ["train", "--data", "closed-form", "--method", "polynomial", "--out", "/dev/null/x"],
            "/dev/null/x",
        ),
        (["compare", "--data", "/none.csv"], "/none.csv"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_two(
    argv: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(argv) == 2
    error = capsys.readouterr().err
    assert error.startswith("models: ")
    assert message in error
    assert error.count("\n") == 1
    assert not Path("/tmp/never").exists()


@pytest.mark.parametrize(
    "argv", [[], ["train"], ["train", "--data", "x", "--out", "y", "--method", "forest"], ["fly"]]
)
def test_bad_arguments_exit_with_two(argv: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        cli.main(argv)
    assert stop.value.code == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert line.startswith("models")
    assert "--help" in line


def test_without_torch_the_message_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.delitem(sys.modules, "models.training.network", raising=False)
    monkeypatch.delattr(models.training, "network", raising=False)
    code = cli.main(
        ["train", "--data", "closed-form", "--method", "bp", "--out", str(tmp_path), "--quiet"]
    )
    assert code == 2
    assert "pip install" in capsys.readouterr().err


def test_an_interrupt_exits_with_130(monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("models.surrogate.store.load", stop)
    assert cli.main(["query", "--h", "1", "--d", "1", "--rpm", "1"]) == 130


def test_json_goes_to_a_file_and_an_unwritable_one_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    argv = ["query", "--h", "1", "--d", "1", "--rpm", "4000", "--json"]
    assert cli.main([*argv, str(tmp_path / "q.json")]) == 0
    assert json.loads((tmp_path / "q.json").read_text())["rpm"] == 4000.0
    assert cli.main([*argv, str(tmp_path / "no" / "q.json")]) == 2
    assert "q.json" in capsys.readouterr().err


def test_help_imports_no_trainer() -> None:
    code = (
        "import sys\nfrom models import cli\n"
        "try:\n cli.main(['--help'])\nexcept SystemExit:\n pass\n"
        "sys.exit(any(m in sys.modules for m in ('numpy', 'torch', 'sklearn', 'scipy', 'matplotlib')))"
    )
    assert (
        subprocess.run([sys.executable, "-c", code], check=False, capture_output=True).returncode
        == 0
    )


def test_the_methods_offered_are_the_methods_there_are() -> None:
    assert cli.METHODS == METHODS
