"""The closed form: what the paper says of ground, wall and corner, and what symmetry demands."""

from __future__ import annotations

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pytest

from models.corner_law import ClosedForm

FAN = ClosedForm()
R = FAN.radius_m


def test_two_fans_hover_the_paper_vehicle() -> None:
    w = FAN.wrench(np.inf, np.inf, 4000.0)
    assert 2 * w[2] == pytest.approx(4.6 * 9.80665)
    assert np.all(w[[0, 1, 3, 4, 5]] == 0.0)


def test_nothing_is_left_beyond_the_papers_ranges() -> None:
    free = FAN.wrench(np.inf, np.inf, 4000.0)
    np.testing.assert_array_equal(FAN.wrench(4.0 * R, np.inf, 4000.0), free)
    np.testing.assert_array_equal(FAN.wrench(np.inf, 3.8 * R, 4000.0), free)


def test_lift_over_ground_falls_with_height_and_is_not_monotonic_in_the_corner() -> None:
    h = np.linspace(0.5, 4.0, 300) * R
    assert np.all(np.diff(FAN.wrench(h, np.inf, 4000.0)[:, 2]) <= 1e-12)
    corner = np.diff(FAN.wrench(h, R, 4000.0)[:, 2])
    assert corner.min() < -1e-4
    assert corner.max() > 1e-4


def test_the_fan_tilts_towards_the_wall_and_ever_less_away_from_it() -> None:
    moment = FAN.wrench(np.inf, np.linspace(0.2, 3.8, 200) * R, 4000.0)[:, 4]
    assert moment[0] > 0.0
    assert np.all(np.diff(moment) <= 1e-12)


def test_at_rest_nothing_acts() -> None:
    assert np.all(FAN.wrench(0.1, 0.1, 0.0) == 0.0)


def test_it_is_the_law_of_the_reference(shared_data: Path) -> None:
    path = shared_data.parent / "corner_reference.py"
    if not path.exists():
        pytest.skip(f"no reference at {path}")
    spec = spec_from_file_location("corner_reference", path)
    assert spec is not None
    assert spec.loader is not None
    reference = module_from_spec(spec)
    spec.loader.exec_module(reference)
    data = FAN.data_set()
    np.testing.assert_allclose(
        data.wrench, reference.duct_wrench(data.h, data.d, data.rpm)[0], rtol=1e-12, atol=1e-13
    )
