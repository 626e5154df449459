"""Numbers of an answer in the units of people: winds of the air, masses by name, shares of the weight."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from made_up import some
from noise_records import noise_record

from models.air_state import blank_state
from models.effects import AdoptedEffect, Context, Effect, get
from models.surrogate.empty import empty_model
from replay.diagnosis.amended_model import amended, of_one_wind
from replay.diagnosis.diagnose import Diagnosis, conclude
from replay.diagnosis.html_report import page
from replay.diagnosis.words import estimate_text, explains_text, size_text
from replay.residual.record import Record
from replay.search import least_visible, pruning, results
from replay.search.estimates import IntervalEstimate
from replay.search.held_out import Acting, FlightFit, flight_fits
from replay.search.posterior import Walked, aliases, class_of
from replay.search.pruning import least_likely, only_parts
from replay.search.regimes import regimes
from replay.search.walk import walk


@pytest.fixture(scope="module")
def quiet() -> Record:
    """Ninety seconds of noise."""
    return noise_record(11, 90.0, 0.3)


def added(record: Record, name: str, shape: tuple[float, ...], *coefficients: float) -> Record:
    """The record with an effect's wrench in its residual; coefficients that are not given are 0."""
    x = np.nan_to_num(get(name).regressors(record.context, shape))
    return replace(
        record, residual=record.residual + x[..., : len(coefficients)] @ np.array(coefficients)
    )


def in_wind(record: Record, north_m_s: float, east_m_s: float, drag: float) -> Record:
    """The record in a wind of the air, of a vehicle with this share of momentum theory's drag."""
    return added(record, "wind", (0.0,), drag * north_m_s, drag * east_m_s, drag)


def with_velocity(record: Record, factor: float) -> Record:
    """The record flown at other speeds."""
    state = record.context.state
    moved = replace(state, velocity_ned=factor * state.velocity_ned)
    return replace(record, context=replace(record.context, state=moved))


def told(answer: Diagnosis) -> dict[str, Any]:
    return json.loads(json.dumps(answer.as_json(None), allow_nan=False))


def parameters(answer: Diagnosis, name: str) -> Mapping[str, Mapping[str, Any]]:
    return next(e for e in told(answer)["effects"] if e["name"] == name)["parameters"]


@pytest.fixture(scope="module")
def brisk(quiet: Record) -> Diagnosis:
    """Three metres a second from the south, of a vehicle with a quarter of momentum theory's drag."""
    return conclude([in_wind(with_velocity(quiet, 4.0), 3.0, -1.0, 0.25)], effects=some("wind"))


def test_a_wind_is_the_speed_of_the_air_whatever_the_vehicles_drag(brisk: Diagnosis) -> None:
    wind = parameters(brisk, "wind")
    for name, true in (("north", 3.0), ("east", -1.0)):
        low, high = wind[name]["ci95"]
        assert low < true < high
        assert wind[name]["unit"] == "m/s"
        assert high - low < 2.0


def test_the_model_keeps_the_force_that_was_found(brisk: Diagnosis) -> None:
    (wind,) = brisk.found
    assert wind.parameters["north"] == pytest.approx(0.25 * 3.0, rel=0.2)
    assert wind.numbers["north"] == pytest.approx(
        wind.parameters["north"] / wind.parameters["own_motion"], rel=0.1
    )


def test_there_is_one_wind_in_an_answer(brisk: Diagnosis) -> None:
    assert not [note for note in brisk.notes if "m/s" in note]
    assert re.search(
        r"[Ww]ind of (2\.[89]|3|3\.[0-4]) m/s from the south", page(brisk, brisk.vehicle)
    )


def test_a_wind_whose_drag_the_flight_does_not_show_has_a_wide_interval_and_says_why(
    quiet: Record,
) -> None:
    still = with_velocity(quiet, 0.0)
    answer = conclude([in_wind(still, 3.0, 0.0, 0.3)], effects=some("wind"))
    low, high = parameters(answer, "wind")["north"]["ci95"]
    assert low < 3.0 < high
    assert high > 2.0 * low
    assert any("hangs on the drag" in note for note in answer.notes)


def test_a_wind_in_the_lift_is_said_as_a_product_and_in_no_speed(quiet: Record) -> None:
    inflow = added(quiet, "vertical_inflow", (), 6.0, 0.0, 60.0, 0.0)
    found = parameters(conclude([inflow], effects=some("vertical_inflow")), "vertical_inflow")
    assert {"lift_by_tilt_north", "lift_by_tilt_east"} <= set(found)
    assert not [name for name, p in found.items() if p["unit"] == "m/s"]


def test_a_wind_beside_a_model_that_has_the_drag_is_the_same_speed(quiet: Record) -> None:
    drag = AdoptedEffect(
        "rotor_drag", {"drag": 0.25, "turning": 0.0, "sinking": 0.0, "above_radii": 0.0}
    )
    model = empty_model(quiet.context.vehicle).with_effects((drag,))
    context = replace(quiet.context, model=model)
    force = {
        "north": 0.75,
        "east": 0.0,
        "own_motion": 0.0,
        "turning": 0.0,
        "sinking": 0.0,
        "lift": 0.0,
        "above_radii": 0.0,
    }
    assert get("wind").said(context, force)["north"] == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("name", "shape", "sizes", "said"),
    [
        # Of a vehicle of 4.6 kg a load of 0.3 kg takes 0.3 / (1 + 0.3 / 4.6) off the acceleration.
        ("payload", (), (0.3 / (1.0 + 0.3 / 4.6),), {"mass_kg": 0.3}),
        ("slung_load", (0.55,), (0.2, 0.25, 0.0), {"mass_kg": 0.2, "hanging_kg": 0.25}),
    ],
)
def test_a_load_is_said_by_its_mass_and_its_length(
    quiet: Record,
    name: str,
    shape: tuple[float, ...],
    sizes: tuple[float, ...],
    said: dict[str, float],
) -> None:
    effect = get(name)
    numbers = effect.said(quiet.context, effect.parameters(sizes, shape))
    assert {key: numbers[key] for key in said} == pytest.approx(said)
    assert not {"mass", "rope_m"} & set(numbers)


def test_a_rope_is_longer_than_its_pendulum(quiet: Record) -> None:
    """The wash pulls the load down, so that it swings as on a shorter rope."""
    effect = get("slung_load")
    numbers = effect.said(quiet.context, effect.parameters((0.2, 0.25, 0.0), (0.55,)))
    assert 0.55 < numbers["length_m"] < 0.85
    heavy = effect.said(quiet.context, effect.parameters((2.0, 2.0, 0.0), (0.55,)))
    assert heavy["length_m"] < numbers["length_m"]


def assumed(record: Record) -> Record:
    """The record of a vehicle whose mass is a typical one."""
    vehicle = replace(record.context.vehicle, assumed=("mass_kg",))
    return replace(record, context=replace(record.context, vehicle=vehicle))


def test_without_a_known_mass_sizes_are_shares_of_the_weight_everywhere(quiet: Record) -> None:
    load = added(quiet, "payload", (), 0.1 * quiet.context.vehicle.mass_kg)
    effects = some("payload", "rotor_drag", "contact")
    answer = conclude([assumed(load)], effects=effects)
    said = told(answer)
    mass = parameters(answer, "payload")["mass_kg"]
    assert mass["unit"] == "weight"
    assert mass["value"] == pytest.approx(0.1, rel=0.1)
    assert said["axes"]["Fz"]["unit"] == "weight"
    assert said["axes"]["Fz"]["rms_before"] == pytest.approx(0.1, rel=0.2)
    assert said["axes"]["My"]["unit"] == "weight m"
    text = answer.as_text() + page(answer, answer.vehicle)
    for unit in (" N ", " N<", " kg", "[N]", "N m", "N/m"):
        assert unit not in text, unit
    units = {one["unit"] for one in said["could_have_seen"]}
    assert not units & {"N", "kg", "N/m", "N m"}


def test_a_known_mass_gives_newtons(quiet: Record) -> None:
    said = told(conclude([quiet], effects=some("payload")))
    assert said["axes"]["Fz"]["unit"] == "N"


@pytest.mark.slow
def test_no_interval_has_zero_width(quiet: Record) -> None:
    state = quiet.context.state
    volts = np.linspace(16.0, 14.0, len(quiet.time_s))
    drained = replace(quiet.context, state=replace(state, battery_voltage_v=volts), commanded=1.0)
    record = replace(quiet, context=drained)
    lively = added(record, "battery_sag", (16.0,), 2.0)
    lively = added(lively, "fan_imbalance", (1.0,), -0.15)
    answer = told(conclude([lively], effects=some("battery_sag", "fan_imbalance", "wind")))
    found = {e["name"]: e["parameters"] for e in answer["effects"]}
    assert {"battery_sag", "fan_imbalance"} <= set(found)
    assert "ci95" not in found["battery_sag"]["reference_v"]
    assert "ci95" not in found["fan_imbalance"]["fan"]
    for sizes in found.values():
        for name, p in sizes.items():
            if "ci95" in p:
                assert p["ci95"][1] > p["ci95"][0], name


@pytest.mark.slow
def test_a_dead_time_that_was_refined_in_one_row_has_the_width_of_its_grid(quiet: Record) -> None:
    rng = np.random.default_rng(7)
    more = (
        1.0
        + 0.05
        * np.repeat(rng.standard_normal(len(quiet.time_s) // 8 + 1), 8)[: len(quiet.time_s), None]
    )
    state = quiet.context.state
    changed = replace(
        state, rpm=state.rpm * np.sqrt(more), specific_force=state.specific_force * more
    )
    context = replace(quiet.context, state=changed, commanded=1.0)
    late = added(replace(quiet, context=context), "motor_lag", (0.06, 0.04), 1.0)
    answer = conclude([late], effects=some("motor_lag"))
    for name in ("dead_s", "tau_s"):
        low, high = parameters(answer, "motor_lag")[name]["ci95"]
        assert high - low > 0.002, name


def test_what_is_not_determined_has_no_value_but_its_interval() -> None:
    unknown = IntervalEstimate(
        name="scale", value=0.26, ci95=(-0.19, 0.72), unit="1", determined=False
    )
    assert unknown.as_json() == {"value": None, "ci95": (-0.19, 0.72), "unit": "1"}
    assert estimate_text(unknown) == "scale not determined [-0.19, 0.72]"
    assert (
        estimate_text(IntervalEstimate(name="from_s", value=102.84, ci95=(102.5, 103.2), unit="s"))
        == "from_s = 102.8 [102.5, 103.2] s"
    )
    assert estimate_text(IntervalEstimate(name="fan", value=3.0, ci95=None, unit="1")) == "fan = 3"
    assert IntervalEstimate(name="fan", value=3.0, ci95=None, unit="1").as_json() == {
        "value": 3.0,
        "unit": "1",
    }


def test_small_numbers_have_digits_and_nothing_is_minus_zero() -> None:
    assert [size_text(v) for v in (0.0000231, 0.0, 1.3194, 123.4)] == [
        "0.0000231",
        "0",
        "1.32",
        "123",
    ]
    assert explains_text(-0.002) == "explains less than 1 %"
    assert explains_text(0.124) == "explains 12%"


def weighed_term(name: str) -> SimpleNamespace:
    """A term of one effect, or of a free curve over a channel."""
    is_curve = name.startswith("over_")
    effect = None if is_curve else get(name)
    return SimpleNamespace(
        name=name, effect=effect, named=effect, key=(name, None, None), order=(name,)
    )


def weighed(*sets: tuple[float, tuple[str, ...]]) -> Walked:
    """Sets of effects and free curves with their probabilities; the first is the best."""
    fits = {}
    for chance, names in sets:
        terms = tuple(weighed_term(name) for name in names)
        of_effects = tuple(t for t in terms if t.effect is not None)
        fit = SimpleNamespace(
            terms=terms,
            of_effects=of_effects,
            effects={t.name for t in of_effects},
            score=math.log(chance),
            noise=None,
            key=frozenset(t.key for t in terms),
        )
        fits[fit.key] = fit
    known = SimpleNamespace(fit=lambda terms, noise: fits[frozenset(t.key for t in terms)])
    return Walked(evidence=known, fits=fits, best=next(iter(fits.values())))


@pytest.mark.parametrize(
    ("likelier", "left"), [("thrust_scale", "thrust_scale"), ("wind", "battery_sag")]
)
def test_where_an_effect_is_taken_out_a_likelier_alias_takes_the_place_of_what_is_left(
    likelier: str, left: str
) -> None:
    """A load was the sag of a pack, a scale of the thrust millions of times likelier, once its inflow was too small.

    Wind is no alias of sag.
    """
    walked = weighed(
        (0.9, ("battery_sag", "vertical_inflow")), (0.0999, (likelier,)), (0.0001, ("battery_sag",))
    )
    less = walked.without([("vertical_inflow", None, None)], "too small")
    assert less.best.effects == {left}


def test_what_an_effect_explained_that_was_taken_out_a_free_curve_may_explain() -> None:
    """A load was headed by the heat of the motors, whose own class gave them nothing."""
    walked = weighed(
        (0.9, ("battery_sag", "vertical_inflow")),
        (0.0999, ("thrust_scale", "over_vd_m_s")),
        (0.0001, ("battery_sag",)),
    )
    less = walked.without([("vertical_inflow", None, None)], "too small")
    assert less.best.effects == {"thrust_scale"}


def test_what_only_fits_beside_an_effect_goes_with_it() -> None:
    """Beside a curve of the thrust an inflow helped, without it a wind alone was likelier by hundreds of nats."""
    walked = weighed(
        (0.9, ("wind", "vertical_inflow", "thrust_curve")),
        (0.099, ("wind",)),
        (1e-4, ("rotor_drag", "vertical_inflow")),
        (1e-5, ("wind", "vertical_inflow")),
    )
    less = walked.without([("thrust_curve", None, None)], "it does harm")
    assert less.best.effects == {"wind"}


def test_members_of_a_class_have_the_probability_of_the_sets_that_hold_them() -> None:
    walked = weighed(
        (0.6, ("wind",)),
        (0.25, ("imu_bias", "rotor_drag")),
        (0.14, ("payload",)),
        (0.01, ("contact",)),
    )
    members = class_of(walked, get("wind"), ("imu_bias", "rotor_drag", "payload", "contact"))
    # Drag is a part of wind: it takes no share of what pushes. What is told from it is left out.
    assert members == (("wind", 0.6), ("imu_bias", 0.25), ("payload", 0.14))


def test_what_acts_on_no_common_axis_is_no_alias() -> None:
    """A scale of the thrust was "or the inertia of the rotors", which turns the vehicle and lifts nothing."""
    walked = weighed((0.6, ("thrust_scale", "gyroscopic")), (0.4, ("payload", "rotor_inertia")))
    assert aliases(walked) == {
        ("thrust_scale", None, None): ["payload"],
        ("gyroscopic", None, None): ["rotor_inertia"],
    }


def test_an_effect_that_most_sets_do_without_is_no_name() -> None:
    """A wind of the second simulator had a curve of the thrust beside it, stated with a probability of 0.14."""
    walked = weighed((0.35, ("wind", "thrust_curve")), (0.34, ("wind",)), (0.31, ()))
    assert least_likely(walked) == [("thrust_curve", None, None)]


def test_an_effect_or_its_alias_that_most_sets_hold_is_a_name() -> None:
    walked = weighed(
        (0.35, ("wind", "thrust_curve")), (0.34, ("wind", "battery_sag")), (0.31, ("wind",))
    )
    assert least_likely(walked) == []


@pytest.mark.parametrize(("north_m_s", "known"), [(0.0, False), (3.0, True)])
def test_a_wind_that_is_not_known_to_blow_is_only_the_drag_of_the_rotors(
    quiet: Record, north_m_s: float, known: bool
) -> None:
    """Of 31 winds on real flights seven were not told from zero, and three of these were none."""
    walked = walk([in_wind(with_velocity(quiet, 4.0), north_m_s, 0.0, 0.3)], some("wind"))
    wind = next(term for term in walked.evidence.library.terms if term.name == "wind")
    windy = replace(walked, best=walked.evidence.fit([wind], walked.best.noise))
    fits = flight_fits(windy.evidence, windy.best)
    assert only_parts(windy, fits) == ([] if known else [wind.key])


def test_what_is_told_from_all_others_is_no_class() -> None:
    assert (
        class_of(weighed((0.98, ("wind",)), (0.02, ("imu_bias",))), get("wind"), ("imu_bias",))
        == ()
    )


def test_at_most_three_members_are_shown_and_the_effect_is_one() -> None:
    walked = weighed(
        (0.1, ("wind",)), (0.3, ("imu_bias",)), (0.3, ("payload",)), (0.3, ("contact",))
    )
    members = class_of(walked, get("wind"), ("imu_bias", "payload", "contact"))
    assert len(members) == 3
    assert "wind" in dict(members)


def test_a_class_is_one_entry_with_its_members_and_what_decides(brisk: Diagnosis) -> None:
    (wind,) = brisk.found
    members = (("wind", 0.7), ("imu_bias", 0.3))
    unsure = replace(wind, members=members, push="a steady push to the left", aliases=("imu_bias",))
    answer = replace(brisk, found=(unsure,))
    (effect,) = told(answer)["effects"]
    assert effect["members"] == [{"name": name, "probability": p} for name, p in members]
    assert all(get(name).excite in effect["decided_by"] for name, _ in members)
    assert told(answer)["aliases"] == [["wind", "imu_bias"]]
    text = answer.as_text()
    assert "a steady push to the left: wind 0.7, or IMU bias 0.3; to know which: turn" in text
    assert "  wind or imu_bias (candidate" in text
    assert "do not tell these apart" in page(answer, answer.vehicle)


def test_a_size_that_may_be_none_is_said_to_be_so(brisk: Diagnosis) -> None:
    """A name stands for its class, too: with its probability, though no interval leaves zero out."""
    (wind,) = brisk.found
    assert wind.told_from_zero
    assert "told_from_zero" not in told(brisk)["effects"][0]
    wide = tuple(
        replace(e, value=0.1, ci95=(-0.5, 0.7)) if e.name in wind.effect.main_names else e
        for e in wind.fitted
    )
    answer = replace(brisk, found=(replace(wind, fitted=wide),))
    assert told(answer)["effects"][0]["told_from_zero"] is False
    assert "its size is not told from zero" in answer.as_text()
    assert "Its size is not told from zero" in page(answer, answer.vehicle)


def test_a_push_is_said_by_its_way(quiet: Record) -> None:
    fit = fit_of(quiet, np.full(len(quiet.time_s), -2.0), np.sin(np.arange(len(quiet.time_s))))
    steady, changing = (results._push(fit, key) for key in fit.effects)
    assert steady == "a steady push backward"
    assert changing == "a changing push forward or backward"


def fit_of(quiet: Record, *pushes: np.ndarray) -> FlightFit:
    """A flight under effects that push along x."""
    effects = {}
    for number, push in enumerate(pushes):
        wrench = np.zeros((len(push), 6))
        wrench[:, 0] = push
        effects[(f"effect {number}", None, None)] = Acting(
            held_out=wrench,
            axes=("Fx",),
            main_axes=("Fx",),
            folds=np.zeros((8, 1)),
            parameters={},
        )
    still = np.zeros_like(quiet.residual)
    return FlightFit(
        record=quiet, index=0, before=quiet.residual, effects=effects, rest=still, beside=still
    )


def test_effects_that_do_harm_together_leave_the_axis_though_each_helps_beside_the_other(
    quiet: Record,
) -> None:
    wave = np.sin(np.arange(len(quiet.time_s)))
    fit = fit_of(quiet, 3.0 * wave, -2.7 * wave)
    keys = list(fit.effects)
    assert all(fit.gain(key, [0]) > 0.0 for key in keys)
    assert fit.energy(fit.after, [0]) > fit.energy(fit.before, [0])
    (mended,), without = pruning._by_axis([fit], keys)
    assert mended.energy(mended.after, [0]) <= mended.energy(mended.before, [0]) * (
        1.0 + pruning.WORSE_SHARE
    )
    assert without


def judged_without(monkeypatch: pytest.MonkeyPatch, name: str, *axes: str) -> None:
    """Held-out time says that an effect does not act on these axes."""
    judged = pruning._by_axis

    def by_axis(fits, keys):
        fits, without = judged(fits, keys)
        return fits, without | {key: axes for key in keys if key[0] == name}

    monkeypatch.setattr(pruning, "_by_axis", by_axis)


@pytest.mark.parametrize(
    ("name", "axes", "shape", "sizes"),
    [
        ("rotor_drag", ("Fx", "Fy"), (0.0,), (0.6,)),
        # What is left of it is the weight: a payload.
        ("slung_load", ("Fx", "Fy", "Mx", "My"), (0.45,), (0.3, 0.3)),
    ],
)
def test_an_effect_that_acts_on_no_axis_that_makes_it_is_no_name(
    quiet: Record, monkeypatch: pytest.MonkeyPatch, name, axes, shape, sizes
) -> None:
    judged_without(monkeypatch, name, *axes)
    answer = conclude([added(with_velocity(quiet, 4.0), name, shape, *sizes)], effects=some(name))
    assert not answer.found
    reasons = {r.name: r.reason for r in answer.rejected}
    assert reasons[name] == "it makes the error on held-out time larger"


def test_what_is_left_of_a_load_that_does_not_swing_is_a_load(
    quiet: Record, monkeypatch: pytest.MonkeyPatch
) -> None:
    judged_without(monkeypatch, "slung_load", "Fx", "Fy", "Mx", "My")
    hangs = added(with_velocity(quiet, 4.0), "slung_load", (0.45,), 0.3, 0.3)
    answer = conclude([hangs], effects=some("slung_load", "payload"))
    (load,) = answer.found
    assert load.effect.name == "payload"
    assert load.probability > 0.9


@pytest.mark.parametrize("level", [0.0, -0.2])
def test_what_is_small_beside_the_rest_has_no_name_and_says_why(
    quiet: Record, level: float
) -> None:
    """A slope of lift of 0.8 % of the weight (RMS): alone it is all there is."""
    calm = added(replace(quiet, residual=0.1 * quiet.residual), "vertical_inflow", (), 4.8)
    flight = added(calm, "thrust_scale", (), level)
    answer = conclude([flight], effects=some("thrust_scale", "vertical_inflow"))
    if level == 0.0:
        assert [f.effect.name for f in answer.found] == ["vertical_inflow"]
    else:
        assert [f.effect.name for f in answer.found] == ["thrust_scale"]
        (rejected,) = answer.rejected
        assert rejected.reason.startswith("too small: below 1 % of the weight")


def test_what_could_have_been_seen_is_not_too_small_for_a_name(quiet: Record) -> None:
    """Beside a thrust that is 20 % off, a slope of lift needs 1 % of the weight (RMS), and what chance takes."""
    calm = replace(quiet, residual=0.1 * quiet.residual)
    weak = added(calm, "thrust_scale", (), -0.2)
    walked = walk([weak], some("thrust_scale", "vertical_inflow"))
    (least,) = least_visible.least_sizes(walked)
    x = np.nan_to_num(least.term.named.regressors(weak.context, ()))
    force = least.size * x[:, 2, least.number]
    rms = np.sqrt((force**2).mean()) / (0.01 * weak.context.weight)
    assert least_visible.SURE <= rms < 1.3 * least_visible.SURE


SEEN = ("payload", "cg_offset", "wind", "ground_effect", "rotor_drag", "imu_bias")


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 4, 5])
def test_what_is_as_large_as_could_have_been_seen_is_seen(seed: int) -> None:
    """Of all that is called visible on flights with nothing in them."""
    record = noise_record(seed, 90.0, 0.3)
    walked = walk([record], some(*SEEN))
    missed = []
    for least in least_visible.least_sizes(walked):
        x, _ = walked.evidence.library.wrenches(least.term, 0)
        wrench = least.size * np.nan_to_num(x[:, :, least.number])
        answer = conclude([replace(record, residual=record.residual + wrench)], effects=some(*SEEN))
        if answer.verdict == "nothing_missing":
            missed.append(least.term.name)
    assert missed == []


def test_what_is_large_in_one_part_of_the_flight_is_not_small(quiet: Record) -> None:
    samples = np.arange(len(quiet.time_s))
    low = regimes(quiet)["low"]
    steady = np.full(len(samples), 20.0)
    gentle = 1.2 * np.sin(samples)
    short = np.where(low, 1.6 * np.sin(samples), 0.0)
    assert np.sqrt((short**2).mean()) < 1.0
    pushes = [quiet.context.weight / 100.0 * push for push in (steady, gentle, short)]
    fit = fit_of(quiet, *pushes)
    fit = replace(fit, before=sum(a.held_out for a in fit.effects.values()))
    assert [fit.is_small(key) for key in fit.effects] == [False, True, False]


def test_drag_that_was_found_in_still_air_is_kept_whole() -> None:
    assert of_one_wind(0.0, 2.0) == 0.0
    assert of_one_wind(2.0, 2.0) == pytest.approx(0.25)
    assert of_one_wind(10.0, 0.1) == pytest.approx(0.5, abs=0.001)


def test_what_is_the_vehicles_of_a_wind_stays_as_drag_and_flies_the_same_force(
    quiet: Record,
) -> None:
    context = quiet.context
    found = {
        "north": 0.7,
        "east": 0.2,
        "own_motion": 0.4,
        "turning": 0.3,
        "sinking": 0.1,
        "lift": 0.0,
        "above_radii": 0.5,
    }
    wind = AdoptedEffect("wind", found, ("My",))
    (kept,) = amended(None, context.vehicle, [wind]).effects
    assert kept.name == "rotor_drag"
    assert kept.without == ("My",)
    calm = found | {"north": 0.0, "east": 0.0}
    assert get("rotor_drag").wrench(context, kept.parameters) == pytest.approx(
        get("wind").wrench(context, calm)
    )


def test_every_quantity_stands_for_a_parameter_and_is_finite(quiet: Record) -> None:
    vehicle = quiet.context.vehicle
    nothing = Context(
        state=blank_state((3,), len(vehicle.fans), len(vehicle.rotors)), vehicle=vehicle
    )
    for effect in _with_quantities():
        known = {c.name for c in effect.coefficients} | {s.name for s in effect.shapes}
        assert {q.instead_of for q in effect.shown.quantities} <= known
        middle = dict.fromkeys(known, 0.5)
        assert set(effect.said(quiet.context, middle)) >= {q.name for q in effect.shown.quantities}
        assert all(math.isfinite(v) for v in effect.said(quiet.context, middle).values())
        assert effect.said(nothing, middle)


def _with_quantities() -> list[Effect]:
    return [
        e for e in some("wind", "payload", "slung_load", "vertical_inflow") if e.shown.quantities
    ]
