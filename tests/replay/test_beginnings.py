"""A fan that loses thrust in flight is one effect with a beginning, and takes nothing from other effects."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from noise_records import noise_record

from models.effects import catalogue, get
from replay.diagnosis.amended_model import amended
from replay.diagnosis.diagnose import conclude
from replay.residual.record import Record
from replay.search.beginnings import times_of

NAMES = ("fan_imbalance", "cg_offset", "payload", "thrust_scale")
EFFECTS = [effect for effect in catalogue() if effect.name in NAMES]
LOSS = -0.2


@pytest.fixture(scope="module")
def quiet() -> Record:
    """Ninety seconds of noise."""
    return noise_record(12, 90.0, 0.3)


def weakened(record: Record, fan: float, from_s: float) -> Record:
    """The record with a fan that gives less from a time on."""
    wrench = np.nan_to_num(get("fan_imbalance").regressors(record.context, (fan,)))[..., 0]
    begun = (record.time_s >= from_s)[:, None]
    return replace(record, residual=record.residual + LOSS * wrench * begun)


def test_the_time_is_suggested_by_the_residual(quiet: Record) -> None:
    middle = float(quiet.time_s[400]) + 0.7
    weak = weakened(quiet, 2.0, middle)
    wrench = np.nan_to_num(get("fan_imbalance").regressors(weak.context, (2.0,)))[..., 0]
    begun = [start for start, end in times_of(weak, wrench) if end == 0.0]
    assert min(abs(start - middle) for start in begun) < 1.0


def test_nothing_begins_right_after_the_start_or_ends_right_before_the_end(quiet: Record) -> None:
    """The ground lifts and the pack is not settled: the first seconds in the air pass for a lighter vehicle."""
    wrench = np.nan_to_num(get("payload").regressors(quiet.context, ()))[..., 0]
    soon = float(quiet.time_s[0]) + 4.0
    light = replace(quiet, residual=quiet.residual + 0.3 * wrench * (quiet.time_s > soon)[:, None])
    times = [time for pair in times_of(light, wrench) for time in pair if time > 0.0]
    assert min(times) >= float(quiet.time_s[0]) + 8.0
    assert max(times) <= float(quiet.time_s[-1]) - 8.0


@pytest.mark.parametrize("until", [False, True], ids=["picked up", "dropped"])
def test_a_load_that_comes_or_goes_is_named_with_its_time(quiet: Record, until: bool) -> None:
    middle = float(quiet.time_s[400]) + 0.7
    carried = (quiet.time_s < middle) if until else (quiet.time_s >= middle)
    wrench = np.nan_to_num(get("payload").regressors(quiet.context, ()))[..., 0]
    load = replace(quiet, residual=quiet.residual + 0.3 * wrench * carried[:, None])
    (entry,) = conclude([load], effects=EFFECTS).as_json(None)["effects"]
    assert entry["name"] == "payload"
    assert entry["until_s" if until else "since_s"] == pytest.approx(middle, abs=1.0)
    low, high = entry["parameters"]["mass_kg"]["ci95"]
    assert low <= 0.3 <= high


def test_a_fan_that_gets_weak_in_flight_has_its_beginning_in_the_answer(quiet: Record) -> None:
    middle = float(quiet.time_s[400]) + 0.7
    answer = conclude([weakened(quiet, 2.0, middle)], effects=EFFECTS)
    (entry,) = answer.as_json(None)["effects"]
    assert entry["name"] == "fan_imbalance"
    assert entry["parameters"]["fan"]["value"] == 2.0
    assert entry["since_s"] == pytest.approx(middle, abs=1.0)
    low, high = entry["parameters"]["scale"]["ci95"]
    assert low <= LOSS <= high


def test_a_fan_that_recovers_has_its_end(quiet: Record) -> None:
    first = float(quiet.time_s[300])
    last = float(quiet.time_s[550])
    weak = weakened(quiet, 2.0, first)
    healed = replace(
        weak, residual=np.where((quiet.time_s < last)[:, None], weak.residual, quiet.residual)
    )
    answer = conclude([healed], effects=EFFECTS)
    (entry,) = answer.as_json(None)["effects"]
    assert entry["name"] == "fan_imbalance"
    assert entry["since_s"] == pytest.approx(first, abs=1.0)
    assert entry["until_s"] == pytest.approx(last, abs=1.0)


def test_a_fan_that_is_weak_from_the_start_has_none(quiet: Record) -> None:
    answer = conclude([weakened(quiet, 2.0, 0.0)], effects=EFFECTS)
    entry = answer.as_json(None)["effects"][0]
    assert entry["name"] == "fan_imbalance"
    assert "since_s" not in entry
    assert "until_s" not in entry


def test_what_ended_in_the_flight_is_not_in_the_next_one(quiet: Record) -> None:
    last = float(quiet.time_s[450])
    weak = weakened(quiet, 2.0, 0.0)
    over = (quiet.time_s >= last)[:, None]
    answer = conclude(
        [replace(weak, residual=np.where(over, quiet.residual, weak.residual))], effects=EFFECTS
    )
    (entry,) = answer.as_json(None)["effects"]
    assert entry["until_s"] == pytest.approx(last, abs=1.0)
    assert entry["kept"] is False
    assert answer.adopted == ()
    assert "not kept: it ended in this flight" in answer.as_text()


def test_the_next_flight_starts_with_it(quiet: Record) -> None:
    """A time of one log means nothing in another."""
    answer = conclude([weakened(quiet, 2.0, float(quiet.time_s[400]))], effects=EFFECTS)
    model = amended(quiet.context.model, answer.vehicle, answer.adopted)
    kept = {e.name: e.parameters for e in model.effects}["fan_imbalance"]
    assert "from_s" not in kept
    assert kept["scale"] < 0.0


def test_a_fan_that_loses_most_of_its_thrust_is_one_effect(quiet: Record) -> None:
    middle = float(quiet.time_s[400]) + 0.7
    wrench = np.nan_to_num(get("fan_imbalance").regressors(quiet.context, (2.0,)))[..., 0]
    begun = (quiet.time_s >= middle)[:, None]
    dead = replace(quiet, residual=quiet.residual - 0.85 * wrench * begun)
    (entry,) = conclude([dead], effects=EFFECTS).as_json(None)["effects"]
    assert entry["name"] == "fan_imbalance"
    low, high = entry["parameters"]["scale"]["ci95"]
    assert low <= -0.85 <= high
