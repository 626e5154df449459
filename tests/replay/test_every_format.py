"""What every log format promises: one suite, run for each reader. A new format adds its writer to ``FLIGHTS``."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from log_writers import bin_flight, flight, ulg_flight, write_tlog

import models
from companion.config import PipelineConfig
from companion.vehicles import default_vehicle
from replay.flightlog import FlightLog, Series
from replay.logs.formats import READERS, load
from replay.rerun.harness import Replay
from replay.rerun.log_samples import samples

FLIGHTS: dict[str, Callable[[Path], object]] = {
    ".tlog": lambda path: write_tlog(path, flight(4.0)),
    ".bin": lambda path: path.write_bytes(bin_flight(4.0)),
    ".ulg": lambda path: path.write_bytes(ulg_flight(4.0)),
}


@pytest.fixture(params=sorted(READERS))
def log(request: pytest.FixtureRequest, tmp_path: Path) -> FlightLog:
    assert request.param in FLIGHTS, (
        f"give a writer of a {request.param} flight: every format passes this suite"
    )
    path = tmp_path / f"flight{request.param}"
    FLIGHTS[request.param](path)
    logs = load(path)
    assert len(logs) == 1, "one boot"
    return logs[0]


def series_of(log: FlightLog) -> dict[str, Series]:
    """Every series that the flight has."""
    out = {
        name: getattr(log, name)
        for name in (
            "attitude",
            "rates",
            "position",
            "velocity",
            "servo",
            "battery",
            "pressure",
            "thrust_command",
        )
    }
    out |= {f"imu {i}": imu.specific_force for i, imu in enumerate(log.imus)}
    out |= {f"gyro {i}": imu.gyro for i, imu in enumerate(log.imus)}
    out |= {f"beam {beam.name}": beam.distance for beam in log.beams}
    out |= {f"esc {n}": esc.rpm for n, esc in log.escs.items()}
    return {name: series for name, series in out.items() if series is not None}


def test_stamps_grow_and_lie_within_the_flight(log: FlightLog) -> None:
    for name, series in series_of(log).items():
        assert series.values.shape[0] == len(series.t_s), name
        assert all(b > a for a, b in pairwise(series.t_s)), name
        assert series.t_s[0] >= log.start_s - 1.0, name
        assert series.t_s[-1] <= log.end_s + 1.0, name


def test_attitudes_are_unit_quaternions_that_never_flip(log: FlightLog) -> None:
    q = log.attitude.values
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, atol=1e-6)
    assert (np.sum(q[1:] * q[:-1], axis=1) > 0.0).all()


def test_a_hovering_accelerometer_feels_the_lift_upwards(log: FlightLog) -> None:
    force = np.nanmedian(log.imus[0].specific_force.values, axis=0)
    assert -12.0 < force[2] < -7.0, "m/s^2, body FRD: up is negative"
    assert np.abs(force[:2]).max() < 3.0


def test_units_are_si(log: FlightLog) -> None:
    assert np.nanmax(np.abs(log.rates.values)) < 20.0, "rad/s"
    for beam in log.beams:
        assert np.linalg.norm(beam.direction_frd) == pytest.approx(1.0)
        assert 0.01 < np.nanmedian(beam.good.values) < 50.0, "m"
    assert 3.0 < np.nanmedian(log.battery.values[:, 0]) < 100.0, "V"
    if log.servo is not None:
        outputs = log.servo.values[np.isfinite(log.servo.values) & (log.servo.values > 0.0)]
        assert 700.0 < np.median(outputs) < 2300.0, "us"
    for number, esc in log.escs.items():
        assert number >= 1, "ESCs count from 1"
        assert 100.0 < np.nanmedian(esc.rpm.values) < 60_000.0, "rpm"


def test_counts_and_notes_say_what_was_read(log: FlightLog) -> None:
    assert log.summary.bytes == log.path.stat().st_size
    assert log.summary.frames > 0
    assert all("\n" not in note for note in log.summary.notes)


def test_the_flight_goes_through_the_pipeline(log: FlightLog) -> None:
    config = PipelineConfig(vehicle=default_vehicle(), model=models.load(), dry_run=True)
    rerun = Replay(config, assumed={"GUID_OPTIONS": 8.0})
    decisions = list(rerun.decisions_on(samples(log)))
    assert len(decisions) > 20
    assert rerun.samples["Attitude"] > 20
    assert all(b.t_s >= a.t_s for a, b in pairwise(decisions))
