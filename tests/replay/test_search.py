"""The search for effects: what it may name, what it must refuse, on made-up residuals of known noise."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_up import biased
from noise_records import coloured, noise_record
from patience import HANG_S
from regression import kernels

import replay.search
from models.common.frames import Array
from models.effects import Effect, adopted_wrench, catalogue, get
from models.vehicle import Throttle
from replay.diagnosis.diagnose import conclude
from replay.residual.record import Record
from replay.search import results
from replay.search.channel import hundredths
from replay.search.curves import LEANS, curves
from replay.search.design import Design
from replay.search.estimates import IntervalEstimate
from replay.search.evidence import Evidence, Fit
from replay.search.library import Library
from replay.search.noise import Noise
from replay.search.noise_spectra import spectra, valid_before, whitened_energies
from replay.search.posterior import canonical
from replay.search.regimes import regimes
from replay.search.remainder import beside_surfaces, outside
from replay.search.results import Found, Searched, summarise
from replay.search.significance import Contributions, tops
from replay.search.terms import Term
from replay.search.walk import walk


@pytest.fixture(scope="module")
def quiet() -> Record:
    """Ninety seconds of noise."""
    return noise_record(11, 90.0, 0.3)


def some(*names: str) -> list[Effect]:
    """These effects of the catalogue."""
    return [e for e in catalogue() if e.name in names]


def added(record: Record, name: str, shape: tuple[float, ...], *coefficients: float) -> Record:
    """The record with an effect's wrench in its residual (a term of the catalogue: plumbing, not physics).

    Coefficients that are not given are 0.
    """
    x = np.nan_to_num(get(name).regressors(record.context, shape))
    return replace(
        record, residual=record.residual + x[..., : len(coefficients)] @ np.array(coefficients)
    )


def with_context(record: Record, **changes: object) -> Record:
    """The record with another context."""
    return replace(record, context=replace(record.context, **changes))


def pumped(record: Record, felt: float = 1.0) -> Record:
    """The record with quick changes of thrust, of which the accelerometer feels a share."""
    state = record.context.state
    rng = np.random.default_rng(7)
    kernel = np.hanning(9) / np.hanning(9).sum()
    more = (
        1.0
        + 0.05
        * np.convolve(coloured(rng, len(record.time_s), 0.5, record.step_s), kernel, "same")[
            :, None
        ]
    )
    force = state.specific_force * (1.0 + felt * (more - 1.0))
    changed = replace(state, rpm=state.rpm * np.sqrt(more), specific_force=force)
    return with_context(record, state=changed, commanded=1.0)


def search(records: Record | list[Record], effects: list[Effect]) -> Searched:
    """The answer to one record or several."""
    return summarise(walk(records if isinstance(records, list) else [records], effects))


def names(answer: Searched) -> set[str]:
    """What was found."""
    return {f.effect.name for f in answer.found}


def found(answer: Searched, name: str) -> Found:
    """One effect that was found."""
    return next(f for f in answer.found if f.effect.name == name)


def estimate(answer: Searched, effect: str, parameter: str) -> tuple[float, float, float]:
    """Low end, value and high end of a parameter that was found."""
    e = next(e for e in found(answer, effect).estimates if e.name == parameter)
    return e.ci95[0], e.value, e.ci95[1]


def reason(answer: Searched, name: str) -> tuple[str, bool]:
    """Why an effect was not adopted, and whether the flight could have shown it."""
    one = next(r for r in answer.rejected if r.name == name)
    return one.reason, one.excited


def test_noise_has_no_name(quiet: Record) -> None:
    answer = search(quiet, list(catalogue()))
    assert names(answer) == set()
    assert answer.traces[0].carriers == ()
    assert answer.traces[0].outside == ()


def test_where_no_axis_can_be_judged_the_verdict_says_so(quiet: Record) -> None:
    blown = added(quiet, "imu_bias", (), 2.0)
    for record in (replace(quiet, axes=()), replace(blown, axes=(), blind=(0,))):
        answer = conclude([record])
        assert answer.verdict == "not_judged"
        assert answer.found == ()


def test_shares_add_up_to_all_at_most(quiet: Record) -> None:
    one = found(search(added(quiet, "imu_bias", (), 0.5), some("imu_bias")), "imu_bias")
    shares = [
        f.explains
        for f in results._at_most_all([replace(one, explains=e) for e in (1.17, 0.6, -0.1)])
    ]
    assert sum(s for s in shares if s > 0.0) == pytest.approx(1.0)
    assert shares[0] / shares[1] == pytest.approx(1.17 / 0.6)
    assert results._at_most_all([one]) == [one]


@pytest.mark.parametrize(
    ("low", "high", "most"), [(-0.003, 0.353, 0.975), (0.01, 0.35, 1.0), (-0.3, 0.5, 0.75)]
)
def test_no_more_is_claimed_of_an_effect_than_of_the_sign_of_its_size(
    low: float, high: float, most: float
) -> None:
    assert (
        IntervalEstimate(
            name="pull", value=(low + high) / 2.0, ci95=(low, high), unit="1"
        ).sign_probability
        <= most
    )


def test_what_a_flight_says_nothing_about_is_not_printed(quiet: Record) -> None:
    flown = conclude(
        [added(pumped(quiet), "thrust_curve", (), 0.3, 0.0)], effects=some("thrust_curve")
    )
    (one,) = flown.found
    unknown = replace(one.estimates[-1], name="what", determined=False)
    text = replace(flown, found=(replace(one, estimates=(*one.estimates, unknown)),))
    assert "what =" not in text.as_text()
    assert "slope =" in text.as_text()


def test_whitening_leaves_unit_variance_and_is_exact_after_gaps() -> None:
    rng = np.random.default_rng(0)
    x = np.stack([coloured(rng, 4000, 1.0, 0.2) for _ in range(2)], axis=1)
    valid = np.ones(4000, bool)
    valid[1000:1100] = valid[2003] = False
    run = valid_before(valid)
    assert run[1100] == 0
    assert run[2004] == 0
    bank = spectra(0.2)
    spectrum = next(s for s in bank if s.slow_s == 1.0 and s.slow_share == 0.75)
    white = spectrum.whiten(x[:, 0], run)
    assert not white[~valid].any()
    assert white[valid].std() == pytest.approx(1.0, abs=0.35)
    found = whitened_energies(
        np.stack([s.filters for s in bank]), np.where(valid, x[:, 0], 0.0)[None], run
    )[0]
    assert found[bank.index(spectrum)] == pytest.approx(float(white @ white))


@pytest.mark.slow
def test_a_lag_is_refused_where_the_thrust_only_answers_noise(quiet: Record) -> None:
    late = added(pumped(quiet), "motor_lag", (0.2, 0.0), 1.0)
    assert names(search(late, some("motor_lag", "wind"))) == {"motor_lag"}
    # A hover of which the accelerometer feels a third: an artanh of 0.3 beside one of 0.6, known to 0.12.
    assert names(search(with_context(late, commanded=0.0), some("motor_lag", "wind"))) == set()


def test_thrust_that_answers_a_loss_of_lift_is_no_flat_curve(quiet: Record) -> None:
    """Lift that is missing goes with more thrust either way: by the curve, or because the loop took a loss off."""
    flat, answered = (
        added(pumped(quiet, felt), "thrust_curve", (), -0.3, 0.0) for felt in (0.7, 0.0)
    )
    low, value, high = estimate(search(flat, some("thrust_curve")), "thrust_curve", "slope")
    assert low < -0.3 < high
    assert value == pytest.approx(-0.3, abs=0.06)
    assert names(search(answered, some("thrust_curve"))) == set()


def test_a_lag_that_the_clock_may_have_made_is_not_tried(quiet: Record) -> None:
    shapes = get("motor_lag").shape_grid(replace(quiet.context, clock_moved_s=0.09))
    assert min(tau + dead for tau, dead in shapes) >= 0.125


def test_the_ratio_of_thrust_to_mass_gets_one_name_with_its_aliases(quiet: Record) -> None:
    answer = search(
        added(quiet, "thrust_scale", (), -0.05), some("thrust_scale", "payload", "battery_sag")
    )
    assert len(names(answer)) == 1
    assert {answer.found[0].effect.name, *answer.found[0].aliases} >= {"thrust_scale", "payload"}


def test_more_lift_than_declared_is_no_load(quiet: Record) -> None:
    assert names(
        search(added(quiet, "thrust_scale", (), 0.05), some("thrust_scale", "payload"))
    ) == {"thrust_scale"}


def test_noise_of_the_voltage_leaves_the_packs_power(quiet: Record) -> None:
    """Thrust follows the pack's voltage; telemetry adds noise as large as what the pack does within seconds."""
    state = quiet.context.state
    true = 25.0 - 1.0 * (state.time_s - state.time_s[0]) / np.ptp(state.time_s)
    noisy = true + 0.1 * np.random.default_rng(5).standard_normal(len(true))
    sagging = added(
        with_context(quiet, state=replace(state, battery_voltage_v=true)),
        "battery_sag",
        (25.0,),
        2.0,
        0,
        0,
    )
    seen = with_context(sagging, state=replace(state, battery_voltage_v=noisy))
    low, value, high = estimate(
        search(seen, some("battery_sag", "thermal_derating")), "battery_sag", "power"
    )
    assert low < 2.0 < high
    assert value == pytest.approx(2.0, abs=0.4)


def test_a_load_has_no_error_of_form_that_is_a_thrust_curve(quiet: Record) -> None:
    """Newton's second law is exact: lift that grows with the thrust is no load, whatever else it is."""
    state = quiet.context.state
    more = 1.0 + 0.3 * np.sin(state.time_s)[:, None]
    force = state.specific_force * more
    stepped = with_context(
        quiet, state=replace(state, rpm=state.rpm * np.sqrt(more), specific_force=force)
    )
    library = Library([stepped], some("payload", "thrust_scale"))
    bent = {t.name: bool(t.form.any()) for t in library.terms if t.effect is not None}
    assert bent == {"payload": False, "thrust_scale": True}


def test_without_moments_no_fan_is_blamed(quiet: Record) -> None:
    forces = replace(quiet, axes=(0, 1, 2))
    weak = added(forces, "fan_imbalance", (1.0,), -0.1, 0.0)
    answer = search(weak, some("fan_imbalance", "cg_offset", "thrust_scale"))
    assert "fan_imbalance" not in names(answer)
    assert reason(answer, "fan_imbalance") == ("this log cannot judge moments", False)


@pytest.mark.slow
def test_a_weak_fan_is_one_finding_and_lists_what_it_may_be_instead(quiet: Record) -> None:
    answer = search(added(quiet, "fan_imbalance", (1.0,), -0.1, 0.0), list(catalogue()))
    assert names(answer) == {"fan_imbalance"}
    assert "cg_offset" in found(answer, "fan_imbalance").aliases
    low, value, high = estimate(answer, "fan_imbalance", "scale")
    assert low <= -0.1 <= high
    assert value == pytest.approx(-0.1, abs=0.03)


def test_a_shape_that_is_not_worth_a_name_gives_way_to_one_that_is(quiet: Record) -> None:
    """Beside an offset a ground effect fits best so long that it is next to constant: a shorter one is tried, too."""
    state = quiet.context.state
    low = with_context(
        quiet, state=replace(state, h_m=state.h_m - 0.9 * quiet.context.vehicle.rotor_radius_m)
    )
    both = added(
        added(low, "imu_bias", (), 0.16, -0.3, 0.2, 0.0, 0.0), "ground_effect", (0.45,), 0.08
    )
    answer = search(both, some("imu_bias", "ground_effect"))
    assert names(answer) == {"imu_bias", "ground_effect"}
    assert estimate(answer, "ground_effect", "length_radii")[1] < 0.6


def test_what_is_below_a_hundredth_of_the_weight_is_not_named(quiet: Record) -> None:
    calm = replace(quiet, residual=0.1 * quiet.residual)
    assert names(search(added(calm, "thrust_scale", (), -0.005), some("thrust_scale"))) == set()
    assert names(search(added(calm, "thrust_scale", (), -0.02), some("thrust_scale"))) == {
        "thrust_scale"
    }


def test_a_range_offset_is_reported_in_metres(quiet: Record) -> None:
    answer = search(added(quiet, "range_offset", (0.06,), 0.06), some("range_offset"))
    low, value, high = estimate(answer, "range_offset", "offset_m")
    assert low < value < high
    assert value == pytest.approx(0.06, abs=0.015)


def test_a_moment_in_time_has_an_interval_that_holds_it(quiet: Record) -> None:
    middle = float(quiet.time_s[400]) + 0.7
    carried = added(quiet, "payload", (), 0.3)
    late = (quiet.time_s >= middle)[:, None]
    picked_up = replace(quiet, residual=np.where(late, carried.residual, quiet.residual))
    answer = search(picked_up, some("payload", "thrust_scale"))
    assert names(answer) == {"payload"}
    low, _, high = estimate(answer, "payload", "from_s")
    assert low <= middle <= high
    assert 0.0 < high - low < 10.0


@pytest.mark.slow
def test_a_parameter_at_the_edge_of_what_was_tried_is_marked(quiet: Record) -> None:
    slow = added(pumped(quiet), "motor_lag", (0.7, 0.0), 1.0)
    answer = search(slow, some("motor_lag"))
    edge = {e.name: e.at_bound for e in found(answer, "motor_lag").estimates}
    assert edge["tau_s"] or edge["gain"]
    inside = search(added(pumped(quiet), "motor_lag", (0.2, 0.0), 1.0), some("motor_lag"))
    assert not found(inside, "motor_lag").at_bound


def straight(record: Record) -> Record:
    """The same flight with the nose kept north."""
    still = np.broadcast_to(np.eye(3), record.context.state.rotation.shape)
    return with_context(record, state=replace(record.context.state, rotation=still))


@pytest.mark.slow
def test_without_a_turn_an_offset_and_drag_pass_for_wind(quiet: Record) -> None:
    effects = some("wind", "imu_bias", "rotor_drag")
    unknown = replace(quiet, kinematic_bias=np.full_like(quiet.kinematic_bias, np.nan))
    ahead = search(added(straight(unknown), "wind", (0.0,), 0.6, 0.5, 1.0, 0.0), effects)
    assert {n for f in ahead.found for n in (f.effect.name, *f.aliases)} >= {
        "wind",
        "imu_bias",
        "rotor_drag",
    }
    turned = search(added(unknown, "wind", (0.0,), 0.6, 0.5, 1.0, 0.0), effects)
    assert (names(turned), turned.found[0].aliases) == ({"wind"}, ())


def test_velocity_decides_what_is_the_accelerometers_own(quiet: Record) -> None:
    offset = np.array([0.4, -0.3, 0.0])
    biased = added(straight(quiet), "imu_bias", (), *offset, 0.0, 0.0)
    told = replace(biased, kinematic_bias=np.broadcast_to(offset, quiet.kinematic_bias.shape))
    assert names(search(told, some("imu_bias", "wind", "rotor_drag"))) == {"imu_bias"}


def in_short_runs(record: Record, level: float) -> Record:
    """Runs of 8 s with gaps, in which lift lacks a share ``level`` of the weight beside some slow noise."""
    weight = record.context.weight
    slow = coloured(np.random.default_rng(101), len(record.time_s), 3.0, record.step_s)
    residual = record.residual.copy()
    residual[:, 2] += (level + 0.005 * slow) * weight
    valid = (record.time_s - record.time_s[0]) % 9.0 < 8.0
    residual[~valid] = np.nan
    return replace(record, residual=residual, valid=valid)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_level_that_is_the_same_in_every_short_run_is_no_slow_noise(seed: int) -> None:
    """Air that lifts a twentieth of the weight for ten seconds, always the same way: no gust lasts as long."""
    record = noise_record(seed, 27.0, 0.3)
    effects = some("payload", "thrust_scale", "imu_bias", "battery_sag", "ground_effect")
    answer = search(in_short_runs(record, -0.0425), effects)
    (one,) = answer.found
    assert {one.effect.name, *one.aliases} >= {"thrust_scale", "payload"}
    assert names(search(in_short_runs(record, 0.0), effects)) == set()


def leaning(record: Record) -> Record:
    """The record with a pitch and a roll that go with the speed, as in steady flight."""
    speed = record.context.velocity
    noise = np.random.default_rng(3).normal(0.0, 0.005, (2, len(speed)))
    leant = {"pitch_rad": -0.1 * speed[:, 0] + noise[0], "roll_rad": 0.1 * speed[:, 1] + noise[1]}
    return replace(record, channels=record.channels | leant)


def test_no_curve_over_attitude_says_what_drag_does(quiet: Record) -> None:
    answer = search(leaning(added(quiet, "rotor_drag", (0.0,), 1.2)), list(catalogue()))
    assert names(answer) == {"rotor_drag"}
    assert answer.traces[0].carriers == ()


def gusty(record: Record) -> Record:
    """A steady push to the left with gusts of 3 s; the vehicle leans against both."""
    gusts = coloured(np.random.default_rng(8), len(record.time_s), 3.0, record.step_s)
    force = 0.1 * (1.0 + 0.2 * gusts)
    residual = record.residual.copy()
    residual[:, 1] -= force * record.context.weight
    return replace(record, residual=residual, channels=record.channels | {"roll_rad": force})


def test_how_a_vehicle_leans_against_the_wind_is_no_cause(quiet: Record) -> None:
    """The roll says all of the force, as it is what holds the vehicle against it."""
    answer = search(gusty(quiet), list(catalogue()))
    assert LEANS.keys().isdisjoint(c.name for c in answer.traces[0].carriers)


def without_accelerometer(record: Record) -> Record:
    """The record with an acceleration that is computed from the velocity."""
    unknown = np.full_like(record.kinematic_bias, np.nan)
    return with_context(replace(record, kinematic_bias=unknown), accelerometer=False)


def test_an_accelerometer_that_is_not_there_has_no_offset(quiet: Record) -> None:
    """A steady push of an eighth of the weight on one heading, as a fan wind of 4 m/s makes it: no mounting does."""
    pushed = straight(without_accelerometer(quiet))
    residual = pushed.residual.copy()
    residual[:, 0] -= 0.12 * pushed.context.weight
    answer = search(
        replace(pushed, residual=residual), some("imu_bias", "mounting_tilt", "wind", "rotor_drag")
    )
    assert names(answer) == {"wind"}
    why, excited = reason(answer, "imu_bias")
    assert "there is no accelerometer" in why
    assert not excited


def test_rotors_askew_in_the_frame_of_the_attitude_are_no_offset(quiet: Record) -> None:
    askew = added(without_accelerometer(quiet), "mounting_tilt", (), 0.04, 0.0)
    effects = some("imu_bias", "mounting_tilt", "wind", "rotor_drag")
    answer = search(askew, effects)
    assert names(answer) == {"mounting_tilt"}
    assert estimate(answer, "mounting_tilt", "pitch")[1] == pytest.approx(0.04, abs=0.005)
    measured = search(added(quiet, "mounting_tilt", (), 0.04, 0.0), effects)
    assert "mounting_tilt" not in names(measured)


def test_no_autopilot_flies_with_an_offset_of_a_tenth_of_the_weight(quiet: Record) -> None:
    answer = search(added(straight(quiet), "imu_bias", (), 1.0), some("imu_bias", "wind"))
    assert "imu_bias" not in names(answer)


def test_a_force_that_is_not_judged_is_not_named(quiet: Record) -> None:
    moments = replace(added(quiet, "ground_effect", (1.5,), -1.5), axes=(3, 4, 5))
    answer = search(moments, some("ground_effect", "cg_offset"))
    assert "ground_effect" not in names(answer)
    assert reason(answer, "ground_effect") == (
        "this log cannot judge the force that it makes",
        False,
    )


def strange(record: Record, newtons: float, mean: float = 0.0) -> tuple[Record, Array]:
    """The record with a vertical force that goes with a logged channel of its own, and that channel."""
    slow = np.cumsum(np.random.default_rng(3).standard_normal(len(record.time_s)))
    slow = (slow - slow.mean()) / slow.std()
    pull = np.zeros_like(record.residual)
    pull[:, 2] = newtons * slow + mean
    channels = {**record.channels, "pressure_pa": slow}
    return replace(record, residual=record.residual + pull, channels=channels), slow


@pytest.mark.slow
def test_an_unknown_force_is_a_channel_and_no_name(quiet: Record) -> None:
    record, _ = strange(quiet, 1.0)
    answer = search(record, list(catalogue()))
    assert names(answer) == set()
    assert "pressure_pa" in [c.name for c in answer.traces[0].carriers][:3]


@pytest.mark.slow
@pytest.mark.parametrize(("share", "channels"), [(0.45, []), (1.5, ["down_m"])])
def test_a_channel_that_carries_next_to_nothing_is_not_reported(
    quiet: Record, share: float, channels: list[str]
) -> None:
    """A range that reads 2 cm too little leaves half a hundredth of the weight near the ground."""
    height = -quiet.context.state.position_ned[:, 2]
    near = np.exp(-height / 0.2)
    near = (near - near.mean()) / near.std()
    residual = 0.5 * quiet.residual
    residual[:, 2] += share * 0.01 * quiet.context.weight * near
    (trace,) = search(replace(quiet, residual=residual), []).traces
    assert [c.name for c in trace.carriers[:1]] == channels


def test_what_an_accelerometer_reads_causes_no_force(quiet: Record) -> None:
    """It reads drag and the pull of a wall, with which lift changes, too."""
    over = {c.name for c in curves([quiet])}
    assert "pitch_rad" in over
    assert not {f"a{axis}_m_s2" for axis in "xyz"} & over


@pytest.mark.slow
def test_a_force_that_waves_over_the_place_is_found_there(quiet: Record) -> None:
    """Three waves and more over where the vehicle flew, as over a grate."""
    residual = quiet.residual.copy()
    north = quiet.context.state.position_ned[:, 0]
    residual[:, 2] += 0.04 * quiet.context.weight * np.sin(2.0 * np.pi * north / 0.4)
    (trace,) = search(replace(quiet, residual=residual), []).traces
    (carrier,) = trace.carriers
    assert carrier.name == "north_m"
    assert carrier.score > 0.5


def test_lift_that_the_wind_gives_is_no_scale_of_the_thrust(quiet: Record) -> None:
    """Air that moves across the discs lifts them all the time."""
    windy = added(quiet, "wind", (0.0,), 4.0, -2.0, 0.7, 0.0, 0.0, 0.04)
    answer = search(windy, some("wind", "thrust_scale", "payload"))
    assert names(answer) == {"wind"}
    low, _, high = estimate(answer, "wind", "lift")
    assert low < 0.04 < high


def test_a_wall_that_takes_lift_is_no_corner(quiet: Record) -> None:
    walled = added(quiet, "wall_effect", (1.1,), 0.1, 0.2, -0.08)
    answer = search(walled, some("wall_effect", "corner_effect", "ground_effect"))
    assert names(answer) == {"wall_effect"}
    low, _, high = estimate(answer, "wall_effect", "lift")
    assert low < -0.08 < high


@pytest.mark.slow
def test_a_constant_beside_an_unknown_force_may_be_its_mean(quiet: Record) -> None:
    effects = some("thrust_scale")
    assert names(search(strange(quiet, 1.0, 0.9)[0], effects)) == set()
    assert names(search(strange(quiet, 1.0, 6.0)[0], effects)) == {"thrust_scale"}


def test_a_slow_disturbance_that_no_channel_carries_is_reported_with_when(quiet: Record) -> None:
    t = quiet.time_s - quiet.time_s[0]
    rest = np.zeros_like(quiet.residual)
    rest[:, 2] = np.where((t > 30.0) & (t < 45.0), 5.0, 0.0)
    (slow,) = outside(quiet, rest)
    assert slow.axis == "Fz"
    assert slow.rms == pytest.approx(5.0 * np.sqrt(15.0 / 90.0), rel=0.1)
    (when,) = slow.intervals_s
    assert when == pytest.approx((quiet.time_s[0] + 30.0, quiet.time_s[0] + 45.0), abs=1.5)
    assert outside(quiet, 0.1 * rest) == ()


def test_what_is_left_beside_a_surface_is_what_is_not_left_away_from_it(quiet: Record) -> None:
    masks = regimes(quiet)
    unit = float(hundredths(quiet.context)[0])
    rest = np.zeros_like(quiet.residual)
    rest[:, 0] = 0.8 * unit
    assert beside_surfaces(quiet, rest) == []
    rest[masks["wall"] | masks["corner"], 0] = 0.2 * unit
    left = beside_surfaces(quiet, rest)
    assert {(o.axis, o.regime) for o in left} == {("Fx", "wall"), ("Fx", "corner")}
    assert left[0].rms == pytest.approx(0.6 * unit)
    # A flight that was never away from the surfaces has nothing to compare with.
    never_away = replace(quiet, valid=quiet.valid & ~masks["far"])
    assert {o.regime for o in beside_surfaces(never_away, rest)} == {"low"}


def test_a_quick_force_above_two_percent_is_no_explained_flight(quiet: Record) -> None:
    weight = quiet.context.weight
    rest = np.zeros_like(quiet.residual)
    rest[:, 2] = 0.01 * weight * np.sin(2.0 * np.pi * 1.7 * quiet.time_s)
    assert outside(quiet, 2.0 * rest) == ()
    assert [o.axis for o in outside(quiet, 3.5 * rest)] == ["Fz"]  # RMS: 2.5 % of the weight


def test_a_moment_that_swings_at_one_frequency_is_no_explained_flight(quiet: Record) -> None:
    """Slower than 1 s it is averaged away by half, and it is smaller than what unsteady air may leave."""
    unit = float(hundredths(quiet.context)[3])
    swing = np.sqrt(2.0) * np.sin(2.0 * np.pi * 0.56 * quiet.time_s)
    noise = np.random.default_rng(4).normal(size=len(swing))
    rest = np.zeros_like(quiet.residual)
    rest[:, 3] = unit * (2.0 * swing + 0.3 * noise)
    (told,) = outside(quiet, rest)
    assert told.axis == "Mx"
    assert told.rms == pytest.approx(2.0 * unit, rel=0.1)
    assert told.swing_hz == pytest.approx(0.56, abs=0.02)
    assert outside(quiet, 0.5 * rest) == ()
    rest[:, 3] = 2.0 * unit * noise
    assert outside(quiet, rest) == ()
    rest[:, 3] = unit * (1.6 * swing + 1.6 * noise)
    assert outside(quiet, rest) == ()


def sets(**scores: float) -> list[Fit]:
    """Fits of sets whose terms are the letters of their names; x, y, z are free curves."""
    none = np.empty(0)
    terms = {
        letter: Term(
            name=letter,
            effect=None if letter in "xyz" else get("payload"),
            shape=(),
            columns=none.astype(int),
            scale=none,
            centre=none,
            low=none,
            high=none,
            log_shape=0.0,
            log_odds=0.0,
            main=none,
            places={},
        )
        for letter in sorted(set("".join(scores)))
    }
    return [
        Fit(terms=tuple(terms[x] for x in name), b=none, cov=none, noise=Noise((), ()), prior=s)
        for name, s in scores.items()
    ]


def test_near_ties_go_to_fewer_terms_and_a_part_needs_more() -> None:
    def answer(**scores: float) -> str:
        return "".join(t.name for t in canonical(sets(**scores)).terms)

    assert answer(ab=10.0, c=7.0) == "c"
    assert answer(ab=10.0, c=5.0) == "ab"
    assert answer(ab=10.0, a=9.5) == "a"
    assert answer(ab=10.0, a=8.0) == "ab"
    # What is no better than a part of the best set does not stand in for it.
    assert answer(ab=10.0, a=8.0, c=7.0) == "ab"


def test_a_set_that_grows_keeps_what_is_not_worth_a_name_yet() -> None:
    (fit,) = sets(a=10.0)
    fit = replace(fit, significance=-2000.0)
    assert fit.score == pytest.approx(-1990.0)
    assert fit.score_at_any_size == pytest.approx(10.0)


def test_a_clock_that_is_off_is_no_lag(quiet: Record) -> None:
    late = added(pumped(quiet), "motor_lag", (0.0, 0.04), 1.0)
    assert names(search(late, some("motor_lag"))) == set()


def test_a_clock_that_is_off_leaves_nothing_beside_a_gap(quiet: Record) -> None:
    late = added(pumped(quiet), "motor_lag", (0.0, 0.04), 1.0)
    rpm, valid = late.context.state.rpm.copy(), late.valid.copy()
    gaps = [slice(i, i + 5) for i in range(0, 800, 100)]
    for gap in gaps:
        rpm[gap], valid[gap] = np.nan, False
    torn = replace(with_context(late, state=replace(late.context.state, rpm=rpm)), valid=valid)
    evidence = Evidence(Library([torn], []))
    fit = evidence.fit([], evidence.noises.unfitted)
    moved = np.abs(evidence.library.trim_wrench(0, fit.b))[valid, 2]
    assert moved.max() < 8.0 * np.sqrt((moved**2).mean())
    assert search(torn, []).traces[0].outside == ()


@pytest.mark.slow
def test_motion_that_answers_disturbances_is_no_drag_that_pushes(quiet: Record) -> None:
    """In hover the vehicle goes where a disturbance pushed it: that must not turn a moment into wind."""
    heavy_nose = added(straight(quiet), "cg_offset", (), 0.012, -0.008)
    pushed = added(heavy_nose, "wind", (1.7,), 0.0, 0.0, -0.4, -2.0)
    assert names(search(pushed, some("wind", "cg_offset"))) == {"cg_offset"}


def test_an_effect_of_the_wrong_sign_has_no_name_for_what_goes_along_with_it(quiet: Record) -> None:
    wrong = added(quiet, "vertical_inflow", (), -3.0, -60.0, 0.0, 0.0)
    assert names(search(wrong, some("vertical_inflow"))) == set()


def test_an_accelerometer_a_little_askew_is_no_finding(quiet: Record) -> None:
    askew = quiet.residual.copy()
    askew[:, 1] += 0.008 * quiet.context.weight
    answer = search(replace(quiet, residual=askew), some("imu_bias"))
    assert names(answer) == set()
    assert answer.traces[0].outside == ()


def swung(record: Record) -> Record:
    """The record with rates of a vehicle that rolls and pitches to and fro by twelve degrees."""
    state = record.context.state
    t = state.time_s
    rates = state.rates + np.stack(
        [0.9 * np.cos(4.3 * t), 1.0 * np.cos(5.1 * t + 1.0), 0.0 * t], axis=1
    )
    return with_context(record, state=replace(state, rates=rates))


@pytest.mark.slow
def test_an_accelerometer_off_the_centre_of_gravity_is_no_finding(quiet: Record) -> None:
    """What it feels of turning goes along with whatever turns the vehicle: fans, outputs, tilt, drag."""
    flown = swung(quiet)
    rates, at = flown.context.state.rates, np.array([0.01, -0.01, -0.05])
    turn = np.gradient(rates, flown.step_s, axis=0)
    residual = flown.residual.copy()
    residual[:, :3] += flown.context.vehicle.mass_kg * (
        np.cross(turn, at) + np.cross(rates, np.cross(rates, at))
    )
    answer = search(replace(flown, residual=residual), list(catalogue()))
    assert names(answer) == set()
    (trace,) = answer.traces
    assert not trace.carriers
    assert not trace.outside


def test_two_laws_of_drag_are_told_where_both_act(quiet: Record) -> None:
    """Linear drag took over from quadratic drag, and came out twice as large as it is."""
    calm = replace(quiet, residual=0.4 * quiet.residual)
    velocity = calm.context.state.velocity_ned
    fast = with_context(calm, state=replace(calm.context.state, velocity_ned=12.0 * velocity))
    linear = added(fast, "rotor_drag", (0.0,), 0.1)
    both = added(linear, "body_drag", (), 0.8, 0.8)
    answer = search(both, some("rotor_drag", "body_drag"))
    assert names(answer) == {"rotor_drag", "body_drag"}
    assert estimate(answer, "rotor_drag", "drag")[1] == pytest.approx(0.1, abs=0.03)
    assert estimate(answer, "body_drag", "front")[1] == pytest.approx(0.8, abs=0.15)
    assert names(search(linear, some("rotor_drag", "body_drag"))) == {"rotor_drag"}


@pytest.mark.slow
def test_a_late_velocity_leaves_no_second_effect_beside_drag(quiet: Record) -> None:
    state = quiet.context.state
    velocity = np.stack(
        [np.sin(3.1 * state.time_s), np.cos(2.6 * state.time_s), 0.0 * state.time_s], axis=1
    )
    fast = with_context(quiet, state=replace(state, velocity_ned=3.0 * velocity))
    drag = added(replace(fast, residual=0.0 * quiet.residual), "rotor_drag", (0.0,), 0.3).residual
    late = quiet.residual + drag + 0.06 * np.gradient(drag, quiet.step_s, axis=0)
    answer = search(replace(fast, residual=late), list(catalogue()))
    assert names(answer) == {"rotor_drag"}
    assert not answer.traces[0].carriers


def test_drag_grows_where_the_vehicle_sinks_and_lift_where_it_flies_level(quiet: Record) -> None:
    state = quiet.context.state
    velocity = np.stack(
        [np.sin(0.8 * state.time_s), np.cos(0.6 * state.time_s), np.sin(0.5 * state.time_s)], axis=1
    )
    fast = with_context(quiet, state=replace(state, velocity_ned=3.0 * velocity))
    flown = added(
        added(fast, "rotor_drag", (0.0,), 0.6, 0.0, 0.5),
        "vertical_inflow",
        (),
        3.0,
        0.0,
        0.0,
        0.0,
        0.4,
    )
    answer = search(flown, some("rotor_drag", "vertical_inflow", "thrust_scale", "thrust_curve"))
    assert names(answer) == {"rotor_drag", "vertical_inflow"}
    for effect, parameter, true in (
        ("rotor_drag", "sinking", 0.5),
        ("vertical_inflow", "level", 0.4),
    ):
        value, low, high = estimate(answer, effect, parameter)
        assert value == pytest.approx(true, abs=0.2)
        assert high - low < 0.4


@pytest.mark.slow
def test_a_load_that_swings_is_pulled_down(quiet: Record) -> None:
    """What swings like a load and lifts like none is no load."""
    state = quiet.context.state
    velocity = np.stack(
        [np.sin(1.7 * state.time_s), np.cos(1.3 * state.time_s), 0.0 * state.time_s], axis=1
    )
    lively = with_context(quiet, state=replace(state, velocity_ned=1.5 * velocity))
    mass = 0.15 * quiet.context.vehicle.mass_kg
    assert names(
        search(added(lively, "slung_load", (0.55,), mass, mass, 0.0), some("slung_load"))
    ) == {"slung_load"}
    assert (
        names(search(added(lively, "slung_load", (0.55,), mass, -mass, 0.0), some("slung_load")))
        == set()
    )


@pytest.mark.slow
def test_a_flywheel_turns_the_way_its_rotors_do(quiet: Record) -> None:
    """No inertia is below zero: rotors that are all alike may turn either way."""
    flown = swung(quiet)
    inertia = 0.008 * quiet.context.vehicle.mass_kg * quiet.context.vehicle.rotor_radius_m**2
    for way in (1.0, -1.0):
        answer = search(added(flown, "gyroscopic", (way,), inertia), some("gyroscopic"))
        assert names(answer) == {"gyroscopic"}
        assert found(answer, "gyroscopic").parameters["all_alike"] == way


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "coefficients"),
    [
        ("rate_damping", (1.2, 0.3)),
        ("flapping_moment", (0.6,)),
        ("rotor_inertia", (0.01,)),
    ],
)
def test_a_moment_is_named_among_all(
    quiet: Record, name: str, coefficients: tuple[float, ...]
) -> None:
    answer = search(added(swung(quiet), name, (), *coefficients), list(catalogue()))
    assert names(answer) == {name}


def test_a_yaw_moment_of_half_a_hundredth_is_not_small(quiet: Record) -> None:
    """Half a hundredth of the weight times the lever is more than a tenth of what all rotors can do about yaw."""
    flown = swung(quiet)
    context = flown.context
    turning = np.nan_to_num(get("rotor_inertia").regressors(context, ()))[:, 5, 0]
    half_a_hundredth = 0.005 * context.weight * context.lever
    inertia = half_a_hundredth / np.percentile(np.abs(turning), 99.0)
    heavy = added(flown, "rotor_inertia", (), inertia)
    assert names(search(heavy, some("rotor_inertia"))) == {"rotor_inertia"}
    light = added(flown, "rotor_inertia", (), 0.2 * inertia)
    assert names(search(light, some("rotor_inertia"))) == set()


@pytest.mark.slow
@pytest.mark.parametrize("pitch", [0.6, 3.0])
def test_a_moment_in_roll_alone_is_not_that_of_round_rotors(quiet: Record, pitch: float) -> None:
    """Pitch moves less than roll, or more, and no moment answers it: rotors do not make that."""
    flown = swung(quiet)
    state = flown.context.state
    rates = state.rates * [1.0, pitch, 1.0]
    flown = with_context(flown, state=replace(state, rates=rates))
    residual = flown.residual.copy()
    residual[:, 3] -= 0.3 * rates[:, 0]
    answer = search(replace(flown, residual=residual), some("rate_damping", "flapping_moment"))
    assert names(answer) == set()


@pytest.mark.slow
def test_a_trim_is_told_beside_a_centre_of_gravity_that_does_the_same(quiet: Record) -> None:
    """Where the thrust hardly changes, no flight separates them."""
    answer = search(added(quiet, "trim_moment", (), 0.3, -1.0), some("trim_moment", "cg_offset"))
    (one,) = answer.found
    assert {one.effect.name, *one.aliases} == {"trim_moment", "cg_offset"}


def test_a_drift_is_not_a_scale_and_a_step(quiet: Record) -> None:
    sagging = added(quiet, "battery_sag", (25.0,), 2.0, 0.0, 0.0)
    assert names(search(sagging, some("battery_sag", "thrust_scale", "payload"))) == {"battery_sag"}


def by_outputs(record: Record) -> Record:
    """The record of a vehicle whose thrust is declared by its outputs, at 25 V."""
    rotors = record.context.vehicle.rotors
    lifted = 2.0 * record.context.weight / len(rotors)
    throttle = Throttle(
        max_thrust_n=lifted, expo=0.0, pwm_min_us=1000.0, pwm_max_us=2000.0, voltage_v=25.0
    )
    return with_context(record, vehicle=replace(record.context.vehicle, throttle=throttle))


def test_a_load_is_not_what_the_pack_is_off_its_reference(quiet: Record) -> None:
    """The pack sags a little on every flight: that must not take a level along which only a load has."""
    loaded = added(by_outputs(quiet), "payload", (0.0, 0.0), 0.35)
    sagging = added(loaded, "battery_sag", (25.0,), 1.5, 0.0, 0.0)
    answer = search(sagging, some("battery_sag", "thrust_scale", "payload"))
    assert names(answer) == {"battery_sag", "payload"}


@pytest.mark.slow
def test_a_scale_with_a_little_drift_stays_a_scale(quiet: Record) -> None:
    effects = some("battery_sag", "thrust_scale", "thermal_derating")
    assert names(search(added(quiet, "battery_sag", (24.5,), 0.1, -0.05, 0.0), effects)) == {
        "thrust_scale"
    }
    assert names(search(added(quiet, "battery_sag", (24.5,), 1.5, 0.0, 0.0), effects)) == {
        "battery_sag"
    }


@pytest.mark.slow
def test_flights_share_what_is_of_the_vehicle_and_not_what_is_of_the_day(quiet: Record) -> None:
    other = noise_record(12, 90.0, 0.3)
    both = [added(r, "rotor_drag", (0.5,), 0.6, 0.0) for r in (quiet, other)]
    both[1] = added(both[1], "payload", (), 0.4)
    answer = search(both, some("rotor_drag", "payload", "cg_offset"))
    assert names(answer) == {"rotor_drag", "payload"}
    assert set(found(answer, "rotor_drag").of_flight) == {0, 1}
    assert found(answer, "rotor_drag").confirmed_by == (0, 1)
    assert found(answer, "payload").flight == 1
    assert found(answer, "payload").confirmed_by == ()
    alone = search(both[0], some("rotor_drag", "payload", "cg_offset"))
    width = [
        high - low for low, _, high in (estimate(a, "rotor_drag", "drag") for a in (answer, alone))
    ]
    assert width[0] < width[1]


@pytest.mark.slow
def test_short_flights_count_together(quiet: Record) -> None:
    def part(k: int) -> Record:
        seconds = quiet.time_s - quiet.time_s[0]
        dragged = added(quiet, "rotor_drag", (0.5,), 0.35, 0.0)
        return replace(
            dragged, valid=quiet.valid & (seconds >= 9.0 * k) & (seconds < 9.0 * (k + 1))
        )

    effects = some("rotor_drag", "wind", "cg_offset")
    together = search([part(k) for k in range(9)], effects)
    assert names(together) == {"rotor_drag"}
    assert len(found(together, "rotor_drag").confirmed_by) > 4


def test_no_effect_is_named_in_the_search() -> None:
    folder = Path(next(iter(replay.search.__path__)))
    for path in folder.glob("*.py"):
        text = path.read_text()
        assert [e.name for e in catalogue() if f'"{e.name}"' in text] == [], path.name


@pytest.mark.slow
@pytest.mark.parametrize("kernel", ["Haswell", "SkylakeX", "Prescott"])
def test_every_linear_algebra_kernel_gives_the_same_answer(kernel: str) -> None:
    known = {k.name: k for k in kernels.KERNELS}
    if kernel in known and not known[kernel].flags <= kernels.processor_flags():
        pytest.skip(f"this processor does not run {kernel}")
    script = (
        "from test_search import added, catalogue, noise_record, search\n"
        "record = added(noise_record(11, 60.0, 1.0), 'wind', (0.5,), 0.6, -0.3, 1.0, 0.0)\n"
        "answer = search(added(record, 'thrust_scale', (), -0.04), list(catalogue()))\n"
        "for f in answer.found:\n"
        "    print(f.effect.name, f.aliases, [(e.name, float(f'{e.value:.5g}')) for e in f.estimates])\n"
    )

    tests = Path(__file__).parents[1]
    folders = ("lib", "benchmarks", "simulators", "replay")
    paths = os.pathsep.join(str(tests / folder) for folder in folders)

    def run(**environment: str) -> str:
        return subprocess.run(
            [sys.executable, "-c", script],
            env={**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": paths, **environment},
            capture_output=True, text=True, check=True, timeout=HANG_S,
        ).stdout  # fmt: skip

    assert run(OPENBLAS_CORETYPE=kernel) == run(OPENBLAS_CORETYPE="Nehalem") != ""


def test_the_error_of_every_regime_is_reported(quiet: Record) -> None:
    wind = search(added(quiet, "wind", (0.0,), 0.8, 0.5, 1.0, 0.0), some("wind"))
    regimes = {r["regime"]: r["axes"]["Fx"] for r in wind.traces[0].regimes}
    assert {"low", "far", "hover"} <= regimes.keys()
    for regime in regimes.values():
        assert regime["rms_after"] < 0.7 * regime["rms_before"]


def test_what_is_left_beside_a_surface_only_is_not_explained(quiet: Record) -> None:
    """One hundredth of the weight, low only: little over the whole flight, a clear error there."""
    context, rest = quiet.context, 0.5 * quiet.residual
    low = (
        np.nan_to_num(context.state.h_m, nan=np.inf).min(axis=1)
        < 4.0 * context.vehicle.rotor_radius_m
    )
    pushed = rest + np.where(low[:, None], 0.01 * context.weight, 0.0) * np.eye(6)[0]
    assert outside(quiet, rest) == ()
    left = {o.regime: o for o in outside(quiet, pushed)}
    assert {o.axis for o in left.values()} == {"Fx"}
    assert left["low"].rms == pytest.approx(0.01 * context.weight, rel=0.2)


@pytest.mark.parametrize("load_kg", [0.15, 0.2, 0.3])
def test_a_load_in_wind_is_named_as_wind_never_pushes_down(quiet: Record, load_kg: float) -> None:
    """The lift that wind gives could take over a load, were it below zero: the load was too small for a name."""
    windy = added(quiet, "wind", (0.0,), 2.0, 1.5, 0.7, 0.0, 0.3, 0.02)
    loaded = added(windy, "payload", (0.0, 0.0), load_kg)
    answer = search(loaded, some("wind", "payload", "rotor_drag"))
    assert names(answer) == {"wind", "payload"}
    answer = search(
        loaded, some("wind", "payload", "rotor_drag", "thrust_scale", "vertical_inflow")
    )
    assert names(answer) in ({"wind", "payload"}, {"wind", "thrust_scale"})


def test_a_steady_push_that_no_effect_makes_is_not_explained() -> None:
    """A trim took 4.8 % of the weight of a hexarotor, and nothing said that it was there."""
    record = biased(bias=0.3)
    answer = conclude([record], effects=some("rotor_drag"))
    assert answer.verdict == "unexplained"
    (left,) = answer.traces[0].outside
    assert left.axis == "Fx"
    weak = conclude([biased(bias=0.1)], effects=some("rotor_drag"))
    assert weak.verdict == "nothing_missing"


def test_an_effect_that_makes_held_out_time_worse_is_not_named() -> None:
    """Twelve seconds of slow noise, and a set that fitted its drift: on the other folds it does harm."""
    walked = walk([noise_record(4, 12.0, 3.0)], some("rotor_drag", "wind"))
    term = next(t for t in walked.evidence.library.terms if t.name == "wind")
    drifting = walked.evidence.fit([term], walked.best.noise)
    answer = summarise(replace(walked, best=drifting, fits={**walked.fits, drifting.key: drifting}))
    assert names(answer) == set()
    assert reason(answer, "wind")[0] == "it makes the error on held-out time larger"


def test_an_effect_does_not_act_on_an_axis_of_which_it_raises_the_error(quiet: Record) -> None:
    """Drag that is mostly along one axis, as of a wing or a box."""
    state = quiet.context.state
    level = [2.0 * np.sin(0.9 * state.time_s), 0.3 * np.cos(1.3 * state.time_s), 0.0 * state.time_s]
    flown = with_context(quiet, state=replace(state, velocity_ned=np.stack(level, axis=1)))
    x, y = (
        added(flown, "rotor_drag", (0.0,), drag).residual[:, i]
        for i, drag in enumerate((0.6, 0.18))
    )
    along_x = replace(flown, residual=np.column_stack([x, y, flown.residual[:, 2:]]))
    answer = conclude([along_x], effects=some("rotor_drag"))
    drag = next(iter(answer.found))
    assert drag.without == ("Fy",)
    assert "Fy" not in drag.axes
    before, after = answer.rms(after=False), answer.rms(after=True)
    assert after[0] < 0.5 * before[0]
    assert after[1] == pytest.approx(before[1])
    (kept,) = answer.adopted
    assert kept.without == ("Fy",)
    assert not adopted_wrench([kept], along_x.context)[:, 1].any()
    (entry,) = answer.as_json(None)["effects"]
    assert entry["without"] == ["Fy"]
    assert "not on Fy" in answer.as_text()


def test_what_another_effect_would_take_over_is_not_its_own(quiet: Record) -> None:
    """A scale takes over the mean of a thrust that grows with the throttle; drag takes over nothing of it."""
    flown = added(added(pumped(quiet), "thrust_curve", (), 0.3, 0.0), "thrust_scale", (), -0.1)
    evidence = Evidence(Library([flown], some("thrust_scale", "payload", "rotor_drag")))
    terms = {t.name: t for t in reversed(evidence.library.terms) if t.effect is not None}

    def own_share(name: str, beside: str) -> float:
        fit = evidence.fit([terms[name], terms[beside]], evidence.noises.quiet)
        u = Contributions(Design(evidence.library, fit.terms), fit.b, fit.cov)
        fz = next(i for i, c in enumerate(evidence.library.channels) if c.axis == 2)
        return float(tops(u, u.own([0]))[0, fz] / tops(u, u.main)[0, fz])

    assert own_share("thrust_scale", "rotor_drag") > 0.9
    assert own_share("thrust_scale", "payload") < 0.5


@pytest.mark.slow
def test_lift_without_its_moment_is_no_weak_fan(quiet: Record) -> None:
    """Neither a trim of the moments nor another effect may take back the moment that makes a fan the weak one."""
    calm = replace(quiet, residual=0.3 * quiet.residual)
    weak = added(calm, "fan_imbalance", (1.0,), -0.05, 0.0)
    lift_alone = np.concatenate([weak.residual[:, :3], calm.residual[:, 3:]], axis=1)
    effects = some("fan_imbalance", "cg_offset")
    assert names(search(replace(weak, residual=lift_alone), effects)) == set()
    assert names(search(weak, effects)) == {"fan_imbalance"}


def late(record: Record, load_kg: float, delay_s: float) -> Record:
    """The record with a load that swings otherwise than foretold, by a delay."""
    x = np.nan_to_num(get("slung_load").regressors(record.context, (0.55,)))[..., 0]
    later = np.roll(x, round(delay_s / record.step_s), axis=0)
    return replace(record, residual=record.residual + load_kg * later)


def test_a_load_that_swings_otherwise_than_foretold_is_in_its_interval() -> None:
    record = noise_record(11, 120.0, 0.3)
    load_kg = 0.6
    answer = search(late(record, load_kg, 0.25), some("slung_load"))
    low, value, high = estimate(answer, "slung_load", "mass_kg")
    assert value < 0.9 * load_kg
    assert low < load_kg < high
