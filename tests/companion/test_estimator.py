"""Which message moves which estimate: rotors that are lost, repeated or too fast, ranges by their direction."""

from __future__ import annotations

import math

import pytest
from flying import CONFIG, DOWN, RIGHT, Bench

from companion.estimation import estimator as est
from companion.estimation.estimates import Estimates
from companion.estimation.surfaces import Seen
from companion.mavlink.samples import Attitude, LocalPosition, Range, RangeVerdict, RotorSpeeds

LEVEL = Attitude(10.0, 1, 1, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), "ATTITUDE")


def blank() -> Estimates:
    return est.take_attitude(est.blank_estimates(CONFIG.vehicle), LEVEL)


def turning(*speeds: tuple[float, ...], counts: tuple[int, ...] = (), first: int = 1) -> Estimates:
    """After telemetry every 50 ms from 10 s on."""
    estimates = blank()
    for k, rpm in enumerate(speeds):
        count = (counts[k],) * len(rpm) if counts else None
        sample = RotorSpeeds(10.0 + 0.05 * k, 1, 1, first, rpm, "ESC_TELEMETRY_1_TO_4", count=count)
        estimates = est.take_rotors(estimates, sample, CONFIG)
    return estimates


def beam(direction: tuple[float, float, float], distance_m: float, t_s: float = 10.0) -> Range:
    return Range(
        t_s,
        1,
        1,
        direction_frd=direction,
        orientation=0,
        sensor_id=0,
        distance_m=distance_m,
        min_m=0.05,
        max_m=8.0,
        sigma_m=None,
        quality=None,
        verdict=RangeVerdict.OK,
        source="DISTANCE_SENSOR",
    )


def test_nothing_is_known_before_anything_is_heard() -> None:
    estimates = blank()
    assert est.rotor_speeds(estimates, CONFIG, 10.0) is None
    assert est.surface(estimates, CONFIG, "ground", 10.0).seen is Seen.MISSING
    assert est.surface(estimates, CONFIG, "ceiling", 10.0).seen is Seen.UNDECLARED


def test_speeds_of_all_rotors_are_needed_and_grow_old() -> None:
    steady = turning(*[(4000.0, 4000.0, 4000.0, 4000.0)] * 10)
    assert est.rotor_speeds(steady, CONFIG, 10.5) == pytest.approx((4000.0,) * 4, rel=1e-3)
    assert est.rotor_speeds(steady, CONFIG, 12.0) is None
    assert est.rotor_speeds(turning(*[(4000.0, 4000.0, 4000.0)] * 10), CONFIG, 10.5) is None


@pytest.mark.parametrize(
    "wrong", [0.0, -60_000.0], ids=["zero among others that turn", "faster than sound"]
)
def test_a_speed_that_cannot_be_is_left_out(wrong: float) -> None:
    full = (4000.0,) * 4
    lost = turning(*[full] * 10, (wrong, *full[1:]))
    assert lost.rotors[0] == turning(*[full] * 10).rotors[0]
    assert lost.rotors[1] != turning(*[full] * 10).rotors[1]


def test_a_speed_whose_packet_count_stands_still_is_an_old_one() -> None:
    speeds = [(4000.0,) * 4] * 3
    held = turning(*speeds, (3000.0,) * 4, counts=(1, 2, 3, 3))
    assert held.rotors == turning(*speeds, counts=(1, 2, 3)).rotors
    never = turning(
        *speeds, (3000.0,) * 4, counts=(7, 7, 7, 7)
    )  # a counter that never moved counts nothing
    assert never.rotors != turning(*speeds, counts=(7, 7, 7)).rotors


def test_a_rotor_that_the_file_does_not_name_is_noticed() -> None:
    assert turning((4000.0,) * 4).undeclared_s == -math.inf
    assert turning((4000.0,) * 4, first=5).undeclared_s == 10.0


def test_the_hottest_esc_counts_and_a_missing_one_does_not() -> None:
    def heat(*celsius: float) -> float | None:
        return est.take_temperatures(blank(), celsius).esc_temperature_c

    assert heat(40.0, 70.0, math.nan, 50.0) == 70.0
    assert heat(math.nan, math.nan) is None


def test_a_range_goes_to_the_sensor_that_looks_the_same_way() -> None:
    b = Bench(height=0.8, wall=0.6)
    b.run(1.0)
    state, t = b.state.estimates, b.t
    assert est.surface(state, CONFIG, "ground", t).distance_m == pytest.approx(0.8, abs=0.01)
    wall = est.surface(state, CONFIG, "wall", t)
    assert wall.normal_ned == pytest.approx((0.0, 1.0, 0.0), abs=1e-6)
    assert (
        est.take_range(state, beam((0.0, 0.0, -1.0), 3.0, t), CONFIG).beams[:2] == state.beams[:2]
    )
    assert est.take_range(state, beam(DOWN, 0.75, t), CONFIG).beams[1] == state.beams[1]
    assert est.take_range(state, beam(RIGHT, 0.6, t), CONFIG).beams[0] == state.beams[0]


def test_a_range_before_any_attitude_is_ignored() -> None:
    unheard = est.blank_estimates(CONFIG.vehicle)
    assert est.take_range(unheard, beam(DOWN, 0.8), CONFIG) == unheard


def test_the_vehicles_own_velocity_is_the_rate_of_a_track() -> None:
    b = Bench(height=0.8)
    b.run(1.0)
    estimates = b.state.estimates
    for k in range(10):
        sample = LocalPosition(b.t + 0.02 * k, 1, 1, (0.0, 0.0, -0.8), (0.0, 0.0, 0.3))
        estimates = est.take_position(estimates, sample)
    assert est.surface(estimates, CONFIG, "ground", b.t + 0.18).rate_m_s == pytest.approx(
        -0.3, abs=0.05
    )


def test_a_position_that_is_set_anew_moves_no_surface() -> None:
    b = Bench(height=0.8)
    b.run(1.0)
    elsewhere = LocalPosition(b.t + 0.02, 1, 1, (2.0, 0.0, -0.8), (0.0, 0.0, 0.0))
    jumped = est.take_position(b.state.estimates, elsewhere)
    assert jumped.reset is not None
    assert jumped.reset.by_ned[0] == pytest.approx(2.0)
    before, after = (est.surface(e, CONFIG, "ground", b.t) for e in (b.state.estimates, jumped))
    assert after.distance_m == pytest.approx(before.distance_m, abs=1e-3)
