"""The direction of a wall that a beam met at many places."""

from __future__ import annotations

import numpy as np
import pytest

from companion.estimation.range_geometry import PlaneDistance
from models.common.frames import Array
from replay.residual.standing_walls import square_to_walls

RNG = np.random.default_rng(1)


def seen(beam_rad: Array, wall_rad: Array, position: Array, to_wall_m: Array) -> PlaneDistance:
    """What a level beam sees of walls with a direction and a distance from the vehicle, noise of 1 cm."""
    slant = to_wall_m / np.cos(beam_rad - wall_rad) + 0.01 * RNG.standard_normal(len(position))
    normal = np.stack([np.cos(beam_rad), np.sin(beam_rad), 0.0 * beam_rad], axis=1)
    return PlaneDistance(slant, normal)


def angle(normals: Array) -> Array:
    return np.arctan2(normals[:, 1], normals[:, 0])


def turning(n: int = 600) -> Array:
    return 0.8 * np.sin(np.linspace(0.0, 12.0, n))


@pytest.mark.parametrize("wall_rad", [0.0, 0.4, -2.0])
def test_a_vehicle_that_turns_before_a_wall_knows_its_direction(wall_rad: float) -> None:
    """Half a metre away, up to 46 degrees off: along the beam the wall seemed 0.2 m farther than it was."""
    position = np.zeros((600, 3))
    beam_rad = wall_rad + turning()
    plane = seen(beam_rad, np.full(600, wall_rad), position, np.full(600, 0.5))
    assert np.abs(plane.distance_m - 0.5).max() > 0.15
    wall = square_to_walls(plane, position)
    assert np.abs(wall.distance_m - 0.5).max() < 0.05
    off = np.angle(np.exp(1j * (angle(wall.normal_ned) - wall_rad)))
    assert np.abs(off).max() < 0.06


def test_a_vehicle_that_passes_along_a_wall_knows_its_direction() -> None:
    along = np.linspace(-1.5, 1.5, 600)
    position = np.stack([0.0 * along, along, 0.0 * along], axis=1)
    plane = seen(np.full(600, 0.5), np.zeros(600), position, np.full(600, 0.8))
    wall = square_to_walls(plane, position)
    assert np.abs(wall.distance_m - 0.8).max() < 0.05


def test_two_walls_have_each_their_own_direction() -> None:
    position = np.zeros((1200, 3))
    position[600:, 1] = 5.0
    wall_rad = np.repeat([0.0, 1.3], 600)
    plane = seen(wall_rad + np.tile(turning(), 2), wall_rad, position, np.full(1200, 0.6))
    wall = square_to_walls(plane, position)
    assert np.abs(angle(wall.normal_ned) - wall_rad).max() < 0.06


def test_one_heading_from_one_place_says_nothing_of_the_direction() -> None:
    position = np.zeros((600, 3))
    position[:, 0] = 0.3 * np.sin(np.linspace(0.0, 9.0, 600))
    plane = seen(np.full(600, 0.5), np.zeros(600), position, 2.0 - position[:, 0])
    moved = position @ np.array([np.cos(0.5), np.sin(0.5), 0.0])
    plane = PlaneDistance(2.0 - moved, plane.normal_ned)
    same = square_to_walls(plane, position)
    assert np.array_equal(same.distance_m, plane.distance_m)
    assert np.array_equal(same.normal_ned, plane.normal_ned)


def test_what_is_no_plane_is_taken_as_the_beam_saw_it() -> None:
    """Boxes and people: places that lie on no line."""
    position = np.zeros((600, 3))
    plane = seen(turning(), np.zeros(600), position, RNG.uniform(0.4, 1.4, 600))
    same = square_to_walls(plane, position)
    assert np.array_equal(same.distance_m, plane.distance_m)


def test_what_was_not_seen_stays_so() -> None:
    position = np.zeros((600, 3))
    plane = seen(turning(), np.zeros(600), position, np.full(600, 0.5))
    distance_m = plane.distance_m.copy()
    distance_m[::7] = np.inf
    distance_m[3::7] = np.nan
    wall = square_to_walls(PlaneDistance(distance_m, plane.normal_ned), position)
    assert np.isinf(wall.distance_m[::7]).all()
    assert np.isnan(wall.distance_m[3::7]).all()
    few = PlaneDistance(distance_m[:20], plane.normal_ned[:20])
    assert square_to_walls(few, position[:20]) is few
