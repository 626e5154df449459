"""A wall that is not seen for a moment is still there: lost echoes and readings below the minimum, in a log."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.mavlink.samples import RangeVerdict
from companion.vehicles import default_vehicle
from models.common.frames import Array
from models.vehicle import Rangefinder
from replay.flightlog import Beam, FlightLog, Series
from replay.residual.distances import distances

T = np.arange(0.0, 20.0, 0.02)
RIGHT = 2
VEHICLE = replace(default_vehicle(), rangefinders=(Rangefinder(RIGHT, "wall", (0.0, 0.21, 0.0)),))
WALL_M = 3.0


def east(t: Array) -> Array:
    """To the wall, a stay with some sway, and back."""
    return np.interp(t, [2.0, 8.0, 12.0, 18.0], [0.0, 2.4, 2.4, 0.0]) + 0.05 * np.sin(2.0 * t)


LEVEL = np.full(len(T), -2.0)


def to_lip(lost: Array, below: Array, down: Array = LEVEL) -> tuple[Array, Array]:
    """Lip to wall [m] by the log, and in truth, (n,) each; readings that are ``lost`` or ``below`` the minimum."""
    true = WALL_M - east(T) - 0.21
    values = np.where(lost, 60.0, np.where(below, 0.0, true))
    kinds = {(True, False): RangeVerdict.ABOVE_MAX, (False, True): RangeVerdict.BELOW_MIN}
    verdicts = tuple(
        kinds.get((bool(a), bool(b)), RangeVerdict.OK) for a, b in zip(lost, below, strict=True)
    )
    series = Series(T, values[:, None])
    beam = Beam((0.0, 1.0, 0.0), 1, 0, RIGHT, "x", series, verdicts, 0.05, 40.0, math.nan, 0.01)
    log = FlightLog(path=None, system=1, boot=0, start_s=0.0, end_s=20.0, beams=(beam,))  # type: ignore[arg-type]
    position = np.stack([np.zeros(len(T)), east(T), down], axis=1)
    rotation = np.broadcast_to(np.eye(3), (len(T), 3, 3))
    return distances(log, VEHICLE, T, rotation, position, 0.0)["d_m"][:, 0], true


@pytest.mark.parametrize("every", [10, 50])
def test_single_lost_samples_are_no_clear_sight(every: int) -> None:
    seen, true = to_lip(np.arange(len(T)) % every == 5, np.zeros(len(T), bool))
    near = true < 8.0 * VEHICLE.rotor_radius_m  # farther away nothing of the wall is felt
    assert np.isfinite(seen[near]).all()
    assert np.abs(seen - true)[near].max() < 0.02


def test_two_seconds_below_the_minimum_are_carried_by_the_vehicles_own_motion() -> None:
    seen, true = to_lip(np.zeros(len(T), bool), (T > 9.0) & (T < 11.0))
    assert np.abs(seen - true).max() < 0.01


def test_a_wall_that_is_not_seen_for_long_is_unknown_and_not_gone() -> None:
    lost = (T > 6.5) & (T < 11.0)
    seen, _ = to_lip(lost, np.zeros(len(T), bool))
    assert np.isnan(seen[lost]).all()


def test_a_wall_that_the_vehicle_left_is_gone() -> None:
    seen, _ = to_lip(T > 17.0, np.zeros(len(T), bool))
    assert np.isinf(seen[T > 17.6]).all()


def test_a_pole_that_the_vehicle_went_past_and_back_to_was_not_there_between() -> None:
    down = np.interp(T, [8.0, 9.0, 10.0, 11.0], [-2.0, -1.0, -1.0, -2.0])
    lost = (down > -1.6) & (T > 8.0) & (T < 11.0)
    seen, _ = to_lip(lost, np.zeros(len(T), bool), down)
    assert np.isinf(seen[lost & (down > -1.4)]).any()
