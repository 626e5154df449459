"""Rotors that turn while the vehicle does not fly: tied down, on a thrust stand, on the ground or in a hand.

In the air thrust answers to nothing but the vehicle's own mass: what lift changes by is felt, and the attitude never
rests. The scale of the lift does not matter here, so that a drafted vehicle file serves as well as a measured one.
Figures are by 65 measured and simulated flights of 20 vehicles; "flights" below are those.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.common.frames import GRAVITY, Array, euler_angles
from models.effects import Context
from replay.residual.grid import Mask, rate_of_change, running_mean
from replay.residual.motion import Trajectory

DID_NOT_FLY = (
    "did not fly: rotors turn, but attitude, height and acceleration do not answer (tied down, or "
    "on the ground)"
)
TURNING_SHARE = 0.1
"""Modelled lift over weight above which rotors turn, and do not just idle."""
SETTLED_SHARE = 0.5
EDGE_S = 1.0
"""Lift over its usual size above which rotors have spun up; time around that is not compared: a take-off's lift is
carried by the ground, too."""
WINDOW_S = 4.0
STEP_S = 1.0
LEAST_S = 1.0
"""Length and distance of the windows; time of turning rotors that one has to hold."""
SMOOTH_S = 0.1
SAMPLE_S = 0.04
LATEST_S = 0.3
"""Half width of the mean over noise; distance of samples that are compared; how late lift or acceleration may be."""
STILL_DEG = 0.04
USUALLY_STILL_DEG = 0.1
CALM_DEG = 0.3
"""Spread of roll and pitch within a window: below that of any window of a flight (0.07 degrees); of half of a flight's
windows (0.15); and of one that thrust leaves alone, or of any in a run that rests."""
EXCITED_SHARE = 0.1
UNANSWERED = 0.2
"""Spread of lift over its size from which on a vehicle must answer, and share of it that is felt below which it does
not. A window of a calm flight answers with 0.46 and more, most windows of the others with 0.36 and more."""
MOVES_SHARE = 0.01
ANSWERED = 0.5
"""A vehicle that feels so much of such a spread of lift flies, however level it is."""
CRUISE_M_S = 1.0
"""Mean speed of what flies: an estimator that drifts on the bench is slower."""
RISEN_M = 5.0
SCALE_HEIGHT_M = 8434.0
"""Above the place where the rotors began to turn, by barometer and estimator: more than their wash on a barometer is,
or its drift within a run. And the height in which pressure falls to 1/e, at 288 K."""
MOSTLY = 0.5
CARRIED_M_S = 0.5
"""Share of windows in which lift is ignored, and mean speed, of a vehicle in a hand. In a flight whose outputs are
wrong, lift is ignored, too, but it goes somewhere."""
LONG_S = 8.0
"""A run of the rotors that is judged by itself; shorter ones are judged together."""


@dataclass(frozen=True, kw_only=True)
class _Seen:
    """Of ``m`` samples ``SAMPLE_S`` apart: lift over its usual size, felt force [g], roll and pitch [deg], speed."""

    t: Array
    lift: Array
    felt: Array
    tilt: Array
    """(m, 2)."""
    speed: Array
    risen: Array
    """Height [m] over the place where this run of the rotors began."""
    turning: Mask
    settled: Mask


@dataclass(frozen=True)
class _Answer:
    """What some samples show: spread of the attitude [deg] and of lift, share of the latter that is felt, speed."""

    tilt_deg: float
    lift_spread: float
    felt: float
    speed: float
    risen: float

    @property
    def flies(self) -> bool:
        """Whether the vehicle surely flies."""
        answers = self.lift_spread > MOVES_SHARE and self.felt > ANSWERED
        return answers or self.speed > CRUISE_M_S or self.risen > RISEN_M

    @property
    def ignores_lift(self) -> bool:
        """Whether lift changes by much, and nothing comes of it."""
        return self.lift_spread > EXCITED_SHARE and self.felt < UNANSWERED


def held_down(ctx: Context, motion: Trajectory) -> tuple[Mask, Mask]:
    """Samples (n,) at which rotors turn, and those of them at which the vehicle is held, or stands."""
    lift = ctx.thrust.sum(axis=1)
    with np.errstate(invalid="ignore"):
        turning = lift > TURNING_SHARE * ctx.weight
    held = np.zeros(len(lift), bool)
    if not turning.any():
        return turning, held
    seen = _seen(lift, turning, motion, ctx.state.pressure_pa)
    latest = np.searchsorted(seen.t, motion.grid.t, side="right") - 1
    held = _held(seen)[np.maximum(latest, 0)]
    return turning, held & turning


def _seen(lift: Array, turning: Mask, motion: Trajectory, pressure: Array) -> _Seen:
    rate = motion.grid.rate
    every = max(round(SAMPLE_S * rate), 1)
    usual = float(np.median(lift[turning]))
    with np.errstate(invalid="ignore"):
        spun = _mean(lift, rate) > SETTLED_SHARE * usual
    around = 2 * round(EDGE_S * rate) + 1
    settled = np.convolve(~spun, np.ones(around), "same") < 0.5
    roll, pitch, _ = np.degrees(euler_angles(motion.rotation))
    tilt = np.stack([_mean(roll, rate), _mean(pitch, rate)], axis=1)
    return _Seen(
        t=motion.grid.t[::every],
        lift=_mean(lift / usual, rate)[::every],
        felt=_mean(-motion.force[:, 2] / GRAVITY, rate)[::every],
        tilt=tilt[::every],
        speed=_speed(motion)[::every],
        risen=_risen(turning, motion.position[:, 2], pressure)[::every],
        turning=turning[::every],
        settled=settled[::every],
    )


def _speed(motion: Trajectory) -> Array:
    """Speed (n,) of the velocity and of the place, whichever is less: a velocity that leads nowhere is an error."""
    moved = rate_of_change(motion.position, motion.grid.rate)
    by_place = np.linalg.norm(moved, axis=1)
    by_velocity = np.linalg.norm(motion.velocity, axis=1)
    return np.asarray(np.fmin(by_velocity, by_place))


def _risen(turning: Mask, down: Array, pressure: Array) -> Array:
    """Height (n,) over the place where the rotors last began to turn, as barometer and estimator both say; else NaN."""
    begins = turning.copy()
    begins[1:] &= ~turning[:-1]
    index = np.where(begins, np.arange(len(turning)), 0)
    first = np.maximum.accumulate(index)
    with np.errstate(divide="ignore", invalid="ignore"):
        by_pressure = SCALE_HEIGHT_M * np.log(pressure[first] / pressure)
    return np.asarray(np.minimum(down[first] - down, by_pressure))


def _held(seen: _Seen) -> Mask:
    """Samples (m,) that are held, by the windows around them and by whole runs of the rotors.

    Half of the windows that hold a sample have to say so: one that begins in the air and ends on the ground does not
    make the descent a standstill.
    """
    runs = _runs(seen)
    windows: list[Array] = []
    for run in runs:
        windows += _windows(seen, run)
    answers = [_answer(seen, window) for window in windows]
    judged = np.zeros(len(seen.t))
    said = np.zeros(len(seen.t))
    for window, answer in zip(windows, answers, strict=True):
        still = answer.tilt_deg < STILL_DEG
        calm = answer.tilt_deg < CALM_DEG
        judged[window] += 1.0
        said[window] += not answer.flies and (still or (calm and answer.ignores_lift))
    held = (said > 0.0) & (2.0 * said >= judged)
    for group in _groups(seen, runs):
        if _all_held(seen, group, windows, answers):
            held[np.concatenate(group)] = True
    return np.asarray(held)


def _all_held(
    seen: _Seen, group: list[Array], windows: list[Array], answers: list[_Answer]
) -> bool:
    """Whether some runs are of a vehicle that is held all the time."""
    together = np.concatenate(group)
    inside = [a for w, a in zip(windows, answers, strict=True) if np.isin(w, together).all()]
    whole = _answer(seen, together)
    tilts = [a.tilt_deg for a in inside] or [np.inf]
    # A calm hover rests most of the time; what turns now and then all the same is not tied down.
    still = float(np.median(tilts)) < USUALLY_STILL_DEG and max(tilts) < CALM_DEG
    ignoring = np.mean([a.ignores_lift for a in inside] or [False]) > MOSTLY
    carried = bool(ignoring) and whole.speed < CARRIED_M_S
    return not whole.flies and (still or carried)


def _runs(seen: _Seen) -> list[Array]:
    """Samples (k,) of every run of the rotors."""
    index = np.flatnonzero(seen.turning)
    breaks = np.flatnonzero(np.diff(index) > 1) + 1
    return list(np.split(index, breaks))


def _groups(seen: _Seen, runs: list[Array]) -> list[list[Array]]:
    """Long runs by themselves, short ones together."""
    long = [run for run in runs if _seconds(seen, run) >= LONG_S]
    short = [run for run in runs if _seconds(seen, run) < LONG_S]
    groups = [[run] for run in long]
    if short:
        return [*groups, short]
    return groups


def _windows(seen: _Seen, run: Array) -> list[Array]:
    """Parts (k,) of a run, which overlap."""
    step = round(STEP_S / _step(seen))
    length = round(WINDOW_S / _step(seen))
    least = round(LEAST_S / _step(seen))
    starts = range(0, max(len(run) - length, 0) + 1, max(step, 1))
    parts = [run[start : start + length] for start in starts]
    return [part for part in parts if len(part) >= least]


def _answer(seen: _Seen, rows: Array) -> _Answer:
    """What the samples ``rows`` (k,) show."""
    tilt = seen.tilt[rows]
    known = np.isfinite(tilt).all(axis=1)
    if known.any():
        spread = float(np.hypot(*tilt[known].std(axis=0)))
    else:
        spread = np.inf
    lift_spread, felt = _felt_share(seen, rows[seen.settled[rows]])
    return _Answer(spread, lift_spread, felt, _usual(seen.speed[rows]), _usual(seen.risen[rows]))


def _usual(values: Array) -> float:
    """Mean of what is known; 0 where nothing is."""
    known = values[np.isfinite(values)]
    if known.size:
        return float(known.mean())
    return 0.0


def _felt_share(seen: _Seen, rows: Array) -> tuple[float, float]:
    """Spread of lift over the samples ``rows`` (k,), and the share that is felt, as late as suits best."""
    latest = round(LATEST_S / _step(seen))
    if len(rows) < round(LEAST_S / _step(seen)):
        return 0.0, 0.0
    lift = seen.lift[rows] - np.nanmean(seen.lift[rows])
    late = np.arange(-latest, latest + 1)
    moved = np.clip(rows + late[:, None], 0, len(seen.t) - 1)
    felt = seen.felt[moved]
    felt = felt - np.nanmean(felt, axis=1, keepdims=True)
    both = np.isfinite(lift) & np.isfinite(felt)
    size = np.where(both, lift**2, 0.0).sum(axis=1)
    product = np.where(both, lift * felt, 0.0).sum(axis=1)
    share = product / np.maximum(size, 1e-12)
    best = max(0.0, float(share.max()))
    return float(np.nanstd(lift)), best


def _step(seen: _Seen) -> float:
    if len(seen.t) > 1:
        return float(seen.t[1] - seen.t[0])
    return SAMPLE_S


def _seconds(seen: _Seen, rows: Array) -> float:
    return len(rows) * _step(seen)


def _mean(x: Array, rate: float) -> Array:
    return running_mean(x, round(SMOOTH_S * rate))
