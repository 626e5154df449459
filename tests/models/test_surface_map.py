"""The map of surfaces: one place and many alike, a prior that is zero in free air, what it does to a model."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import models
from companion.vehicles import default_vehicle
from models.air_state import blank_state
from models.common.frames import corner_to_body
from models.effects import AdoptedEffect, Context, get
from models.surface_map import CELLS, MEASURED, PARTS, cell_name, prior_factor
from models.surrogate.store import load, save_model

places = st.floats(0.05, 30.0) | st.just(math.inf)


@settings(deadline=None)
@given(places, places)
def test_cells_of_a_place_are_the_weights_of_an_array(height: float, gap: float) -> None:
    one, many = np.zeros(MEASURED.size), MEASURED.weights(np.array([height]), np.array([gap]))[0]
    for k, weight in MEASURED.cells(height, gap):
        one[k] += weight
    assert one == pytest.approx(many, abs=1e-12)
    assert many.sum() == pytest.approx(1.0)


def test_the_prior_is_zero_in_free_air_and_its_factor_gives_it_back() -> None:
    factor = prior_factor(MEASURED, 0.1, True)
    covariance = MEASURED.covariance(0.1, of_wall=True)
    assert factor @ factor.T == pytest.approx(covariance, abs=1e-9)
    assert covariance[-1, -1] == 0.0
    assert covariance[len(MEASURED.gaps) - 1].max() == 0.0  # no wall
    assert covariance[0, 0] == pytest.approx(0.01)


def _law(lift: float = 0.0, gain: float = 0.0) -> AdoptedEffect:
    """One value everywhere beside a surface."""
    cells = {cell_name(part, k): lift if part == "lift" else 0.0 for part, k in CELLS}
    gains = {f"{part}_of_model": gain for part in PARTS}
    return AdoptedEffect("surface_law", cells | gains | {f"{part}_spread": 1.0 for part in PARTS})


def test_an_amended_model_answers_with_the_map_and_is_the_same_after_saving(tmp_path) -> None:
    bare = models.load()
    amended = bare.with_effects((_law(lift=0.03, gain=-1.0),), bare.info)
    h, d = np.array([0.2, 0.3, np.inf]), np.array([0.1, np.inf, np.inf])
    free = bare.free_air(4000.0)
    assert amended.wrench(h, d, 4000.0)[:2] == pytest.approx(
        np.stack([free + 0.03 * free[2] * np.eye(6)[2]] * 2), abs=1e-9
    )
    assert amended.wrench(np.inf, np.inf, 4000.0) == pytest.approx(free)
    save_model(tmp_path, amended)
    assert load(tmp_path).wrench(h, d, 4000.0) == pytest.approx(amended.wrench(h, d, 4000.0))


def test_what_flights_saw_is_trusted_whatever_the_model_said_of_itself() -> None:
    bare = models.load("corner_cfd")
    seen = _law()
    seen = AdoptedEffect(
        seen.name, dict(seen.parameters) | {cell_name("seen", k): 1.0 for k in range(MEASURED.size)}
    )
    amended = bare.with_effects((seen,), bare.info)
    assert bare.trust(0.2, 0.02, 4000.0) < 0.9
    assert amended.trust(0.2, 0.02, 4000.0) == 1.0


def test_nearer_to_the_wall_than_flights_were_the_map_does_not_fall() -> None:
    vehicle = default_vehicle()
    radius_m = vehicle.rotor_radius_m
    flown = {cell_name("pull", k): 0.0 for k in range(MEASURED.size)}
    place = MEASURED.heights.index(2.0) * len(MEASURED.gaps) + MEASURED.gaps.index(1.0)
    flown[cell_name("lift", place)] = 0.03
    seen = {cell_name("seen", k): 0.0 for k in range(MEASURED.size)}
    column = MEASURED.gaps.index(1.0)
    high = MEASURED.heights.index(2.0)
    low = MEASURED.heights.index(1.25)
    for row in (high, low):
        flown[cell_name("pull", row * len(MEASURED.gaps) + column)] = 0.02
    seen[cell_name("seen", high * len(MEASURED.gaps) + column)] = 1.0
    law = AdoptedEffect("surface_law", dict(_law().parameters) | flown | seen)
    amended = models.load().with_effects((law,), models.load().info)
    bare = models.load()
    h = np.array([2.0, 2.0, 1.25, 2.0]) * radius_m
    d = np.array([1.0, 0.1, 0.1, 1.6]) * radius_m
    lift = bare.free_air(4000.0)[2]
    added = (amended.wrench(h, d, 4000.0) - bare.wrench(h, d, 4000.0)) / lift
    assert added[:, 0] == pytest.approx([0.02, 0.02, 0.02, 0.0])
    assert added[:, 2] == pytest.approx([0.03, 0.0, 0.0, 0.0])  # lift fades as before


def test_the_columns_that_diagnosis_fits_are_what_the_amended_model_answers() -> None:
    vehicle, bare = default_vehicle(), models.load()
    rng = np.random.default_rng(3)
    state = blank_state((20,), 2, 4)
    state.rpm[...] = 4000.0
    state.h_m[...], state.d_m[...] = (
        rng.uniform(0.15, 1.0, (20, 1)),
        rng.uniform(0.04, 1.0, (20, 1)),
    )
    bearing = rng.uniform(-3.0, 3.0, 20)
    state = replace(state, wall_bearing_rad=bearing, time_s=np.arange(20.0))
    effect = get("surface_law")
    values = rng.normal(0.0, 0.05, len(effect.coefficients))
    parameters = {c.name: float(v) for c, v in zip(effect.coefficients, values, strict=True)}
    amended = bare.with_effects((AdoptedEffect("surface_law", parameters),), bare.info)
    fitted = effect.wrench(
        Context(state=state, vehicle=vehicle, model=bare),
        parameters | {s.name: 1.0 for s in effect.shapes},
    )
    fans = [amended.wrench(state.h_m[:, i], state.d_m[:, i], 4000.0) for i in range(2)]
    alone = [bare.wrench(state.h_m[:, i], state.d_m[:, i], 4000.0) for i in range(2)]
    force = sum(corner_to_body(a - b, bearing)[:, :3] for a, b in zip(fans, alone, strict=True))
    assert fitted[:, :3] == pytest.approx(force, abs=1e-9)


def _said(height_m: float, gap_m: float, lift: float) -> str:
    """The map's sentence of a flight at one place."""
    vehicle = default_vehicle()
    state = blank_state((10,), len(vehicle.fans), len(vehicle.rotors))
    state = replace(
        state,
        h_m=np.full_like(state.h_m, height_m),
        d_m=np.full_like(state.d_m, gap_m),
        rpm=np.full_like(state.rpm, 4000.0),
    )
    ctx = Context(state=state, vehicle=vehicle, model=models.load())
    words = get("surface_law").shown.in_words
    assert words is not None
    return words(ctx, _law(lift=lift).parameters)


def test_the_words_of_a_map_tell_only_what_differs_from_the_model() -> None:
    assert "a fan lifts" in _said(0.2, math.inf, lift=0.03)
    assert _said(0.2, 0.2, lift=0.0002).endswith("within 0.1 % of the thrust of the model's")
    assert "wall" not in _said(0.2, 0.3, lift=0.03)
