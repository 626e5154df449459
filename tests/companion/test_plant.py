"""The hold knows its plant: margins against a simulated loop, gains that follow, the attitude's answer measured."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import numpy as np
import pytest
from flying import bench, with_plant

from companion import refusals
from companion.control import plant, swing_detector
from companion.control.attitude_response import AttitudeResponse, hear_tilt, measured_loop, sent
from companion.control.dead_reckoning import KEPT_S
from companion.control.plant import (
    FULL,
    AttitudeLoop,
    HoldGains,
    Source,
    Timing,
    declared_loop,
    hear_position,
    horizontal_loop,
    margin_of,
    soften,
    tune,
)
from companion.control.reasons import Notice, Reason
from companion.control.swing_detector import SwingDetector, calmed, watch
from companion.control.wall_stability import stiffness_held
from companion.mavlink.firmware import Stack


def swings(
    gains: HoldGains,
    loop: AttitudeLoop,
    late_s: float,
    factor: float = 1.0,
    seconds: float = 60.0,
    stiffness_1_s2: float = 0.0,
) -> float:
    """Growth of a nudge over a minute, by time steps of 5 ms: the linear loop that the margins are computed for."""
    dt = 0.005
    commands = deque([0.0] * (1 + round(loop.delay_s / dt)), maxlen=1 + round(loop.delay_s / dt))
    seen = deque([(0.0, 0.0)] * (1 + round(late_s / dt)), maxlen=1 + round(late_s / dt))
    felt = deque([0.0] * round(late_s / dt), maxlen=round(late_s / dt))
    x = v = first = tilt = mean = integral = 0.0
    v, sizes = 0.05, []
    for _ in range(round(seconds / dt)):
        first += dt / loop.tau_s * (factor * loop.gain * commands[0] - first)
        tilt += dt / loop.tau_s * (first - tilt)
        v += dt * (tilt + stiffness_1_s2 * x)
        x += dt * v
        seen.append((x, v))
        mean += dt / plant.TILT_MEAN_S * (tilt - mean)
        late_x, late_v = seen[0]
        felt.append(tilt - mean)
        gained_v = dt * sum(felt)
        gained_x = dt**2 * sum((len(felt) - k - 0.5) * one for k, one in enumerate(felt))
        now_v = late_v + gained_v
        now_x = late_x + late_s * late_v + gained_x
        slip = -gains.position_1_s * now_x - now_v - gains.tilt_lead_s * (tilt - mean)
        integral += dt * gains.integral_1_s2 * slip
        commands.append(gains.velocity_1_s * slip + integral)
        sizes.append(abs(x))
    part = len(sizes) // 6
    return max(sizes[-part:]) / max(sizes[:part])


@pytest.mark.parametrize(
    "loop", [AttitudeLoop(0.07, 0.10), AttitudeLoop(0.16, 0.02), AttitudeLoop(0.10, 0.20)]
)
@pytest.mark.parametrize("late_s", [0.0, 0.10])
def test_the_gain_margin_is_where_the_simulated_loop_begins_to_swing(loop, late_s):
    led = replace(FULL, tilt_lead_s=0.8 * loop.lag_s)
    margin = margin_of(horizontal_loop(led, loop, late_s)).gain
    assert margin > 1.0
    assert swings(led, loop, late_s, 0.9 * margin if margin < 20.0 else 1.0) < 1.0
    tuned = tune(loop, Timing(position_period_s=0.0, position_late_s=late_s))
    assert swings(tuned.gains, loop, late_s) < 0.05


def test_an_unstable_loop_has_no_margin():
    loop = AttitudeLoop(0.30, 0.30)
    led = replace(FULL, tilt_lead_s=0.0)
    margin = margin_of(horizontal_loop(led, loop, 0.15))
    assert swings(led, loop, 0.15, seconds=20.0) > 1.0
    assert margin.phase_deg < 0.0 or margin.gain < 1.0


def test_the_recorded_slow_loop_rang_as_its_margin_says(monkeypatch):
    """A firmware with ATC_INPUT_TC 0.3 (fitted: tau 0.16 s, delay 0.02 s) rang at 0.4 Hz, 0.77 a cycle, flown with a
    lead of 0.15 s and a mean of 0.4 s: a damping ratio of 0.04, or 4 degrees of phase margin."""
    flown = replace(FULL, tilt_lead_s=0.15, position_1_s=1.8, velocity_1_s=4.0, integral_1_s2=1.35)
    with monkeypatch.context() as then:
        then.setattr(plant, "TILT_MEAN_S", 0.4)
        margin = margin_of(horizontal_loop(flown, AttitudeLoop(0.16, 0.02), 0.01))
    assert margin.phase_deg == pytest.approx(4.0, abs=1.5)
    chosen = tune(AttitudeLoop(0.16, 0.02), Timing())
    assert chosen.margin.phase_deg >= plant._WANTED.phase_deg


def test_slow_loops_and_late_positions_get_softer_gains():
    quick = tune(AttitudeLoop(0.05, 0.08), Timing())
    assert quick.share == quick.climb_share == 1.0
    slow = tune(AttitudeLoop(0.20, 0.10), Timing(position_period_s=0.1))
    assert slow.share < 0.8
    assert slow.gains.tilt_lead_s > quick.gains.tilt_lead_s
    late = tune(AttitudeLoop(0.07, 0.10), Timing(position_period_s=0.1, position_late_s=0.15))
    assert late.share < 0.9
    assert late.climb_share < 0.6
    for tuned in (quick, slow, late):
        assert tuned.margin.meets(plant._WANTED_CLIMB)


@pytest.mark.parametrize("late_s", [0.02, 0.10])
def test_a_slow_attitude_softens_the_position_and_keeps_the_damping(late_s):
    """Softened alike, both gains at 0.34 and 0.29 held pulls of 0.7 and 0.6 1/s^2."""
    slow = tune(AttitudeLoop(0.20, 0.10), Timing(position_period_s=0.10, position_late_s=late_s))
    assert slow.gains.velocity_1_s == FULL.velocity_1_s
    assert slow.gains.position_1_s < 0.7 * FULL.position_1_s
    assert stiffness_held(slow.gains, slow.loop, slow.age_s) > 1.4


def test_a_dead_time_softens_the_damping():
    late = tune(AttitudeLoop(0.03, 0.30), Timing())
    assert late.gains.velocity_1_s < 0.7 * FULL.velocity_1_s


@pytest.mark.parametrize("late_s", [0.05, 0.10, 0.15])
def test_late_positions_of_a_quick_loop_cost_no_gain_since_they_are_carried_on(late_s):
    """By the newest tilt times the age, gains of 0.72 and 0.47 were left at 0.13 and 0.20 s."""
    loop = AttitudeLoop(0.03, 0.08)
    tuned = tune(loop, Timing(position_period_s=0.10, position_late_s=late_s))
    assert tuned.share == 1.0
    assert swings(tuned.gains, loop, tuned.age_s) < 0.05


def test_a_position_older_than_is_carried_on_costs_gain():
    """Counted as carried on for all of its age, 0.6 s were flown with half of the gains."""
    loop = AttitudeLoop(0.05, 0.10)
    shares = [
        tune(loop, Timing(position_period_s=0.0, position_late_s=late_s)).share
        for late_s in (KEPT_S, KEPT_S + 0.2)
    ]
    assert shares[0] > 0.6
    assert shares[1] < refusals._LEAST_SHARE


def test_no_other_pair_of_gains_with_the_margin_pushes_back_harder():
    loop = AttitudeLoop(0.12, 0.12)
    timing = Timing(position_period_s=0.10, position_late_s=0.05)
    chosen = tune(loop, timing)
    led = replace(FULL, tilt_lead_s=0.6 * loop.lag_s)
    for position_share in np.linspace(0.2, 1.0, 9):
        for velocity_share in np.linspace(0.2, 1.0, 9):
            gains = soften(led, position_share=position_share, velocity_share=velocity_share)
            margin = margin_of(horizontal_loop(gains, loop, chosen.age_s))
            if margin.meets(plant._WANTED):
                # The shares that are tried are 15 % apart.
                assert position_share * velocity_share < 1.18 * chosen.share**2


def test_where_no_gains_have_a_margin_the_hold_is_refused():
    hopeless = tune(AttitudeLoop(0.8, 0.5), Timing(position_period_s=0.5, position_late_s=0.4))
    assert not hopeless.margin.meets(refusals._LEAST)
    b = bench()
    b.run(0.1)
    b.state = with_plant(b.state, tuned=hopeless, tuned_s=b.t)
    assert Reason.NO_MARGIN in b.tick().reasons


def test_parameters_say_how_slow_the_attitude_is():
    assert declared_loop(Stack.ARDUPILOT, {}).source is Source.ASSUMED
    slow = declared_loop(Stack.ARDUPILOT, {"ATC_INPUT_TC": 0.3})
    assert slow.source is Source.PARAMETERS
    assert slow.lag_s == pytest.approx(0.36, abs=0.04), "fitted to a recording: 0.34"
    assert declared_loop(Stack.ARDUPILOT, {"ATC_INPUT_TC": 0.15}).lag_s == pytest.approx(
        0.24, abs=0.03
    )
    assert declared_loop(Stack.PX4, {"MC_ROLL_P": 6.5, "MC_PITCH_P": 6.5}).lag_s == pytest.approx(
        0.20, abs=0.03
    )
    assert declared_loop(Stack.PX4, {"MC_ROLL_P": 6.5, "MC_PITCH_P": 3.0}).lag_s > 0.3


def test_rate_and_lateness_of_positions_are_measured():
    timing = Timing()
    for k in range(100):
        timing = hear_position(timing, 10.0 + 0.1 * k, 0.12)
    assert timing.position_period_s == pytest.approx(0.1, abs=0.005)
    assert timing.position_late_s == pytest.approx(0.12, abs=0.005)
    for k in range(500):
        timing = hear_position(timing, 30.0 + 0.02 * k, 0.0)
    assert timing.position_period_s == pytest.approx(0.02, abs=0.002)
    assert timing.position_late_s < 0.005


@pytest.mark.parametrize(
    ("tau", "delay", "gain"), [(0.065, 0.08, 1.0), (0.16, 0.05, 1.0), (0.09, 0.17, 1.3)]
)
def test_the_attitude_loop_is_measured_from_its_own_setpoints(tau, delay, gain):
    rng, dt = np.random.default_rng(3), 0.02
    response, wanted = AttitudeResponse(), np.zeros(2)
    waiting = deque([np.zeros(2)] * (1 + round(delay / dt)), maxlen=1 + round(delay / dt))
    first, tilt = np.zeros(2), np.zeros(2)
    for k in range(1500):
        t = 10.0 + dt * k
        response = hear_tilt(response, t, *(tilt + 0.001 * rng.normal(size=2) + [0.02, -0.01]))
        if k % 25 == 0:
            wanted = math.radians(2.0) * rng.normal(size=2)
        response = sent(response, t, *wanted)
        waiting.append(wanted)
        first = first + (1.0 - math.exp(-dt / tau)) * (gain * waiting[0] - first)
        tilt = tilt + (1.0 - math.exp(-dt / tau)) * (first - tilt)
    loop = measured_loop(response)
    assert loop.source is Source.MEASURED
    assert loop.lag_s == pytest.approx(2.0 * tau + delay, abs=0.05)
    assert loop.gain == pytest.approx(gain, abs=0.11)


def test_nothing_is_measured_without_setpoints_or_from_noise():
    response = AttitudeResponse()
    rng = np.random.default_rng(4)
    for k in range(1000):
        response = hear_tilt(response, 0.02 * k + 1.0, *(0.02 * rng.normal(size=2)))
        response = sent(response, 0.02 * k + 1.0, *(0.02 * rng.normal(size=2)))
    assert measured_loop(response) is None


def fed(signal, seconds=20.0, detector=None):
    detector = detector or SwingDetector()
    for k in range(round(seconds / 0.02)):
        t = 0.02 * k
        detector = watch(detector, 10.0 + t, np.array([signal(t), 0.0, 0.0]))
    return detector


def test_a_growing_or_steady_swing_is_noticed_and_one_that_dies_out_is_not():
    assert fed(lambda t: 1.2 * math.sin(2.5 * t)).level >= 1
    assert fed(lambda t: 0.1 * math.exp(0.15 * t) * math.sin(2.5 * t)).level >= 1
    assert fed(lambda t: 3.0 * math.exp(-0.4 * t) * math.sin(2.5 * t)).level == 0
    assert fed(lambda t: 0.3 * math.sin(2.5 * t)).level == 0, "small"
    assert fed(lambda t: 2.0 if 3.0 < t < 6.0 else 0.0).level == 0, "one gust"


def test_a_swinging_hold_gets_softer_gains_no_offsets_and_says_so():
    b = bench(height=0.3, wall=0.3)
    full = b.run(4.0).tuned.share
    swing = SwingDetector(level=1, swings=1, swung_s=b.t, stepped_s=b.t)
    b.state = with_plant(b.state, swing=swing, tuned_s=-math.inf)
    decision = b.run(0.6)
    assert decision.tuned.share <= 0.61
    assert decision.tuned.share < 0.7 * full
    assert Reason.SWINGING in decision.reasons
    assert decision.offset.share == 0.0
    assert decision.command is not None, "the hold goes on"
    swing = replace(b.state.plant.swing, level=swing_detector.SWING_LEVELS + 1)
    b.state = with_plant(b.state, swing=swing)
    assert Reason.SWINGS_ON in b.tick().reasons
    assert Notice.SOFTENED.value.startswith("swinging")


def test_the_gains_come_back_after_a_calm_twice_as_long_after_each_swing():
    """An hour of flight on a busy computer: one swing, and the hold stayed soft until it was refused for good."""
    calm_s = swing_detector._CALM_S
    once = fed(lambda t: 1.2 * math.sin(2.5 * t) if t < 8.0 else 0.0)
    assert (once.level, once.swings) == (1, 1)
    assert calmed(once, once.swung_s + 0.9 * calm_s).level == 1
    back = calmed(once, once.swung_s + 1.1 * calm_s)
    assert (back.level, back.swings) == (0, 1)
    twice = replace(once, level=1, swings=2)
    assert calmed(twice, once.swung_s + 1.1 * calm_s).level == 1
    assert calmed(twice, once.swung_s + 2.1 * calm_s).level == 0
    gone = replace(once, level=4, swings=4)
    assert calmed(gone, 1e6).level == 4, "a hold that let go for it comes back in another mode only"


@pytest.mark.slow
def test_a_hold_that_swung_once_is_firm_again_two_minutes_later():
    b = bench(height=0.3, wall=0.3)
    full = b.run(4.0).tuned.share
    swing = SwingDetector(level=1, swings=1, swung_s=b.t, stepped_s=b.t)
    b.state = with_plant(b.state, swing=swing, tuned_s=-math.inf)
    assert b.run(1.5).tuned.share < 0.7 * full
    assert b.run(swing_detector._CALM_S).tuned.share == pytest.approx(full)


def test_a_measured_loop_is_kept_while_the_vehicle_hovers_too_quietly_to_measure_it_again():
    b = bench()
    b.run(2.0)
    slow = AttitudeLoop(0.22, 0.12, source=Source.MEASURED)
    b.state = with_plant(b.state, loop=slow, tuned_s=-math.inf)
    decision = b.run(3.0)
    assert decision.tuned.loop.lag_s == pytest.approx(slow.lag_s)
    assert decision.tuned.share < 1.0


def test_a_hold_weaker_than_the_autopilots_own_does_not_engage():
    b = bench(mode=5)
    b.run(2.0)
    slow = AttitudeLoop(0.30, 0.30, source=Source.MEASURED)
    b.state = with_plant(b.state, loop=slow, tuned_s=-math.inf)
    b.mode = 4
    decision = b.run(1.5)
    assert decision.tuned.margin.meets(plant._WANTED), "stable, and too soft"
    assert decision.tuned.share < refusals._LEAST_SHARE
    assert Reason.NO_MARGIN in decision.reasons
    assert decision.command is None
