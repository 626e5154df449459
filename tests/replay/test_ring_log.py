"""Walls from a ring of range directions in a log: the distances that the diagnosis works with."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from log_writers import BinWriter, UlgWriter

from companion.mavlink.samples import Ring
from companion.vehicles import default_vehicle
from models.vehicle import Rangefinder
from replay.flightlog import FlightLog
from replay.logs.formats import load
from replay.residual.distances import distances, unseen_surfaces

T = np.arange(0.0, 20.0, 0.02)
VEHICLE = replace(default_vehicle(), rangefinders=(Rangefinder(target="wall", position_m=(0.0, 0.0, 0.0), ring=8),))
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
    found = distances(log_of((0.5 * math.pi, 2.0), frozen_s=7.0), VEHICLE, T, ROTATION, POSITION, 0.0)
    assert not np.isfinite(found["d_m"][(T > 15.5) & (T < 19.0), 0]).any()


def sector_minima(gap_m: float, bearing_deg: float, most: float = 6.0) -> list[float]:
    """What ArduPilot logs of an upright wall: the nearest return of each sector of 45 degrees."""
    out = []
    for middle in range(0, 360, 45):
        aside = abs(math.remainder(bearing_deg - middle, 360.0))
        nearest = math.radians(max(aside - 22.5, 0.0))
        out.append(min(gap_m / math.cos(nearest), most) if nearest < 1.5 else most)
    return out


def bin_with_proximity(
    path: Path, bearing_deg: float, cutoff_hz: float | None, raw: bool = False, health: int = 2
) -> FlightLog:
    """The flight of this module in a dataflash log, the wall 2 m from its start."""
    w = BinWriter()
    w.kind("ATT", "Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw")
    w.kind("XKF1", "QBffffff", "TimeUS,C,VN,VE,VD,PN,PE,PD")
    w.kind("PRX", "QBBfffffffffff", "TimeUS,Layer,He,D0,D45,D90,D135,D180,D225,D270,D315,DUp,CAn,CDis")
    w.kind("PRXR", "QBffffffff", "TimeUS,Layer,D0,D45,D90,D135,D180,D225,D270,D315")
    w.kind("PARM", "QNf", "TimeUS,Name,Value")
    if cutoff_hz is not None:
        w.row("PARM", 10_000_000, "PRX_FILT", cutoff_hz)
    state = np.array(sector_minima(2.0, bearing_deg))
    share = 1.0 if cutoff_hz is None else 1.0 - math.exp(-2.0 * math.pi * cutoff_hz * 0.02)
    for k, (t, east) in enumerate(zip(T.tolist(), EAST.tolist(), strict=True)):
        us = 10_000_000 + round(1e6 * t)
        now = np.array(sector_minima(2.0 - east * math.sin(math.radians(bearing_deg)), bearing_deg))
        state = np.where(now == 6.0, now, state + share * (now - state))
        w.row("ATT", us, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        w.row("XKF1", us, 0, 0.0, 0.0, 0.0, 0.0, east, -2.0)
        if k % 5 == 0:
            w.row("PRX", us, 1, health, *[0.5] * 8, 0.0, bearing_deg, 0.5)
            w.row("PRX", us, 2, health, *state, 0.0, bearing_deg, min(state))
            if raw:
                w.row("PRXR", us, 2, *now)
    path.write_bytes(w.bytes())
    return load(path)[0]


@pytest.mark.parametrize(("bearing_deg", "cutoff_hz", "raw"), [(90, None, False), (70, 0.25, False), (115, 0.25, True)])
def test_proximity_of_a_dataflash_log_is_the_wall(
    tmp_path: Path, bearing_deg: float, cutoff_hz: float | None, raw: bool
) -> None:
    log = bin_with_proximity(tmp_path / "x.bin", bearing_deg, cutoff_hz, raw)
    found = distances(log, VEHICLE, T + log.start_s, ROTATION, POSITION, 0.0)
    known = np.isfinite(found["d_m"][:, 0]) & (T > 1.0)
    assert known.mean() > 0.85
    towards = math.radians(bearing_deg)
    gap = 2.0 - EAST * math.sin(towards)
    assert found["wall_bearing_rad"][known] == pytest.approx(towards, abs=math.radians(2.0))
    # From the CG to the wall, in place of the lips: their reach depends on the bearing.
    reach = np.median((gap - found["d_m"].min(axis=1))[known])
    off = gap[known] - reach - found["d_m"].min(axis=1)[known]
    assert np.abs(off).max() < 0.06
    assert np.sqrt(np.mean(off**2)) < 0.03


def test_a_proximity_sensor_without_data_is_no_clear_sight(tmp_path: Path) -> None:
    log = bin_with_proximity(tmp_path / "x.bin", 90.0, None, health=1)
    assert log.rings == ()
    assert unseen_surfaces(log, VEHICLE) != []


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
