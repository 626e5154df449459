"""Rotors that turn on a vehicle that does not fly: no flight, whatever the landed flag says; a quiet hover is one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from log_writers import BinWriter

from models.common.errors import LogError
from models.common.frames import GRAVITY, Array
from models.vehicle import Vehicle, load_vehicle
from replay.flightlog import FlightLog, Interval, Series
from replay.residual.record import build_record
from replay.vehicle.draft import draft
from replay.vehicle.given import Given
from tests.replay.rigid_flight import RATE_HZ, Motion, fly, logged

SHIPPED = Path(__file__).parents[2] / "companion" / "vehicles" / "quad.toml"
SECONDS = 40.0
NOT_FLOWN = "did not fly: rotors turn, but attitude, height and acceleration do not answer"


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    return load_vehicle(SHIPPED)


@pytest.fixture(scope="module")
def flown(vehicle: Vehicle) -> Motion:
    return fly(vehicle, seconds=SECONDS)


def hover_rpm(motion: Motion) -> float:
    return float(np.sqrt((motion.speed**2).mean()))


def held(motion: Motion, speed: Array) -> Motion:
    """The vehicle stands level and still, its rotors at ``speed`` (n,)."""
    n = len(motion.t)
    level = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
    zero = np.zeros((n, 3))
    weighed = np.tile([0.0, 0.0, -GRAVITY], (n, 1))
    rotors = motion.speed.shape[1]
    speeds = np.repeat(speed[:, None], rotors, axis=1)
    return Motion(motion.t, level, zero, zero, zero, weighed, speeds)


def ramps(motion: Motion) -> Array:
    return hover_rpm(motion) * (1.0 + 0.25 * np.sin(0.8 * motion.t))


def constant(motion: Motion) -> Array:
    return np.full(len(motion.t), hover_rpm(motion))


def spin_ups(motion: Motion) -> Array:
    on = (motion.t % 8.0) < 4.0
    return np.where(on, hover_rpm(motion), 0.0)


RUNS = (ramps, constant, spin_ups)


def bench(motion: Motion, vehicle: Vehicle, run: object) -> FlightLog:
    assert callable(run)
    return logged(held(motion, run(motion)), vehicle, Path("bench.tlog"))


def refused(log: FlightLog, vehicle: Vehicle) -> str:
    with pytest.raises(LogError) as error:
        build_record(log, vehicle, None)
    return str(error.value)


@pytest.mark.parametrize("run", RUNS)
def test_a_vehicle_that_is_tied_down_did_not_fly(
    flown: Motion, vehicle: Vehicle, run: object
) -> None:
    log = bench(flown, vehicle, run)
    assert NOT_FLOWN in refused(log, vehicle)


@pytest.mark.parametrize("state", [2, 1])
def test_whatever_the_landed_flag_says(flown: Motion, vehicle: Vehicle, state: int) -> None:
    log = bench(flown, vehicle, ramps)
    landed = (Interval(log.start_s, log.end_s, state),)
    assert NOT_FLOWN in refused(replace(log, landed=landed), vehicle)


@pytest.mark.parametrize("run", RUNS)
def test_a_stand_that_shakes(flown: Motion, vehicle: Vehicle, run: object) -> None:
    log = bench(flown, vehicle, run)
    rng = np.random.default_rng(1)
    imu = log.imus[0]
    force = imu.specific_force
    shaken = Series(force.t_s, force.values + 3.0 * rng.standard_normal(force.values.shape))
    turned = Series(
        imu.gyro.t_s, imu.gyro.values + 0.1 * rng.standard_normal(imu.gyro.values.shape)
    )
    noisy = replace(imu, specific_force=shaken, gyro=turned)
    assert NOT_FLOWN in refused(replace(log, imus=(noisy,)), vehicle)


def test_an_attitude_that_drifts_while_the_vehicle_stands_is_no_flight(
    flown: Motion, vehicle: Vehicle
) -> None:
    spun_up = np.clip(flown.t - 2.0, 0.0, 1.0)
    stood = held(flown, spun_up * constant(flown))
    roll = 0.02 * np.sin(0.5 * flown.t)
    quaternion = np.stack([np.cos(roll / 2.0), np.sin(roll / 2.0), 0.0 * roll, 0.0 * roll], axis=1)
    log = logged(replace(stood, quaternion=quaternion), vehicle, Path("stand.tlog"))
    assert "did not fly" in refused(replace(log, beams=()), vehicle)


@pytest.mark.parametrize(("blow_s", "judged"), [(0.3, True), (5.0, False)])
def test_a_hard_landing_ends_a_low_flight_and_one_before_is_a_hop(
    flown: Motion, vehicle: Vehicle, blow_s: float, judged: bool
) -> None:
    """``blow_s``: before the rotors stop. Height hardly changes, and nothing looks down."""
    stop = len(flown.t) - round(3.0 * RATE_HZ)
    speed = flown.speed.copy()
    speed[: round(2.0 * RATE_HZ)] = 0.0
    speed[stop:] = 0.0
    height = flown.position[:, 2] - flown.position[0, 2]
    position = flown.position.copy()
    position[:, 2] = 0.08 * height / np.abs(height).max()
    force = flown.force.copy()
    blow = stop - round(blow_s * RATE_HZ)
    force[blow : blow + 10, 2] = -2.5 * GRAVITY
    landed = replace(flown, speed=speed, position=position, force=force)
    log = replace(logged(landed, vehicle, Path("low.tlog")), beams=())
    if judged:
        assert build_record(log, vehicle, None).seconds > 10.0
    else:
        assert "did not fly" in refused(log, vehicle)


def test_a_position_that_drifts_is_no_flight(flown: Motion, vehicle: Vehicle) -> None:
    log = bench(flown, vehicle, ramps)
    assert log.position is not None
    assert log.velocity is not None
    t = log.position.t_s - log.start_s
    drift = np.stack([2.0 * np.sin(0.1 * t), np.cos(0.15 * t), 1.5 * np.sin(0.07 * t)], axis=1)
    speed = np.gradient(drift, t, axis=0)
    moved = replace(
        log, position=Series(log.position.t_s, drift), velocity=Series(log.velocity.t_s, speed)
    )
    assert NOT_FLOWN in refused(moved, vehicle)


def test_a_vehicle_in_the_hand_did_not_fly(flown: Motion, vehicle: Vehicle) -> None:
    """The hand turns it, and its thrust lifts nothing."""
    stood = held(flown, ramps(flown))
    roll = 0.2 * np.sin(1.1 * flown.t)
    quaternion = np.stack([np.cos(roll / 2.0), np.sin(roll / 2.0), 0.0 * roll, 0.0 * roll], axis=1)
    rates = np.zeros((len(roll), 3))
    rates[:, 0] = np.gradient(roll, 1.0 / RATE_HZ)
    force = GRAVITY * np.stack([0.0 * roll, -np.sin(roll), -np.cos(roll)], axis=1)
    carried = replace(stood, quaternion=quaternion, rates=rates, force=force)
    log = logged(carried, vehicle, Path("hand.tlog"))
    assert NOT_FLOWN in refused(log, vehicle)


def test_a_bench_run_before_a_flight_leaves_the_flight(flown: Motion, vehicle: Vehicle) -> None:
    whole = build_record(logged(flown, vehicle, Path("flight.tlog")), vehicle, None)
    half = len(flown.t) // 2
    stood = held(flown, ramps(flown))
    pause = slice(half - 200, half)
    speed = np.concatenate([stood.speed[:half], flown.speed[half:]])
    speed[pause] = 0.0
    both = {
        name: np.concatenate([getattr(stood, name)[:half], getattr(flown, name)[half:]])
        for name in ("quaternion", "rates", "position", "velocity", "force")
    }
    mixed = Motion(t=flown.t, speed=speed, **both)
    log = replace(logged(mixed, vehicle, Path("mixed.tlog")), beams=())
    record = build_record(log, vehicle, None)
    times = record.time_s[record.valid]
    assert times.min() > 10.0 + SECONDS / 2.0
    assert record.seconds > whole.seconds / 2.0 - 4.0


def test_a_vehicle_that_settles_under_full_throttle_did_not_fly(
    flown: Motion, vehicle: Vehicle
) -> None:
    """Its ropes give way by a degree, so slowly that no window shows it."""
    roll = np.radians(1.5) * np.exp(-flown.t / (SECONDS / 3.0))
    zero = 0.0 * roll
    quaternion = np.stack([np.cos(roll / 2.0), np.sin(roll / 2.0), zero, zero], axis=1)
    full = held(flown, constant(flown) * 1.4)
    log = logged(replace(full, quaternion=quaternion), vehicle, Path("bench.tlog"))
    assert NOT_FLOWN in refused(log, vehicle)


def always(t: Array) -> Array:
    """It turns by a tenth of a degree, as hovers do without any wind."""
    return np.asarray(0.15 * np.sin(1.9 * t))


def now_and_then(t: Array) -> Array:
    """It rests most of the time, and turns by two degrees for a twelfth of it."""
    return np.where(
        (t > 20.0) & (t < 20.0 + SECONDS / 12.0), 2.0 * np.sin(1.9 * t), 0.08 * np.sin(1.9 * t)
    )


@pytest.mark.parametrize("turned_deg", [always, now_and_then])
def test_a_quiet_hover_is_a_flight(vehicle: Vehicle, turned_deg: Callable[[Array], Array]) -> None:
    """It hardly asks for thrust."""
    quiet = fly(vehicle, seconds=SECONDS)
    roll = np.radians(turned_deg(quiet.t))
    quaternion = np.stack([np.cos(roll / 2.0), np.sin(roll / 2.0), 0.0 * roll, 0.0 * roll], axis=1)
    stood = held(quiet, constant(quiet) * (1.0 + 0.002 * np.sin(3.0 * quiet.t)))
    lift = (stood.speed[:, 0] / hover_rpm(quiet)) ** 2
    force = np.stack([0.0 * lift, 0.0 * lift, -GRAVITY * lift], axis=1)
    rates = np.zeros((len(roll), 3))
    rates[:, 0] = np.gradient(roll, 1.0 / RATE_HZ)
    position = np.tile([0.0, 0.0, -3.0], (len(roll), 1))
    hover = replace(stood, quaternion=quaternion, rates=rates, force=force, position=position)
    record = build_record(logged(hover, vehicle, Path("hover.tlog")), vehicle, None)
    assert record.seconds > 30.0


def test_a_level_climb_is_a_flight(flown: Motion, vehicle: Vehicle) -> None:
    """It never turns, but it feels its thrust."""
    heave = 0.05 * np.sin(1.5 * flown.t)
    stood = held(flown, hover_rpm(flown) * np.sqrt(1.0 + heave))
    force = np.stack([0.0 * heave, 0.0 * heave, -GRAVITY * (1.0 + heave)], axis=1)
    velocity = np.zeros((len(heave), 3))
    velocity[:, 2] = GRAVITY * 0.05 / 1.5 * np.cos(1.5 * flown.t)
    position = np.tile([0.0, 0.0, -3.0], (len(heave), 1))
    position[:, 2] += GRAVITY * 0.05 / 1.5**2 * np.sin(1.5 * flown.t)
    climb = replace(stood, force=force, velocity=velocity, position=position)
    record = build_record(logged(climb, vehicle, Path("climb.tlog")), vehicle, None)
    assert record.seconds > 30.0


def written(path: Path, low_us: float, high_us: float) -> None:
    """A dataflash log of outputs alone: tied down, the landed flag says flying."""
    w = BinWriter()
    w.kind("ATT", "Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw")
    w.kind("IMU", "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
    w.kind("RCOU", "QHHHH", "TimeUS,C1,C2,C3,C4")
    w.kind("PARM", "QNf", "TimeUS,Name,Value")
    w.kind("EV", "QB", "TimeUS,Id")
    parameters = {
        "FRAME_CLASS": 1.0,
        "FRAME_TYPE": 1.0,
        "MOT_PWM_MIN": 1000.0,
        "MOT_PWM_MAX": 2000.0,
    }
    for name, value in parameters.items():
        w.row("PARM", 10_000_000, name, value)
    w.row("EV", 10_000_000, 10)
    rng = np.random.default_rng(1)
    for k in range(1500):
        us = 10_000_000 + 20_000 * k
        noise = 0.6 * rng.standard_normal(3)
        w.row("ATT", us, 0.0, 0.1, 0.0, 1.3, 0.0, 28.6)
        w.row(
            "IMU", us, 0, *(0.02 * rng.standard_normal(3)), noise[0], noise[1], noise[2] - GRAVITY
        )
        spun = 500 <= k < 1400
        middle = (low_us + high_us) / 2.0
        output = middle + (high_us - low_us) / 2.0 * np.sin(0.02 * k)
        w.row("RCOU", us, *[int(output) if spun else 1000] * 4)
        if k == 510:
            w.row("EV", us, 28)
    path.write_bytes(w.bytes())


@pytest.mark.parametrize("outputs", [(1190.0, 1250.0), (1400.0, 1700.0), (1500.0, 1500.0)])
def test_no_vehicle_is_drafted_from_a_bench_run(
    tmp_path: Path, outputs: tuple[float, float]
) -> None:
    path = tmp_path / "bench.bin"
    written(path, *outputs)
    with pytest.raises(LogError, match="did not fly"):
        draft([path], Given())
