"""What the firmware is told of a body whose sensors go wrong, without a firmware."""

from __future__ import annotations

import math

import pytest
from rough_air import AIRS, CORNER_TIMES, RoughBody, StrongCornerBody
from wrong_sensors import NOTHING_WRONG, Range, Wrong, WrongSensors, read, write

from companion.sim.scenario import build
from companion.sim.sensors import OUT_OF_RANGE_M
from companion.sim.world import law_of
from companion.vehicles import QUAD
from models.vehicle import load_vehicle

VEHICLE = load_vehicle(QUAD)


def body(kind=RoughBody):
    scenario = build("corner", VEHICLE)
    made = kind(vehicle=VEHICLE, surroundings=scenario.surroundings, law=law_of("corner", 1))
    made.position = [1.0, 2.0, -3.0]
    made.velocity = [0.1, 0.2, 0.0]
    return made


def begun(wrong: Wrong) -> tuple[WrongSensors, RoughBody]:
    sensors = WrongSensors()
    vehicle = body()
    sensors.begin(wrong, vehicle)
    return sensors, vehicle


def moved(vehicle, seconds: float = 2.0):
    """Flown on for so long at its velocity."""
    for axis, speed in enumerate(vehicle.velocity):
        vehicle.position[axis] += seconds * speed
    vehicle.time_s += seconds
    return vehicle


def test_nothing_wrong_tells_the_truth():
    sensors, vehicle = begun(NOTHING_WRONG)
    position, velocity = sensors.motion(moved(vehicle))
    assert position == pytest.approx(vehicle.position)
    assert velocity == pytest.approx(vehicle.velocity)
    assert sensors.range_m("wall", 0.7, vehicle) == 0.7


@pytest.mark.parametrize(
    ("wrong", "off", "faster"),
    [
        (Wrong(position_off_m=(-0.5, 0.0, 0.0)), (-0.5, 0.0, 0.0), (0.0, 0.0, 0.0)),
        (Wrong(position_drift_m_s=(0.0, 0.1, 0.0)), (0.0, 0.2, 0.0), (0.0, 0.1, 0.0)),
    ],
)
def test_a_position_that_is_off_or_drifts(wrong, off, faster):
    sensors, vehicle = begun(wrong)
    position, velocity = sensors.motion(moved(vehicle))
    for told, true, by in zip(position, vehicle.position, off, strict=True):
        assert told - true == pytest.approx(by)
    for told, true, by in zip(velocity, vehicle.velocity, faster, strict=True):
        assert told - true == pytest.approx(by)


def test_a_frozen_position_stands_still():
    sensors, vehicle = begun(Wrong(position_frozen=True))
    position, velocity = sensors.motion(moved(vehicle))
    assert position == (1.0, 2.0, -3.0)
    assert velocity == (0.0, 0.0, 0.0)


def test_a_turned_position_turns_the_way_flown_since():
    sensors, vehicle = begun(Wrong(position_turned_deg=90.0))
    position, velocity = sensors.motion(moved(vehicle))
    assert position == pytest.approx((1.0 - 0.4, 2.0 + 0.2, -3.0))
    assert velocity == pytest.approx((-0.2, 0.1, 0.0))


def test_a_wall_range_that_is_off_drifts_freezes_or_is_lost():
    sensors, vehicle = begun(Wrong(wall_range_off_m=0.4))
    assert sensors.range_m("wall", 0.7, vehicle) == pytest.approx(1.1)
    assert sensors.range_m("ground", 0.7, vehicle) == 0.7
    assert sensors.range_m("wall", OUT_OF_RANGE_M, vehicle) == OUT_OF_RANGE_M
    sensors.begin(Wrong(wall_range_drift_m_s=-0.1), vehicle)
    assert sensors.range_m("wall", 0.7, moved(vehicle)) == pytest.approx(0.5)
    assert sensors.range_m("wall", 0.7, moved(vehicle, 60.0)) == pytest.approx(0.3)
    sensors.begin(Wrong(wall_range=Range.FROZEN), vehicle)
    assert sensors.range_m("wall", 0.2, vehicle) == 0.7
    sensors.begin(Wrong(wall_range=Range.LOST), vehicle)
    assert sensors.range_m("wall", 0.2, vehicle) == OUT_OF_RANGE_M


def test_in_the_sun_half_of_the_readings_are_none_and_the_others_noise():
    sensors, vehicle = begun(Wrong(wall_range=Range.SUN))
    readings = [sensors.range_m("wall", 1.0, vehicle) for _ in range(1000)]
    seen = [r for r in readings if r < OUT_OF_RANGE_M]
    assert 400 < len(seen) < 600
    assert sum(seen) / len(seen) == pytest.approx(1.0, abs=0.02)
    assert max(seen) - min(seen) > 0.3


def test_a_script_changes_it_in_flight(tmp_path):
    path = tmp_path / "wrong.json"
    sensors = WrongSensors(path)
    vehicle = body()
    sensors.look(vehicle)
    assert sensors.wrong == NOTHING_WRONG
    wrong = Wrong(position_off_m=(0.5, 0.0, 0.0), wall_range=Range.SUN, gust_m_s=(3.0, 0.0, 0.0))
    write(path, wrong)
    assert read(path) == wrong
    vehicle.time_s += 0.2
    sensors.look(vehicle)
    assert sensors.wrong == wrong


def test_a_strong_corner_differs_only_where_ground_and_wall_are_near():
    rough, strong = (body(kind).law.increments for kind in (RoughBody, StrongCornerBody))
    assert rough(math.inf, 0.5) == strong(math.inf, 0.5)
    assert rough(1.0, math.inf) == strong(1.0, math.inf)
    assert strong(1.0, 0.5).x < rough(1.0, 0.5).x
    assert CORNER_TIMES > 1.0
    assert set(AIRS) == {"calm", "rough", "strong corner", "free"}


def test_a_gust_comes_on_top_of_the_turbulence():
    vehicle = body()
    vehicle.gust = (3.0, 0.0, 0.0)
    vehicle.step([1000.0] * 8)
    assert 2.0 < vehicle.wind[0] < 4.0
