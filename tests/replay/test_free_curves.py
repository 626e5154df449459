"""What no effect explains: which channel carries it, and when it is only noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnose_noise import noise_record

from models.frames import Array
from replay.residual.delays import Delay
from replay.residual.record import Record
from replay.search.free_curves import REACTIVE_SHARE, SMALLEST_SHARE, Channel, free_search, smallest_share
from replay.search.noise import fit_noise


@pytest.fixture(scope="module")
def quiet() -> Record:
    """Two minutes of noise."""
    return noise_record(21, 120.0, 0.3)


def search(record: Record, force: Array | None = None, axis: int = 2) -> tuple[Channel, ...]:
    """The free search of the record's residual, with ``force`` (n,) added on one axis."""
    rest = record.residual.copy()
    if force is not None:
        rest[:, axis] += force
    return free_search(record, rest, fit_noise(rest, record.valid, record.step_s), 0)


def test_noise_is_left_alone(quiet: Record) -> None:
    assert not search(quiet)


def test_a_force_with_place_names_the_place(quiet: Record) -> None:
    force = 1.2 * np.tanh((quiet.channels["north_m"] + 0.5) / 0.3)
    found = search(quiet, force)
    assert found
    assert found[0].name in ("north_m", "range_forward_m")
    assert found[0].axis == "Fz"


def test_a_hum_is_named_by_its_frequency(quiet: Record) -> None:
    found = search(quiet, 1.0 * np.sin(2.0 * np.pi * 0.43 * quiet.time_s), axis=0)
    assert found[0].name == "time_s"
    assert found[0].peak_hz == pytest.approx(0.43, abs=0.02)


def test_what_answers_a_disturbance_has_to_carry_more(quiet: Record) -> None:
    vehicle = quiet.context.vehicle
    assert smallest_share("rpm_1", "Fx", vehicle) == REACTIVE_SHARE > SMALLEST_SHARE
    assert smallest_share("north_m", "Fx", vehicle) == SMALLEST_SHARE
    assert smallest_share("rpm_1", "My", vehicle) > 1.0  # in hover every moment is mirrored by what balances it


@pytest.mark.slow
def test_in_a_flight_that_only_hovers_place_is_drift(quiet: Record) -> None:
    hover = replace(quiet, delays=(Delay("rotor speed", -0.1, 0.45, False),))
    moved = replace(quiet, delays=(Delay("rotor speed", -0.02, 0.9, True),))
    force = 1.2 * np.tanh((quiet.channels["north_m"] + 0.5) / 0.3)
    assert search(moved, force)
    assert not any(c.name in ("north_m", "range_forward_m") for c in search(hover, force))
    hum = 1.0 * np.sin(2.0 * np.pi * 0.43 * quiet.time_s)
    assert search(hover, hum, axis=0)[0].name == "time_s"


def test_a_step_late_in_the_flight_is_a_matter_of_time(quiet: Record) -> None:
    late = replace(quiet, residual=quiet.residual.copy())
    force = 1.5 * (quiet.time_s > quiet.time_s[0] + 70.0)
    assert "time_s" in {c.name for c in search(late, force, axis=1)}
