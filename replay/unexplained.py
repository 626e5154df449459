"""What no effect explains: free curves in every channel, and spectral lines, against the same null as the effects."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.wrench import AXES, Array
from replay.blocks import FOLDS, Noise, block_numbers, embargo_blocks, fit_noise, fold_of_block, training_blocks, whiten
from replay.residual import Record
from replay.shift_null import flip_maxima, p_value

KNOTS = 5
MANY_KNOTS = 10
FINE = ("time_s", "north_m", "east_m", "down_m", "range_down_m")
BLOCK_S = 1.5
ALPHA = 0.003
SMALLEST_SHARE = 0.06
REACTIVE_SHARE = 0.3
LAG_S = 0.4
MOST_CHANNELS = 3
MOST_TRIED = 40
SAME_SENSOR = {
    "ax_m_s2": ("Fx",), "ay_m_s2": ("Fy",), "az_m_s2": ("Fz",), "p_rad_s": ("Mx",), "q_rad_s": ("My",),
    "r_rad_s": ("Mz",),
}  # fmt: skip
"""Channels whose own noise is in the residual of that axis."""
REACTIONS = {
    "Fx": ("vn_", "ve_", "pitch", "roll", "q_", "servo", "rpm", "thrust"),
    "Fy": ("vn_", "ve_", "roll", "pitch", "p_", "servo", "rpm", "thrust"),
    "Fz": ("vd_", "servo", "rpm", "thrust"),
    "Mx": ("roll", "pitch", "p_", "q_", "r_", "ay_", "servo", "rpm", "thrust", "ve_", "vn_"),
    "My": ("pitch", "roll", "p_", "q_", "r_", "ax_", "servo", "rpm", "thrust", "ve_", "vn_"),
    "Mz": ("p_", "q_", "r_", "servo", "rpm", "thrust"),
}
"""Channels that answer a disturbance of that axis within the loop: they go along with noise, and must carry more of it
before they count (``REACTIVE_SHARE``)."""


@dataclass(frozen=True)
class Channel:
    """A channel that carries part of the leftover: ``score`` is the share of its axis' energy on held-out time."""

    name: str
    score: float
    axis: str
    lag_s: float | None = None
    peak_hz: float | None = None


@dataclass(frozen=True)
class Leftover:
    """``significant``: more than noise. ``gain``: held-out energy of the best channel, in units of the noise."""

    significant: bool
    gain: float
    p: float
    channels: tuple[Channel, ...]
    r2: float


@dataclass(frozen=True)
class _Curve:
    name: str
    axis: int
    columns: NDArray[np.int64]
    lag_s: float | None = None
    peak_hz: float | None = None


def free_search(record: Record, rest: Array, noise: Noise, seed: int) -> Leftover:
    """Curves of one channel on one axis in the leftover ``rest`` (n, axes)."""
    bases = _bases(record)
    if not bases:
        return Leftover(False, 0.0, 1.0, (), 0.0)
    x = np.concatenate([b for _, b, _, _ in bases], axis=1)
    x = np.where(record.valid[:, None], x, 0.0)
    x[record.valid] -= x[record.valid].mean(axis=0)
    k = x.shape[1]
    block = block_numbers(record.valid, record.step_s, BLOCK_S)
    count = int(block.max()) + 1
    folds = fold_of_block(count, record.seconds / count)
    embargo = embargo_blocks(float(np.median(noise.tau_s)), record.seconds / count)
    noise = _noise_beside_curves(record, x, rest, [(name, b.shape[1]) for name, b, _, _ in bases])
    results: list[tuple[float, float, float, _Curve]] = []
    nulls: list[Array] = []
    again = []
    observed: list[tuple[float, _Curve]] = []
    axis_data = []
    for a in range(rest.shape[1]):
        one = Noise(noise.ar[a : a + 1], noise.innovation[a : a + 1], noise.total[a : a + 1], noise.tau_s[a : a + 1])
        xw, _ = whiten(x[:, None, :], record.valid, one)
        yw, _ = whiten(rest[:, a : a + 1], record.valid, one)
        timing = _timing(record, a)
        zw, _ = whiten(timing[:, None, :], record.valid, one)
        xa, ya = _without(zw[:, 0], xw[:, 0]), _without(zw[:, 0], yw[:, 0])
        w = xa.T @ xa
        parts = np.zeros((count, k))
        np.add.at(parts, block, xa * ya[:, None])
        curves, inverses = [], []
        start = 0
        for name, basis, lag, peak in bases:
            columns = np.arange(start, start + basis.shape[1])
            start += basis.shape[1]
            if AXES[record.axes[a]] in SAME_SENSOR.get(name, ()):
                continue
            curves.append(_Curve(name, a, columns, lag, peak))
            inverses.append(np.linalg.pinv(w[np.ix_(columns, columns)], rcond=1e-6, hermitian=True))
        effective = max(record.seconds / float(noise.tau_s.max()), 10.0)
        penalties = np.array([len(c.columns) * np.log(effective) for c in curves])
        groups = [c.columns for c in curves]
        null = flip_maxima(parts, groups, inverses, penalties, seed + 7)
        again.append((groups, inverses, penalties))
        nulls.append(null)
        g = parts.sum(0)
        for curve, inverse, penalty in zip(curves, inverses, penalties, strict=True):
            part = g[curve.columns]
            observed.append((float(part @ inverse @ part) - penalty, curve))
        valid = record.valid
        own = np.where(valid, rest[:, a], 0.0)
        axis_data.append((xa, ya, _without(np.where(valid[:, None], timing, 0.0), own)))
    top: dict[tuple[str, int], tuple[float, _Curve]] = {}
    for score, curve in observed:
        key = (curve.name, curve.axis)
        if key not in top or score > top[key][0]:
            top[key] = (score, curve)
    ranked = sorted(top.values(), key=lambda s: -s[0])
    if not ranked:
        return Leftover(False, 0.0, 1.0, (), 0.0)
    # A strong curve would inflate its own null: flip what it leaves.
    best = ranked[0][1]
    xa, ya, _ = axis_data[best.axis]
    xb = xa[:, best.columns]
    parts = np.zeros((count, k))
    np.add.at(parts, block, xa * (ya - xb @ np.linalg.lstsq(xb, ya, rcond=None)[0])[:, None])
    nulls[best.axis] = flip_maxima(parts, *again[best.axis], seed + 7)
    nulls = np.max(nulls, axis=0)
    if p_value(nulls, ranked[0][0]) > ALPHA:
        return Leftover(False, 0.0, p_value(nulls, ranked[0][0]), (), 0.0)
    for score, curve in ranked[:MOST_TRIED]:
        if p_value(nulls, score) > ALPHA:
            break
        xa, ya, raw_y = axis_data[curve.axis]
        raw_x = x[:, curve.columns]
        gain = total = 0.0
        for f in range(FOLDS):
            train = training_blocks(folds, f, embargo)[block]
            test = (folds[block] == f) & record.valid
            fit = np.linalg.lstsq(xa[train][:, curve.columns], ya[train], rcond=None)[0]
            error = raw_y[test] - raw_x[test] @ fit
            total += float(raw_y[test] @ raw_y[test])
            gain += float(raw_y[test] @ raw_y[test] - error @ error)
        share = gain / max(total, 1e-12)
        if share >= smallest_share(curve.name, AXES[record.axes[curve.axis]]):
            results.append((share, gain / float(noise.total[curve.axis]) ** 2, score, curve))
    results.sort(key=lambda r: -r[1])
    if not results:
        return Leftover(False, 0.0, p_value(nulls, ranked[0][0]), (), 0.0)
    channels, names = [], set()
    for share, _, _, curve in results:
        if curve.name not in names:
            names.add(curve.name)
            axis = AXES[record.axes[curve.axis]]
            channels.append(Channel(curve.name, float(min(share, 1.0)), axis, curve.lag_s, curve.peak_hz))
    return Leftover(
        True, results[0][1], p_value(nulls, ranked[0][0]), tuple(channels[:MOST_CHANNELS]), float(results[0][0])
    )


def smallest_share(channel: str, axis: str) -> float:
    """Share of an axis' energy from which on a channel counts as its carrier.

    In closed loop the controller answers a disturbance, so that speeds, vanes and lean repeat its noise; such a channel
    has to carry much more than one that nothing drives.
    """
    return REACTIVE_SHARE if channel.startswith(REACTIONS[axis]) else SMALLEST_SHARE


def _noise_beside_curves(record: Record, x: Array, rest: Array, widths: list[tuple[str, int]]) -> Noise:
    """Noise of every axis beside the curve that fits it best, so that a curve to be found does not pass for noise."""
    valid = record.valid
    left = rest.copy()
    gram = x[valid].T @ x[valid]
    for a in range(rest.shape[1]):
        product = x[valid].T @ (rest[valid, a] - rest[valid, a].mean())
        best, gain, start = slice(0, 0), 0.0, 0
        for name, width in widths:
            part = slice(start, start + width)
            start += width
            if AXES[record.axes[a]] in SAME_SENSOR.get(name, ()):
                continue
            fit = np.linalg.lstsq(gram[part, part] + 1e-9 * np.eye(width), product[part], rcond=None)[0]
            if float(fit @ product[part]) > gain:
                gain, best, chosen = float(fit @ product[part]), part, fit
        if gain > 0.0:
            left[:, a] = rest[:, a] - x[:, best] @ chosen
    return fit_noise(left, valid, record.step_s)


def _bases(record: Record) -> list[tuple[str, Array, float | None, float | None]]:
    """(channel, basis (n, k), lag, frequency) of every free curve."""
    out: list[tuple[str, Array, float | None, float | None]] = []
    t = record.time_s
    for name, values in record.channels.items():
        if name == "yaw_rad":
            if np.ptp(np.unwrap(np.nan_to_num(values[record.valid]))) > 0.5:
                angles = [np.stack([np.sin(m * values), np.cos(m * values)], 1) for m in (1, 2)]
                out.append((name, np.nan_to_num(np.concatenate(angles, axis=1)), None, None))
            continue
        hats = _hats(values, record.valid, MANY_KNOTS if name in FINE else KNOTS)
        if hats is not None:
            out.append((name, hats, None, None))
        if name.startswith(("rpm", "servo", "thrust", "battery_current")):
            slow = _slow(values, max(int(LAG_S / record.step_s), 1))
            moved = _hats(values - slow, record.valid, 3)
            if moved is not None:
                out.append((name, moved, LAG_S, None))
    for hz in np.exp(np.arange(np.log(0.15), np.log(min(2.0, 0.4 / record.step_s)), 0.5 / (0.2 * record.seconds))):
        phase = 2.0 * np.pi * hz * (t - t[0])
        out.append(("time_s", np.stack([np.sin(phase), np.cos(phase)], axis=1), None, float(hz)))
        if len(out) > 400:
            break
    return out


def _timing(record: Record, axis: int) -> Array:
    """What errors of timing and of gain of the actuators look like on one axis, (n, k).

    The autopilot answers every disturbance with its actuators, so they go along with the noise of the moments; that is
    no cause.
    """
    modelled = np.nan_to_num(record.measured - record.residual)[:, record.axes[axis]]
    rate = np.gradient(modelled, record.step_s)
    modelled = modelled - modelled[record.valid].mean()
    return rate[:, None] if record.axes[axis] < 3 else np.stack([modelled, rate], axis=1)


def _without(z: Array, x: Array) -> Array:
    """``x`` less its projection on the columns of ``z``."""
    out: Array = x - z @ np.linalg.lstsq(z, x, rcond=None)[0]
    return out


def _hats(values: Array, valid: NDArray[np.bool_], knots: int) -> Array | None:
    """Piecewise linear basis (n, knots - 1) on quantiles; None where the channel hardly varies."""
    known = valid & np.isfinite(values)
    if known.sum() < 0.5 * valid.sum() or known.sum() < 50:
        return None
    places = np.unique(np.quantile(values[known], np.linspace(0.01, 0.99, knots)))
    if len(places) < 3 or places[-1] - places[0] < 1e-9:
        return None
    x = np.clip(np.where(known, values, np.median(values[known])), places[0], places[-1])
    return np.stack([np.interp(x, places, np.eye(len(places))[j]) for j in range(1, len(places))], axis=1)


def _slow(values: Array, samples: int) -> Array:
    known = np.isfinite(values).astype(float)
    kernel = np.ones(samples) / samples
    full = np.convolve(np.where(known > 0, values, 0.0), kernel)[: len(values)]
    weight = np.convolve(known, kernel)[: len(values)]
    return full / np.maximum(weight, 1e-9)
