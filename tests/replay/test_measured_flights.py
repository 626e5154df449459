"""The rules by which answers on measured flights are judged, and the table that they are judged by."""

from __future__ import annotations

import json
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from diagnosis import reliability
from measured import answers, measured_flights
from measured.judge import OLD_NAMES, judge, judge_refusal
from measured.known import CATALOGUE, TABLE, YOUNGER, Flight, Range, read, together

from models.effects import catalogue

KNOWN = read()
WEIGHT_N = 20.0
FLIGHT = Flight("source", "measured", "a/flight.tlog", "a/vehicle.toml", ("Fx", "Fy", "Fz"))


def answer(*effects, verdict="explained", aliases=(), after=0.1, **more):
    entries = [
        e if isinstance(e, dict) else {"name": e, "q_value": 0.01, "status": "candidate"}
        for e in effects
    ]
    axes = {a: {"rms_before": 1.0, "rms_after": after, "unit": "N"} for a in ("Fx", "Fy", "Fz")}
    return {
        "verdict": verdict,
        "effects": entries,
        "aliases": [list(a) for a in aliases],
        "axes": axes,
        **more,
    }


def verdict_on(flight, *effects, **more):
    return judge(flight, KNOWN, answer(*effects, **more), WEIGHT_N)


def sized(name, **values):
    return {
        "name": name,
        "parameters": {k: {"value": v, "ci95": [v, v], "unit": "1"} for k, v in values.items()},
    }


def test_every_effect_of_the_catalogue_may_stand_in_the_table():
    assert {e.name for e in catalogue()} <= CATALOGUE | YOUNGER
    assert not CATALOGUE & YOUNGER


@pytest.mark.parametrize("table", sorted(TABLE.parent.glob("*.toml")), ids=lambda path: path.stem)
def test_no_flight_contradicts_itself(table):
    for f in read(table).flights:
        assert not f.never & f.true, f.name
        assert not f.unknown & f.true - f.may, f.name
        assert all(r.low <= r.high for r in f.limits + f.sizes), f.name


def test_a_flight_stands_once_in_the_sums():
    logs = [f.log for f in KNOWN.flights if not f.again]
    assert len(logs) == len(set(logs))


def test_the_logs_and_vehicle_files_are_there(shared_data):
    absent = {f.name: f.missing(shared_data) for f in KNOWN.flights}
    assert not {name: files for name, files in absent.items() if files}


def test_flights_together_must_name_what_each_must_and_may_name_what_any_may():
    wind, drag = frozenset({"wind"}), frozenset({"rotor_drag"})
    one = replace(FLIGHT, must=(wind, drag), never=frozenset({"payload", "ceiling"}))
    other = replace(
        FLIGHT, log="a/other.tlog", must=(drag,), never=frozenset({"payload"}), open=True
    )
    (both,) = together([one, other, replace(FLIGHT, vehicle="b.toml")])
    assert both.logs == ("a/flight.tlog", "a/other.tlog")
    assert (both.must, both.true, both.never, both.open) == (
        (drag,),
        wind | drag,
        frozenset({"payload"}),
        True,
    )


def test_what_must_be_named_is_right_when_named_and_missed_when_not():
    flight = replace(FLIGHT, must=(frozenset({"wind"}), frozenset({"rotor_drag", "body_drag"})))
    assert verdict_on(flight, "wind", "body_drag").right
    assert verdict_on(flight, "wind").missed == ("body_drag|rotor_drag",)


def test_what_may_be_there_is_no_miss_and_the_unknown_is_neither_right_nor_wrong():
    flight = replace(FLIGHT, may=frozenset({"wind"}), unknown=frozenset({"cg_offset"}))
    got = verdict_on(flight, "wind", "cg_offset")
    assert got.right
    assert got.unknown == ("cg_offset",)
    assert [s.right for s in got.statements] == [True, None]
    assert verdict_on(flight, verdict="nothing_missing").right


def test_any_other_name_is_wrong():
    assert verdict_on(FLIGHT, "payload").wrong == ("payload",)


def test_a_name_that_is_new_to_the_table_is_unknown():
    assert verdict_on(FLIGHT, "downwash").unknown == ("downwash",)


def test_an_alias_counts_when_the_answer_says_it_and_the_table_agrees():
    flight = replace(FLIGHT, must=(frozenset({"thrust_scale"}),))
    assert verdict_on(flight, "payload", aliases=[("payload", "thrust_scale")]).right
    assert verdict_on(flight, "payload").wrong == ("payload",)
    assert verdict_on(flight, "ceiling", aliases=[("ceiling", "thrust_scale")]).wrong == (
        "ceiling",
    )


def test_an_alias_beside_the_true_name_is_a_second_name_and_wrong():
    flight = replace(FLIGHT, must=(frozenset({"fan_imbalance"}),))
    pair = [("fan_imbalance", "cg_offset")]
    assert verdict_on(flight, "cg_offset", aliases=pair).right
    assert verdict_on(flight, "fan_imbalance", "cg_offset", aliases=pair).wrong == ("cg_offset",)


def test_an_alias_of_an_unknown_name_is_unknown():
    flight = replace(FLIGHT, unknown=frozenset({"imu_bias"}))
    assert verdict_on(flight, "wind", aliases=[("wind", "imu_bias")]).unknown == ("wind",)
    assert verdict_on(flight, "wind").wrong == ("wind",)


def test_what_is_excluded_by_name_is_wrong_even_as_an_alias():
    flight = replace(FLIGHT, may=frozenset({"thrust_scale"}), never=frozenset({"payload"}))
    assert verdict_on(flight, "payload", aliases=[("payload", "thrust_scale")]).wrong == (
        "payload",
    )


def test_a_size_outside_its_limits_makes_the_name_wrong_and_outside_its_tolerance_does_not():
    flight = replace(
        FLIGHT,
        must=(frozenset({"fan_imbalance"}),),
        limits=(Range("fan_imbalance", "fan", 3, 3),),
        sizes=(Range("fan_imbalance", "scale", -0.3, -0.1),),
    )
    other_fan = verdict_on(flight, sized("fan_imbalance", fan=2.0, scale=-0.2))
    assert other_fan.wrong == ("fan_imbalance",)
    assert other_fan.missed
    too_large = verdict_on(flight, sized("fan_imbalance", fan=3.0, scale=-0.4))
    assert too_large.right
    assert [s.right for s in too_large.sizes] == [False]


@pytest.mark.parametrize("asked", ["sizes", "limits"])
def test_a_size_that_the_answer_does_not_have_is_no_silent_pass(asked):
    flight = replace(
        FLIGHT, may=frozenset({"slung_load"}), **{asked: (Range("slung_load", "weight", 0.1, 0.2),)}
    )
    with pytest.raises(ValueError, match=r"asks for slung_load\.weight"):
        verdict_on(flight, sized("slung_load", mass_kg=0.15))


def test_a_size_is_judged_by_its_name_in_the_contract_and_by_the_older_one():
    sizes = (Range("slung_load", "mass_kg", 0.1, 0.2), Range("slung_load", "length_m", 0.4, 0.6))
    flight = replace(FLIGHT, may=frozenset({"slung_load"}), sizes=sizes)
    for said in (
        sized("slung_load", mass_kg=0.15, length_m=0.7),
        sized("slung_load", mass=0.15, rope_m=0.7),
    ):
        assert [s.right for s in verdict_on(flight, said).sizes] == [True, False]


def test_what_the_tables_ask_is_what_the_catalogue_says():
    """An older name of a parameter, or a slip of the pen, would leave its size unjudged."""
    have = {e.name: {p.name for p in (*e.coefficients, *e.shapes)} for e in catalogue()}
    for table in sorted(TABLE.parent.glob("*.toml")):
        for f in read(table).flights:
            for r in (*f.sizes, *f.limits):
                assert {r.parameter, OLD_NAMES.get(r.parameter)} & have[r.effect], f"{f.name}: {r}"


def test_explained_with_too_much_left_is_an_overclaim():
    assert not verdict_on(FLIGHT, after=0.5, verdict="nothing_missing").overclaim
    assert verdict_on(FLIGHT, after=0.7, verdict="nothing_missing").overclaim
    assert not verdict_on(FLIGHT, after=0.7, verdict="unexplained").overclaim


def test_what_the_best_fit_leaves_is_no_overclaim():
    flight = replace(FLIGHT, axes=("Fz",), best=(("Fz", 0.9),))
    assert not verdict_on(flight, after=1.0).overclaim
    assert verdict_on(flight, after=1.1).overclaim


def test_an_axis_that_says_nothing_is_not_judged():
    assert not verdict_on(replace(FLIGHT, axes=()), after=5.0).overclaim


def test_explained_where_something_unrecorded_acts_is_an_overclaim():
    flight = replace(FLIGHT, open=True)
    assert verdict_on(flight).overclaim
    assert verdict_on(flight, verdict="partly_explained").right


def test_explained_beside_a_remainder_that_the_answer_lists_is_an_overclaim():
    assert verdict_on(FLIGHT, outside=[{"axes": ["Fz"], "rms": 0.05, "unit": "N"}]).overclaim


def test_a_fault_of_the_log_has_to_be_said():
    flight = replace(FLIGHT, must=(frozenset({"fault:rpm_1"}),))
    assert verdict_on(flight).missed == ("fault:rpm_1",)
    assert verdict_on(flight, log_faults=[{"channel": "rpm_1", "what": "reads 0"}]).right


def test_the_channel_that_carries_the_rest_has_to_be_among_the_first():
    flight = replace(
        FLIGHT, must=(frozenset({"channel:yaw_rad"}),), verdicts=frozenset({"unexplained"})
    )
    channels = {"channels": [{"name": "down_m"}, {"name": "yaw_rad"}]}
    assert verdict_on(flight, verdict="unexplained", unexplained=channels).right
    assert verdict_on(
        flight, verdict="unexplained", unexplained={"channels": [{"name": "down_m"}]}
    ).missed


def test_a_refusal_counts_against_unless_the_flight_is_short_or_the_fault_is_named():
    assert judge_refusal(FLIGHT, 3, "too short").refused
    assert judge_refusal(replace(FLIGHT, short=True), 3, "too short").excused
    faulty = replace(FLIGHT, short=True, must=(frozenset({"fault:rpm_1"}),))
    assert judge_refusal(faulty, 3, "rpm_1 reads 0").right
    assert judge_refusal(replace(FLIGHT, short=True), 1, "Traceback").verdict == "failed"


def test_reliability_counts_what_was_stated_against_what_was_right(tmp_path):
    flight = replace(FLIGHT, must=(frozenset({"wind"}),), unknown=frozenset({"cg_offset"}))
    stated = [
        {"name": n, "probability": 0.93, "q_value": 0.01} for n in ("wind", "payload", "cg_offset")
    ]
    row = measured_flights.as_json(verdict_on(flight, *stated))
    file = tmp_path / "judged.json"
    file.write_text(json.dumps({"flights": [row, row | {"again": True}]}))
    said = reliability.read(file)
    assert [(s.effect, s.right) for s in said] == [("wind", True), ("payload", False)]
    (only,) = reliability.bins(said, reliability.PROBABILITY)
    assert (only.low, only.right, only.trials) == (0.9, 1, 2)
    picture = tmp_path / "reliability.png"
    reliability.plot(picture, {"measured": said})
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_without_probabilities_the_q_value_stands_in_and_is_called_so():
    flight = replace(FLIGHT, must=(frozenset({"wind"}),))
    said = reliability.statements(measured_flights.as_json(verdict_on(flight, "wind")))
    assert [(s.basis, s.sure) for s in said] == [(reliability.Q_VALUE, pytest.approx(0.99))]


def test_absent_flights_are_left_out_by_name(tmp_path, capsys):
    assert measured_flights.main(["--data", str(tmp_path), "--source", "neighbour"]) == 0
    said = capsys.readouterr().err
    assert "ns_pair_swap_ll_cf101_02" in said
    assert "not part of the project" in said


def test_an_unknown_source_is_refused_with_the_names_there_are(capsys):
    assert measured_flights.main(["--source", "nonesuch"]) == 2
    assert "neural-fly" in capsys.readouterr().err


def test_flights_in_a_relative_folder_are_found(tmp_path, monkeypatch):
    """``--data LOGS``: the command runs in the project's folder, and not where the user is."""
    asked = []

    def run(command, **_):
        asked.extend(command)
        return subprocess.CompletedProcess(command, 3, "", "replay: flight.tlog: is empty")

    monkeypatch.setattr(subprocess, "run", run)
    monkeypatch.chdir(tmp_path)
    answers.ask([Path("logs/flight.tlog")], Path("logs/vehicle.toml"), "none", 60.0)
    assert {str(tmp_path / "logs" / name) for name in ("flight.tlog", "vehicle.toml")} <= set(asked)
