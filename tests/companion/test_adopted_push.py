"""What an adopted effect may command: never the vehicle's own damping, no ceiling faster than the delay allows."""

from __future__ import annotations

from dataclasses import replace
from unittest import mock

import numpy as np
import pytest

import models
from companion.config import Base, PipelineConfig
from companion.control.plant import FULL
from companion.disturbance import stable_gain
from companion.disturbance.adopted_effects import adopted_now, adopted_pull_change_n
from companion.pipeline import damping_1_s, initial_state
from companion.vehicles import default_vehicle
from models.air_state import blank_state
from models.effects import adopted
from models.effects.adopted_effect import AdoptedEffect

VEHICLE = default_vehicle()
DAMPING_1_S = FULL.velocity_1_s
MODEL = models.load()


def state(gap_m: float = np.inf, velocity=(0.0, 0.0, 0.0), rates=(0.0, 0.0, 0.0)):
    blank = blank_state((), len(VEHICLE.fans), len(VEHICLE.rotors))
    fans = np.full(len(VEHICLE.fans), np.inf)
    return replace(
        blank,
        velocity_ned=np.array(velocity),
        rates=np.array(rates),
        h_m=fans,
        d_m=fans,
        ceiling_m=np.full(len(VEHICLE.fans), gap_m),
        rpm=np.full(len(VEHICLE.rotors), 4000.0),
    )


def push(effects, *args, **kwargs):
    model = MODEL.with_effects(effects)
    return adopted_now(model, state(*args, **kwargs), VEHICLE, DAMPING_1_S).wrench


def test_the_drag_on_its_own_climb_is_left_to_damp_the_loop():
    inflow = (adopted("vertical_inflow", {"slope": 4.8, "turning": 1.4, "level": 0.2}),)
    climbing = push(inflow, velocity=(0.3, 0.0, -1.0), rates=(0.2, 0.1, 0.0))
    assert climbing == pytest.approx(np.zeros(6), abs=1e-12)


def test_a_steady_wind_is_compensated_whatever_the_vehicle_does():
    blows = {
        "north": 3.0,
        "east": 0.0,
        "own_motion": 1.0,
        "turning": 1.0,
        "sinking": 0.4,
        "above_radii": 0.0,
    }
    wind = (adopted("wind", blows),)
    still, moving = push(wind), push(wind, velocity=(2.0, 1.0, 0.0), rates=(0.0, 0.0, 1.0))
    assert still[0] > 0.1
    assert moving == pytest.approx(still)


def test_a_ceiling_is_followed_in_full_far_off_and_in_part_close_by_without_a_step():
    ceiling = (AdoptedEffect("ceiling", {"gain": 1.0, "scale": 1.0}),)
    radius = VEHICLE.rotor_radius_m
    gaps = np.linspace(0.3, 3.0, 271) * radius
    ours = np.array([push(ceiling, gap)[2] for gap in gaps])
    with mock.patch.object(stable_gain, "RESIDUAL_DELAY_S", 1e-6):
        whole = np.array([push(ceiling, gap)[2] for gap in gaps])
    share = ours / whole
    assert share[-1] == pytest.approx(1.0)
    assert share[0] < 0.5
    assert np.all(np.diff(share) >= -1e-9)
    # No step anywhere: from one 1.65 mm to the next the command changes by less than 3 % of the lift it stands for.
    assert np.abs(np.diff(ours)).max() < 0.03 * np.abs(whole).max()


def test_the_feed_forward_near_a_surface_is_bounded_by_the_damping_that_the_hold_flies_with():
    ceiling = (AdoptedEffect("ceiling", {"gain": 1.0, "scale": 1.0}),)
    model, near = MODEL.with_effects(ceiling), 0.4 * VEHICLE.rotor_radius_m
    soft = adopted_now(model, state(near), VEHICLE, 0.5 * DAMPING_1_S).wrench[2]
    firm = adopted_now(model, state(near), VEHICLE, DAMPING_1_S).wrench[2]
    assert soft == pytest.approx(0.5 * firm)
    hold = PipelineConfig(vehicle=VEHICLE, model=MODEL)
    assert damping_1_s(initial_state(hold), hold) == FULL.velocity_1_s
    assert damping_1_s(initial_state(hold), replace(hold, base=Base.UPSTREAM)) < FULL.velocity_1_s


@pytest.mark.parametrize("gap_radii", [0.3, 0.8, 2.0])
def test_the_pull_of_an_adopted_wall_counts_towards_the_bound_of_the_feed_forward(gap_radii: float):
    """Pull p T exp(-d/L): less a step further off by p T (1 - exp(-step/L)) exp(-d/L)."""
    length, pull, step = 0.7, 0.2, 0.02
    model = MODEL.with_effects(
        (adopted("wall_effect", {"pull": pull, "tilt": 0.0, "length_radii": length}),)
    )
    gap = gap_radii * VEHICLE.rotor_radius_m
    beside = replace(state(), d_m=np.full(len(VEHICLE.fans), gap), wall_bearing_rad=np.array(0.8))
    thrust = len(VEHICLE.fans) * float(MODEL.wrench(np.inf, np.inf, 4000.0)[2])
    scale = length * VEHICLE.rotor_radius_m
    expected = pull * thrust * np.exp(-gap / scale) * (1.0 - np.exp(-step / scale))
    assert adopted_pull_change_n(model, beside, VEHICLE, step) == pytest.approx(expected, rel=0.02)
    assert adopted_pull_change_n(model, state(), VEHICLE, step) == 0.0
    assert adopted_now(model, beside, VEHICLE, DAMPING_1_S).pull_change_n == pytest.approx(
        expected, rel=0.02
    )
