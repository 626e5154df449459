"""The boot axis: wraps, reboots, jitter, other clocks."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.mavlink.boot_clock import BootClock, Stamp

UNIX = 1_767_225_600_000_000


def ms(clock, stamp_ms, arrival_us, component=1, system=1):
    return clock.stamped(system, component, Stamp.BOOT_MS, stamp_ms, arrival_us)


def test_stamps_are_the_axis():
    clock = BootClock()
    assert not clock.known
    assert clock.unstamped(UNIX) == 0.0
    assert ms(clock, 42_200, UNIX) == 42.2
    assert clock.system == 1
    assert ms(clock, 42_190, UNIX + 1) == 42.19, "a little out of order is normal"


def test_unstamped_by_the_smallest_latency():
    clock, rng = BootClock(), random.Random(1)
    for k in range(500):
        ms(clock, 1000 + 10 * k, UNIX + 10_000 * k + 300 + int(rng.expovariate(1 / 3000)))
    t = clock.unstamped(UNIX + 10_000 * 500 + 300)
    assert t == pytest.approx(1.0 + 5.0, abs=0.001)
    assert clock.unstamped(0) == 1.0 + 4.99, "never older than the newest stamp"


def test_drift_is_followed():
    clock = BootClock()
    for k in range(0, 3600 * 50):
        t = k * 20_000
        ms(clock, t // 1000 + 1, UNIX + t + t // 10_000 + 1000)  # receiver 100 ppm fast
    t = 3600 * 1_000_000
    assert clock.unstamped(UNIX + t + t // 10_000 + 1000) == pytest.approx(3600.0, abs=0.002)


def late_after(at_s, *, set_back_s=0.0, delay_s=0.0):
    """Lateness [s] of a message at 50 Hz, ``at_s`` after the clock was set back or the link fell behind, at 10 s."""
    clock, late = BootClock(), 0.0
    for k in range(round((10.0 + at_s) * 50)):
        after = k >= 500
        t_s = 1.0 + 0.02 * k - (set_back_s if after else 0.0)
        arrival_us = UNIX + 20_000 * k + (round(delay_s * 1e6) if after else 0)
        late = clock.late(ms(clock, round(1000 * t_s), arrival_us), arrival_us)
    return late, clock.set_back_s


def test_a_link_that_falls_behind_stays_late_and_so_does_a_clock_that_was_set_back_until_it_is_asked():
    assert late_after(20.0, delay_s=0.77) == pytest.approx((0.77, 0.0), abs=0.05)
    assert late_after(20.0, set_back_s=0.77) == pytest.approx((0.77, 0.0), abs=0.05)


@pytest.mark.parametrize("set_back", [False, True], ids=["stood still", "was set back"])
@pytest.mark.parametrize(
    ("under_way_s", "late_s", "stood_s"), [(0.02, 0.0, 0.57), (0.59, 0.57, 0.0)]
)
def test_a_round_trip_tells_a_clock_that_stood_still_from_a_link_that_fell_behind(
    under_way_s, late_s, stood_s, set_back
):
    """The same (arrival - stamp), 0.57 s more from 10 s on: how long the answer was under way decides."""
    clock, late = BootClock(), 0.0
    for k in range(1000):
        behind_us = 570_000 if k >= 500 else 0
        stamp_ms, arrival_us = 1000 + 20 * k, UNIX + 20_000 * k
        if set_back:
            stamp_ms -= behind_us // 1000
        else:
            arrival_us += behind_us
        late = clock.late(ms(clock, stamp_ms, arrival_us), arrival_us)
        if k in (520, 570):
            clock.answered(arrival_us - round(1e6 * under_way_s), 1000 * stamp_ms, arrival_us)
    assert late == pytest.approx(late_s, abs=0.06)
    assert clock.set_back_s == pytest.approx(stood_s, abs=0.03)


def test_one_stamp_that_went_back_is_no_step():
    clock = BootClock()
    for k in range(400):
        ms(clock, 1000 + 20 * k - (500 if k == 100 else 0), UNIX + 20_000 * k)
    assert clock.set_back_s == 0.0
    assert clock.late(1.0 + 0.02 * 399, UNIX + 20_000 * 399) == 0.0


def test_wrap_of_32_bit_milliseconds():
    clock = BootClock()
    before = 2**32 - 50
    assert ms(clock, before, 0) == before / 1000
    assert ms(clock, 10, 60_000) == (2**32 + 10) / 1000
    assert ms(clock, 2**32 - 5, 61_000) == (2**32 - 5) / 1000, "late, from before the wrap"
    assert ms(clock, 30, 80_000) == (2**32 + 30) / 1000
    assert clock.boot == 0


def test_servo_microseconds_wrap_every_72_minutes():
    clock = BootClock()
    true_us = 3 * 2**32 + 1_234_567
    ms(clock, true_us // 1000, UNIX)
    assert clock.stamped(1, 1, Stamp.BOOT_US32, 1_234_567, UNIX) == true_us / 1e6


def test_one_bad_stamp_is_not_a_reboot_and_two_are():
    clock = BootClock()
    for k in range(100):
        ms(clock, 100_000 + 20 * k, 20_000 * k)
    assert ms(clock, 500, 2_000_000) == pytest.approx(102.0, abs=0.03), "put there by arrival"
    assert ms(clock, 102_020, 2_020_000) == 102.02
    assert clock.boot == 0
    ms(clock, 3_000, 9_000_000)
    assert ms(clock, 3_020, 9_020_000) == 3.02
    assert clock.boot == 1
    assert clock.unstamped(9_040_000) == pytest.approx(3.04, abs=1e-6)


def test_a_stamp_from_the_future_moves_nothing():
    clock = BootClock()
    ms(clock, 1000, 0)
    ms(clock, 4_000_000_000, 20_000)
    assert ms(clock, 1040, 40_000) == 1.04
    assert clock.boot == 0


def test_a_gap_is_not_a_reboot():
    clock = BootClock()
    ms(clock, 1000, 0)
    assert ms(clock, 601_000, 600_000_000) == 601.0
    assert clock.boot == 0


def test_unix_stamps_and_other_components_come_onto_the_axis():
    clock = BootClock()
    for k in range(200):
        arrival = UNIX + 10_000 * k
        ms(clock, 5000 + 10 * k, arrival + 2000)
        # The vehicle believes it is another day; a sensor board booted 3 s later.
        unix = clock.stamped(1, 1, Stamp.US64, UNIX + 86_400_000_000 + 10_000 * k, arrival + 2000)
        board = ms(clock, 2000 + 10 * k, arrival + 2000, component=158)
    assert unix == pytest.approx(5.0 + 1.99, abs=1e-6)
    assert board == pytest.approx(5.0 + 1.99, abs=1e-6)
    assert clock.system == 1


def test_microseconds_of_the_same_boot_are_taken_as_they_are():
    clock = BootClock()
    ms(clock, 43_013, UNIX)
    assert clock.stamped(1, 1, Stamp.US64, 43_013_162, UNIX + 5) == 43.013162


def test_another_vehicle_does_not_move_the_axis():
    clock = BootClock(system=1)
    ms(clock, 9_000, 0, system=2)
    assert not clock.known
    ms(clock, 1_000, 10)
    for k in range(5):
        ms(clock, 9_000 + k, 10 + k, system=2)
    assert clock.boot == 0
    assert clock.unstamped(20_010) == 1.02


stamps = st.tuples(
    st.integers(0, 2**32 - 1),
    st.integers(0, 2**63),
    st.sampled_from([0, 1, 2, 158]),
    st.sampled_from(list(Stamp)),
)


@settings(max_examples=200)
@given(st.lists(stamps, max_size=50))
def test_any_stamps_give_finite_times_and_the_same_again(messages):
    def run():
        clock = BootClock()
        return [clock.stamped(1, c, unit, s, a) for s, a, c, unit in messages]

    first = run()
    assert all(0.0 <= t < float("inf") for t in first)
    assert first == run()
