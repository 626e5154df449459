import itertools
import math

import numpy as np
import pytest

from companion.estimation.range_geometry import (
    choose_walls,
    fan_heights,
    fan_wall_distances,
    nearest_level,
    plane_distance,
    plane_distance_now,
    wall_bearing,
)
from companion.vehicles import default_vehicle
from models.common.frames import quaternion_from_euler, rotation_from_quaternion

DOWN, RIGHT = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])


def turned(roll=0.0, pitch=0.0, yaw=0.0):
    return rotation_from_quaternion(np.array(quaternion_from_euler(roll, pitch, yaw)))


@pytest.mark.parametrize(("roll", "pitch"), [(0.0, 0.0), (0.15, 0.0), (-0.1, 0.12), (0.2, -0.2)])
def test_height_is_free_of_tilt_and_lever_arm(roll, pitch):
    rotation, height, mount = turned(roll, pitch, 0.7), 1.2, np.array([0.1, -0.05, 0.05])
    # The slant range at which mount + range * beam lies on the ground.
    slant = (height - (rotation @ mount)[2]) / (rotation @ DOWN)[2]
    plane = plane_distance("ground", DOWN, mount, slant, rotation, math.inf)
    assert plane.distance_m == pytest.approx(height)


def test_wall_distance_is_horizontal_and_faces_the_beam():
    rotation = turned(roll=0.2, yaw=math.pi / 2)
    plane = plane_distance("wall", RIGHT, np.zeros(3), 1.0, rotation, 5.0)
    assert plane.distance_m == pytest.approx(math.cos(0.2))
    assert plane.normal_ned == pytest.approx([-1.0, 0.0, 0.0])  # nose east: right is south
    assert wall_bearing(plane.normal_ned, rotation) == pytest.approx(math.pi / 2)


def wall_at(slant, rotation, height=math.inf, radius=0.165):
    return float(
        plane_distance("wall", RIGHT, np.zeros(3), slant, rotation, height, radius).distance_m
    )


def test_a_wall_beam_that_meets_the_ground_is_no_wall():
    rolled_right = turned(roll=0.3)
    assert math.isnan(wall_at(1.7, rolled_right, 0.5))
    assert wall_at(1.0, rolled_right, 0.5) == pytest.approx(math.cos(0.3))
    assert math.isinf(wall_at(3.0, rolled_right, 0.5)), (
        "it got so far that a wall behind it does not matter"
    )


def test_steep_incidence_tells_nothing_and_a_clear_beam_still_does():
    steep = turned(roll=math.radians(31))
    assert math.isnan(plane_distance("ground", DOWN, np.zeros(3), 1.0, steep).distance_m)
    assert math.isnan(wall_at(1.0, steep))
    assert math.isinf(wall_at(math.inf, steep))


def test_a_far_reading_to_the_side_is_no_wall_and_a_far_ground_is_ground():
    assert math.isinf(wall_at(6.0, turned()))
    assert (
        plane_distance("ground", DOWN, np.zeros(3), 6.0, turned(), rotor_radius_m=0.165).distance_m
        == 6.0
    )


def test_a_record_gives_what_its_instants_give():
    rotations = np.stack(
        [turned(r, p, y) for r, p, y in ((0.0, 0.1, 0.3), (0.2, -0.1, 2.0), (0.6, 0.0, 0.0))]
    )
    slants, heights = np.array([0.5, math.inf, 1.0]), np.array([1.0, math.nan, 0.4])
    mount, vehicle = np.array([0.1, 0.2, -0.05]), default_vehicle()
    for target, beam in (("wall", RIGHT), ("ground", DOWN), ("ceiling", -DOWN)):
        whole = plane_distance(target, beam, mount, slants, rotations, heights, 0.165)
        bearings = wall_bearing(whole.normal_ned, rotations)
        lips = fan_wall_distances(vehicle, whole.distance_m, whole.normal_ned, rotations)
        for k in range(3):
            one = plane_distance(target, beam, mount, slants[k], rotations[k], heights[k], 0.165)
            assert one.distance_m == pytest.approx(whole.distance_m[k], nan_ok=True)
            assert one.normal_ned == pytest.approx(whole.normal_ned[k])
            assert wall_bearing(one.normal_ned, rotations[k]) == pytest.approx(bearings[k])
            assert fan_wall_distances(
                vehicle, one.distance_m, one.normal_ned, rotations[k]
            ) == pytest.approx(lips[k], nan_ok=True)


@pytest.mark.parametrize("target", ["wall", "ground", "ceiling"])
def test_an_instant_in_plain_floats_is_the_same_plane(target):
    beams = {"wall": (0.0, 1.0, 0.0), "ground": (0.0, 0.0, 1.0), "ceiling": (0.0, 0.0, -1.0)}
    mount = (0.1, 0.2, -0.05)
    rng = np.random.default_rng(0)
    seen = []
    for slant, height in itertools.product(
        (0.1, 1.0, 3.0, 9.0, math.inf, math.nan), (0.2, 1.0, math.inf, math.nan)
    ):
        for roll, pitch, yaw in rng.uniform(-0.8, 0.8, (5, 3)):
            rotation = turned(roll, pitch, yaw)
            plane = plane_distance(target, beams[target], mount, slant, rotation, height, 0.165)
            distance, normal = plane_distance_now(
                target=target,
                beam_ned=tuple((rotation @ beams[target]).tolist()),
                position_m=mount,
                slant_m=slant,
                rotation=tuple(map(tuple, rotation.tolist())),
                height_cg_m=height,
                rotor_radius_m=0.165,
            )
            assert distance == pytest.approx(float(plane.distance_m), rel=1e-12, nan_ok=True)
            assert normal == pytest.approx(plane.normal_ned.tolist(), rel=1e-12)
            seen.append(distance)
    assert any(map(math.isnan, seen))
    assert any(map(math.isinf, seen))
    assert any(map(math.isfinite, seen))


NORTH, EAST, NORTH_EAST = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.87, 0.5, 0.0)


@pytest.mark.parametrize(
    ("distances", "chosen"),
    [
        ((0.9, 0.5, 0.7), (1, 2, True)),  # north-east is 60 degrees off the nearest: another wall
        ((0.4, math.inf, 0.5), (0, -1, True)),  # 30 degrees apart: one wall
        ((math.inf, math.inf, math.inf), (-1, -1, True)),
        (
            (0.4, math.nan, 0.5),
            (-1, -1, False),
        ),  # the beam that tells nothing may look at the nearest
    ],
)
def test_the_nearest_wall_is_the_models_and_the_nearest_at_another_bearing_the_second(
    distances, chosen
):
    walls = choose_walls(distances, (NORTH, EAST, NORTH_EAST))
    assert (int(walls.first), int(walls.second), bool(walls.known)) == chosen


def test_beams_to_the_same_ground_confirm_each_other():
    assert nearest_level((1.2, math.nan, 1.0)) == 1.0
    assert math.isnan(nearest_level((math.inf, math.nan)))
    assert math.isinf(nearest_level((math.inf, math.inf)))


def test_each_fan_has_its_own_distances():
    vehicle = default_vehicle()
    nose_up = turned(pitch=0.1)
    front, rear = fan_heights(vehicle, 1.0, nose_up)
    assert front - rear == pytest.approx(0.64 * math.sin(0.1))
    yawed = turned(yaw=0.1)
    toward_east = np.array([0.0, 1.0, 0.0])
    front, rear = fan_wall_distances(vehicle, 1.0, toward_east, yawed)
    assert front == pytest.approx(1.0 - 0.32 * math.sin(0.1) - 0.21)
    assert rear == pytest.approx(1.0 + 0.32 * math.sin(0.1) - 0.21)
