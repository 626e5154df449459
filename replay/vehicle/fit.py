"""Rotor coefficient or throttle curve, and hover thrust, from the time of logs in which the vehicle flies freely.

A hovering vehicle is carried by its rotors and nothing else, so the accelerometer weighs them: -Fz is their sum.
With rotor speeds one number follows, C_T; with servo outputs the thrust at full output.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from models.common.frames import Array
from models.vehicle import Vehicle
from replay.residual.record import Record

_CLIMB_M_S = 0.3
_SPEED_M_S = 1.0
_TILT_COS = 0.985
"""A hover: slower than these, tilted less than 10 degrees."""
_FAR = 4.0
"""In rotor radii from ground, wall and ceiling: lift there is within 2 % of free air (Cheeseman and Bennett 1955)."""


@dataclass(frozen=True)
class ThrustFit:
    """What flights say of the vehicle."""

    vehicle: Vehicle
    """With the measured numbers."""
    measured: tuple[str, ...] = ()
    """Their keys in a vehicle file."""
    output: float = math.nan
    """Median output 0...1 of the rotors; NaN where rotor speeds are telemetered."""


def fit_records(
    records: Sequence[Record], start: Vehicle, where: Callable[[Record], NDArray[np.bool_]]
) -> ThrustFit:
    """The vehicle ``start``, of which the records are, with what the rows ``where`` of them measure."""
    rows = [(r, where(r)) for r in records]

    def pooled(quantity: Callable[[Record], Array]) -> Array:
        return np.concatenate([quantity(r)[chosen] for r, chosen in rows])

    lift = pooled(lambda r: -r.measured[:, 2])
    if not lift.size:
        return ThrustFit(start)
    found: dict[str, float] = {}
    vehicle = start
    curve = start.throttle
    output = math.nan
    if curve is None:
        scale = _slope(lift, pooled(lambda r: r.context.thrust.sum(axis=1)))
        fans = tuple(replace(f, ct=_rounded((f.ct or 0.0) * scale)) for f in start.fans)
        found["ct"] = scale
        vehicle = replace(start, fans=fans)
    else:
        u = pooled(_outputs)
        output = float(np.median(u.mean(axis=1)))
        shape = (1.0 - curve.expo) * u.sum(axis=1) + curve.expo * (u**2).sum(axis=1)
        voltage = pooled(lambda r: r.context.state.battery_voltage_v)
        found["max_thrust_n"] = _rounded(_slope(lift, shape))
        curve = replace(curve, max_thrust_n=found["max_thrust_n"])
        if np.isfinite(voltage).any():
            found["voltage_v"] = _rounded(float(np.nanmedian(voltage)))
            curve = replace(curve, voltage_v=found["voltage_v"])
        vehicle = replace(start, throttle=curve)
    throttle = pooled(lambda r: r.context.state.thrust_command)
    if np.isfinite(throttle).sum() >= 0.5 * len(lift):
        hover = float(np.nanmedian(throttle))
    else:
        hover = math.nan
    if 0.05 < hover < 0.95:
        found["hover_thrust"] = _rounded(hover)
        vehicle = replace(vehicle, hover_thrust=found["hover_thrust"])
    return ThrustFit(vehicle, tuple(found), output)


def hovering(record: Record) -> NDArray[np.bool_]:
    """Rows (n,) of free hover: judged, slow, level, away from every surface that is seen."""
    state = record.context.state
    with np.errstate(invalid="ignore"):
        fast = (np.abs(state.velocity_ned[:, 2]) > _CLIMB_M_S) | (
            np.hypot(state.velocity_ned[:, 0], state.velocity_ned[:, 1]) > _SPEED_M_S
        )
    return free_flight(record) & ~fast & np.asarray(state.rotation[:, 2, 2] > _TILT_COS)


def free_flight(record: Record) -> NDArray[np.bool_]:
    """Rows (n,) that are judged, away from every surface that is seen."""
    state = record.context.state
    far = _FAR * record.context.vehicle.rotor_radius_m
    distances = np.hstack([state.h_m, state.d_m, state.ceiling_m])
    return np.asarray(record.valid & (np.nan_to_num(distances, nan=np.inf).min(axis=1) >= far))


def _outputs(record: Record) -> Array:
    """Outputs (n, rotors) of the rotors, 0...1."""
    vehicle = record.context.vehicle
    assert vehicle.throttle is not None
    low = vehicle.throttle.pwm_min_us
    high = vehicle.throttle.pwm_max_us
    channels = [r.servo - 1 for r in vehicle.rotors if r.servo is not None]
    return np.asarray(
        np.clip((record.context.state.servo_us[:, channels] - low) / (high - low), 0.0, 1.0)
    )


def _slope(y: Array, x: Array) -> float:
    """Of y over x through zero."""
    return float(y @ x / (x @ x))


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")
