"""Walls from a ring of range directions in a log: the distances that the diagnosis works with."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from log_writers import UlgWriter

from companion.mavlink.samples import Ring
from companion.vehicles import default_vehicle
from models.vehicle import Rangefinder
from replay.flightlog import FlightLog
from replay.logs.formats import load
from replay.residual.distances import distances, unseen_surfaces

T = np.arange(0.0, 20.0, 0.02)
VEHICLE = replace(
    default_vehicle(),
    rangefinders=(Rangefinder(target="wall", position_m=(0.0, 0.0, 0.0), ring=8),),
)
EAST = np.interp(T, [2.0, 8.0, 12.0, 18.0], [0.0, 1.2, 1.2, 0.0])
ROTATION = np.broadcast_to(np.eye(3), (len(T), 3, 3))
POSITION = np.stack([np.zeros(len(T)), EAST, np.full(len(T), -2.0)], axis=1)
BEARINGS = tuple(k * math.pi / 4.0 for k in range(8))


def log_of(*walls, frozen_s=math.inf):
    """A log of the flight between walls (bearing, distance of the start)."""
    rings = []
    for t in np.arange(0.05, 19.9, 0.1).tolist():
        y = float(np.interp(min(t, frozen_s), T, EAST))
        out = []
        for a in BEARINGS:
            hits = [(d - y * math.sin(b)) / c for b, d in walls if (c := math.cos(a - b)) > 1e-6]
            out.append(min(hits, default=math.inf))
        rings.append(Ring(t, 1, 1, BEARINGS, tuple(out), northward=False))
    return FlightLog(path=None, system=1, boot=0, start_s=0.0, end_s=20.0, rings=tuple(rings))  # type: ignore[arg-type]


def test_a_log_with_a_ring_gives_the_wall_of_flight():
    found = distances(log_of((0.5 * math.pi, 2.0)), VEHICLE, T, ROTATION, POSITION, 0.0)
    known = np.isfinite(found["d_m"][:, 0])
    assert known.mean() > 0.98
    assert np.abs(found["d_m"][:, 0] - (2.0 - EAST - 0.21))[known].max() < 0.02
    assert found["wall_bearing_rad"][known] == pytest.approx(0.5 * math.pi)
    assert not np.isfinite(found["second_d_m"]).any()
    assert unseen_surfaces(log_of((0.0, 2.0)), VEHICLE) == []


def test_both_walls_of_a_corner_are_in_the_log():
    found = distances(log_of((0.5 * math.pi, 2.0), (0.0, 1.5)), VEHICLE, T, ROTATION, POSITION, 0.0)
    near = (T > 9.0) & (T < 11.0)
    assert found["d_m"][near, 0] == pytest.approx(2.0 - 1.2 - 0.21, abs=0.02)
    assert np.degrees(found["second_bearing_rad"][near]) == pytest.approx(0.0, abs=3.0)


def test_a_ring_that_freezes_while_the_vehicle_moves_is_not_believed():
    found = distances(
        log_of((0.5 * math.pi, 2.0), frozen_s=7.0), VEHICLE, T, ROTATION, POSITION, 0.0
    )
    assert not np.isfinite(found["d_m"][(T > 15.5) & (T < 19.0), 0]).any()


@pytest.mark.parametrize("topic", ["obstacle_distance", "obstacle_distance_fused"])
def test_obstacle_distance_of_a_px4_log_is_the_wall(tmp_path: Path, topic: str) -> None:
    w = UlgWriter()
    w.topic("vehicle_attitude", ("float[4]", "q"))
    w.topic("sensor_combined", ("float[3]", "gyro_rad"), ("float[3]", "accelerometer_m_s2"))
    w.topic(
        topic, ("float", "increment"), ("float", "angle_offset"), ("uint16_t[72]", "distances"),
        ("uint16_t", "min_distance"), ("uint16_t", "max_distance"), ("uint8_t", "frame"),
    )  # fmt: skip
    w.subscribe()
    for k, (t, east) in enumerate(zip(T.tolist(), EAST.tolist(), strict=True)):
        us = 20_000_000 + round(1e6 * t)
        w.row("vehicle_attitude", us, 1.0, 0.0, 0.0, 0.0)
        w.row("sensor_combined", us, 0.0, 0.0, 0.0, 0.0, 0.0, -9.8)
        if k % 5 == 0:
            cosines = [math.cos(math.radians(5.0 * i - 30.0 - 90.0)) for i in range(72)]
            read = [round(100.0 * (2.0 - east) / c) if c > 0.2 else 1001 for c in cosines]
            w.row(topic, us, 5.0, -30.0, *read[:71], 65535, 20, 1000, 12)
    path = tmp_path / "x.ulg"
    path.write_bytes(w.bytes())
    log = load(path)[0]
    found = distances(log, VEHICLE, T + log.start_s, ROTATION, POSITION, 0.0)
    known = np.isfinite(found["d_m"][:, 0])
    assert known.mean() > 0.98
    assert np.abs(found["d_m"][:, 0] - (2.0 - EAST - 0.21))[known].max() < 0.03
