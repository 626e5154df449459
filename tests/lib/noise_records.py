"""Records of flights that were not flown: a made-up trajectory, all channels, and coloured noise as the residual."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import models
from companion.vehicles import default_vehicle
from models.air_state import blank_state
from models.common.frames import Array, quaternion_from_euler, rotation_from_quaternion
from models.effects import Context
from replay.residual.grid import RATE_HZ
from replay.residual.log_state import named_channels
from replay.residual.record import Record

LEVEL = (0.30, 0.30, 0.45, 0.022, 0.14, 0.013)
"""RMS per axis [N, N m]: what a quiet flight of the default vehicle shows below 2 Hz."""


def coloured(rng: np.random.Generator, n: int, tau_s: float, step_s: float) -> Array:
    """First-order autoregressive noise (n,) of unit variance and correlation time ``tau_s``."""
    a = math.exp(-step_s / tau_s)
    out = np.empty(n)
    value = rng.standard_normal()
    kicks = rng.standard_normal(n) * math.sqrt(1.0 - a * a)
    for i in range(n):
        value = a * value + kicks[i]
        out[i] = value
    return out


def path(rng: np.random.Generator, t: Array, places: Sequence[float], speed: float) -> Array:
    """Hold a place for some seconds, move smoothly to the next: (n,)."""
    at = 0.0
    now = float(rng.choice(places))
    times = [0.0]
    values = [0.0]
    values[0] = now
    while at < t[-1]:
        at += rng.uniform(4.0, 12.0)
        times.append(at)
        values.append(now)
        then = float(rng.choice(places))
        at += max(abs(then - now) / speed, 0.5)
        times.append(at)
        values.append(then)
        now = then
    line = np.interp(t, times, values)
    width = max(int(0.8 / (t[1] - t[0])), 1)
    padded = np.pad(line, width, mode="edge")
    kernel = np.hanning(2 * width + 1)
    return np.convolve(padded, kernel / kernel.sum(), "valid")[: len(t)]


def noise_record(seed: int, seconds: float, tau_s: float) -> Record:
    """A flight whose residual is noise."""
    rng = np.random.default_rng(seed)
    vehicle = default_vehicle()
    model = models.load()
    step = 1.0 / RATE_HZ
    t = 10.0 + np.arange(int(seconds / step)) * step
    n = len(t)
    height = path(rng, t, (0.25, 0.35, 0.5, 0.9, 1.4), 0.3)
    gap = path(rng, t, (0.15, 0.25, 0.4, 0.8, 1.5), 0.3)
    side = path(rng, t, (-0.5, 0.0, 0.5), 0.5)
    yaw = path(rng, t, (0.0, 0.0, 1.5, 3.0), 0.4)
    position = np.stack([-gap, side, -height], axis=1)
    velocity = np.gradient(position, step, axis=0)
    accel = np.gradient(velocity, step, axis=0)
    pitch = -accel[:, 0] / 9.8 + np.radians(0.3) * coloured(rng, n, 1.0, step)
    roll = accel[:, 1] / 9.8 + np.radians(0.3) * coloured(rng, n, 1.0, step)
    euler = zip(roll, pitch, yaw, strict=True)
    rotation = np.stack(
        [rotation_from_quaternion(quaternion_from_euler(*angles)) for angles in euler]
    )
    force = np.einsum("nji,nj->ni", rotation, accel - np.array([0.0, 0.0, 9.80665]))
    hover = 4000.0 * np.sqrt(np.linalg.norm(force, axis=1) / 9.80665)
    rotors = len(vehicle.rotors)
    rpm = hover[:, None] * (
        1.0 + 0.004 * np.stack([coloured(rng, n, 0.5, step) for _ in range(rotors)], axis=1)
    )
    servo = np.full((n, 16), np.nan)
    for channel in range(8):
        servo[:, channel] = 1500.0 + 20.0 * coloured(rng, n, 0.7, step)
    bearing = -yaw
    seen = np.abs(bearing) < 0.5
    blank = blank_state((n,), len(vehicle.fans), rotors)
    ranges = np.full((n, 6), np.inf)
    ranges[:, 0] = height
    ranges[:, 2] = np.where(seen, gap + 0.5, np.inf)
    drain = np.linspace(0.0, 1.0, n)
    state = replace(
        blank,
        time_s=t, position_ned=position, velocity_ned=velocity, rotation=rotation,
        rates=np.stack([np.gradient(a, step) for a in (roll, pitch, yaw)], axis=1),
        specific_force=force, ranges_m=ranges,
        h_m=np.stack([height - rotation[:, 2] @ np.asarray(f.position_m) for f in vehicle.fans], axis=1),
        d_m=np.where(seen[:, None], np.stack([gap] * len(vehicle.fans), axis=1), np.inf),
        wall_bearing_rad=np.where(seen, bearing, 0.0),
        rpm=rpm, servo_us=servo, thrust_command=0.5 * (hover / 4000.0) ** 2,
        battery_voltage_v=24.5 - 2.0 * drain + 0.05 * coloured(rng, n, 1.0, step),
        battery_current_a=60.0 * (hover / 4000.0) ** 3, esc_temperature_c=30.0 + 30.0 * (1.0 - np.exp(-3.0 * drain)),
        pressure_pa=np.full(n, 101325.0) + 20.0 * coloured(rng, n, 20.0, step), air_temperature_c=np.full(n, 15.0),
    )  # fmt: skip
    residual = np.stack([s * coloured(rng, n, tau_s, step) for s in LEVEL], axis=1)
    return Record(
        name=f"noise-{seed}", path=Path(f"noise-{seed}"), context=Context(state=state, vehicle=vehicle, model=model),
        residual=residual, measured=residual,
        valid=np.ones(n, bool), axes=tuple(range(6)), step_s=step, kinematic_bias=np.zeros((n, 3)),
        channels=named_channels(vehicle, state), delays=(), excluded=(),
    )  # fmt: skip
