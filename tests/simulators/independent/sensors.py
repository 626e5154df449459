"""What the sensors make of a flight.

IMU: bias that walks, blade-rate vibration aliased by the sampling, a 25 Hz two-pole filter (late by about 10 ms).
Attitude wanders; position and velocity come from a lagged estimator that wanders. Rangefinders: percentage noise, 1 cm
steps, latency, dropouts in bursts. Rotor speeds: each ESC reports in turn, whole electrical revolutions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, lfilter, sosfilt, sosfilt_zi

from . import loads
from .airframes import Airframe, Array, Beam
from .conditions import Conditions
from .explain import at_declared_cg
from .flight import DT, Track
from .weather import coloured

RANGE_MAX_M = 8.0
RPM_STEP = 60.0 / 7.0
"""One electrical revolution a second of a motor with 14 poles."""
ESC_PERIOD_S = 0.05


@dataclass(frozen=True)
class Seen:
    """One flight as sensed, every ``DT``; time last."""

    accel: Array
    gyro: Array
    quaternion: Array
    position: Array
    velocity: Array
    rpm: Array
    ranges: Array
    """(beams, t): inf where nothing is in reach, NaN where the sensor failed."""
    volts: Array
    amperes: Array
    esc_celsius: Array
    pascal: Array
    celsius: Array


def sense(frame: Airframe, c: Conditions, s: Track, beams: tuple[Beam, ...], seed: int) -> Seen:
    """One flight through its sensors."""
    rng = np.random.default_rng([seed, 2])
    n = len(s.time)
    R = loads.rotation(s.quaternion)

    def wander(size: float, tau_s: float, rows: int = 3) -> Array:
        return size * coloured(rng, (n, rows), tau_s, DT).T

    bias = np.array([c.bias_x, c.bias_y, c.bias_z])[:, None]
    walk = 0.002 * np.cumsum(rng.standard_normal((n, 3)) * np.sqrt(DT), axis=0).T
    shaking = _vibration(rng, frame, s)
    accel = (
        _filtered(at_declared_cg(s) + bias + walk) + shaking + 0.05 * rng.standard_normal((3, n))
    )
    gyro = (
        _filtered(s.rates)
        + 0.02 * shaking / 9.8
        + 0.003 * rng.standard_normal((3, n))
        + 0.0007 * rng.standard_normal((3, 1))
    )
    origin = s.position - loads.into_world(R, s.cg)
    place, speed = _lagged(origin, 0.06), _lagged(s.velocity, 0.03)
    tilt = wander(1.0, 12.0) * np.radians(rng.uniform([0.1, 0.1, 0.4], [0.35, 0.35, 1.2]))[:, None]
    pressure = float(c.pascal) + 12.0 * s.position[2] + 3.0 * rng.standard_normal(n)
    return Seen(
        accel, gyro, _turned(s.quaternion, tilt),
        place + wander(float(rng.uniform(0.005, 0.02)), 20.0) + 0.002 * rng.standard_normal((3, n)),
        speed + wander(float(rng.uniform(0.01, 0.02)), 6.0) + 0.008 * rng.standard_normal((3, n)),
        _speeds(rng, frame, s), _ranges(rng, c, R, origin, beams),
        _lagged(s.volts, 0.2) + 0.015 * rng.standard_normal(n),
        _lagged(s.amperes, 0.3) * (1.0 + 0.03 * rng.standard_normal()),
        float(c.kelvin) - 273.15 + 14.0 + _lagged(s.warm.mean(axis=0), 6.0) * 0.7, pressure,
        np.full(n, float(c.kelvin) - 273.15) + 0.05 * rng.standard_normal(n),
    )  # fmt: skip


def _filtered(x: Array) -> Array:
    sos = butter(2, 25.0, fs=1.0 / DT, output="sos")
    return sosfilt(sos, x, axis=-1, zi=sosfilt_zi(sos)[:, None] * x[:, 0][None, :, None])[0]


def _lagged(x: Array, tau_s: float) -> Array:
    keep = float(np.exp(-DT / tau_s))
    return lfilter([1.0 - keep], [1.0, -keep], x, axis=-1, zi=x[..., :1] * keep)[0]


def _vibration(rng: np.random.Generator, frame: Airframe, s: Track) -> Array:
    """Unbalanced rotors, once per turn; what the filter leaves of it."""
    phase = np.cumsum(s.omega * DT, axis=-1) + rng.uniform(0.0, 2.0 * np.pi, (frame.count, 1))
    strength = rng.uniform(0.01, 0.06, (3, frame.count, 1)) * (s.omega / frame.hover_speed) ** 2
    return (strength * np.stack([np.sin(phase), np.cos(phase), np.sin(phase + 1.0)])).sum(axis=1)


def _turned(q: Array, small: Array) -> Array:
    """Quaternions (4, t) times the small body rotations (3, t)."""
    half = 0.5 * small
    out = np.concatenate(
        [(q[0] - (q[1:] * half).sum(axis=0))[None], q[1:] + q[0] * half + loads.cross(q[1:], half)]
    )
    return out / np.sqrt((out**2).sum(axis=0))


def _speeds(rng: np.random.Generator, frame: Airframe, s: Track) -> Array:
    rpm = s.omega * 30.0 / np.pi
    out = np.empty_like(rpm)
    period = round(ESC_PERIOD_S / DT)
    for k in range(frame.count):
        first = int(rng.integers(period))
        index = np.arange(rpm.shape[1])
        held = np.maximum((index - first) // period * period + first, 0)
        out[k] = np.rint(rpm[k, held] / RPM_STEP) * RPM_STEP
    return out


def _ranges(
    rng: np.random.Generator, c: Conditions, R: Array, origin: Array, beams: tuple[Beam, ...]
) -> Array:
    out = np.empty((len(beams), origin.shape[1]))
    for i, beam in enumerate(beams):
        start = origin + np.einsum("jkt,k->jt", R, np.array(beam.position_m))
        way = np.einsum("jkt,k->jt", R, np.array(beam.axis))
        true = _hit(c, start, way)
        noisy = true * (1.0 + 0.006 * rng.standard_normal(len(true))) + 0.004 * rng.standard_normal(
            len(true)
        )
        noisy = noisy + (c.range_bias if beam.target == "ground" else 0.0)
        far = ~(noisy < RANGE_MAX_M)
        out[i] = np.where(
            far, np.inf, np.maximum(np.rint(np.where(far, 1.0, noisy) * 100.0) / 100.0, 0.01)
        )
        for begin in rng.integers(0, len(true), max(len(true) // 4000, 1)):
            out[i, begin : begin + int(rng.integers(20, 120))] = np.nan
    return out


def _hit(c: Conditions, start: Array, way: Array) -> Array:
    """Distance (t,) along the beam to the nearest surface."""
    best = np.full(start.shape[1], np.inf)
    table = np.where(start[0] > c.edge_north, -c.table_m, 0.0)
    planes: list[tuple[int, float, Array | float]] = [(2, 1.0, table)]
    planes += [(0, 1.0, c.wall_north), (1, 1.0, c.wall_east), (2, -1.0, -c.ceiling_m)]
    for axis, sense_of, at in planes:
        if not np.isfinite(np.asarray(at)).all():
            continue
        toward = way[axis] * sense_of
        reach = (np.asarray(at) - start[axis]) * sense_of / np.maximum(toward, 1e-6)
        # A beam that grazes a surface comes back from nowhere.
        best = np.where((toward > 0.5) & (reach > 0.0), np.minimum(best, reach), best)
    return best
