"""What of the rotor speeds a log carries."""

from __future__ import annotations

import numpy as np
import pytest

from models.common.frames import GRAVITY, Array, rotation_from_quaternion
from replay.flightlog import Series
from replay.residual.grid import Grid
from replay.residual.motion import Trajectory, carried_hz
from replay.residual.motion_faults import first_upside_down


def series(t_s: Array) -> Series:
    return Series(t_s, np.ones((len(t_s), 1)))


def test_a_steady_record_carries_its_rate() -> None:
    assert carried_hz(series(np.arange(100) * 0.1)) == pytest.approx(10.0)


def test_every_third_sample_missing_halves_what_is_carried() -> None:
    """Two thirds of the time lie in steps of twice the length; the median step stays as it was."""
    t_s = np.arange(300) * 0.1
    thinned = series(np.delete(t_s, np.arange(2, 300, 3)))
    assert thinned.rate_hz == pytest.approx(10.0)
    assert carried_hz(thinned) == pytest.approx(5.0)


def test_a_long_gap_does_not_count() -> None:
    """What is not bridged is not judged."""
    t_s = np.concatenate([np.arange(100) * 0.1, 100.0 + np.arange(100) * 0.1])
    assert carried_hz(series(t_s)) == pytest.approx(10.0)


def test_samples_that_come_in_pairs_carry_the_rate_of_pairs() -> None:
    pairs = np.repeat(np.arange(100) * 0.1, 2)
    pairs[1::2] += 0.001
    assert carried_hz(series(pairs)) == pytest.approx(1.0 / 0.099)


def tilted(degrees: float, lift_g: float) -> Trajectory:
    """Ten seconds at 50 Hz, the last seven of them at a tilt."""
    t = np.arange(500) * 0.02
    over = t >= 3.0
    angle = np.where(over, np.radians(degrees), 0.0)
    nothing = np.zeros(500)
    half = 0.5 * angle
    rotation = rotation_from_quaternion(
        np.stack([np.cos(half), np.sin(half), nothing, nothing], axis=1)
    )
    force = np.zeros((500, 3))
    force[:, 2] = -GRAVITY * np.where(over, lift_g, 1.0)
    still = np.zeros((500, 3))
    return Trajectory(
        grid=Grid(0.0, 9.98, 50.0, 2.0),
        force=force,
        gyro=still,
        gyro_hz=50.0,
        rotation=rotation,
        position=still,
        velocity=still,
        attitude_hz=50.0,
    )


def test_a_steep_turn_is_no_crash() -> None:
    """At 75 degrees a level turn takes 1 / cos(75 degrees) = 3.9 g."""
    assert first_upside_down(tilted(75.0, 3.9)) is None


@pytest.mark.parametrize(("degrees", "lift_g"), [(90.0, 0.0), (180.0, -1.0), (110.0, 0.3)])
def test_what_lies_on_its_side_or_back_is_one(degrees: float, lift_g: float) -> None:
    assert first_upside_down(tilted(degrees, lift_g)) == 150
