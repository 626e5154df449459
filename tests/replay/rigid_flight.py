"""A rigid quadrotor that really turns, as a FlightLog: rotor speeds make its moments. For tests of log faults."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from companion.mavlink.range_beams import orientation_direction
from companion.mavlink.samples import RangeVerdict
from models.common.frames import GRAVITY, Array, rotation_from_quaternion
from models.vehicle import RHO_SEA_LEVEL, Vehicle
from replay.flightlog import Beam, EscRecord, FlightLog, ImuRecord, Series

RATE_HZ = 100.0
RANGE_HZ = 20.0


@dataclass(frozen=True)
class Motion:
    """What truly happened at ``RATE_HZ``: quaternion, rates, position and velocity NED, specific force, rotor rpm."""

    t: Array
    quaternion: Array
    rates: Array
    position: Array
    velocity: Array
    force: Array
    speed: Array


def fly(vehicle: Vehicle, seconds: float = 40.0, height_m: float = 3.0) -> Motion:
    """Thrust steps up and down, roll, pitch and yaw by differences of rotor speed; free air."""
    n = int(seconds * RATE_HZ)
    t = np.arange(n) / RATE_HZ
    arms = np.array([fan.position_m for fan in vehicle.fans])
    spins = np.array([float(fan.rotors[0].spin) for fan in vehicle.fans])
    area, radius = np.pi * vehicle.rotor_radius_m**2, vehicle.rotor_radius_m
    ct, cq = vehicle.fans[0].ct or 0.0, vehicle.fans[0].cq or 0.0
    per_thrust = -spins * cq / ct * radius
    allocation = np.stack([-arms[:, 1], arms[:, 0], per_thrust, np.ones(len(arms))])
    inertia = np.array(vehicle.inertia_kgm2)
    roll = 0.10 * np.sin(1.9 * t) + 0.04 * np.sin(6.3 * t)
    pitch = 0.10 * np.sin(2.3 * t + 1.0) + 0.04 * np.sin(7.1 * t)
    yaw = 0.4 * np.sin(0.7 * t) + 0.05 * np.sin(4.3 * t)
    quaternion = _attitude(roll, pitch, yaw)
    rotation = _matrices(quaternion)
    rates = _rates(rotation)
    wanted = np.gradient(rates, 1.0 / RATE_HZ, axis=0)
    moments = inertia * wanted + np.cross(rates, inertia * rates)
    heave = 0.6 * np.sin(0.9 * t) + 0.4 * np.sin(2.3 * t)
    lift = vehicle.mass_kg * (GRAVITY + heave) / rotation[:, 2, 2]
    thrust = np.linalg.lstsq(allocation, np.column_stack([moments, lift]).T, rcond=None)[0].T
    speed = np.sqrt(thrust / (ct * RHO_SEA_LEVEL * area * radius**2)) * 60.0 / (2.0 * np.pi)
    force = np.zeros((n, 3))
    force[:, 2] = -lift / vehicle.mass_kg
    acceleration = np.einsum("nij,nj->ni", rotation, force) + np.array([0.0, 0.0, GRAVITY])
    acceleration -= acceleration.mean(axis=0)
    velocity = np.cumsum(acceleration, axis=0) / RATE_HZ
    velocity -= velocity.mean(axis=0)
    # What moved the vehicle besides its lift (a wind that holds it in place) is felt, too.
    felt = np.einsum("nji,nj->ni", rotation, acceleration - np.array([0.0, 0.0, GRAVITY]))
    position = np.cumsum(velocity, axis=0) / RATE_HZ
    position[:, 2] -= position[:, 2].max() + height_m
    return Motion(t, quaternion, rates, position, velocity, felt, speed)


def logged(
    motion: Motion, vehicle: Vehicle, path: Path, *, outputs: bool = True, seed: int = 0
) -> FlightLog:
    """A log of it: IMU, attitude and position at 100 Hz, speeds at 50 Hz, ranges at 20 Hz, with noise."""
    rng = np.random.default_rng(seed)
    t = 10.0 + motion.t
    offset = np.array([0.04, -0.03, 0.02])
    force = motion.force + 0.05 * rng.standard_normal(motion.force.shape) + offset
    gyro = motion.rates + 0.005 * rng.standard_normal(motion.rates.shape)
    attitude = _unit(motion.quaternion + 2e-4 * rng.standard_normal(motion.quaternion.shape))
    velocity = motion.velocity + 0.01 * rng.standard_normal(motion.velocity.shape)
    every = slice(None, None, 2)
    speed = motion.speed[every] + 5.0 * rng.standard_normal(motion.speed[every].shape)
    hover = np.sqrt((motion.speed**2).mean())
    servo = np.full((len(t[every]), 16), np.nan)
    for k, rotor in enumerate(vehicle.rotors):
        servo[:, (rotor.esc or rotor.servo or 1) - 1] = np.round(
            1000.0 + 450.0 * motion.speed[every, k] / hover
        )
    escs = {}
    if vehicle.telemetered:
        for k, r in enumerate(vehicle.rotors):
            escs[r.esc or k + 1] = EscRecord(Series(t[every], speed[:, k : k + 1]))
    imu = ImuRecord(
        source="HIGHRES_IMU",
        specific_force=Series(t, force),
        gyro=Series(t, gyro),
        force_step=0.0,
        clipped=0,
    )
    return FlightLog(
        path=path,
        system=1,
        boot=0,
        start_s=float(t[0]),
        end_s=float(t[-1]),
        vehicle_type=2,
        autopilot=3,
        attitude=Series(t, attitude),
        rates=Series(t, gyro),
        position=Series(t, motion.position),
        velocity=Series(t, velocity),
        imus=(imu,),
        beams=(_down_beam(motion, t, rng),),
        escs=escs,
        servo=Series(t[every], servo) if outputs else None,
    )


def _down_beam(motion: Motion, t: Array, rng: np.random.Generator) -> Beam:
    """A rangefinder that looks down."""
    slow = slice(None, None, int(RATE_HZ / RANGE_HZ))
    upright = _matrices(motion.quaternion)[slow, 2, 2]
    slant = -motion.position[slow, 2] / upright + 0.01 * rng.standard_normal(len(t[slow]))
    direction = orientation_direction(25)
    assert direction is not None
    return Beam(
        direction_frd=direction,
        component=1,
        sensor_id=0,
        orientation=25,
        source="DISTANCE_SENSOR",
        distance=Series(t[slow], slant[:, None]),
        verdicts=(RangeVerdict.OK,) * len(slant),
        min_m=0.05,
        max_m=40.0,
        sigma_m=0.01,
        step_m=0.0,
    )


def with_speed(log: FlightLog, esc: int, rpm: Array) -> FlightLog:
    """The log with other speeds (n,) of one ESC."""
    old = log.escs[esc].rpm
    assert old is not None
    return replace(log, escs={**log.escs, esc: EscRecord(Series(old.t_s, rpm[:, None]))})


def speeds(log: FlightLog, esc: int) -> Array:
    """Speeds (n,) of one ESC."""
    series = log.escs[esc].rpm
    assert series is not None
    return series.values[:, 0]


def _attitude(roll: Array, pitch: Array, yaw: Array) -> Array:
    """Quaternions (n, 4), w first, of yaw, then pitch, then roll."""
    (cr, sr), (cp, sp), (cy, sy) = ((np.cos(a / 2.0), np.sin(a / 2.0)) for a in (roll, pitch, yaw))
    return np.stack(
        [cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy,
         cr * cp * sy - sr * sp * cy], axis=1,
    )  # fmt: skip


def _rates(rotation: Array) -> Array:
    """Body rates (n, 3) of attitudes (n, 3, 3)."""
    skew = np.einsum("nji,njk->nik", rotation, np.gradient(rotation, 1.0 / RATE_HZ, axis=0))
    return np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)


def _matrices(q: Array) -> Array:
    return rotation_from_quaternion(_unit(q))


def _unit(q: Array) -> Array:
    return q / np.linalg.norm(q, axis=1, keepdims=True)
