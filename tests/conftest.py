"""Shared fixtures: where the reference data lie, a transparent fan model, and samples of a hovering vehicle."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

# Continuous integration replays the same examples every time; at a desk hypothesis goes on searching.
settings.register_profile("ci", derandomize=True)
if os.environ.get("CI"):
    settings.load_profile("ci")

SHARED = Path(os.environ.get("CORNER_SHARED", Path(__file__).resolve().parents[2] / "shared"))


@pytest.fixture(scope="session", autouse=True)
def nothing_left_behind() -> Iterator[None]:
    """Tests write into their own folders: where pytest was started nothing new may lie in the end."""
    before = {path.name for path in Path.cwd().iterdir()}
    yield
    new = {path.name for path in Path.cwd().iterdir()} - before
    assert not {name for name in new if not name.startswith(".")}


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Recorded flights that are not part of the project."""
    if not (SHARED / "data").is_dir():
        pytest.skip(
            f"no recorded flights at {SHARED / 'data'} (set CORNER_SHARED to the folder that holds them)"
        )
    return SHARED / "data"
