"""The rules by which answers of ``replay diagnose`` are judged."""

from __future__ import annotations

from dataclasses import asdict

import pytest
from diagnosis import reliability
from diagnosis.flights_judge import judge, rms_ratio
from shares import wilson

AXES = ["Fx", "Fy", "Fz", "Mx", "My", "Mz"]


def truth(group="single", effects=(), channels=(), carrying=("Fz",)):
    def table(scale):
        return {"axes": AXES, "before": [scale] * 6, "oracle": [0.5 * scale] * 6}

    return {
        "group": group, "effects": list(effects), "channels": list(channels), "axes_carrying_it": list(carrying),
        "rms_by_bandwidth_hz": {"1": table(1.0), "2": table(1.2), "5": table(1.5), "12": table(2.0)},
    }  # fmt: skip


def answer(*names, verdict="explained", aliases=(), channels=(), after=0.6):
    return {
        "verdict": verdict, "effects": [{"name": n} for n in names], "aliases": [list(a) for a in aliases],
        "unexplained": {"channels": [{"name": c, "score": 1.0} for c in channels]},
        "axes": {a: {"rms_before": 1.2, "rms_after": after, "unit": "N"} for a in AXES},
    }  # fmt: skip


def test_the_true_name_alone_is_right():
    assert judge("wind", truth(effects=["wind"]), answer("wind"), 0).exact


def test_a_second_name_is_wrong_even_beside_the_true_one():
    verdict = judge("wind", truth(effects=["wind"]), answer("wind", "imu_bias"), 0)
    assert not verdict.right
    assert verdict.wrong_names == ("imu_bias",)


def test_an_alias_counts_only_inside_a_listed_class_and_when_reported():
    payload = truth(effects=["payload"])
    said = judge(
        "payload", payload, answer("thrust_scale", aliases=[("payload", "thrust_scale")]), 0
    )
    assert said.right
    assert not said.exact
    assert not judge("payload", payload, answer("thrust_scale"), 0).right
    assert not judge("payload", payload, answer("wind", aliases=[("payload", "wind")]), 0).right


def test_half_of_a_pair_is_missed():
    verdict = judge("pair", truth("pair", ["wind", "payload"]), answer("wind"), 0)
    assert verdict.missed == ("payload",)
    assert not verdict.wrong_names


def test_nulls_must_stay_silent():
    assert judge("null", truth("null"), answer(verdict="nothing_missing"), 0).right
    assert not judge("null", truth("null"), answer(verdict="unexplained"), 0).right
    assert not judge("null", truth("null"), answer("wind"), 0).right


def test_strangers_need_the_verdict_and_a_right_channel_and_no_name():
    unlisted = truth("unlisted", channels=["yaw_rad", "rpm_*"])
    assert judge("x", unlisted, answer(verdict="unexplained", channels=["rpm_3"]), 0).right
    assert not judge("x", unlisted, answer(verdict="unexplained", channels=["time_s"]), 0).right
    assert not judge(
        "x", unlisted, answer("wind", verdict="partly_explained", channels=["yaw_rad"]), 0
    ).right


def test_only_flights_without_the_needed_messages_may_be_refused():
    assert judge("bad_no_imu", truth("bad"), None, 3).right
    assert not judge("bad_no_imu", truth("bad"), None, 1).right
    assert not judge("wind", truth(effects=["wind"]), None, 3).right


def test_the_wrong_mass_must_be_found_as_a_ratio_of_thrust_to_mass():
    wrong = truth("bad", ["payload"])
    assert judge("bad_mass_low", wrong, answer("thrust_scale"), 0).right
    assert not judge("bad_mass_low", wrong, answer(verdict="nothing_missing"), 0).right


def test_rms_is_compared_at_the_bandwidth_that_the_answer_used():
    # Said to be 1.2 before: the table's 2 Hz; the oracle there is 0.6.
    assert rms_ratio(truth(effects=["wind"]), answer("wind", after=0.66)) == pytest.approx(
        1.1, rel=0.02
    )


def test_wilson_interval_of_19_in_20():
    low, high = wilson(19, 20)
    assert low == pytest.approx(0.764, abs=0.002)
    assert high == pytest.approx(0.991, abs=0.002)


def test_every_name_is_a_statement_that_reliability_can_count():
    said = answer("wind", "imu_bias")
    said["effects"][0] |= {"probability": 0.97, "q_value": 0.01, "status": "confirmed"}
    statements = judge("wind", truth(effects=["wind"]), said, 0).statements
    assert [(s.effect, s.right, s.probability) for s in statements] == [
        ("wind", True, 0.97),
        ("imu_bias", False, None),
    ]
    (row,) = reliability.statements(
        {"group": "single", "judgement": {"statements": [asdict(s) for s in statements]}}
    )
    assert (row.kind, row.basis, row.right) == ("simulated", reliability.PROBABILITY, True)
