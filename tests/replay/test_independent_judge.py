"""The rules by which answers on flights of the second simulator are judged."""

from __future__ import annotations

from diagnosis.independent_judge import claimed_size, judge
from shares import share

AXES = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")


def truth(lag=0.0, payload_moment=0.0, group="single", largest=None, **sizes):
    return {
        "sizes": sizes,
        "largest": largest or sizes,
        "lag_beyond_delay": lag,
        "payload_moment": payload_moment,
        "weight_n": 10.0,
        "arm_m": 0.5,
        "group": group,
    }


def answer(*names, verdict="explained", aliases=(), explains=0.5, before=0.5, **more):
    effects = [{"name": n, "axes": ["Fz"], "explains": explains} for n in names]
    axes = {
        a: {"rms_before": before, "rms_after": 0.1, "unit": "N" if a[0] == "F" else "N m"}
        for a in AXES
    }
    return {
        "verdict": verdict,
        "effects": effects,
        "aliases": [list(a) for a in aliases],
        "axes": axes,
    } | more


def test_needed_effects_are_to_be_named_and_small_ones_may():
    flight = truth(wind=0.05, rotor_drag=0.01, cg_offset=0.002)
    assert judge(flight, answer("wind")).exact
    assert judge(flight, answer("wind", "rotor_drag", explains=0.1)).exact
    assert judge(flight, answer("wind", "cg_offset")).wrong == ("cg_offset",)
    missed = judge(flight, answer(verdict="unexplained"))
    assert missed.missed == ("wind",)
    assert not missed.right


def test_what_acts_for_a_moment_may_be_named_though_no_percentile_has_it():
    brief = truth(wind=0.05, contact=0.0, largest={"contact": 0.1})
    assert judge(brief, answer("wind", "contact", explains=0.01)).right
    assert judge(truth(wind=0.05, contact=0.0), answer("wind", "contact")).wrong == ("contact",)


def test_a_part_of_a_law_may_be_named_where_the_law_acts():
    flight = truth(vertical_inflow=0.015, gyroscopic=0.01)
    assert judge(flight, answer("momentum_thrust", "rotor_inertia", explains=0.1)).right
    assert judge(truth(wind=0.05), answer("wind", "rotor_inertia")).wrong == ("rotor_inertia",)


def test_a_small_effect_in_a_large_size_is_wrong():
    flight = truth(wind=0.05, thrust_scale=0.005)
    assert claimed_size({"explains": 0.64, "axes": ["Fz"]}, flight, answer(before=1.0)) == 0.08
    assert judge(flight, answer("wind", "thrust_scale", explains=0.64, before=1.0)).wrong == (
        "thrust_scale",
    )


def test_an_alias_counts_where_physics_allows_it_and_the_answer_says_it():
    flight = truth(payload=0.06)
    assert not judge(flight, answer("thrust_scale")).right
    said = judge(
        flight, answer("thrust_scale", aliases=[("payload", "thrust_scale", "air_density")])
    )
    assert said.right
    assert not said.exact
    assert said.named == ("payload",)
    assert not judge(flight, answer("wind", aliases=[("payload", "wind")])).right
    large = {"explains": 0.9, "before": 0.7, "aliases": [("payload", "thrust_scale")]}
    assert judge(truth(payload=0.07), answer("thrust_scale", **large)).right
    assert judge(truth(payload=0.005), answer("thrust_scale", **large)).wrong == ("thrust_scale",)


def test_what_an_effect_contains_may_come_along():
    assert judge(truth(slung_load=0.05), answer("slung_load", "payload")).right
    assert judge(truth(wind=0.05), answer("wind", "vertical_inflow")).right
    assert not judge(truth(payload=0.05), answer("payload", "cg_offset")).right
    assert judge(truth(payload=0.05, payload_moment=0.01), answer("payload", "cg_offset")).right


def test_a_lag_is_needed_only_beyond_a_constant_delay():
    assert judge(truth(motor_lag=0.03), answer(verdict="nothing_missing")).right
    assert judge(truth(motor_lag=0.03), answer("motor_lag")).right
    assert judge(truth(motor_lag=0.03, lag=0.025), answer(verdict="nothing_missing")).missed == (
        "motor_lag",
    )


def test_a_force_in_no_catalogue_may_not_be_explained_away():
    flight = truth(x_downwash=0.05)
    claimed = judge(flight, answer(verdict="nothing_missing"))
    assert claimed.overclaimed
    assert not claimed.right
    assert judge(flight, answer(verdict="unexplained")).right
    assert judge(flight, answer(outside=[{"axes": ["Fz"], "rms": 0.4}])).right
    assert judge(flight, answer("payload", verdict="partly_explained")).wrong == ("payload",)


def test_a_null_is_right_without_wrong_names_and_silent_without_any():
    null = truth(group="null", vertical_inflow=0.01)
    assert judge(null, answer(verdict="nothing_missing")).silent
    named = judge(null, answer("vertical_inflow", explains=0.1))
    assert named.right
    assert not named.silent
    assert not judge(null, answer(verdict="unexplained")).right
    assert judge(
        truth(wall_effect=0.015), answer(verdict="unexplained")
    ).right  # something small is there


def test_no_answer_misses_everything():
    none = judge(truth(wind=0.05), None, "exit code 3")
    assert none.missed == ("wind",)
    assert not none.right


def test_shares_come_with_wilson_intervals():
    assert share([True] * 19 + [False]) == "19/20 = 95% [76%, 99%]"
    assert share([]) == "none"
