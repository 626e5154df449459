"""What no effect explains: free curves of every channel, and spectral lines, on time that their fit never saw.

The share of an axis' energy that a curve takes off unseen time is compared with the shares that the same curves take
off coloured noise of the same spectrum; the most surprising of all curves on all axes is what has to be beaten.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.frames import AXES, Array
from models.vehicle import Vehicle
from replay.residual.record import Record
from replay.search.curves import DRIFTS, SAME_SENSOR, answers
from replay.search.noise import FOLDS, ORDER, Noise, fit_noise, split

KNOTS, MANY_KNOTS = 5, 12
"""Of a curve on quantiles of a channel, and of a fine one evenly over its range."""
FINE = ("time_s", "north_m", "east_m", "down_m", "range_down_m")
"""Channels over which a force may change within a small part of their range."""
BLOCK_S = 1.5
"""Unit of the time that is held out [s]."""
DRAWS = 199
"""Surrogates of noise alone."""
ALPHA = 0.005
"""Chance with which noise alone has a further channel."""
SMALLEST_SHARE = 0.06
"""Share of an axis' energy on unseen time from which on a channel counts."""
REACTIVE_SHARE = 0.25
"""The same of a channel that answers disturbances within the control loop."""
NEVER = 2.0
"""A share that nothing reaches."""
CAUSE_SHARE = 0.6
"""A channel that nothing drives comes before reactions that carry up to this much (as a ratio) more."""
LAG_S = 0.4
"""Rates of outputs and speeds are differences to their mean over this time [s]."""
MOST_CHANNELS = 3
"""Channels that are listed."""
STIFFNESS = 0.01
"""Ridge on the differences of a curve's knots, as a share of its energy."""
BURN_IN = 200
"""Samples of surrogate noise that are dropped before it counts as stationary."""
LINES_HZ, LINES = (0.15, 2.0), 400
"""Spectral lines: lowest and highest frequency [Hz], and how many at most."""


@dataclass(frozen=True)
class Channel:
    """A channel that carries part of the remainder: ``score`` is the share of its axis' energy on held-out time."""

    name: str
    score: float
    axis: str
    lag_s: float | None = None
    peak_hz: float | None = None


@dataclass(frozen=True)
class _Curve:
    name: str
    columns: slice
    stiffness: Array
    """What holds the fit where there are few samples (k, k), in units of the columns' energy."""
    lag_s: float | None = None
    peak_hz: float | None = None


def free_search(record: Record, rest: Array, noise: Noise, seed: int) -> tuple[Channel, ...]:
    """Channels that carry more of the remainder ``rest`` (n, axes) than chance, best first; ``noise`` of its axes.

    A curve is significant where it exceeds the largest of ``DRAWS`` surrogates, p = 1 / (``DRAWS`` + 1).
    """
    curves, x = _curves(record)
    if not curves:
        return ()
    valid = record.valid
    y = np.stack([_beside_timing(record, rest[:, a], a) for a in range(rest.shape[1])], axis=1)
    fits = _Split(record, x, float(np.median(noise.tau_s)))
    seen = fits.shares(curves, y[valid])
    axes = [AXES[a] for a in record.axes]
    allowed = np.array([[axis not in SAME_SENSOR.get(c.name, ()) for axis in axes] for c in curves])
    seen[~allowed] = -1.0
    left = _beside_best(y, curves, x, seen, valid)
    worlds = _surrogates(fit_noise(left, valid, record.step_s), len(y), seed)[valid]
    chance = fits.shares(curves, worlds.reshape(len(worlds), -1)).reshape(len(curves), len(axes), DRAWS)
    middle, width = chance.mean(axis=2), np.maximum(chance.std(axis=2), 1e-6)
    surprise = np.where(allowed, (seen - middle) / width, -np.inf)
    null = np.where(allowed[..., None], (chance - middle[..., None]) / width[..., None], -np.inf).max(axis=(0, 1))
    if not surprise.max() > null.max():
        return ()
    energy = (y[valid] ** 2).sum(axis=0) / noise.total**2
    found = [
        _Found(Channel(c.name, min(float(seen[i, k]), 1.0), axes[k], c.lag_s, c.peak_hz), float(seen[i, k] * energy[k]))
        for i, k in zip(*np.nonzero(surprise > np.quantile(null, 1.0 - ALPHA)), strict=True)
        for c in [curves[i]]
        if seen[i, k] >= _limit(c.name, axes[k], record)
    ]
    return _ranked(found, record.context.vehicle)


@dataclass(frozen=True)
class _Found:
    """A channel that carries more than chance, and its held-out energy in units of the noise."""

    channel: Channel
    gain: float


def _limit(channel: str, axis: str, record: Record) -> float:
    """Smallest share that counts; none where a flight that only hovers lets nothing but disturbances move a channel."""
    limit = smallest_share(channel, axis, record.context.vehicle)
    return NEVER if record.only_answers and (limit > SMALLEST_SHARE or channel.startswith(DRIFTS)) else limit


def _ranked(found: list[_Found], vehicle: Vehicle) -> tuple[Channel, ...]:
    """The channels that carry most, a cause before what answers it.

    Channels that answer a disturbance go along with it: where one that nothing drives does nearly as well, it is the
    cause.
    """
    reacts = {f: answers(f.channel.name, f.channel.axis, vehicle) for f in found}
    lead = max((f.gain for f in found if not reacts[f]), default=0.0)
    top = max((f.gain for f in found), default=0.0)
    found.sort(key=lambda f: (reacts[f] and lead >= CAUSE_SHARE * top, -f.gain))
    names: dict[str, Channel] = {}
    for f in found:
        names.setdefault(f.channel.name, f.channel)
    return tuple(names.values())[:MOST_CHANNELS]


def smallest_share(channel: str, axis: str, vehicle: Vehicle) -> float:
    """Share of an axis' energy from which on a channel counts as its carrier.

    In closed loop the controller answers a disturbance, so that speeds, vanes and tilt repeat its noise; such a channel
    has to carry much more than one that nothing drives. In hover every moment is mirrored by what balances it, so that
    a reaction proves no moment at all.
    """
    if not answers(channel, axis, vehicle):
        return SMALLEST_SHARE
    return REACTIVE_SHARE if axis.startswith("F") else NEVER


class _Split:
    """Fits of many curves to many signals at once, each fold by the others; sums of squares and little else."""

    def __init__(self, record: Record, x: Array, tau_s: float) -> None:
        fold_of, fitted = split(record.valid, record.step_s, BLOCK_S, tau_s)
        self.x = x[record.valid].astype(np.float32)
        self.unseen = [np.flatnonzero(fold_of[record.valid] == f) for f in range(FOLDS)]
        self.unused = [np.flatnonzero(~rows[record.valid]) for rows in fitted]
        self.gram = self.x.T @ self.x
        self.gram_unseen = [self.x[rows].T @ self.x[rows] for rows in self.unseen]
        self.gram_unused = [self.x[rows].T @ self.x[rows] for rows in self.unused]

    def shares(self, curves: list[_Curve], y: Array) -> Array:
        """Share of the energy of signals ``y`` (n, signals) that every curve takes off unseen time."""
        y = (y - y.mean(axis=0)).astype(np.float32)
        product = self.x.T @ y
        gain = np.zeros((len(curves), y.shape[1]))
        for f in range(FOLDS):
            unseen = self.x[self.unseen[f]].T @ y[self.unseen[f]]
            train = product - self.x[self.unused[f]].T @ y[self.unused[f]]
            gram = self.gram - self.gram_unused[f]
            for i, curve in enumerate(curves):
                part = curve.columns
                b = np.linalg.solve(gram[part, part] + len(y) * curve.stiffness, train[part])
                gain[i] += (2.0 * b * unseen[part] - b * (self.gram_unseen[f][part, part] @ b)).sum(axis=0)
        gain[~np.isfinite(gain)] = 0.0
        out: Array = gain / np.maximum((y**2).sum(axis=0), 1e-30)
        return out


def _surrogates(noise: Noise, n: int, seed: int) -> Array:
    """Gaussian noise of the given spectra, (n, axes, DRAWS)."""
    # Written out: scipy.signal takes half a second to import.
    kicks = np.random.default_rng(seed + 7).standard_normal((n + BURN_IN, len(noise.total), DRAWS), np.float32)
    worlds = kicks.astype(float)
    worlds[:ORDER] = 0.0
    weights = noise.ar[:, ::-1].T[..., None]
    for i in range(ORDER, len(worlds)):
        worlds[i] += (weights * worlds[i - ORDER : i]).sum(axis=0)
    return worlds[BURN_IN:]


def _beside_best(y: Array, curves: list[_Curve], x: Array, share: Array, valid: NDArray[np.bool_]) -> Array:
    """Every axis less the curve that fits it best, so that a curve to be found does not pass for noise."""
    left = y.copy()
    for a in range(y.shape[1]):
        best = int(share[:, a].argmax())
        if share[best, a] > SMALLEST_SHARE:
            part = x[:, curves[best].columns]
            left[:, a] -= part @ np.linalg.lstsq(part[valid], y[valid, a], rcond=1e-6)[0]
    return left


def _curves(record: Record) -> tuple[list[_Curve], Array]:
    """Every free curve and the columns (n, K) of all of them: no mean, unit size."""
    curves: list[_Curve] = []
    parts: list[Array] = []

    def add(name: str, basis: Array | None, lag_s: float | None = None, peak_hz: float | None = None) -> None:
        if basis is None:
            return
        start = sum(b.shape[1] for b in parts)
        basis = basis - basis[record.valid].mean(axis=0)
        size = np.sqrt((basis[record.valid] ** 2).mean(axis=0))
        size[size < 1e-9] = 1.0
        k = basis.shape[1]
        # The difference of neighbouring knots is held small, so that a curve goes on straight over a gap.
        bend = np.eye(k) - (np.eye(k, k, -1) if peak_hz is None and name != "yaw_rad" else 0.0)
        stiffness = (bend.T @ bend) / np.outer(size, size) * np.mean(size**2)
        curves.append(_Curve(name, slice(start, start + k), (STIFFNESS * stiffness).astype(np.float32), lag_s, peak_hz))
        parts.append(np.where(record.valid[:, None], basis / size, 0.0))

    for name, values in record.channels.items():
        if name == "yaw_rad":
            if np.ptp(np.unwrap(np.nan_to_num(values[record.valid]))) > 0.5:
                angles = [np.stack([np.sin(m * values), np.cos(m * values)], 1) for m in (1, 2)]
                add(name, np.nan_to_num(np.concatenate(angles, axis=1)))
            continue
        add(name, _hats(values, record.valid, KNOTS))
        if name in FINE:
            add(name, _hats(values, record.valid, MANY_KNOTS, even=True))
        if name.startswith(("rpm", "servo", "thrust", "battery_current")):
            slow = _slow(values, max(int(LAG_S / record.step_s), 1))
            add(name, _hats(values - slow, record.valid, 3), LAG_S)
    t = record.time_s - record.time_s[0]
    low, high = LINES_HZ
    lines = np.arange(np.log(low), np.log(min(high, 0.4 / record.step_s)), 0.5 / (0.2 * record.seconds))
    for hz in np.exp(lines[:LINES]):
        phase = 2.0 * np.pi * hz * t
        add("time_s", np.stack([np.sin(phase), np.cos(phase)], axis=1), None, float(hz))
    if not parts:
        return [], np.zeros((len(t), 0))
    return curves, np.concatenate(parts, axis=1)


def _beside_timing(record: Record, rest: Array, axis: int) -> Array:
    """One axis (n,) less its mean and what an error of timing of the actuators looks like."""
    valid = record.valid
    modelled = (record.measured - record.residual)[:, record.axes[axis]]
    rate = np.nan_to_num(np.gradient(modelled, record.step_s))  # 0 beside a gap: that is no change of lift
    z = np.stack([np.ones(len(rate)), rate], axis=1)
    fit = np.linalg.lstsq(z[valid], rest[valid], rcond=None)[0]
    out: Array = np.where(valid, rest - z @ fit, 0.0)
    return out


def _hats(values: Array, valid: NDArray[np.bool_], knots: int, *, even: bool = False) -> Array | None:
    """Piecewise linear basis (n, knots - 1), even or on quantiles; None where the channel hardly varies."""
    known = valid & np.isfinite(values)
    if known.sum() < 0.5 * valid.sum() or known.sum() < 50:
        return None
    if even:
        low, high = np.quantile(values[known], (0.01, 0.99))
        places = np.linspace(low, high, knots)
    else:
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
