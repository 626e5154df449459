"""The error of a model's motion ahead of measured states, by horizon; beside no model, and the declared one.

Windows of a flight overlap, and errors last: intervals are by blocks of time, drawn with replacement (Künsch 1989, The
Annals of Statistics 17, 1217).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.common.frames import Array, rotation_from_quaternion
from models.effects import get
from replay.predict.rollout import POSITION, QUATERNION, RATES, VELOCITY, FlightModel, rollout
from replay.predict.windows import Windows
from replay.residual.record import Flown

TIMES = 10
"""Times within the horizon at which the error is told."""
BLOCK_S = 5.0
DRAWS = 1000
FASTEST_M_S = 100.0
FASTEST_RAD_S = 50.0
"""A window that leaves these speeds diverges: it is counted, and in no mean."""
WORST = 5
"""Windows that are shown by themselves."""
QUANTITIES = {"position": "m", "velocity": "m/s", "attitude": "rad", "rates": "rad/s"}
MODELS = ("naive", "declared", "model")
"""Nothing changes (rates, velocity and attitude stay); without the adopted effects; with them."""


@dataclass(frozen=True, kw_only=True)
class Foretold:
    """One flight: errors (models, n, steps) of every quantity, norms in its unit; NaN of a window that diverged."""

    log: str
    windows: Windows
    errors: dict[str, Array]
    diverged: int
    turning: bool
    """Whether attitude and rates were foretold; else the measured attitude is used."""


def foretell(
    name: str,
    flown: Flown,
    cut: Windows,
    declared: FlightModel,
    amended: FlightModel,
    *,
    turning: bool,
) -> Foretold:
    """The windows of one flight under all models."""
    paths = [_naive(cut)]
    for model in (declared, amended):
        beside = _beside(model, flown)[cut.rows]
        paths.append(
            rollout(
                model,
                cut.states,
                cut.inputs,
                step_s=cut.step_s,
                near=cut.near,
                beside=beside,
                rotations=None if turning else cut.rotations,
                weather=cut.weather,
            )
        )
    sound = np.stack([_sound(path) for path in paths]).all(axis=0)
    errors = {}
    for quantity in _judged(cut, turning):
        by_model = np.stack([_error(quantity, path, cut.measured) for path in paths])
        by_model[:, ~sound] = np.nan
        errors[quantity] = by_model
    return Foretold(
        log=name, windows=cut, errors=errors, diverged=int((~sound).sum()), turning=turning
    )


def _judged(cut: Windows, turning: bool) -> list[str]:
    out = ["velocity"]
    if cut.placed:
        out.insert(0, "position")
    if turning:
        out += ["attitude", "rates"]
    return out


def _naive(cut: Windows) -> Array:
    """Velocity and attitude stay as they are (n, steps, 13)."""
    steps = cut.inputs.shape[1]
    out = np.repeat(cut.states[:, None], steps, axis=1)
    elapsed = cut.step_s * np.arange(1, steps + 1)
    out[..., POSITION] += cut.states[:, None, VELOCITY] * elapsed[:, None]
    return out


def _beside(model: FlightModel, flown: Flown) -> Array:
    """Wrench (n, 6) of the effects that follow from the rotors' past alone."""
    out = np.zeros((len(flown.context.state.time_s), 6))
    for adopted in model.adopted:
        effect = get(adopted.name)
        if effect.of_inputs:
            out += np.nan_to_num(effect.wrench(flown.context, adopted.parameters))
    return out


def _sound(path: Array) -> Array:
    """(n,) windows that stay within what flies."""
    with np.errstate(invalid="ignore", over="ignore"):
        speed = np.linalg.norm(path[..., VELOCITY], axis=2)
        rate = np.linalg.norm(path[..., RATES], axis=2)
        return np.asarray(((speed < FASTEST_M_S) & (rate < FASTEST_RAD_S)).all(axis=1))


def _error(quantity: str, path: Array, measured: Array) -> Array:
    """Norm of the error (n, steps)."""
    if quantity == "attitude":
        return _angle(path[..., QUATERNION], measured[..., QUATERNION])
    columns = {"position": POSITION, "velocity": VELOCITY, "rates": RATES}[quantity]
    return np.asarray(np.linalg.norm(path[..., columns] - measured[..., columns], axis=2))


def _angle(a: Array, b: Array) -> Array:
    """Angle (n, steps) [rad] between attitudes (n, steps, 4)."""
    between = np.einsum(
        "...ji,...jk->...ik", rotation_from_quaternion(a), rotation_from_quaternion(b)
    )
    cosine = 0.5 * (np.trace(between, axis1=-2, axis2=-1) - 1.0)
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


@dataclass(frozen=True)
class HorizonError:
    """The error of one quantity a time ahead: mean of all windows by model, and the model's 95 % interval."""

    s: float
    means: dict[str, float]
    interval: tuple[float, float]

    def as_json(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "s": self.s,
            "mae": self.means["model"],
            "interval": list(self.interval),
            "mae_declared": self.means["declared"],
            "mae_naive": self.means["naive"],
        }


def errors_ahead(flights: Sequence[Foretold]) -> dict[str, list[HorizonError]]:
    """By quantity, at ``TIMES`` times of the horizon, over all flights that judge it."""
    out = {}
    for quantity in QUANTITIES:
        judged = [f for f in flights if quantity in f.errors]
        if judged:
            out[quantity] = _over_time(quantity, judged)
    return out


def _over_time(quantity: str, flights: Sequence[Foretold]) -> list[HorizonError]:
    shares = np.arange(1, TIMES + 1) / TIMES
    out = []
    for share in shares.tolist():
        errors = []
        blocks = []
        for number, flight in enumerate(flights):
            steps = flight.errors[quantity].shape[2]
            k = max(round(share * steps), 1) - 1
            seconds = (k + 1) * flight.windows.step_s
            errors.append(flight.errors[quantity][..., k])
            block = np.floor(flight.windows.at_s / BLOCK_S).astype(int)
            blocks.append(np.column_stack([np.full(len(block), number), block]))
        together = np.concatenate(errors, axis=1)
        sound = np.isfinite(together).all(axis=0)
        if not sound.any():
            continue
        means = together[:, sound].mean(axis=1).tolist()
        known = dict(zip(MODELS, means, strict=True))
        interval = _interval(together[-1, sound], np.concatenate(blocks)[sound])
        out.append(HorizonError(seconds, known, interval))
    return out


def _interval(errors: Array, blocks: NDArray[np.int64]) -> tuple[float, float]:
    """95 % interval of the mean of (n,), by blocks (n, 2: flight, block) that are drawn with replacement."""
    _, number = np.unique(blocks, axis=0, return_inverse=True)
    number = number.ravel()
    total = np.bincount(number, errors)
    count = np.bincount(number)
    drawn = np.random.default_rng(0).integers(len(total), size=(DRAWS, len(total)))
    means = total[drawn].sum(axis=1) / count[drawn].sum(axis=1)
    low, high = np.quantile(means, [0.025, 0.975]).tolist()
    return low, high


def worst_windows(flights: Sequence[Foretold]) -> list[dict[str, Any]]:
    """The windows of the largest error of velocity at the end of the horizon."""
    rows = []
    for flight in flights:
        error = flight.errors["velocity"][-1, :, -1]
        for at_s, size in zip(flight.windows.at_s.tolist(), error.tolist(), strict=True):
            if np.isfinite(size):
                rows.append({"log": flight.log, "at_s": at_s, "velocity": size})
    rows.sort(key=lambda row: -float(row["velocity"]))
    return rows[:WORST]
