"""The pull's stiffness over the distance, the gains and the least distance that follow, and where targets end."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from audited import config
from flying import bench, with_plant

import models
from companion.config import PipelineConfig
from companion.control.plant import AttitudeLoop, HoldTuning, Source, Timing, tune
from companion.control.position_hold import Hold
from companion.control.position_target import Target, start_reference, stay
from companion.control.wall_distance import WallPlane, kept_off, sent_to_m
from companion.control.wall_stability import DECAY_1_S, beside_wall, roots_right_of
from companion.disturbance.wall_law import WallLaw, hovering, wall_law
from companion.telemetry.status import StatusReporter
from companion.vehicles import QUAD
from models.common.frames import GRAVITY
from models.effects.effect import AdoptedEffect
from models.surrogate.empty import empty_model
from models.vehicle import load_vehicle

SLOW = AttitudeLoop(0.16, 0.05)
QUICK = AttitudeLoop(0.075, 0.09)
SLUGGISH = AttitudeLoop(0.24, 0.12)
LATE = Timing(position_period_s=0.10, position_late_s=0.15)
TEN_HZ = Timing(position_period_s=0.10, position_late_s=0.02)
STEEP = WallLaw((0.1, 0.2, 0.3, 0.4), (2.0, 1.4, 0.8, 0.4))


def of_model(name: str) -> PipelineConfig:
    return replace(config("tandem"), model=models.load(name))


@pytest.mark.parametrize("name", ["default", "corner_cfd"])
def test_the_stiffness_sums_up_to_the_pull_that_the_model_has(name):
    own = of_model(name)
    lips = hovering(own, math.inf)
    law = wall_law(own, lips)
    d = np.array(law.distances_m)
    places = np.repeat(d[:, None], len(lips.rpm), axis=1)
    pull = own.model.query(math.inf, places, np.array(lips.rpm)).wrench[..., 0].sum(axis=1)
    gained = np.trapezoid(law.stiffness_1_s2, d)
    assert gained == pytest.approx(1.25 * (pull[0] - pull[-1]) / own.vehicle.mass_kg, rel=0.25)


def test_the_speed_of_a_hover_carries_the_weight():
    own = of_model("default")
    lips = hovering(own, math.inf)
    lift = -own.model.free_air(np.array(lips.rpm))[:, 2].sum()
    assert abs(lift) == pytest.approx(own.vehicle.mass_kg * GRAVITY, rel=0.02)


def test_without_a_model_a_pull_as_around_the_papers_robot_is_assumed():
    tandem = config("tandem").vehicle
    own = replace(config("tandem"), model=empty_model(tandem))
    law = wall_law(own, hovering(own, math.inf))
    assert law.steepest(0.30) == pytest.approx(0.8, abs=0.15)
    assert all(near > far for near, far in pairwise(law.stiffness_1_s2))


def test_an_adopted_wall_effect_counts():
    tandem = config("tandem").vehicle
    effect = AdoptedEffect(
        "wall_effect", {"pull": 0.3, "tilt": 0.0, "lift": 0.0, "length_radii": 1.0}
    )
    bare = replace(config("tandem"), model=empty_model(tandem))
    amended = replace(bare, model=bare.model.with_effects([effect]))
    lips = hovering(amended, math.inf)
    law = wall_law(amended, lips)
    assumed = wall_law(bare, lips)
    assert law.steepest(0.15) > 2.0 * assumed.steepest(0.15)


def test_the_least_distance_is_where_the_pull_is_held_from_there_on():
    assert STEEP.least_m(3.0) == 0.0
    assert STEEP.least_m(1.0) == 0.3
    assert STEEP.least_m(0.1) == 0.4
    assert STEEP.steepest(0.25) == 1.4
    assert STEEP.steepest(math.inf) == 0.4


@pytest.mark.parametrize(("loop", "timing"), [(QUICK, Timing()), (SLOW, TEN_HZ)])
def test_gains_that_hold_the_pull_are_flown_at_any_distance(loop, timing):
    tuned = tune(loop, timing)
    assert beside_wall(tuned, STEEP) == tuned


@pytest.mark.parametrize(("loop", "timing"), [(SLUGGISH, TEN_HZ), (QUICK, LATE)])
def test_the_distance_grows_until_the_pull_is_held(loop, timing):
    tuned = tune(loop, timing)
    steep = WallLaw(STEEP.distances_m, tuple([1.5 * k for k in STEEP.stiffness_1_s2]))
    beside = beside_wall(tuned, steep)
    assert beside.gains == tuned.gains
    assert 0.1 < beside.least_wall_m < 0.4
    near = steep.steepest(0.0)
    assert roots_right_of(-DECAY_1_S, tuned.gains, tuned.loop, tuned.age_s, near) > 0
    there = steep.steepest(beside.least_wall_m)
    assert roots_right_of(-DECAY_1_S, tuned.gains, tuned.loop, tuned.age_s, there) == 0


def test_gains_softened_after_a_swing_hold_less_and_the_distance_grows():
    law = WallLaw((0.1, 0.2), (3.2, 0.5))
    assert beside_wall(tune(QUICK, TEN_HZ), law).least_wall_m == 0.0
    assert beside_wall(tune(QUICK, TEN_HZ, 0.6), law).least_wall_m == 0.2


def held(target: Target) -> Hold:
    reference = start_reference((0.0, 0.0, -1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    return Hold(
        target=target,
        reference=reference,
        integral=(0.0, 0.0, 0.0),
        t_s=0.0,
        tilt_mean=(0.0, 0.0),
        climb_mean=0.0,
        climb_command=0.0,
    )


def test_targets_end_at_the_least_distance_and_move_along_the_wall_as_asked():
    wall = WallPlane(1.0, 0.0, 1.0, 0.0)
    near = held(Target(position=(0.9, 2.0, -1.5), velocity=(0.3, 0.0, 0.0), yaw=0.0, set_s=0.0))
    assert sent_to_m(near, wall) == pytest.approx(0.1)
    kept = kept_off(near, wall, 0.3)
    assert kept.target.position == pytest.approx((0.7, 2.0, -1.5))
    assert kept.target.velocity == (0.0, 0.0, 0.0)
    assert kept_off(kept, wall, 0.3) is kept
    far = held(Target(position=(0.5, 2.0, -1.5), velocity=(0.0, 0.0, 0.0), yaw=0.0, set_s=0.0))
    assert kept_off(far, wall, 0.3) is far


def test_the_wall_stays_where_it_is_when_the_origin_moves():
    wall = WallPlane(0.6, 0.8, 1.0, 0.0)
    moved = wall.shifted((1.0, -2.0, 3.0))
    assert moved.lip_m((1.3, -1.9, 2.0)) == pytest.approx(wall.lip_m((0.3, 0.1, -1.0)))


def test_a_velocity_into_the_wall_ends_at_the_least_distance_and_a_hold_inside_it_moves_out():
    wall = WallPlane(0.0, 1.0, 0.5, 0.0)
    into = held(Target(position=(math.nan,) * 3, velocity=(0.0, 1.0, 0.0), yaw=0.0, set_s=0.0))
    assert sent_to_m(kept_off(into, wall, 0.3), wall) == pytest.approx(0.3)
    along = held(Target(position=(math.nan,) * 3, velocity=(1.0, 0.0, 0.0), yaw=0.0, set_s=0.0))
    assert kept_off(along, wall, 0.3) is along
    inside = held(stay(0.0, 0.0))
    assert kept_off(inside, wall, 0.6).target.position[:2] == pytest.approx((0.0, -0.1))


def test_the_pilot_reads_once_what_the_loop_holds_and_what_was_asked():
    flown = bench(wall=0.20, model=models.load("corner_cfd"))
    flown.run(3.0)
    slow = AttitudeLoop(0.30, 0.24, source=Source.MEASURED)
    flown.state = with_plant(flown.state, loop=slow, tuned_s=-math.inf)
    reporter = StatusReporter()
    said = []
    for _ in range(150):
        decision = flown.tick()
        said += [text for _, text in reporter.messages(flown.state, decision) if text]
    told = [text for text in said if "from a wall, not" in text]
    assert len(told) == 1
    found = re.search(r"can hold (\d\.\d\d) m from a wall, not (\d\.\d\d)", told[0])
    assert found is not None
    assert float(found[1]) > float(found[2])
    assert flown.state.plant.tuned.least_wall_m == pytest.approx(float(found[1]), abs=0.01)
    assert flown.state.held.hold.target.position[1] < -0.02, "off the wall at the right"


def test_a_tuning_knows_no_least_distance_away_from_walls():
    tuned: HoldTuning = tune(SLOW, TEN_HZ)
    assert tuned.least_wall_m == 0.0


def test_the_quad_of_the_file_has_a_lift_without_a_model():
    quad = load_vehicle(QUAD)
    own = PipelineConfig(vehicle=quad, model=empty_model(quad))
    assert wall_law(own, hovering(own, math.inf)).steepest(0.0) > 1.0
