from __future__ import annotations

import itertools
import math

import pytest
from simflight import vehicle

from companion.sim.scenario import NAMES, ROUNDING_S, build, wall_azimuth
from models.common.errors import ConfigError

EACH = [(name, v) for name in NAMES for v in ("tandem", "quad")]


@pytest.mark.parametrize(("name", "which"), EACH)
def test_velocity_is_the_slope_of_position(name, which):
    s = build(name, vehicle(which))
    dt = 1e-4
    for k in range(int(s.duration_s * 10)):
        t = 0.1 * k + 0.0213
        a, b, mid = s.reference(t - dt), s.reference(t + dt), s.reference(t)
        for axis in range(3):
            slope = (b.position[axis] - a.position[axis]) / (2.0 * dt)
            assert mid.velocity[axis] == pytest.approx(slope, abs=2e-3)


@pytest.mark.parametrize(("name", "which"), EACH)
def test_no_reference_meets_ground_or_wall(name, which):
    v = vehicle(which)
    s = build(name, v)
    azimuth = wall_azimuth(v)
    reach = max(
        f.position_m[0] * math.cos(azimuth) + f.position_m[1] * math.sin(azimuth) + f.lip_radius_m
        for f in v.fans
    )
    for k in range(int(s.duration_s * 20)):
        n, e, d = s.reference(0.05 * k).position
        assert -d >= 0.19
        gap = s.surroundings.wall_m - (n * math.cos(azimuth) + e * math.sin(azimuth)) - reach
        assert gap > 0.05


def test_corner_flight_is_about_a_minute_and_goes_close():
    v = vehicle()
    s = build("corner", v)
    assert 50.0 < s.duration_s < 65.0
    points = [s.reference(0.05 * k) for k in range(int(s.duration_s * 20))]
    heights = [-p.position[2] / v.rotor_radius_m for p in points]
    gaps = [(s.surroundings.wall_m - p.position[1] - 0.21) / v.rotor_radius_m for p in points]
    assert min(heights) == pytest.approx(1.25, abs=0.05)
    assert min(gaps) == pytest.approx(0.6, abs=0.05)
    assert min(h + g for h, g in zip(heights, gaps, strict=True)) < 2.0  # both at once: the corner
    assert {p.phase for p in points} >= {"free", "ground", "wall", "corner"}
    assert max(abs(v) for p in points for v in p.velocity) == pytest.approx(0.3, abs=0.01)


def test_corners_are_rounded_to_a_finite_acceleration():
    s = build("corner", vehicle())
    speeds = [s.reference(0.02 * k).velocity[2] for k in range(int(s.duration_s * 50))]
    steepest = max(abs(b - a) / 0.02 for a, b in itertools.pairwise(speeds))
    assert steepest <= 0.3 / ROUNDING_S * 1.05


def test_before_and_after_the_script_the_reference_rests():
    s = build("corner", vehicle())
    for t in (-100.0, -1.0, s.duration_s + 1.0, 1e6):
        assert s.reference(t).velocity == (0.0, 0.0, 0.0)
    assert s.reference(1e6).phase == "end"


def test_free_air_has_no_obstacles_and_air_off_keeps_them():
    assert math.isinf(build("free", vehicle()).surroundings.wall_m)
    off = build("corner", vehicle(), air=False).surroundings
    assert math.isfinite(off.wall_m)
    assert not off.air


def test_the_wall_stands_where_the_vehicle_looks():
    assert wall_azimuth(vehicle("tandem")) == pytest.approx(math.pi / 2)
    assert wall_azimuth(vehicle("quad")) == pytest.approx(0.0)


def test_unknown_scenario_is_refused_by_name():
    with pytest.raises(ConfigError, match="moon"):
        build("moon", vehicle())
