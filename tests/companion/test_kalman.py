import math
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.estimation import beams, rotors
from companion.estimation.kalman import (
    Outcome,
    Track,
    TrackModel,
    measure,
    measure_rate,
    predict,
    update,
)

MODEL = TrackModel(
    acceleration_sd=1.5, initial_rate_sd=0.5, gate=16.0, restart_after=5, agree_within=0.1
)


def settled(value=1.0, rate=0.0, delay=0.0, n=100):
    track = None
    for i in range(n):
        t = i * 0.05
        track, _ = measure(track, MODEL, t, value + rate * (t - delay), 0.01, delay)
    return track


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_nothing_but_finite_numbers_reaches_the_filter(bad):
    track = settled()
    for value, sigma in ((bad, 0.01), (1.0, bad)):
        after, outcome = measure(track, MODEL, 6.0, value, sigma)
        assert outcome is Outcome.UNUSABLE
        assert after is track
    assert measure_rate(track, MODEL, 6.0, bad, 0.1) is track


def test_a_ramp_seen_late_is_tracked_without_lag():
    rate, delay = 0.4, 0.08
    track = settled(1.0, rate, delay)
    assert track.rate == pytest.approx(rate, abs=0.01)
    assert track.value == pytest.approx(1.0 + rate * track.t_s, abs=0.005)


def test_one_outlier_is_rejected_and_does_not_refresh_the_age():
    track = settled()
    after, outcome = measure(track, MODEL, track.t_s + 0.05, 60.0, 0.01)
    assert outcome is Outcome.OUTLIER
    assert after.value == pytest.approx(1.0, abs=0.01)
    assert after.updated_s == track.updated_s


def test_a_step_of_the_world_restarts_the_track_but_scatter_does_not():
    track = settled()
    t = track.t_s
    outcomes = []
    for i in range(5):
        track, outcome = measure(track, MODEL, t + 0.05 * (i + 1), 2.0, 0.01)
        outcomes.append(outcome)
    assert outcomes == [Outcome.OUTLIER] * 4 + [Outcome.RESTARTED]
    assert track.value == pytest.approx(2.0)
    assert track.restarted_s == pytest.approx(t + 0.25)

    track = settled()
    for i in range(20):
        track, outcome = measure(track, MODEL, track.t_s + 0.001, 5.0 + 3.0 * (i % 2), 0.01)
        assert outcome is Outcome.OUTLIER


def test_the_own_velocity_sharpens_the_rate():
    track = settled(n=5)
    better = measure_rate(track, MODEL, track.t_s + 0.01, 0.2, 0.02)
    assert better.rate_variance < track.rate_variance
    assert better.updated_s == track.updated_s


@given(st.lists(st.tuples(st.floats(0.001, 0.5), st.floats(allow_nan=True, width=32)), max_size=60))
def test_any_stream_leaves_a_finite_state(stream):
    track, t = None, 0.0
    for dt, value in stream:
        t += dt
        track, _ = measure(track, MODEL, t, value, 0.01, 0.03)
    if track is not None:
        state, p = arrays(track)
        assert np.isfinite(state).all()
        assert (np.linalg.eigvalsh(p) > -1e-9 * p.max()).all()


def arrays(track):
    p = [[track.value_variance, track.covariance], [track.covariance, track.rate_variance]]
    return np.array([track.value, track.rate]), np.array(p)


def test_the_two_formulas_are_those_of_filterpy():
    filterpy = pytest.importorskip("filterpy.kalman")
    common = pytest.importorskip("filterpy.common")
    rng = np.random.default_rng(5)
    for _ in range(50):
        x, root, dt = rng.normal(size=2), rng.normal(size=(2, 2)), rng.uniform(0.0, 0.5)
        p, f = root @ root.T, np.array([[1.0, dt], [0.0, 1.0]])
        q = common.Q_discrete_white_noise(dim=2, dt=dt, var=MODEL.acceleration_sd**2)
        track = Track(3.0, *x, p[0, 0], p[0, 1], p[1, 1], 3.0)
        ahead = predict(track, MODEL, 3.0 + dt)
        oracle = filterpy.predict(x, p, f, q)
        for ours, theirs in zip(arrays(ahead), oracle, strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=1e-10, atol=1e-12)
        h, value, variance = rng.normal(size=2), float(rng.normal()), float(rng.uniform(1e-4, 1.0))
        after = update(ahead, value, variance, *h)
        oracle = filterpy.update(
            *arrays(ahead), np.array([value]), np.array([[variance]]), h[None, :]
        )
        for ours, theirs in zip(arrays(after), oracle, strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=1e-8, atol=1e-12)


def stream(seed, n=300):
    """Steps of a clock [s], values and rates of a ramp that is seen with noise; no outlier."""
    rng = np.random.default_rng(seed)
    steps = rng.uniform(0.005, 0.06, n)
    times = np.cumsum(steps)
    return steps, 1.0 + 0.2 * times, 0.2 + 0.05 * rng.normal(size=n), rng.normal(size=n)


@pytest.mark.parametrize(
    ("model", "sigma", "delay"),
    [(beams._TRACK, 0.01, beams._DELAY_S), (rotors._TRACK, rotors._SIGMA_RPM, rotors._DELAY_S)],
)
def test_a_track_of_flight_is_the_filter_that_the_library_designs(model, sigma, delay):
    design = pytest.importorskip("companion.estimation.track_design")
    steps, values, rates, noise = stream(3)
    track = None
    t = 0.0
    for k, (dt, value, rate) in enumerate(zip(steps, values, rates, strict=True)):
        t += dt
        value = float(value + sigma * noise[k])
        if track is None:
            theirs = design.designed(model, value, sigma)
            track, outcome = measure(track, model, t, value, sigma, delay)
            assert outcome is Outcome.RESTARTED
            continue
        design.step_to(theirs, model, float(t - track.t_s))
        if k % 3:
            design.take_value(theirs, value, sigma, delay)
            track, outcome = measure(track, model, t, value, sigma, delay)
            assert outcome is Outcome.ACCEPTED
        else:
            design.take_rate(theirs, float(rate), 0.1)
            track = measure_rate(track, model, t, float(rate), 0.1)
        x, p = arrays(track)
        np.testing.assert_allclose(x, theirs.x, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(p, theirs.P, rtol=1e-7, atol=1e-14)


def test_the_smoother_sees_both_sides_of_a_gap():
    design = pytest.importorskip("companion.estimation.track_design")
    rng = np.random.default_rng(0)
    t = 0.02 * np.arange(400)
    truth = 1.0 + 0.3 * np.sin(t)
    values = truth + 0.02 * rng.normal(size=400)
    values[100:150] = np.nan
    rates = 0.3 * np.cos(t) + 0.1 * rng.normal(size=400)
    found = design.smoothed(MODEL, 0.02, values, rates, sigma=0.02, rate_sigma=0.1)
    assert np.std(found[:, 0] - truth) < 0.3 * 0.02
    assert np.abs(found[100:150, 0] - truth[100:150]).max() < 0.02
    assert np.std(found[:, 1] - 0.3 * np.cos(t)) < 0.3 * 0.1
    with pytest.raises(ValueError, match="begins at a measured value"):
        design.smoothed(MODEL, 0.02, values[100:], rates[100:], sigma=0.02, rate_sigma=0.1)


def test_flight_needs_no_filterpy():
    code = (
        "import sys, companion.flight.loop; "
        "print([m for m in sys.modules if 'filterpy' in m or m == 'scipy'])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"
