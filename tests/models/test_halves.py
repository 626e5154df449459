"""A set cut in two like a chessboard: no place in both halves but free air, all edges in each."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import models
from models.cli import main
from models.dataset import half, read

DATA = Path(models.__file__).parent / "data" / "corner_cfd.csv"
SET = read(DATA)
EVEN, ODD = half(SET, "even"), half(SET, "odd")


def places(data) -> set[tuple[float, float]]:
    return set(zip(data.h.tolist(), data.d.tolist(), strict=True))


def test_every_place_but_free_air_is_in_one_half_with_all_its_speeds():
    assert places(EVEN) & places(ODD) == {(np.inf, np.inf)}
    assert places(EVEN) | places(ODD) == places(SET)
    assert len(EVEN) + len(ODD) == len(SET) + SET.free_air.sum()
    assert abs(len(EVEN) - len(ODD)) <= 3


@pytest.mark.parametrize("part", [EVEN, ODD], ids=["even", "odd"])
def test_both_halves_cover_the_region(part):
    for axis in ("h", "d"):
        assert set(np.unique(getattr(part, axis))) == set(np.unique(getattr(SET, axis)))
    assert (np.isinf(part.h) & np.isfinite(part.d)).any()
    assert (np.isfinite(part.h) & np.isinf(part.d)).any()


def test_a_model_of_one_half_says_so(tmp_path):
    command = [
        "train",
        "--data",
        str(DATA),
        "--places",
        "odd",
        "--method",
        "polynomial",
        "--out",
        str(tmp_path),
    ]
    assert main([*command, "--quiet"]) == 0
    info = json.loads((tmp_path / "model.json").read_text())
    assert info["data"]["rows"] == len(ODD)
    assert any("odd places only" in note for note in info["notes"])


def test_the_shipped_half_is_of_the_shipped_set():
    info = models.load("corner_cfd_half").info
    assert info["data"] == {"file": DATA.name, "sha256": SET.sha256, "rows": len(ODD)}
    assert any("odd places only" in note for note in info["notes"])
