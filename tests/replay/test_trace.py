"""The search for effects: what it may adopt, what it must refuse, on made-up residuals of known noise."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from models.effects import Effect, catalogue, get
from replay.residual import Delay, Record
from replay.trace import Trace, trace

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
from diagnose_noise import noise_record


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
