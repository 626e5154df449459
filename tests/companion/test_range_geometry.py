import math

import numpy as np
import pytest

from companion.estimation.range_geometry import fan_heights, fan_wall_distances, plane_distance, wall_bearing
from companion.vehicles import default_vehicle
from models.frames import quaternion_from_euler, rotation_from_quaternion

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


def test_a_wall_beam_that_meets_the_ground_is_no_wall():
    rolled_right = turned(roll=0.3)
    assert plane_distance("wall", RIGHT, np.zeros(3), 3.0, rolled_right, 0.5) is None
    assert plane_distance("wall", RIGHT, np.zeros(3), 1.0, rolled_right, 0.5) is not None


def test_steep_incidence_tells_nothing():
    steep = turned(roll=math.radians(31))
    assert plane_distance("ground", DOWN, np.zeros(3), 1.0, steep, math.inf) is None
    assert plane_distance("wall", RIGHT, np.zeros(3), 1.0, steep, math.inf) is None


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
