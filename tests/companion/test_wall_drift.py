"""A position that drifts against the wall range is said: frozen vision, a slow drift; not noise, leaps, slopes."""

from __future__ import annotations

import math
import random

import pytest
from flying import bench
from simflight import vehicle
from simulated import simulated

from companion.control.reasons import Notice
from companion.estimation.felt_motion import UNFELT, Felt, passed
from companion.estimation.surfaces import Seen, Surface
from companion.estimation.wall_drift import NO_WALL_DRIFT, Wrong, compare_wall, corrected
from companion.mavlink.dialect import ID_OF
from companion.mavlink.firmware import Stack
from companion.mavlink.message_filter import UNREAD
from companion.mavlink.samples import LocalPosition
from companion.mavlink.stream_rates import wanted_streams
from companion.sim.scenario import build

EAST = (0.0, 1.0, 0.0)


def every(k, reading):
    return reading


def flown(
    truth,
    estimate,
    seconds=10.0,
    wall=lambda n: 0.8,
    resets=(),
    noise=0.0,
    read=every,
    range_every=1,
    feels=False,
):
    """Seconds until a drift is noticed, or None: a wall ``wall(north)`` east of the origin, places (north, east).

    ``feels``: accelerometers feel the true motion.
    """
    state, rng, reset_s = NO_WALL_DRIFT, random.Random(1), -math.inf
    plane = heard = math.nan
    way, last_east, felt = (0.0, 0.0), 0.0, UNFELT
    for k in range(round(25.0 * seconds)):
        t = k / 25.0
        (north, east), believed = truth(t), estimate(t)
        reset_s = max([r for r in resets if r <= t], default=-math.inf)
        reading = wall(north) - east + rng.gauss(0.0, noise)
        if k % range_every == 0:
            plane = read(k, reading)
            heard = t
        surface = Surface(
            seen=Seen.SURFACE,
            distance_m=reading,
            normal_ned=EAST,
            met_ned=None if math.isnan(plane) else (0.0, plane, 0.0),
            heard_s=heard,
        )
        sample = LocalPosition(10.0 + t, 1, 1, (*believed, -1.0), (0.0, 0.0, 0.0))
        if feels:
            way = passed(way, east - last_east, 1.0 / 25.0)
            last_east = east
            felt = Felt(t_s=sample.t_s, place=(0.0, way[1]))
        state = compare_wall(state, surface, sample, 2.0, 10.0 + reset_s, felt)
        if state.drifts:
            return t
    return None


def still(t):
    return (0.0, 0.0)


@pytest.mark.parametrize(("speed", "within"), [(0.1, 1.4), (-0.1, 1.4), (0.025, 7.0)])
def test_a_position_that_stands_still_while_the_wall_comes_nearer_is_noticed(speed, within):
    assert flown(lambda t: (0.0, speed * t), still) < within


def test_a_drift_that_the_accelerometers_confirm_is_noticed_sooner():
    """Beside a wall at 30 degrees the vehicle came within 2 cm of it before the range alone was sure."""

    def drifting(t):
        return (0.0, 0.1 * max(t - 1.0, 0.0))

    assert flown(drifting, still) > 2.2
    assert flown(drifting, still, feels=True) < 1.95


@pytest.mark.parametrize("feels", [False, True])
def test_noise_of_range_and_estimate_is_no_drift(feels):
    def wanders(t):
        return (0.0, 0.03 * math.sin(t))

    assert flown(still, wanders, seconds=60.0, noise=0.01, feels=feels) is None


@pytest.mark.parametrize("wrong", [math.nan, math.inf, 0.65, 0.95])
def test_a_single_reading_that_is_none_or_wrong_is_no_drift(wrong):
    def read(k, reading):
        if k % 20 == 19:
            return wrong
        return reading

    assert flown(still, still, read=read, noise=0.005) is None


def test_a_range_too_short_to_be_read_is_carried_on_by_the_position():
    def read(k, reading):
        if reading < 0.75:
            return math.nan
        return reading

    def place(t):
        return (0.0, 0.1 * math.sin(t))

    assert flown(place, place, seconds=20.0, read=read) is None


def test_a_drift_of_two_per_cent_of_the_path_is_not_said():
    assert (
        flown(
            lambda t: (0.0, 0.3 * math.sin(t)), lambda t: (0.0, 0.3 * math.sin(t) - 0.004 * t), 60.0
        )
        is None
    )


def test_a_slanted_wall_that_is_flown_along_is_no_drift():
    def place(t):
        return (0.3 * t, 0.0)

    assert flown(place, place, wall=lambda n: 0.9 - 0.2 * n) is None


def test_a_leap_that_is_known_as_one_is_no_drift():
    def leapt(t):
        return (0.0, 0.25 if t >= 3.02 else 0.0)

    assert flown(still, leapt, resets=(3.02,)) is None
    assert flown(still, leapt) == pytest.approx(3.04)


def test_frozen_vision_beside_a_wall_is_said_to_the_pilot():
    b = bench(height=0.3)
    b.run(3.0)
    for _ in range(100):
        b.wall -= 0.0015
        decision = b.tick()
    assert decision.notice is not None
    assert decision.notice[0] is Notice.POSITION_DRIFTS
    assert decision.reasons == ()


def test_visual_odometry_drifts_and_leaps_back():
    flight = simulated(vehicle(), build("hover", vehicle()), 1, vision=True)
    off = []
    for k in range(round(10.5 / flight.body.dt)):
        flight.body.position[0] += (
            0.5 * flight.body.dt
        )  # carried along: the accelerometers feel nothing of it
        flight.step()
        if k % 40 == 0:
            off.append(math.dist(flight.estimator._odometry(), flight.estimator._seen[0]))
    assert max(off) == pytest.approx(0.02 * 5.0, rel=0.1)
    assert off[-1] < 0.01


def test_a_range_that_leaps_is_no_drift_of_the_position():
    def read(k, reading):
        if k > 60:
            return reading - 0.4
        return reading

    assert flown(still, still, read=read, noise=0.005) is None


def test_a_quick_departure_with_ranges_ten_times_a_second_is_no_drift():
    def place(t):
        return (0.0, -0.5 * max(t - 2.0, 0.0) if t < 4.0 else -1.0)

    assert flown(place, place, seconds=6.0, range_every=3) is None


def test_without_an_accelerometer_a_frozen_range_drives_the_vehicle_off_by_half_a_metre_at_most():
    """The vehicle leaves the wall, the range repeats itself: nothing tells which of them is wrong."""
    state = NO_WALL_DRIFT
    surface = Surface(seen=Seen.SURFACE, distance_m=0.5, normal_ned=EAST, met_ned=(0.0, 0.5, 0.0))
    for k in range(250):
        t = 10.0 + k / 25.0
        sent = LocalPosition(t, 1, 1, (0.0, -0.2 * (t - 10.0), -1.0), (0.0, -0.2, 0.0))
        state, flown_by = corrected(state, sent)
        state = compare_wall(
            state, surface._replace(heard_s=t), flown_by, near_m=2.0, reset_s=-math.inf
        )
    assert state.wrong is None
    assert state.correction_ned[1] == pytest.approx(0.5, abs=0.01)


def test_what_came_apart_is_taken_back_once_although_the_range_was_blamed_in_between():
    """The vehicle rests, its position drifts by 0.4 m. What is felt blames nobody, then the range."""
    state = NO_WALL_DRIFT
    surface = Surface(seen=Seen.SURFACE, distance_m=0.8, normal_ned=EAST, met_ned=(0.0, 0.8, 0.0))
    blamed = []
    for k in range(200):
        t = 10.0 + k / 25.0
        drift_m = -0.1 * min(max(t - 11.0, 0.0), 4.0)
        sent = LocalPosition(t, 1, 1, (0.0, drift_m, -1.0), (0.0, 0.0, 0.0))
        if t < 13.0:
            felt_m = 0.5 * state.by_position[1]
        elif t < 13.5:
            felt_m = state.by_position[1]
        else:
            felt_m = 0.0
        felt = Felt(t_s=t, place=(0.0, felt_m))
        state, flown_by = corrected(state, sent, felt)
        now = surface._replace(heard_s=t)
        state = compare_wall(state, now, flown_by, near_m=2.0, reset_s=-math.inf, felt=felt)
        blamed.append(state.wrong)
    assert Wrong.RANGE in blamed
    assert blamed[-1] is Wrong.POSITION
    assert flown_by.position_ned[1] == pytest.approx(0.0, abs=0.05)


def test_accelerations_are_asked_for_and_read_whether_or_not_sizes_are_measured():
    imu = ID_OF["HIGHRES_IMU"]
    assert imu in {w.message_id for w in wanted_streams(vehicle(), Stack.PX4)}
    assert imu not in UNREAD
