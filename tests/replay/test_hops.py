"""Hops of decimetres, with feet that touch between, are no flight that can be judged; other low ways are."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from companion.vehicles import chosen_vehicle
from models.common.errors import LogError
from models.common.frames import Array, rotation_from_quaternion
from replay.logs.formats import load
from replay.residual.hops import stays_low, touches
from replay.residual.record import build_record
from tests.simulators.failing import cases, craft, tlog, world

FLIGHTS = 4
HZ = 50.0
CLEAR_M = 0.02
LEAST_HOPS = 4
LOWEST_M = 0.1
LONG_S = 40.0
HIGHEST_M = 0.45
LONGEST_S = 4.0
ROCKING_RAD = 0.5
HOP = cases.Case(
    kind="hops", motors=(), since_s=1e3, size=ROCKING_RAD, end_s=60.0, height_m=(0.1, 0.2)
)


LOW = replace(HOP, kind="ordinary", height_m=(0.3, 0.4))
"""Stays as low, but in the air."""


@dataclass(frozen=True)
class Hopped:
    """Logs and vehicle files, and what truly happened."""

    logs: list[Path]
    rises_m: list[Array]
    """Height over the ground [m] of what is next to it, at 50 Hz."""


def lowest_m(tape: world.Tape, vehicle: craft.Craft, i: int) -> Array:
    """Height (n,) of the point that is next to the ground."""
    points = world.touching(vehicle.places[None], np.array([vehicle.arm_m]))[0]
    rotation = rotation_from_quaternion(tape.quaternion[:, i])
    below = np.einsum("nij,kj->nki", rotation, points)[..., 2]
    return np.asarray(-(tape.position[:, i, 2:] + below).max(axis=1))


@pytest.fixture(scope="module")
def hopped(tmp_path_factory: pytest.TempPathFactory) -> Hopped:
    rng = np.random.default_rng(11)
    folder = tmp_path_factory.mktemp("hops")
    logs = []
    rises = []
    crafts = [craft.draw("quad-x", rng) for _ in range(FLIGHTS + 1)]
    flown = [HOP] * FLIGHTS + [LOW]
    tape = world.fly(crafts, flown, rng)
    for i, vehicle in enumerate(crafts):
        rises.append(lowest_m(tape, vehicle, i))
        case = flown[i]
        for speeds in (False, True):
            log = folder / f"hops_{i}_{speeds}.tlog"
            tlog.write(log, vehicle, case, tape, i, i, speeds=speeds, rates=tlog.Rates())
            text = craft.vehicle_toml(vehicle, rng, speeds=speeds)
            log.with_suffix(".toml").write_text(text, encoding="utf-8")
            logs.append(log)
    return Hopped(logs, rises)


def test_the_hops_are_low_and_short(hopped: Hopped) -> None:
    for rise in hopped.rises_m[:FLIGHTS]:
        clear = rise > CLEAR_M
        edges = np.flatnonzero(np.diff(np.concatenate([[False], clear, [False]]).astype(int)))
        lengths = np.diff(edges)[::2] / HZ
        assert LOWEST_M < rise.max() < HIGHEST_M
        assert len(lengths) > LEAST_HOPS
        assert lengths.max() < LONGEST_S


def test_hops_are_refused(hopped: Hopped) -> None:
    for path in hopped.logs[: 2 * FLIGHTS]:
        log = next(iter(load(path, None, {})))
        vehicle = chosen_vehicle(path.with_suffix(".toml"))
        with pytest.raises(LogError, match="did not fly"):
            build_record(log, vehicle, None)


def test_a_low_flight_is_judged(hopped: Hopped) -> None:
    for path in hopped.logs[2 * FLIGHTS :]:
        log = next(iter(load(path, None, {})))
        record = build_record(log, chosen_vehicle(path.with_suffix(".toml")), None)
        assert record.seconds > LONG_S


def test_a_descent_is_no_hop() -> None:
    down_m = np.linspace(-900.0, 0.0, round(LONG_S * HZ))
    assert not stays_low(down_m, HZ)


def test_a_hover_that_drifts_down_is_no_hop() -> None:
    down_m = np.linspace(-600.0, -598.2, round(LONG_S * HZ))
    assert not stays_low(down_m, HZ)


def test_pressure_under_turning_rotors_is_no_descent() -> None:
    """On a bench their wash raises it: the height seems to sink by 0.8 m."""
    down_m = np.concatenate([np.zeros(50), np.full(round(LONG_S * HZ), 0.8)])
    assert stays_low(down_m, HZ)


def test_steep_turns_at_one_height_do_not_touch() -> None:
    """Half of the time it feels 2.5 g, in between 1 g, with as much lift as that takes."""
    time_s = np.arange(0.0, LONG_S, 1.0 / HZ)
    load_g = 1.75 + 0.75 * np.sin(time_s)
    felt = np.stack([np.zeros_like(load_g), np.zeros_like(load_g), -load_g], axis=1)
    assert not touches(np.zeros(len(time_s), bool), load_g, felt, HZ)


def test_blows_on_the_ground_touch() -> None:
    """1 g, and ten landings of 3 g."""
    load_g = np.ones(round(LONG_S * HZ))
    load_g[100:1500:140] = 3.0
    felt = np.stack([np.zeros_like(load_g), np.zeros_like(load_g), -load_g], axis=1)
    assert touches(np.zeros(len(load_g), bool), np.ones_like(load_g), felt, HZ)
