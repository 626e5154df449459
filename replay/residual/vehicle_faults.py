"""A vehicle file of another vehicle: its lift, the places of its rotors, the sense in which they turn."""

from __future__ import annotations

import math
from collections.abc import Collection
from itertools import combinations

import numpy as np

from models.common.frames import Array
from models.effects import Context
from models.vehicle.lift_ratio import JUDGED
from models.vehicle.rotor_speed import POLE_PARAMETERS
from replay.flightlog import LogFault
from replay.residual.grid import Mask, band, rate_of_change
from replay.residual.motion import Trajectory

FEWEST_SAMPLES = 50
"""Airborne samples from which on the lift is compared."""
POLES_LEAST = (0.4, 2.5)
"""Share of the speeds outside which they may be in another unit: other poles make 2/5 at most of them, or 5/2."""
FEWEST_COMMON = 200
"""Common samples from which on a correlation counts."""
BAND_S = (0.05, 0.5)
FAST_BAND_S = (0.05, 0.25)
"""Half widths of running means between which moments and angular accelerations are compared: 1 to 8 Hz, 2 to 8 Hz.

The rotors hold against a moment of the air that rocks the vehicle slowly: in the first band the declared order looks
wrong then, in the second it does not.
"""
ANSWER_S = 0.2
FAST_ANSWER_S = 0.06
"""Time within which a vehicle answers a moment: telemetry and motors.

In the second band it is shorter: half a swing of the control loop later any order looks right.
"""
EXCITED = 1e-3
"""RMS of a moment over weight and lever from which on it is compared."""
OPPOSED = -0.5
"""Correlation of declared yaw moment and angular acceleration from which on the spins are exchanged."""
FITS = 0.4
FITS_LESS = 0.5
"""Correlation of roll and pitch with another order of the rotors; the declared one stays below that share of it."""
SAME_PLACE = 0.3
"""Distance over lever within which a turned or mirrored fan stands on another one's place."""
MIRRORS = {
    "left and right": (1.0, -1.0),
    "front and back": (-1.0, 1.0),
    "left and right, front and back": (-1.0, -1.0),
}
Order = tuple[int, ...]


def wrong_lift(ctx: Context, flying: Mask) -> list[LogFault]:
    """A declared lift that is far from the one that flew."""
    if flying.sum() < FEWEST_SAMPLES:
        return []
    measured = -ctx.vehicle.mass_kg * float(np.nanmean(ctx.state.specific_force[flying, 2]))
    ratio = float(np.nanmean(ctx.thrust.sum(axis=1)[flying])) / max(measured, 1e-6)
    low, high = JUDGED
    if not np.isfinite(ratio) or low <= ratio <= high:
        return []
    what = (
        f"declared lift is {ratio:.2g} times the lift that flew: mass, rotors or thrust of "
        "another vehicle"
    )
    speed = math.sqrt(ratio)
    if ctx.vehicle.telemetered and not POLES_LEAST[0] < speed < POLES_LEAST[1]:
        carried = f"carries {ctx.vehicle.mass_kg:.3g} kg with such propellers"
        advice = f"pole count ({', '.join(POLE_PARAMETERS[:2])}) or unit"
        what += f"; or speeds are {speed:.2g} of what {carried}: {advice}"
    return [LogFault("vehicle file" if ctx.model is None else "model", what)]


def exchanged_fans(ctx: Context, motion: Trajectory, flying: Mask) -> list[LogFault]:
    """Another order of the fans explains roll and pitch, and the declared one does not."""
    if len(ctx.vehicle.fans) < 3 or not flying.any():
        return []
    places = np.array([fan.position_m[:2] for fan in ctx.vehicle.fans])
    declared = tuple(range(len(places)))
    orders = {declared: "", **_orders(places, ctx.lever)}
    fit = _fits(ctx, motion, flying, orders, BAND_S, ANSWER_S)
    fast = _fits(ctx, motion, flying, [declared], FAST_BAND_S, FAST_ANSWER_S)
    fit_of_declared = max(fit[declared], fast[declared])
    best = max(orders, key=lambda o: round(fit[o], 6))
    if best == declared or fit[best] < FITS or fit_of_declared > FITS_LESS * fit[best]:
        return []
    what = (
        f"declared moments oppose the angular acceleration: {orders[best]} are exchanged (r = "
        f"{fit[best]:.2f} so)"
    )
    return [LogFault("vehicle file", what)]


def _fits(
    ctx: Context,
    motion: Trajectory,
    flying: Mask,
    orders: Collection[Order],
    band_s: tuple[float, float],
    answer_s: float,
) -> dict[Order, float]:
    """How well roll and pitch answer the moments, the lesser of both, by order; 0 where there is hardly a moment."""
    rate = motion.grid.rate
    places = np.array([fan.position_m[:2] for fan in ctx.vehicle.fans])
    thrust = np.stack([band(ctx.thrust[:, k], rate, *band_s) for k in range(len(places))], axis=1)
    turning = rate_of_change(motion.gyro, rate)
    turned = [band(turning[:, axis], rate, *band_s) for axis in (0, 1)]
    moments = {order: _moments(thrust, places, order) for order in orders}
    sizes = [np.nanstd(moment[flying], axis=0) for moment in moments.values()]
    if not (np.max(sizes, axis=0) > EXCITED * ctx.weight * ctx.lever).all():
        return dict.fromkeys(orders, 0.0)
    most = int(answer_s * rate)
    out = {}
    for order, moment in moments.items():
        roll = _correlations(moment[:, 0], turned[0], flying, most)
        pitch = _correlations(moment[:, 1], turned[1], flying, most)
        out[order] = min(_answered(roll), _answered(pitch))
    return out


def exchanged_spins(ctx: Context, motion: Trajectory, flying: Mask) -> list[LogFault]:
    """Rotor torques that oppose the angular acceleration about the vertical."""
    moment = ctx.rotor_moment[:, 2]
    least = EXCITED * ctx.weight * ctx.lever
    if not flying.any() or not float(np.nanstd(moment[flying])) > least:
        return []
    rate = motion.grid.rate
    most = int(ANSWER_S * rate)
    turning = rate_of_change(motion.gyro[:, 2], rate)
    turned = band(turning, rate, *BAND_S)
    found = _correlations(band(moment, rate, *BAND_S), turned, flying, most)
    at = int(np.abs(found).argmax())
    r = float(found[at])
    # A torque of the other sense opposes at once. What only opposes later, or still grows at the longest delay, is the
    # control loop, which opposes what turned the vehicle before.
    if r >= OPPOSED or at == len(found) - 1 or found[0] >= 0.0:
        return []
    spins = "clockwise and counter-clockwise are exchanged"
    what = f"declared moments oppose the angular acceleration: {spins} (r = {r:.2f})"
    return [LogFault("vehicle file", what)]


def _answered(found: Array) -> float:
    """The largest of correlations by delay; 0 where that is the longest: an answer to a moment has passed by then.

    What still grows is the control loop, which opposes what turned the vehicle before.
    """
    at = int(found.argmax())
    if at == len(found) - 1:
        return 0.0
    return float(found[at])


def _moments(thrust: Array, places: Array, order: Order) -> Array:
    """Roll and pitch moment (n, 2) of thrusts (n, fans) if fan ``k`` stood where ``order[k]`` is declared."""
    at = places[list(order)]
    return np.asarray(thrust @ np.stack([-at[:, 1], at[:, 0]], axis=1))


def _orders(places: Array, lever: float) -> dict[Order, str]:
    """Orders of the fans that a mistake makes, in words: two exchanged, mirrored, turned by a quarter."""
    n = len(places)
    out: dict[Order, str] = {}
    for i, j in combinations(range(n), 2):
        pair = list(range(n))
        pair[i] = j
        pair[j] = i
        out[tuple(pair)] = f"fans {i + 1} and {j + 1}"
    moved = {what: places * np.array(sign) for what, sign in MIRRORS.items()}
    moved["front and right"] = np.stack([-places[:, 1], places[:, 0]], axis=1)
    moved["front and left"] = np.stack([places[:, 1], -places[:, 0]], axis=1)
    for what, where in moved.items():
        distance = np.linalg.norm(where[:, None] - places[None], axis=2)
        order = tuple(int(k) for k in distance.argmin(axis=1))
        each_has_a_place = len(set(order)) == n
        near = distance.min(axis=1).max() < SAME_PLACE * lever
        if each_has_a_place and near and order not in out:
            out[order] = what
    out.pop(tuple(range(n)), None)
    return out


def _correlations(cause: Array, effect: Array, flying: Mask, most: int) -> Array:
    """Correlation (m,) of an effect 0 to ``most`` samples behind its cause; 0 where too little is known."""
    out = []
    for lag in range(0, most + 1, max(most // 10, 1)):
        a = cause[: len(cause) - lag]
        b = effect[lag:]
        known = flying[lag:] & np.isfinite(a) & np.isfinite(b)
        a = a[known]
        b = b[known]
        r = 0.0
        if len(a) >= FEWEST_COMMON and a.std() > 0.0 and b.std() > 0.0:
            r = float(np.corrcoef(a, b)[0, 1])
        out.append(r)
    return np.array(out)
