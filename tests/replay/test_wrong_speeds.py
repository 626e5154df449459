"""All rotor speeds in another unit, by another number of poles, or at other motors' numbers: faults by name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from log_writers import quad_flight, write_tlog

from models.common.errors import LogError
from models.vehicle import Vehicle, load_vehicle
from models.vehicle.rotor_speed import Hover, misread
from replay.flightlog import EscRecord, FlightLog, Series
from replay.residual.record import Record, build_record
from replay.sources.choose import chosen
from replay.vehicle.draft import draft
from replay.vehicle.given import Given
from tests.replay.rigid_flight import Motion, fly, logged

SHIPPED = Path(__file__).parents[2] / "companion" / "vehicles" / "quad.toml"
VOLTS = 16.0
MOMENTS = {3, 4, 5}


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    return load_vehicle(SHIPPED)


@pytest.fixture(scope="module")
def flown(vehicle: Vehicle) -> Motion:
    return fly(vehicle)


def flight(flown: Motion, vehicle: Vehicle, factor: float = 1.0) -> FlightLog:
    """A log with a battery, its speeds ``factor`` of the true ones."""
    log = logged(flown, vehicle, Path("flight.tlog"))
    times = np.arange(log.start_s, log.end_s, 0.5)
    battery = Series(times, np.tile([VOLTS, np.nan], (len(times), 1)))
    escs = {}
    for number in log.escs:
        rpm = log.escs[number].rpm
        assert rpm is not None
        escs[number] = EscRecord(Series(rpm.t_s, factor * rpm.values))
    return replace(log, battery=battery, escs=escs)


def said(record: Record) -> str:
    return " ".join(fault.what for fault in record.faults)


@pytest.mark.parametrize("factor", [7.0, 10.0])
def test_speeds_that_no_battery_turns_are_a_fault_by_name(
    flown: Motion, vehicle: Vehicle, factor: float
) -> None:
    record = build_record(flight(flown, vehicle, factor), vehicle, None)
    assert f"{factor:.2g} of what" in said(record)
    assert "pole count (SERVO_BLH_POLES, MOT_POLE_COUNT) or unit" in said(record)
    assert not MOMENTS & set(record.axes)


@pytest.mark.parametrize("factor", [0.1, 1.0 / 7.0, 0.01])
@pytest.mark.parametrize("battery", [True, False])
def test_speeds_that_carry_nothing_are_the_reason(
    flown: Motion, vehicle: Vehicle, factor: float, *, battery: bool
) -> None:
    log = flight(flown, vehicle, factor)
    with pytest.raises(LogError, match=rf"{factor:.2g} of what .*: pole count \(SERVO_BLH_POLES"):
        build_record(log if battery else replace(log, battery=None), vehicle, None)


def test_without_a_battery_the_lift_says_it(flown: Motion, vehicle: Vehicle) -> None:
    log = replace(flight(flown, vehicle, 2.6), battery=None)
    text = said(build_record(log, vehicle, None))
    assert "speeds are 2.6 of what carries 3 kg with such propellers: pole count" in text


def test_right_speeds_are_no_fault(flown: Motion, vehicle: Vehicle) -> None:
    assert build_record(flight(flown, vehicle), vehicle, None).faults == ()


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_one_esc_alone_keeps_its_own_message(flown: Motion, vehicle: Vehicle) -> None:
    log = flight(flown, vehicle)
    rpm = log.escs[2].rpm
    assert rpm is not None
    other = {**log.escs, 2: EscRecord(Series(rpm.t_s, 7.0 * rpm.values))}
    record = build_record(replace(log, escs=other), vehicle, None)
    assert [fault.channel for fault in record.faults] == ["rpm_2"]
    assert "of what" not in said(record)


@pytest.mark.parametrize(
    ("volts", "rpm"),
    [
        (3.7, 17_000.0),
        (7.4, 9_500.0),
        (16.0, 11_000.0),
        (22.8, 3_500.0),
        (24.0, 12_000.0),
        (52.0, 1_000.0),
    ],
)
def test_speeds_of_real_multirotors_may_be(volts: float, rpm: float) -> None:
    """Crazyflie, Mini, racing quadrotors of 4 and 6 cells, Inspire, an agricultural octocopter."""
    assert misread(rpm, Hover(rotors=4, places=4, voltage_v=volts), {}) is None


def test_the_pole_count_that_fits_is_named() -> None:
    hover = Hover(rotors=4, places=4, voltage_v=15.8)
    high = misread(7.0 * 6_500.0, hover, {"SERVO_BLH_POLES": 14.0})
    low = misread(6_500.0 / 6.0, hover, {"SERVO_BLH_POLES": 24.0})
    assert high is not None
    assert "electrical speed (eRPM) of 14 poles" in high
    assert low is not None
    assert "poles instead of 24" in low


def test_mass_and_propeller_say_it_without_a_battery() -> None:
    by_mass = misread(669.0, Hover(rotors=4, places=4, mass_kg=1.5), {})
    by_both = misread(669.0, Hover(rotors=4, places=4, mass_kg=1.5, radius_m=0.12), {})
    by_size = misread(669.0, Hover(rotors=4, places=4, radius_m=0.12, radius_spread=1.25), {})
    assert by_mass is not None
    assert by_both is not None
    assert by_size is not None
    assert "0.1 of what carries 1.5 kg with such propellers" in by_both


def shifted(log: FlightLog, order: dict[int, int]) -> FlightLog:
    """ESC ``n`` sends the speed of ESC ``order[n]``."""
    return replace(log, escs={n: log.escs[old] for n, old in order.items()})


@pytest.mark.parametrize(
    "order", [{1: 4, 2: 1, 3: 2, 4: 3}, {1: 2, 2: 3, 3: 4, 4: 1}, {1: 1, 2: 3, 3: 2, 4: 4}]
)
def test_speeds_at_the_numbers_of_other_motors(
    flown: Motion, vehicle: Vehicle, order: dict[int, int]
) -> None:
    record = build_record(shifted(flight(flown, vehicle), order), vehicle, None)
    assert "speeds stand at the numbers of other motors" in said(record)
    assert f"ESC 2 output {order[2]}" in said(record)
    assert not MOMENTS & set(record.axes)
    assert 2 in record.axes


def test_escs_that_are_numbered_by_motor_are_right(flown: Motion, vehicle: Vehicle) -> None:
    """Motor 1 on output 3, 2 on 4, 3 on 2 and 4 on 1: PX4 and CAN count by motor."""
    log = flight(flown, vehicle)
    assert log.servo is not None
    wired = {1: 3, 2: 4, 3: 2, 4: 1}
    values = log.servo.values.copy()
    for motor, output in wired.items():
        values[:, output - 1] = log.servo.values[:, motor - 1]
    parameters = {f"SERVO{output}_FUNCTION": 32.0 + motor for motor, output in wired.items()}
    moved = chosen(
        replace(log, servo_ports={0: Series(log.servo.t_s, values)}, parameters=parameters)
    )
    assert "numbers of other motors" not in said(build_record(moved, vehicle, None))


def test_no_vehicle_is_drafted_from_impossible_speeds(tmp_path: Path) -> None:
    path = tmp_path / "flight.tlog"
    write_tlog(path, quad_flight())
    right = draft([path], Given())
    assert right.vehicle.telemetered
    assert right.doubts == ()
    given = draft([path], Given(mass_kg=300.0))
    assert not given.vehicle.telemetered
    assert "carries 300 kg" in given.doubts[0]
    assert "outputs are used instead" in given.notes[0]
