"""The search for effects: what it may adopt, what it must refuse, on made-up residuals of known noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnose_noise import noise_record

from models.effects import Effect, catalogue, get
from replay.residual.delays import Delay
from replay.residual.record import Record
from replay.search.backward import believed, merged
from replay.search.library import Candidate, freedom
from replay.search.null import flips
from replay.search.search import Trace, trace
from replay.search.shapes import refined
from replay.search.workspace import Workspace


@pytest.fixture(scope="module")
def quiet() -> Record:
    """Ninety seconds of noise."""
    return noise_record(11, 90.0, 0.3)


def some(*names: str) -> list[Effect]:
    """These effects of the catalogue."""
    return [e for e in catalogue() if e.name in names]


def added(record: Record, name: str, shape: tuple[float, ...], *coefficients: float) -> Record:
    """The record with an effect's wrench in its residual (a term of the catalogue: plumbing, not physics)."""
    x = np.nan_to_num(get(name).regressors(record.context, shape))
    return replace(record, residual=record.residual + x @ np.array(coefficients))


def names(answer: Trace) -> set[str]:
    """What was found."""
    return {f.effect.name for f in answer.found}


def reason(answer: Trace, name: str) -> tuple[str, bool]:
    """Why an effect was not adopted, and whether the flight could have shown it."""
    found = next(r for r in answer.rejected if r.name == name)
    return found.reason, found.excited


def test_a_lag_is_refused_where_the_thrust_only_answers_noise(quiet: Record) -> None:
    late = added(quiet, "motor_lag", (0.12,), 1.0)
    steps = replace(late, delays=(Delay("rotor speed", -0.07, 0.9, False),))
    hover = replace(late, delays=(Delay("rotor speed", -0.09, 0.5, False),))
    assert names(trace(steps, some("motor_lag", "wind"))) == {"motor_lag"}
    answer = trace(hover, some("motor_lag", "wind"))
    assert names(answer) == set()
    assert not reason(answer, "motor_lag")[1]


def test_the_ratio_of_thrust_to_mass_gets_one_name(quiet: Record) -> None:
    answer = trace(added(quiet, "thrust_scale", (), -0.05), some("thrust_scale", "payload", "battery_sag"))
    assert len(names(answer)) == 1
    found = answer.found[0]
    assert {found.effect.name, *found.aliases} >= {"thrust_scale", "payload"}


def test_without_moments_no_fan_is_blamed(quiet: Record) -> None:
    forces = replace(quiet, axes=(0, 1, 2))
    weak = added(forces, "fan_imbalance", (1.0,), -0.1)
    answer = trace(weak, some("fan_imbalance", "cg_offset", "thrust_scale"))
    assert "fan_imbalance" not in names(answer)
    assert reason(answer, "fan_imbalance") == ("this log cannot judge moments", False)


def test_what_is_below_a_hundredth_of_the_weight_is_not_named(quiet: Record) -> None:
    calm = replace(quiet, residual=0.1 * quiet.residual)
    assert names(trace(added(calm, "thrust_scale", (), -0.005), some("thrust_scale"))) == set()
    assert names(trace(added(calm, "thrust_scale", (), -0.02), some("thrust_scale"))) == {"thrust_scale"}


def estimate(answer: Trace, effect: str, parameter: str) -> tuple[float, float, float]:
    """Low end, value and high end of a parameter that was found."""
    found = next(f for f in answer.found if f.effect.name == effect)
    e = next(e for e in found.estimates if e.name == parameter)
    return e.ci95[0], e.value, e.ci95[1]


def test_a_range_offset_is_reported_in_metres(quiet: Record) -> None:
    low, value, high = estimate(
        trace(added(quiet, "range_offset", (0.06,), 0.06), some("range_offset")), "range_offset", "offset_m"
    )
    assert low < value < high
    assert value == pytest.approx(0.06, abs=0.015)


def test_a_moment_in_time_has_an_interval_that_holds_it(quiet: Record) -> None:
    middle = float(quiet.time_s[400]) + 0.7
    answer = trace(added(quiet, "payload", (middle,), 0.3), some("payload", "thrust_scale"))
    low, _, high = estimate(answer, "payload", "from_s")
    assert low <= middle <= high
    assert 0.0 < high - low < 10.0


def test_a_common_shape_needs_evidence_to_be_left(quiet: Record) -> None:
    effect = get("ceiling")
    over = replace(quiet.context.state, ceiling_m=quiet.context.state.h_m)
    under = replace(quiet, context=replace(quiet.context, state=over))
    assert effect.usual == (1.0,)
    found = trace(added(under, "ceiling", (1.0,), 4.0), [effect])
    assert estimate(found, "ceiling", "scale")[1] == 1.0


def test_a_lively_rival_does_not_hide_a_quiet_one() -> None:
    rng = np.random.default_rng(0)
    parts = np.concatenate([30.0 * rng.standard_normal((100, 1)), rng.standard_normal((100, 1))], axis=1)
    groups, inverses = [np.array([0]), np.array([1])], [np.eye(1) / 100.0] * 2
    chance = flips(parts, ["lively", "quiet"], groups, inverses, np.zeros(2), 0)
    assert chance.p("quiet", 40.0) < 0.01 < chance.p("lively", 40.0)


def straight(record: Record) -> Record:
    """The same flight with the nose kept north."""
    still = np.broadcast_to(np.eye(3), record.context.state.rotation.shape)
    return replace(record, context=replace(record.context, state=replace(record.context.state, rotation=still)))


WIND = (2.0, 1.5, 1.0, 0.0)


def test_without_a_turn_an_offset_and_drag_pass_for_wind(quiet: Record) -> None:
    effects = some("wind", "imu_bias", "rotor_drag")
    unknown = replace(quiet, kinematic_bias=np.full_like(quiet.kinematic_bias, np.nan))
    turned = trace(added(unknown, "wind", (0.0,), *WIND), effects)
    ahead = trace(added(straight(unknown), "wind", (0.0,), *WIND), effects)
    assert (names(turned), turned.found[0].aliases) == ({"wind"}, ())
    assert names(ahead) == {"wind"}
    assert set(ahead.found[0].aliases) == {"imu_bias", "rotor_drag"}


def test_a_force_that_is_not_judged_is_not_named(quiet: Record) -> None:
    moments = replace(added(quiet, "ground_effect", (1.5,), -1.5), axes=(3, 4, 5))
    answer = trace(moments, some("ground_effect", "cg_offset"))
    assert "ground_effect" not in names(answer)
    assert reason(answer, "ground_effect") == ("this log cannot judge the force that it makes", False)


def test_velocity_decides_the_vertical_part_of_an_offset(quiet: Record) -> None:
    offset = np.array([0.4, -0.3, 0.0])
    weak = added(added(quiet, "imu_bias", (), *offset), "thrust_scale", (), -0.08)
    told = replace(weak, kinematic_bias=np.broadcast_to(offset, quiet.kinematic_bias.shape))
    answer = trace(told, some("imu_bias", "thrust_scale"))
    assert names(answer) == {"imu_bias", "thrust_scale"}
    assert abs(estimate(answer, "imu_bias", "z")[1]) < 0.3
    assert estimate(answer, "imu_bias", "x")[1] == pytest.approx(0.4, abs=0.1)


def candidates(search: Workspace, *wanted: str) -> list[Candidate]:
    """The middle one of every effect's candidates."""
    of = {name: [c for c in search.library.candidates if c.effect.name == name] for name in wanted}
    return [of[name][len(of[name]) // 2] for name in wanted]


def test_a_drift_is_not_a_scale_and_a_step(quiet: Record) -> None:
    sagging = added(quiet, "battery_sag", (25.0,), 2.0, -0.05)
    search = Workspace(sagging, some("battery_sag", "thrust_scale", "payload"), 0)
    p_of = {"thrust_scale": 0.001, "payload": 0.004}
    one = merged(search, candidates(search, "thrust_scale", "payload"), p_of)
    assert [c.effect.name for c in one] == ["battery_sag"]
    assert p_of["battery_sag"] == 0.004
    # A scale with a step in time is no drift.
    stepping = added(added(quiet, "thrust_scale", (), -0.1), "payload", (float(quiet.time_s[400]),), 0.4)
    search = Workspace(stepping, some("battery_sag", "thrust_scale", "payload"), 0)
    both = refined(search, candidates(search, "thrust_scale", "payload"))
    assert {c.effect.name for c in merged(search, both, dict(p_of))} == {"thrust_scale", "payload"}


def test_a_name_is_taken_back_where_a_curve_finds_more(quiet: Record) -> None:
    slow = np.cumsum(np.random.default_rng(3).standard_normal(len(quiet.time_s)))
    slow = (slow - slow.mean()) / slow.std()
    pull = np.zeros_like(quiet.residual)
    pull[:, 2] = 0.7 * slow
    strange = replace(quiet, residual=quiet.residual + pull, channels={**quiet.channels, "pressure_pa": slow})
    search = Workspace(strange, some("vertical_inflow", "thrust_scale"), 0)
    assert believed(search, candidates(search, "vertical_inflow")) == []
    # Curves have no mean: a constant may be that of the unknown force, unless it is too large for that.
    for newtons, left in ((0.9, 0), (3.0, 1)):
        constant = replace(strange, residual=strange.residual + newtons * np.eye(6)[2])
        search = Workspace(constant, some("thrust_scale"), 0)
        assert len(believed(search, candidates(search, "thrust_scale"))) == left


def test_what_replaces_two_effects_has_less_freedom_than_they_have(quiet: Record) -> None:
    search = Workspace(quiet, some("battery_sag", "thrust_scale", "payload", "wind", "rotor_drag", "cg_offset"), 0)
    free = {c.effect.name: freedom(c) for c in search.library.candidates}
    assert free["battery_sag"] < free["thrust_scale"] + free["payload"]
    assert free["wind"] >= free["rotor_drag"] + free["cg_offset"]


def test_one_unknown_force_is_better_than_a_load_and_an_unknown_force(quiet: Record) -> None:
    # A pull that is on in the second half and, more weakly, from time to time in the first.
    n = len(quiet.time_s)
    switch = np.where(np.arange(n) > n // 2, 1.0, np.arange(n) // 90 % 2 * 0.8)
    pull = np.zeros_like(quiet.residual)
    pull[:, 2] = 3.0 * switch
    strange = replace(quiet, residual=quiet.residual + pull, channels={**quiet.channels, "pressure_pa": switch})
    search = Workspace(strange, some("payload"), 0)
    middle = min(search.library.candidates, key=lambda c: abs(c.shape[0] - quiet.time_s[n // 2]))
    assert believed(search, [middle]) == []
    assert search.reasons["payload"][0].endswith("goes with pressure_pa does as well alone")
    # The same load with nothing else to find stays.
    loaded = added(quiet, "payload", middle.shape, 0.3)
    search = Workspace(loaded, some("payload"), 0)
    same = next(c for c in search.library.candidates if c.shape == middle.shape)
    assert len(believed(search, [same])) == 1


def test_what_uneven_sampling_looks_like_is_no_lag(quiet: Record) -> None:
    steps = replace(quiet, delays=(Delay("rotor speed", 0.009, 0.9, True),))
    effects = some("motor_lag", "vertical_inflow")
    rising = added(steps, "vertical_inflow", (), 4.0, 0.0)
    for tau, found in ((0.03, set[str]()), (0.12, {"motor_lag"})):
        late = added(rising, "motor_lag", (tau,), 1.0)
        assert names(trace(late, effects)) - {"vertical_inflow"} == found


def test_less_lift_near_the_ground_is_first_an_error_of_the_rangefinder(quiet: Record) -> None:
    effects = some("ground_effect", "range_offset")
    answer = trace(added(quiet, "range_offset", (-0.06,), -0.06), effects)
    assert names(answer) == {"range_offset"}


def test_a_wrong_mass_with_a_little_drift_is_no_sagging_battery(quiet: Record) -> None:
    heavy = added(quiet, "battery_sag", (25.0,), 0.25, -0.30)
    answer = trace(heavy, some("battery_sag", "thrust_scale", "payload"))
    assert len(names(answer) & {"thrust_scale", "payload"}) == 1
    assert answer.found[0].effect.name != "battery_sag"


def test_a_scale_with_a_little_drift_stays_a_scale(quiet: Record) -> None:
    effects = some("battery_sag", "thrust_scale", "thermal_derating")
    assert names(trace(added(quiet, "battery_sag", (24.5,), 0.1, -0.05), effects)) == {"thrust_scale"}
    assert names(trace(added(quiet, "battery_sag", (24.5,), 1.5, -0.05), effects)) == {"battery_sag"}


def test_a_torque_that_nothing_feels_tells_against_no_effect(quiet: Record) -> None:
    """The simulated yaw torque of a real firmware's flight is quiet to 1e-4 N m: a wall leaves more than that."""
    flight = added(quiet, "wall_effect", (1.2,), 0.3, 0.0)
    still = flight.residual.copy()
    still[:, 5] = 2e-3 * quiet.residual[:, 5]
    answer = trace(replace(flight, residual=still), some("wall_effect", "wind"))
    assert names(answer) == {"wall_effect"}
