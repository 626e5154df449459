"""A tilted beam to the side sees far ground and sky in turn; neither is a wall, neither is a lost sensor."""

from __future__ import annotations

import pytest
from flying import CONFIG, RIGHT, Bench

from companion.estimation.readings import take_range
from companion.estimation.surfaces import Seen, surface
from companion.mavlink.samples import Range, RangeVerdict


def heard(bench: Bench, t_s: float, distance_m: float, verdict: RangeVerdict) -> Range:
    sensor = next(s for s in CONFIG.vehicle.rangefinders if s.target == "wall")
    assert sensor.orientation == 2
    return Range(
        t_s,
        1,
        1,
        direction_frd=RIGHT,
        orientation=0,
        sensor_id=sensor.orientation,
        distance_m=distance_m,
        min_m=0.05,
        max_m=40.0,
        sigma_m=None,
        quality=None,
        verdict=verdict,
        source="DISTANCE_SENSOR",
    )


@pytest.mark.parametrize("period_s", [0.2, 0.6, 2.0])
def test_far_ground_and_sky_in_turn_are_no_stale_wall(period_s):
    bench = Bench(wall=28.0)
    for _ in range(20):
        bench.tick()
    estimates, t = bench.state.estimates, bench.t
    seen = set()
    for k in range(400):
        t += 0.02
        ground = int(k * 0.02 / period_s) % 2 == 0
        verdict = RangeVerdict.OK if ground else RangeVerdict.ABOVE_MAX
        estimates = take_range(
            estimates, heard(bench, t, 28.0 if ground else 60.0, verdict), CONFIG
        )
        if k > 50:
            seen.add(surface(estimates, CONFIG, "wall", t).seen)
    assert seen == {Seen.NOTHING}


def test_a_wall_that_is_near_is_still_seen():
    bench = Bench(wall=0.5)
    for _ in range(40):
        bench.tick()
    assert surface(bench.state.estimates, bench.config, "wall", bench.t).seen is Seen.SURFACE
