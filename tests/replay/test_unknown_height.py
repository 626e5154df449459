"""A height that is unknown: effects of the ground cannot be judged there, all others can."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from companion.mavlink.samples import RangeVerdict
from models.common.frames import Array
from models.vehicle import Vehicle, load_vehicle
from replay.flightlog import Beam, FlightLog
from replay.residual.record import Record, build_record
from tests.replay.rigid_flight import fly, logged

SHIPPED = Path(__file__).parents[2] / "companion" / "vehicles" / "quad.toml"


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    return load_vehicle(SHIPPED)


def flown(vehicle: Vehicle, height_m: float) -> FlightLog:
    """A flight whose lowest point is ``height_m`` over the ground, and whose highest is half a metre over that."""
    motion = fly(vehicle, height_m=height_m)
    position = motion.position.copy()
    position[:, 2] = -height_m - 0.1 * (-height_m - position[:, 2])
    return logged(replace(motion, position=position), vehicle, Path("flight.tlog"))


def judged(log: FlightLog, vehicle: Vehicle, known: Array, verdict: RangeVerdict) -> Record:
    """Its record where the rangefinder tells the distance in the samples ``known`` (n,) alone."""
    beam = log.beam("down")
    assert beam is not None
    verdicts = tuple(RangeVerdict.OK if good else verdict for good in known.tolist())
    return build_record(replace(log, beams=(replace(beam, verdicts=verdicts),)), vehicle, None)


def readings(log: FlightLog) -> Beam:
    beam = log.beam("down")
    assert beam is not None
    return beam


NOTHING = (RangeVerdict.LOW_QUALITY, RangeVerdict.BELOW_MIN)


@pytest.mark.parametrize("verdict", NOTHING)
def test_a_sensor_that_is_out_of_range_for_most_of_the_flight(
    vehicle: Vehicle, verdict: RangeVerdict
) -> None:
    log = flown(vehicle, 3.0)
    whole = build_record(replace(log, beams=()), vehicle, None)
    times = readings(log).distance.t_s
    record = judged(log, vehicle, times < times[0] + 2.0, verdict)
    assert record.seconds == pytest.approx(whole.seconds, abs=1.0)
    far = np.isinf(record.context.state.h_m).all(axis=1)
    assert far.mean() > 0.9
    assert any("height over ground unknown in 3" in note for note in record.notes)


def test_a_gap_near_the_ground_stays_out(vehicle: Vehicle) -> None:
    log = flown(vehicle, 0.5)
    times = readings(log).distance.t_s
    gap = (times > times[0] + 10.0) & (times < times[0] + 16.0)
    record = judged(log, vehicle, ~gap, RangeVerdict.LOW_QUALITY)
    inside = (record.time_s > times[0] + 11.0) & (record.time_s < times[0] + 15.0)
    assert not record.valid[inside].any()
    assert not np.isinf(record.context.state.h_m[inside]).any()
    assert any("perhaps small" in left.reason for left in record.excluded)


def test_a_gap_near_the_ground_without_a_position_stays_out(vehicle: Vehicle) -> None:
    log = replace(flown(vehicle, 0.5), position=None, velocity=None)
    times = readings(log).distance.t_s
    gap = (times > times[0] + 10.0) & (times < times[0] + 16.0)
    record = judged(log, vehicle, ~gap, RangeVerdict.LOW_QUALITY)
    inside = (record.time_s > times[0] + 11.0) & (record.time_s < times[0] + 15.0)
    assert not record.valid[inside].any()


def test_a_low_flight_whose_height_is_hardly_known_is_judged_for_all_else(vehicle: Vehicle) -> None:
    log = flown(vehicle, 0.5)
    times = readings(log).distance.t_s
    record = judged(log, vehicle, times < times[0] + 3.0, RangeVerdict.LOW_QUALITY)
    assert record.seconds > 30.0
    assert not np.isfinite(record.context.state.h_m[record.valid]).any()
    assert any("its effects are not judged" in note for note in record.notes)


def test_no_good_reading_at_all_is_a_log_without_that_sensor(vehicle: Vehicle) -> None:
    log = flown(vehicle, 3.0)
    nothing = np.zeros(len(readings(log).distance), bool)
    for verdict in NOTHING:
        record = judged(log, vehicle, nothing, verdict)
        assert record.seconds > 30.0
        assert any("taken to be far away" in note for note in record.notes)


def test_a_whole_height_is_used_as_before(vehicle: Vehicle) -> None:
    record = build_record(flown(vehicle, 0.5), vehicle, None)
    assert np.isfinite(record.context.state.h_m[record.valid]).all()
    assert not any("unknown" in note for note in record.notes)
