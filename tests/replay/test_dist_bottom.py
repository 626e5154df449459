"""PX4's ``dist_bottom``: a rangefinder only where one made it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from log_writers import UlgWriter

from replay.flightlog import FlightLog
from replay.logs.formats import load

SECONDS, RATE_HZ = 20.0, 20
RISES_S, LANDS_S = 5.0, 15.0
RANGE, FLOW = 1, 2
REACH_M = 1.5


def height(t: float) -> float:
    return 0.1 if not RISES_S < t < LANDS_S else 0.1 + min(t - RISES_S, LANDS_S - t)


def written(path: Path, valid: Callable[[float], bool], bits: int | None) -> FlightLog:
    """A flight to 5 m; ``valid`` of the time; ``bits`` of dist_bottom_sensor_bitfield, None in old firmware."""
    w = UlgWriter()
    w.topic("vehicle_attitude", ("float[4]", "q"))
    flags = ("xy_valid", "z_valid", "v_xy_valid", "v_z_valid", "dist_bottom_valid")
    numbers = ("x", "y", "z", "vx", "vy", "vz", "dist_bottom")
    fields = [("float", n) for n in numbers] + [("bool", n) for n in flags]
    newer = [] if bits is None else [("uint8_t", "dist_bottom_sensor_bitfield")]
    w.topic("vehicle_local_position", *fields, *newer)
    w.topic("vehicle_land_detected", ("bool", "landed"))
    w.subscribe()
    for k in range(round(SECONDS * RATE_HZ)):
        t = k / RATE_HZ
        us = 20_000_000 + round(1e6 * t)
        w.row("vehicle_attitude", us, 1.0, 0.0, 0.0, 0.0)
        above = height(t)
        values = [0.0, 0.0, -above, 0.0, 0.0, 0.0, above]
        known = [True, True, True, True, valid(t)]
        w.row("vehicle_local_position", us, *values, *known, *([] if bits is None else [bits]))
        w.row("vehicle_land_detected", us, not RISES_S < t < LANDS_S)
    path.write_bytes(w.bytes())
    return load(path)[0]


def on_ground(t: float) -> bool:
    return not RISES_S < t < LANDS_S


def in_reach(t: float) -> bool:
    return height(t) < REACH_M


def always(_: float) -> bool:
    return True


@pytest.mark.parametrize("bits", [0, FLOW])
def test_without_a_range_sensor_it_is_no_rangefinder(tmp_path: Path, bits: int) -> None:
    assert not written(tmp_path / "a.ulg", always, bits).beams


@pytest.mark.parametrize("bits", [RANGE, RANGE + FLOW, None])
def test_what_a_range_sensor_made_is_used(tmp_path: Path, bits: int | None) -> None:
    log = written(tmp_path / "a.ulg", in_reach, bits)
    beam = log.beam("down")
    assert beam is not None
    assert float(beam.distance.values.max()) < REACH_M


def test_what_old_firmware_calls_valid_on_the_ground_only_is_no_rangefinder(tmp_path: Path) -> None:
    assert not written(tmp_path / "a.ulg", on_ground, None).beams
