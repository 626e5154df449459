"""Gyro, accelerometer, attitude and velocity that do not belong together, and logs that end upside down."""

from __future__ import annotations

import numpy as np

from models.common.frames import GRAVITY, Array
from replay.flightlog import LogFault
from replay.residual.grid import Mask, band, rate_of_change, running_mean
from replay.residual.motion import Trajectory

FEWEST_SAMPLES = 100
"""Airborne samples from which on two sensors are compared."""
GYRO_S = 0.1
GYRO_LEAST_RAD_S = 0.05
GYRO_DISAGREE = 0.7
"""Half width of the mean over which gyro and attitude are compared; turning that is needed; RMS of the difference, as a
share of the gyro's, from which on one of them is wrong (1 for a dead gyro, 2 for a reversed one)."""
GYRO_SAMPLES = 5
"""Samples of the slower of the two that half the mean has to hold: a frame that shakes is caught at other moments."""
FORCE_S = (0.25, 2.0)
FORCE_LEAST_M_S2 = (0.6, 0.6, 0.15)
FORCE_DISAGREE = 0.9
"""The same for accelerometer and rate of the velocity, between two half widths, by axis: slower than that, and on the
level axes, errors of the attitude count (3 degrees are 0.5 m/s^2)."""
STRETCHES = 5
"""Equal parts of the flight: where more of them agree than disagree, what disturbs the others is no fault."""
ASKEW_M_S2 = 2.5
"""Mean difference of accelerometer and velocity that no offset and no tilt error makes: 15 degrees, or a quarter g."""
DERIVED_OVER_S = (0.5, 5.0)
DERIVED_M_S2 = 0.003
DERIVED_SHARE = 0.2
"""Times over which accelerometer and derivative of the velocity are compared; spread of their difference over the
longer, and its share of that over the shorter (a tenth for derivatives), below which no accelerometer has measured.
Where the shorter is below the first of both, rounding is what differs, which averages out more slowly (a third)."""
UPSIDE_DOWN = 0.3
OVER_S = 0.3
OVER_SHARE = 0.3
END_SHARE = 0.8
"""Cosine of the tilt below which nothing flies; for how long; share of the rest of the log, or place of the first in
the log, from which on it is the end of the flight rather than a flip."""
BANKED_G = 1.5
"""Lift over gravity from which on a vehicle at such a tilt flies a banked turn: one that lies or falls feels less."""
DERIVED_ACCELEROMETER = LogFault("ax_m_s2", "is computed from the velocity, not measured")


def gyro_faults(motion: Trajectory, flying: Mask) -> list[LogFault]:
    """Gyro axes that do not turn as the attitude does."""
    rate = motion.grid.rate
    skew = np.einsum("nji,njk->nik", motion.rotation, rate_of_change(motion.rotation, rate))
    turning = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
    slower = min(motion.attitude_hz, motion.gyro_hz) or rate
    half = max(int(max(GYRO_S, GYRO_SAMPLES / slower) * rate), 1)
    out = []
    for axis, name in enumerate(("p_rad_s", "q_rad_s", "r_rad_s")):
        gyro = running_mean(motion.gyro[:, axis], half)
        attitude = running_mean(turning[:, axis], half)
        both = flying & np.isfinite(gyro) & np.isfinite(attitude)
        if both.sum() < FEWEST_SAMPLES:
            continue
        size = float(max(gyro[both].std(), attitude[both].std()))
        difference = float((gyro - attitude)[both].std())
        if size > GYRO_LEAST_RAD_S and difference > GYRO_DISAGREE * size:
            out.append(LogFault(name, "disagrees with the rate at which the attitude turns"))
    return out


def accelerometer_faults(motion: Trajectory, flying: Mask) -> list[tuple[int, LogFault]]:
    """Axes of the accelerometer that do not follow the rate of the velocity, seen in the attitude's body frame."""
    rate = motion.grid.rate
    implied = motion.force - motion.kinematic_bias
    out = []
    for axis, name in enumerate(("ax_m_s2", "ay_m_s2", "az_m_s2")):
        measured = band(motion.force[:, axis], rate, *FORCE_S)
        kinematic = band(implied[:, axis], rate, *FORCE_S)
        both = flying & np.isfinite(measured) & np.isfinite(kinematic)
        if both.sum() < FEWEST_SAMPLES:
            continue
        difference = (motion.force - implied)[both, axis]
        offset = abs(float(np.median(difference)))
        least = FORCE_LEAST_M_S2[axis]
        if offset > ASKEW_M_S2 or _unlike(measured[both], kinematic[both], least):
            what = "disagrees with velocity and attitude: one of them is wrong"
            out.append((axis, LogFault(name, what)))
    return out


def _unlike(measured: Array, kinematic: Array, least: float) -> bool:
    """Whether two accelerations (n,) disagree as a whole, and in as many stretches as they agree in."""
    if _agree(measured, kinematic, least) is not False:
        return False
    stretches = []
    for part in np.array_split(np.arange(len(measured)), STRETCHES):
        stretches.append(_agree(measured[part], kinematic[part], least))
    return stretches.count(False) >= stretches.count(True)


def _agree(measured: Array, kinematic: Array, least: float) -> bool | None:
    """Whether two accelerations (n,) belong together; None where neither exceeds ``least`` [m/s^2]."""
    size = max(_usual(measured), _usual(kinematic))
    if size <= least:
        return None
    return _usual(measured - kinematic) <= FORCE_DISAGREE * size


def _usual(x: Array) -> float:
    """Standard deviation by the middle two thirds: blows count once."""
    low, high = np.percentile(x, (15.87, 84.13))
    return float(high - low) / 2.0


def derived_accelerometer(motion: Trajectory, flying: Mask) -> bool:
    """Whether the specific force is a derivative of the logged velocity.

    Two derivatives of one velocity differ by how they smooth it, so that their difference averages out as one over the
    time; the offset of an accelerometer and the tilt error of an estimator do not average out.
    """
    rate = motion.grid.rate
    difference = np.einsum("nij,nj->ni", motion.rotation, motion.kinematic_bias)
    difference[~flying] = np.nan
    short_s, long_s = DERIVED_OVER_S
    short = _spread(difference, flying, short_s, rate)
    long = _spread(difference, flying, long_s, rate)
    expected = DERIVED_SHARE * np.maximum(short, DERIVED_M_S2)
    return bool((long < DERIVED_M_S2).all() and (long < expected).all())


def _spread(x: Array, flying: Mask, seconds: float, rate: float) -> Array:
    """Standard deviation (3,) of the mean of (n, 3) over ``seconds`` of unbroken flight; inf where there is little."""
    half = int(seconds / 2.0 * rate)
    whole = np.convolve(flying, np.ones(2 * half + 1), "same") > 2 * half
    if whole.sum() < FEWEST_SAMPLES or not np.isfinite(x[whole]).any():
        return np.full(3, np.inf)
    means = [running_mean(of_axis, half) for of_axis in x.T]
    return np.array([float(np.nanstd(mean[whole])) for mean in means])


def first_upside_down(motion: Trajectory) -> int | None:
    """First sample of the end of a log that ends upside down."""
    with np.errstate(invalid="ignore"):
        over = motion.rotation[:, 2, 2] < UPSIDE_DOWN
        over &= -motion.force[:, 2] < BANKED_G * GRAVITY
    if over.sum() < OVER_S * motion.grid.rate:
        return None
    first = int(np.argmax(over))
    if over[first:].mean() > OVER_SHARE or first > END_SHARE * len(over):
        return first
    return None
