"""A motor that fails in flight is named with its time; what is no failure names none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from companion.vehicles import chosen_vehicle
from models.effects import Context
from replay.diagnosis.motor_losses import loss_json, loss_text
from replay.flightlog import FlightLog, LogFault, MotorLoss, ParameterChange, Series
from replay.logs.formats import load
from replay.residual.log_state import raw_state
from replay.residual.lost_speed import SLOW_SHARE
from replay.residual.motion import read_motion
from replay.residual.motor_failure import _seen
from replay.residual.motor_signals import evidence_of
from replay.residual.record import build_record
from replay.search.thresholds import SURE
from tests.simulators.failing import cases, craft, tlog, world

BOOT_S = 30.0
SINCE_S = 22.0
KINDS: Mapping[str, tuple[tuple[int, ...], float]] = {
    "stopped": ((4,), 1.0),
    "thrown": ((2,), 1.0),
    "partial": ((1,), 0.6),
    "ordinary": ((), 1.0),
    "dive": ((), 6.0),
    "flip": ((), 5.0),
    "drop": ((), 0.25),
}
"""Motors and size by kind."""


@dataclass(frozen=True)
class Flights:
    """Logs and vehicle files of one flight of each kind."""

    folder: Path

    def log(self, kind: str, *, speeds: bool) -> FlightLog:
        return next(iter(load(self.folder / f"{_name(kind, speeds=speeds)}.tlog", None, {})))

    def faults(self, log: FlightLog, kind: str, *, speeds: bool) -> list[LogFault]:
        vehicle = chosen_vehicle(self.folder / f"{_name(kind, speeds=speeds)}.toml")
        return [
            fault for fault in build_record(log, vehicle, None).faults if fault.since_s is not None
        ]


def _name(kind: str, *, speeds: bool) -> str:
    return f"{kind}_{'speeds' if speeds else 'outputs'}"


@pytest.fixture(scope="module")
def flights(tmp_path_factory: pytest.TempPathFactory) -> Flights:
    rng = np.random.default_rng(3)
    folder = tmp_path_factory.mktemp("failing")
    crafts = [craft.draw("quad-x", rng) for _ in KINDS]
    flown = [
        cases.Case(
            kind=kind,
            motors=motors,
            since_s=SINCE_S,
            size=size,
            end_s=SINCE_S + 6.0,
            height_m=(12.0, 20.0),
        )
        for kind, (motors, size) in KINDS.items()
    ]
    tape = world.fly(crafts, flown, rng)
    for i, (vehicle, case) in enumerate(zip(crafts, flown, strict=True)):
        for speeds in (False, True):
            own = folder / f"{_name(case.kind, speeds=speeds)}.tlog"
            tlog.write(own, vehicle, case, tape, i, 3, speeds=speeds, rates=tlog.Rates())
            text = craft.vehicle_toml(vehicle, rng, speeds=speeds)
            own.with_suffix(".toml").write_text(text, encoding="utf-8")
    return Flights(folder)


@pytest.mark.parametrize("speeds", [False, True], ids=["outputs", "speeds"])
@pytest.mark.parametrize("kind", ["stopped", "thrown", "partial"])
def test_the_motor_and_the_time_are_named(flights: Flights, kind: str, speeds: bool) -> None:
    log = flights.log(kind, speeds=speeds)
    first = flights.faults(log, kind, speeds=speeds)[0]
    assert first.motors == KINDS[kind][0]
    assert first.since_s == pytest.approx(BOOT_S + SINCE_S, abs=0.5)
    assert f"motor {first.motors[0]} (" in first.what


@pytest.mark.parametrize("speeds", [False, True], ids=["outputs", "speeds"])
@pytest.mark.parametrize("kind", ["ordinary", "dive", "flip", "drop"])
def test_where_none_fails_none_is_named(flights: Flights, kind: str, speeds: bool) -> None:
    log = flights.log(kind, speeds=speeds)
    assert flights.faults(log, kind, speeds=speeds) == []


def test_the_words_say_place_output_and_what_the_vehicle_does(flights: Flights) -> None:
    first = flights.faults(flights.log("stopped", speeds=False), "stopped", speeds=False)[0]
    assert first.what.startswith("motor 4 (rear right, output 4) gives no thrust from ")
    assert "its output rises to 2000 us" in first.what
    assert first.as_json()["motors"] == [4]


@pytest.mark.parametrize("speeds", [False, True], ids=["outputs", "speeds"])
def test_a_motor_that_fails_is_an_effect_that_begins(flights: Flights, speeds: bool) -> None:
    log = flights.log("stopped", speeds=speeds)
    first = flights.faults(log, "stopped", speeds=speeds)[0]
    effect = loss_json(first)
    assert effect["name"] == "fan_imbalance"
    assert effect["since_s"] == pytest.approx(BOOT_S + SINCE_S, abs=0.5)
    assert effect["parameters"]["fan"]["value"] == 4
    low, high = effect["parameters"]["scale"]["ci95"]
    assert low <= -1.0 <= high < 0.0
    assert 0.9 < effect["probability"] < 1.0


def test_a_motor_that_stalls_is_not_said_to_have_lost_all() -> None:
    """Below 55 % of the speed that is asked, 30 % of the thrust may be left."""
    stalled = _seen("rpm_2", "motor 2 does not follow its output", 12.0, 2, 1.0 - SLOW_SHARE**2)
    low, high = loss_json(stalled)["parameters"]["scale"]["ci95"]
    assert (low, high) == pytest.approx((-1.0, -0.6975))
    assert low < loss_json(stalled)["parameters"]["scale"]["value"] < high


def test_no_motor_is_named_more_surely_than_any_effect() -> None:
    loss = MotorLoss(motors=(1,), share=0.9, interval=(0.8, 1.0), probability=1.0)
    fault = LogFault("servo_1", "motor 1 gives no thrust", 12.0, loss)
    assert loss_json(fault)["probability"] == SURE
    assert "probability 1.00" not in "".join(loss_text(fault))


def test_of_two_motors_the_effect_names_none() -> None:
    loss = MotorLoss(motors=(1, 3), share=0.5, interval=(0.4, 0.6), probability=0.96)
    effect = loss_json(LogFault("servo_1", "one of motors 1 and 3 gives less thrust", 12.0, loss))
    assert effect["parameters"]["fan"]["value"] is None
    assert effect["parameters"]["fan"]["ci95"] == (1.0, 3.0)
    assert effect["parameters"]["scale"]["value"] == -0.5


def test_a_speed_that_is_lost_while_the_vehicle_flies_on_is_telemetry(flights: Flights) -> None:
    log = flights.log("ordinary", speeds=True)
    rpm = log.escs[2].rpm
    assert rpm is not None
    gone = np.where(rpm.t_s[:, None] > BOOT_S + SINCE_S, 0.0, rpm.values)
    quiet = replace(log.escs[2], rpm=Series(rpm.t_s, gone, rpm.source))
    lost = replace(log, escs={**log.escs, 2: quiet})
    (fault,) = flights.faults(lost, "ordinary", speeds=True)
    assert fault.motors == ()
    assert "telemetry is lost" in fault.what


def test_an_output_that_a_parameter_takes_away_is_named_with_it(flights: Flights) -> None:
    log = flights.log("ordinary", speeds=False)
    change = ParameterChange(BOOT_S + SINCE_S, "SERVO3_FUNCTION", 35.0, 1.0)
    (fault,) = flights.faults(replace(log, parameter_changes=(change,)), "ordinary", speeds=False)
    assert fault.motors == (3,)
    assert "SERVO3_FUNCTION was set to 1" in fault.what


def test_exchanged_places_are_not_told_apart_where_the_order_is_unknown(flights: Flights) -> None:
    log = flights.log("stopped", speeds=False)
    vehicle = replace(chosen_vehicle(flights.folder / "stopped_outputs.toml"), assumed=("order",))
    assert [fault for fault in build_record(log, vehicle, None).faults if fault.motors] == []


def test_a_row_beside_a_gap_is_no_evidence(flights: Flights) -> None:
    # What is declared there has no slope, so that its doubt is unknown; it made likelihoods that are no numbers.
    log = flights.log("ordinary", speeds=False)
    vehicle = chosen_vehicle(flights.folder / "ordinary_outputs.toml")
    motion = read_motion(log, vehicle)
    context = Context(state=raw_state(log, vehicle, motion), vehicle=vehicle)
    outputs = context.state.servo_us.copy()
    outputs[1000:1200] = np.nan
    holed = replace(context, state=replace(context.state, servo_us=outputs))
    seen = evidence_of(holed, motion, np.ones(len(outputs), bool))
    assert np.isfinite(seen.doubt[seen.good]).all()
    assert not seen.good.all()


def test_a_blow_between_two_samples_of_the_accelerometer_shows_in_the_velocity(
    flights: Flights,
) -> None:
    """A hard touch-down turns 5 m/s round; what follows says nothing of a motor."""
    log = flights.log("ordinary", speeds=False)
    vehicle = chosen_vehicle(flights.folder / "ordinary_outputs.toml")
    motion = read_motion(log, vehicle)
    context = Context(state=raw_state(log, vehicle, motion), vehicle=vehicle)
    flying = np.ones(len(motion.grid.t), bool)
    middle = len(flying) // 2
    bounced = motion.velocity.copy()
    bounced[middle:, 2] -= 7.0
    struck = evidence_of(context, replace(motion, velocity=bounced), flying).struck
    every = motion.grid.every
    assert struck[middle // every - 1 : middle // every + 2].any()
    assert not evidence_of(context, motion, flying).struck[middle // every - 1 :][:3].any()
