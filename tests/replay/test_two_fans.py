"""Fans that are weak one after the other are two names, each with its fan and time; one weak fan is one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from companion.vehicles import chosen_vehicle
from replay.diagnosis.diagnose import diagnose
from tests.simulators.failing import cases, craft, tlog, world

SECONDS = 85.0
SINCE_S = 20.0
BOOT_S = 30.0
SOON_S = 2.0
NEAR = 0.06
"""How near a share of thrust has to come."""
MOTORS = ((1, 2), (4, 2), (1, 3), (3,))
LOST = 0.25
"""Share of its thrust that a weak one lacks."""


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[int, ...], Path]:
    rng = np.random.default_rng(21)
    folder = tmp_path_factory.mktemp("weak")
    crafts = [craft.draw("quad-x", rng) for _ in MOTORS]
    flown = [
        cases.Case(
            kind="weak",
            motors=motors,
            since_s=SINCE_S,
            size=LOST,
            end_s=SECONDS,
            height_m=(12.0, 20.0),
        )
        for motors in MOTORS
    ]
    tape = world.fly(crafts, flown, rng)
    out = {}
    for i, (vehicle, case) in enumerate(zip(crafts, flown, strict=True)):
        log = folder / f"weak_{i}.tlog"
        tlog.write(log, vehicle, case, tape, i, i, speeds=True, rates=tlog.Rates())
        text = craft.vehicle_toml(vehicle, rng, speeds=True)
        log.with_suffix(".toml").write_text(text, encoding="utf-8")
        out[case.motors] = log
    return out


@pytest.mark.slow
@pytest.mark.parametrize("motors", MOTORS, ids=str)
def test_every_weak_fan_is_named(logs: dict[tuple[int, ...], Path], motors: tuple[int]) -> None:
    path = logs[motors]
    answer = diagnose([path], chosen_vehicle(path.with_suffix(".toml")), None)
    fans = [f.parameters for f in answer.found if f.effect.name == "fan_imbalance"]
    assert sorted(p["fan"] for p in fans) == sorted(motors)
    for p in fans:
        since = BOOT_S + SINCE_S + world.WEAK_EVERY_S * motors.index(round(p["fan"]))
        assert p["scale"] == pytest.approx(-LOST, abs=NEAR)
        assert p["from_s"] == pytest.approx(since, abs=SOON_S)
        assert p["until_s"] == pytest.approx(since + world.WEAK_S, abs=SOON_S)
