"""A single beam learns how a wall runs from the places where it meets it."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
from flying import CONFIG, bench

from companion.control.reasons import Notice
from companion.estimation.surfaces import walls
from companion.estimation.wall_line import met, square_to

EAST = (0.0, 1.0, 0.0)
MOUNT_M = 0.21
"""The shipped vehicle's wall sensor sits so far to the right of the CG."""


def bearing(degrees):
    """Level unit vector ``degrees`` to the right of east."""
    angle = math.radians(90.0 + degrees)
    return (math.cos(angle), math.sin(angle))


def seen(truth, estimate, degrees=0.0, gap_m=1.0, seconds=10.0, noise=0.01, beam_deg=None):
    """Degrees by which the wall is known to be turned, after places flown by; True ones are (north, east)."""
    rng = random.Random(3)
    n, e = bearing(degrees)
    line = None
    for k in range(round(20.0 * seconds)):
        t = k / 20.0
        yaw = 0.0 if beam_deg is None else beam_deg(t)
        b_n, b_e = bearing(yaw)
        north, east = truth(t)
        slant = (gap_m - n * north - e * east) / (n * b_n + e * b_e) + rng.gauss(0.0, noise)
        north, east = (x + rng.gauss(0.0, 0.2 * noise) for x in estimate(t))
        place = (north + slant * b_n, east + slant * b_e, 0.0)
        beam = (b_n, b_e, 0.0)
        if line is None:
            line = square_to(beam, place, t)
        else:
            line = met(line, beam, place, t)
    return math.degrees(line.bearing_rad) - 90.0


def still(t):
    return (0.0, 0.0)


def nearer(t):
    """Towards a wall that is turned by 40 degrees to the right."""
    n, e = bearing(40.0)
    return (0.09 * t * n, 0.09 * t * e)


@pytest.mark.parametrize("degrees", [-50.0, -20.0, 20.0, 40.0])
def test_a_wall_that_is_flown_along_is_known_to_be_turned(degrees):
    def place(t):
        return (0.05 * t, 0.0)

    assert seen(place, place, degrees) == pytest.approx(degrees, abs=5.0)


def test_a_wall_that_is_come_nearer_to_is_known_to_be_turned():
    assert seen(nearer, nearer, degrees=40.0) == pytest.approx(40.0, abs=5.0)


def test_a_wall_at_which_the_vehicle_turns_is_known_to_be_turned():
    turned = seen(still, still, degrees=25.0, beam_deg=lambda t: 20.0 * math.sin(t))
    assert turned == pytest.approx(25.0, abs=5.0)


def test_noise_turns_no_wall():
    assert abs(seen(still, still, seconds=300.0)) < 5.0


@pytest.mark.parametrize("way", [(0.0, 0.1), (0.0, -0.1)])
def test_a_position_that_drifts_across_turns_no_wall(way):
    assert abs(seen(still, lambda t: (way[0] * t, way[1] * t))) < 5.0


def test_a_wall_after_its_origin_moved_or_through_another_place_runs_as_before():
    line = square_to(EAST, (0.0, 1.0, 0.0), 0.0)
    moved = line.shifted((3.0, 2.0, 0.0))
    assert (moved.north, moved.east, moved.bearing_rad) == (3.0, 3.0, line.bearing_rad)
    assert not line.near((0.0, 1.5, 0.0))
    again = line.through((0.0, 1.5, 0.0), 2.0)
    assert again.near((1.0, 1.5, 0.0))
    assert (again.covariance, again.slope_variance, again.t_s) == (0.0, line.slope_variance, 2.0)


def test_the_filter_is_filterpys():
    """The way along the wall stands in the place of time; the variances of Q are those of the module."""
    filterpy = pytest.importorskip("filterpy.kalman")
    rng = np.random.default_rng(2)
    line = square_to(EAST, (0.0, 1.0, 0.0), 0.0)
    for k in range(50):
        # Square to the beam is north, and a slope turns the normal to the left of it.
        dx, t = float(rng.normal(0.0, 0.1)), 0.05 * (k + 1)
        slope = math.tan(math.radians(90.0) - line.bearing_rad)
        place = (line.north - dx, line.east + float(rng.normal(0.0, 0.05)), 0.0)
        p = [[line.variance, line.covariance], [line.covariance, line.slope_variance]]
        q = np.diag([0.02**2 * 0.05, 0.1**2 * abs(dx)])
        f = np.array([[1.0, dx], [0.0, 1.0]])
        x, p = filterpy.predict(np.array([0.0, slope]), np.array(p), f, q)
        z, h = np.array([place[1] - line.east]), np.array([[1.0, 0.0]])
        x, p = filterpy.update(x, p, z, np.array([[0.03**2]]), h)
        after = met(line, EAST, place, t)
        ours = [after.variance, after.covariance, after.slope_variance]
        np.testing.assert_allclose(ours, [p[0, 0], p[0, 1], p[1, 1]], rtol=1e-9, atol=1e-15)
        slope = math.tan(math.radians(90.0) - after.bearing_rad)
        np.testing.assert_allclose([after.east - line.east, slope], x, rtol=1e-9, atol=1e-12)
        line = after


@pytest.mark.parametrize("degrees", [0.0, 20.0, 40.0])
def test_a_vehicle_knows_how_far_a_turned_wall_is(degrees):
    """It comes nearer square to the wall, not along the beam; nobody is told that its position drifts."""
    gap_m = 1.9
    n, e = bearing(degrees)
    b = bench(height=0.6)
    notices = set()
    for k in range(400):
        way = 0.3 * min(max(0.02 * k - 2.0, 0.0), 3.0)
        b.position = (way * n, way * e)
        b.wall = (gap_m - way) / e - MOUNT_M
        notices.add(b.tick().notice)
    wall = walls(b.state.estimates, CONFIG, b.t)[0]
    assert wall.distance_m == pytest.approx(gap_m - 0.9, abs=0.03)
    turned = math.degrees(math.atan2(wall.normal_ned[1], wall.normal_ned[0])) - 90.0
    assert turned == pytest.approx(degrees, abs=5.0)
    assert Notice.POSITION_DRIFTS not in {notice[0] for notice in notices if notice}


def test_another_wall_is_square_again():
    b = bench(height=0.6, wall=1.0)
    for k in range(200):
        b.position = (0.005 * k, 0.0)
        b.wall = 1.0 - 0.0025 * k
        b.tick()
    wall = walls(b.state.estimates, CONFIG, b.t)[0]
    assert abs(wall.normal_ned[0]) > 0.3
    b.wall = 2.0
    b.run(1.0)
    wall = walls(b.state.estimates, CONFIG, b.t)[0]
    assert wall.normal_ned == pytest.approx(EAST, abs=0.05)


def test_a_range_that_jumps_at_a_turned_wall_is_remembered_until_it_is_back():
    """Somebody steps aside from the beam: the wall that is seen then is another one, square to the beam at first."""
    gap_m = 2.0
    n, e = bearing(30.0)
    b = bench(height=0.6)
    for k in range(300):
        way = 0.003 * k
        b.position = (way * n, way * e)
        b.wall = (gap_m - way) / e - MOUNT_M
        b.tick()
    before = b.wall
    b.wall = before - 0.5
    b.run(2.0)
    assert walls(b.state.estimates, CONFIG, b.t)[0].jumped
    b.wall = before
    b.run(1.0)
    assert not walls(b.state.estimates, CONFIG, b.t)[0].jumped


def test_beside_a_wall_a_position_in_a_turned_frame_turns_no_wall():
    """What comes nearer seems to pass along the wall then: a wall at 45 degrees, were it learned here."""
    b = bench(height=0.6, wall=0.5)
    b.run(2.0)
    for k in range(150):
        way = 0.15 * math.sin(0.05 * k)
        b.position = (way, 0.0)
        b.wall = 0.5 - way
        b.tick()
    assert walls(b.state.estimates, CONFIG, b.t)[0].normal_ned == pytest.approx(EAST, abs=0.05)
