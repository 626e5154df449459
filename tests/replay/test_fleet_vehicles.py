"""Vehicle files of a folder by identity, and drafts that the logs of one vehicle share."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from log_writers import frame, quad_flight, write_tlog

from companion.mavlink.dialect import mavlink
from companion.vehicles import QUAD
from models.common.errors import ConfigError
from models.vehicle import load_vehicle
from replay.cli import main
from replay.fleet import contents as contents_module
from replay.fleet.contents import contents
from replay.fleet.store import NAME, Store
from replay.fleet.vehicles import fitting, named, shared_name
from replay.identity import VehicleIdentity

LONG_AGO_NS = 1_700_000_000_000_000_000


def who(vehicle: str = "", board: str = "", frame: str = "", parameters: str = "") -> object:
    return VehicleIdentity(
        vehicle=vehicle, board=board, firmware="", frame=frame, parameters=parameters
    )


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    with ExitStack() as stack:
        yield stack.enter_context(Store.open(tmp_path / NAME, make=True))


def test_the_most_special_file_fits() -> None:
    files = {name: Path(f"{name}.toml") for name in ("abc", "board-B", "B", "quad-x")}
    assert fitting(files, who("board-B", "B", "quad-x", "abc")) == files["abc"]
    assert fitting(files, who("board-B", "B", "quad-x", "def")) == files["board-B"]
    assert fitting(files, who("board-C", "C", "quad-x", "def")) == files["quad-x"]
    assert fitting(files, who("board-C", "C", "hexa-x", "")) is None
    assert fitting({"": Path("none.toml")}, who()) is None


def test_a_draft_is_shared_where_something_tells_the_vehicle_from_others() -> None:
    assert shared_name(who("board-B", "B")) == "board-B"
    assert shared_name(who("sensors-1")) == "sensors-1"
    assert shared_name(who("quad-x-1", parameters="abc")) == "parameters-abc"
    assert shared_name(who("quad-x-1")) is None


def test_wrong_vehicle_files_are_said_before_the_work(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="is no folder"):
        named(tmp_path / "nowhere")
    with pytest.raises(ConfigError, match="holds no vehicle file"):
        named(tmp_path)
    (tmp_path / "B.toml").write_text("mass_kg = -3\n")
    with pytest.raises(ConfigError, match=r"B\.toml"):
        named(tmp_path)


def test_a_file_is_read_once_until_it_changes(
    tmp_path: Path, store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = []

    def counted(log: Path) -> str:
        read.append(log.name)
        return log.read_text()

    monkeypatch.setattr(contents_module, "content_hash", counted)
    paths = [tmp_path / name for name in ("a.tlog", "b.tlog", "copy.tlog")]
    for path, text in zip(paths, ("a", "b", "a"), strict=True):
        path.write_text(text)
        os.utime(path, ns=(LONG_AGO_NS, LONG_AGO_NS))
    first = contents(paths, store)
    assert list(first.logs) == ["a", "b"]
    assert first.copies == ((paths[2], paths[0]),)
    assert len(read) == 3
    assert contents(paths, store) == first
    assert len(read) == 3
    paths[1].write_text("c")  # as large as before, and just written
    assert list(contents(paths, store).logs) == ["a", "c"]
    assert list(contents(paths, store).logs) == ["a", "c"]
    assert read[3:] == ["b.tlog", "b.tlog"], "what may still change is not remembered"


def test_a_file_that_is_gone_is_one_line(
    tmp_path: Path, store: Store, capsys: pytest.CaptureFixture[str]
) -> None:
    assert contents([tmp_path / "gone.tlog"], store).logs == {}
    assert "gone.tlog: No such file" in capsys.readouterr().err


def write(path: Path, seed: int) -> None:
    """A flight that says its board at its start."""
    board = mavlink.MAVLink_statustext_message(6, b"CubeBlack 00340023 30355112 37313838")
    messages = quad_flight(30.0, seed=seed)
    write_tlog(path, [*messages[:20], (messages[20][0], frame(board)), *messages[20:]])


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    folder = tmp_path / "logs"
    folder.mkdir()
    for seed in (1, 2):
        write(folder / f"{seed}.tlog", seed)
    return folder


def test_vehicles_is_of_a_folder(logs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["diagnose", str(logs / "1.tlog"), "--vehicles", str(logs)]) == 2
    assert "--vehicles: is of a folder" in capsys.readouterr().err
    both = ["--vehicle", str(QUAD), "--vehicles", str(logs)]
    assert main(["diagnose", str(logs), *both]) == 2
    assert "leave one of them out" in capsys.readouterr().err


@pytest.mark.slow
def test_one_draft_of_all_logs_of_a_vehicle_until_a_file_is_given(
    logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    asked = ["diagnose", str(logs), "--model", "none", "--out", str(out), "--workers", "2"]
    assert main([*asked, "--mass", "1.5", "--json", "-"]) == 0
    told = json.loads(capsys.readouterr().out)["logs"]
    (draft,) = (out / "vehicles").glob("*.toml")
    assert draft.stem == "board-003400233035511237313838"
    assert load_vehicle(draft).mass_kg == pytest.approx(1.5)
    frames = [answer["vehicle"]["known"][0] for answer in told]
    assert frames[0]["key"] == "frame"
    assert frames[0] == frames[1]
    # A second run keeps the draft, so that everything is known.
    stamp = draft.stat().st_mtime_ns
    assert main([*asked, "--mass", "1.5"]) == 0
    assert "2 of them known from before" in capsys.readouterr().out
    # Four logs are twice as many: another draft, and all are answered again.
    for seed in (3, 4):
        write(logs / f"{seed}.tlog", seed)
    assert main([*asked, "--mass", "1.5"]) == 0
    assert "known from before" not in capsys.readouterr().out
    assert draft.stat().st_mtime_ns > stamp
    # A given file takes the place of the draft; one of another vehicle is said.
    files = tmp_path / "files"
    files.mkdir()
    key = draft.stem.removeprefix("board-")
    shutil.copy(QUAD, files / f"{key}.toml")
    shutil.copy(QUAD, files / "board-of-another.toml")
    assert main([*asked, "--vehicles", str(files), "--json", "-"]) == 0
    said = capsys.readouterr()
    assert "board-of-another.toml: fits no log" in said.err
    assert f"{key}.toml: fits no log" not in said.err
