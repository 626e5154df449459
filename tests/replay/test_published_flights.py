"""Flights that others published: taken out of a clone as their table says, or written from their motion."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from measured.known import TABLE
from scipy.spatial.transform import Rotation
from sources import __main__ as sources
from sources.motion import Motion
from sources.vehicle_file import vehicle_toml

from models.vehicle import parse_vehicle
from replay import load

ORIGINS = {
    f"{path.stem}: {name}": keys
    for path in TABLE.parent.glob("*.toml")
    for name, keys in tomllib.loads(path.read_text()).get("origin", {}).get("vehicle", {}).items()
}


@pytest.mark.parametrize("keys", ORIGINS.values(), ids=ORIGINS)
def test_the_vehicle_of_a_table_is_a_vehicle_file(keys):
    text = vehicle_toml(keys)
    assert tomllib.loads(text) == keys
    assert parse_vehicle(text, "a.toml").mass_kg == keys["mass_kg"]


@pytest.mark.parametrize("name", sources.CONVERTERS)
def test_the_vehicles_of_a_converter_are_vehicle_files(name):
    vehicles = import_module(f"sources.{name}").VEHICLES
    for keys in vehicles.values():
        text = vehicle_toml(keys)
        assert parse_vehicle(text, "a.toml").mass_kg == keys["mass_kg"]


def test_every_converter_is_one_that_the_command_names():
    folder = Path(sources.__file__).parent
    found = {path.stem for path in folder.glob("*.py") if "\nVEHICLES = " in path.read_text()}
    assert found == set(sources.CONVERTERS)


def test_a_log_is_copied_from_the_commit_of_its_table(tmp_path, monkeypatch, capsys):
    clone = tmp_path / "clone"
    clone.mkdir()

    def git(*arguments: str) -> str:
        who = ("-c", "user.name=a", "-c", "user.email=a@example.org")
        done = subprocess.run(
            ["git", *who, "-C", str(clone), *arguments], check=True, capture_output=True, text=True
        )
        return done.stdout.strip()

    git("init", "-q")
    (clone / "a flight.bin").write_bytes(b"first")
    git("add", "-A")
    git("commit", "-q", "-m", "first")
    commit = git("rev-parse", "HEAD")
    (clone / "a flight.bin").write_bytes(b"second")
    git("commit", "-q", "-a", "-m", "second")
    table = tmp_path / "table.toml"
    table.write_text(
        f'[origin]\ncommit = "{commit}"\n[origin.logs]\n"a.BIN" = "a flight.bin"\n'
        '[origin.vehicle.a]\nname = "a"\nmass_kg = 1.5\n'
    )
    monkeypatch.setattr(sys, "argv", ["sources", str(table), str(clone), str(tmp_path / "out")])
    assert sources.main() == 0
    assert (tmp_path / "out" / "a.BIN").read_bytes() == b"first"
    assert tomllib.loads((tmp_path / "out" / "a.toml").read_text()) == {"name": "a", "mass_kg": 1.5}
    table.write_text("[[source]]\n")
    with pytest.raises(SystemExit, match="2"):
        sources.main()
    assert "origin" in capsys.readouterr().err
    monkeypatch.setattr(sys, "argv", ["sources", "nobody", str(clone), str(tmp_path / "out")])
    with pytest.raises(SystemExit, match="2"):
        sources.main()
    assert "nobody" in capsys.readouterr().err


def test_motion_is_read_back_as_it_was_written(tmp_path):
    t = np.arange(300) / 100.0
    motion = Motion(
        time_s=t,
        position=np.stack([t, 0 * t, 0 * t - 2.0], axis=1),
        velocity=np.tile([1.0, 0.0, 0.0], (300, 1)),
        attitude=Rotation.identity(300),
        rates=np.tile([0.0, 0.0, 0.1], (300, 1)),
        force=np.tile([0.0, 0.0, -9.8], (300, 1)),
        outputs_us=np.full((300, 6), 1500.4),
    )
    (tmp_path / "a.tlog").write_bytes(b"".join(motion.records()))
    (log,) = load(tmp_path / "a.tlog")
    assert log.duration_s == pytest.approx(2.99, abs=0.01)
    assert log.velocity.values[:, 0] == pytest.approx(np.ones(300))
    assert log.imus[0].specific_force.values[:, 2] == pytest.approx(np.full(300, -9.8))
    assert log.servo.values[0, :6] == pytest.approx(np.full(6, 1500.0))
    assert sum(i.end_s - i.start_s for i in log.armed) > 2.0
