"""Model directories: what is saved is what is loaded, and whatever does not fit is refused in one line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import models
from models.common.errors import ModelError
from models.effects import get
from models.effects.adopted_effect import AdoptedEffect


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    models.save_model(tmp_path / "model", models.load())
    return tmp_path / "model"


def _edit(directory: Path, **changes: Any) -> None:
    path = directory / "model.json"
    manifest = json.loads(path.read_text())
    for key, value in changes.items():
        if value is None:
            del manifest[key]
        else:
            manifest[key] = value
    path.write_text(json.dumps(manifest))


def test_a_saved_model_answers_the_same(directory: Path) -> None:
    one, other = models.load(), models.load(directory)
    h = np.linspace(0.05, 1.0, 50)
    for a, b in zip(one.query(h, 0.1, 4000.0), other.query(h, 0.1, 4000.0), strict=True):
        np.testing.assert_array_equal(a, b)
    assert dict(other.info) == dict(one.info)


def test_a_shipped_model_is_found_by_name_unless_a_directory_has_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert dict(models.load("default").info) == dict(models.load().info)
    (tmp_path / "default").mkdir()
    with pytest.raises(ModelError, match="cannot be read"):
        models.load("default")


def test_adopted_effects_survive(directory: Path) -> None:
    effects = (
        AdoptedEffect("ceiling", {"gain": 1.1, "scale": 1.0}),
        AdoptedEffect("payload", {"mass": 0.2}),
    )
    models.save_model(directory, models.load(directory).with_effects(effects))
    back = models.load(directory)
    assert back.effects == effects
    np.testing.assert_array_equal(
        back.wrench(0.2, 0.1, 4000.0), models.load().wrench(0.2, 0.1, 4000.0)
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"schema": 2}, "schema is 2"),
        ({"schema": None}, "schema is None"),
        ({"units": {"h": "cm"}}, "units or frame"),
        ({"frame": "body FRD"}, "units or frame"),
        ({"domain": None}, "'domain' is missing"),
        ({"free_air": {"lift_n": 1.0}}, "is damaged"),
        ({"regressor": "forest"}, "'forest' is missing or not known"),
        ({"effects": [{"name": "ceiling"}]}, "'parameters' is missing"),
        ({"effects": [{"name": "ceiling", "parameters": {"gain": "much"}}]}, "is damaged"),
        ({"effects": [{"name": "phlogiston", "parameters": {}}]}, "not in the catalogue"),
        (
            {"effects": [{"name": "ceiling", "parameters": {"gain": 1.0}}]},
            "'ceiling' lacks parameter 'scale'",
        ),
        (
            {"effects": [{"name": "cg_offset", "parameters": {"x": 0, "y": 0, "z": 0}}]},
            "does not know parameter 'z'",
        ),
        (
            {"effects": [{"name": "cg_offset", "parameters": {"x": 0, "y": float("nan")}}]},
            "parameter 'y' is nan",
        ),
        ({"weights": {"file": "weights.npz", "sha256": "0" * 64}}, "does not have the hash"),
    ],
)
def test_a_manifest_that_does_not_fit_is_refused(
    directory: Path, changes: dict[str, Any], message: str
) -> None:
    _edit(directory, **changes)
    with pytest.raises(ModelError, match=message) as error:
        models.load(directory)
    assert str(directory) in str(error.value)
    assert "\n" not in str(error.value)


def test_a_map_of_ground_and_wall_without_the_radius_that_it_is_in_is_refused(
    directory: Path,
) -> None:
    law = get("surface_law")
    size = dict.fromkeys([c.name for c in law.coefficients], 0.02) | dict.fromkeys(
        [s.name for s in law.shapes], 1.0
    )
    models.save_model(directory, models.load().with_effects((AdoptedEffect(law.name, size),)))
    assert np.isfinite(models.load(directory).wrench(0.2, 0.1, 4000.0)).all()
    _edit(directory, fan=None)
    with pytest.raises(ModelError, match="surface_law needs the fan's radius"):
        models.load(directory)


@pytest.mark.parametrize("content", ["", "{", "[]", "3"])
def test_a_manifest_that_is_no_object_is_refused(directory: Path, content: str) -> None:
    (directory / "model.json").write_text(content)
    with pytest.raises(ModelError, match=r"model\.json"):
        models.load(directory)


def test_truncated_weights_are_refused(directory: Path) -> None:
    path = directory / "weights.npz"
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(ModelError, match=r"weights\.npz: does not have the hash"):
        models.load(directory)


def test_weights_that_are_no_archive_are_refused_even_with_their_hash(directory: Path) -> None:
    import hashlib

    (directory / "weights.npz").write_bytes(b"PK\x03\x04 not an archive")
    digest = hashlib.sha256(b"PK\x03\x04 not an archive").hexdigest()
    _edit(directory, weights={"file": "weights.npz", "sha256": digest})
    with pytest.raises(ModelError, match=r"weights\.npz: is damaged"):
        models.load(directory)


@pytest.mark.parametrize("name", ["model.json", "weights.npz"])
def test_a_missing_file_is_refused_by_name(directory: Path, name: str) -> None:
    (directory / name).unlink()
    with pytest.raises(ModelError, match=f"{name}: cannot be read"):
        models.load(directory)


def test_a_directory_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="cannot be read"):
        models.load(tmp_path / "nothing")
    (tmp_path / "file").write_text("x")
    with pytest.raises(ModelError, match="cannot be written"):
        models.save_model(tmp_path / "file" / "model", models.load())
