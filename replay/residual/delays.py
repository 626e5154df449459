"""How late rotor speeds and ranges are stamped, from their correlation with the accelerometer and the velocity."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from models.common.frames import Array
from models.effects import Context
from models.vehicle import Vehicle
from replay.flightlog import FlightLog
from replay.residual.distances import ground_height
from replay.residual.grid import Grid, band, running_mean

LONGEST_DELAY_S = 0.3
"""Longest delay that is looked for: telemetry at 5 Hz is stamped a fifth of a second late at most."""
SPEED_LEAD_S = 0.045
OUTPUT_LEAD_S = 0.035
"""By which an IMU's low-pass may be behind rotor speeds: sqrt(2) / (2 pi f) of a second-order Butterworth low-pass at
5 Hz, the lowest in common use. Outputs less, because they lead the thrust by the motors' own lag, too."""
SEEN_ROTORS = 0.3
SEEN_RANGES = 0.5
"""Correlations from which on a delay is believed; ranges against velocity are cleaner than lift against the IMU."""
DETREND_S = 0.7
SMOOTH_S = 0.03
"""Half widths of the running means between which signals are compared: about 0.5 to 10 Hz."""
CLIMB_S = 0.1
FASTEST_CLIMB_M_S = 2.0
"""Half width over which ranges are differentiated, and the rate beyond which the range has jumped."""
BORDER = 0.6
BORDER_SD = 0.1
SURE = 0.999
"""Correlation of lift with the accelerometer about which changes of the lift may be commands or responses; standard
deviation of that border, in Fisher's z; and the largest correlation whose z is told from others."""
FEWEST_SAMPLES = 100
"""Common samples from which on a correlation is taken."""


@dataclass(frozen=True)
class Delay:
    """How late a signal is stamped [s], and how well that is known (correlation at the best lag)."""

    signal: str
    seconds: float
    correlation: float
    corrected: bool

    @property
    def correction_s(self) -> float:
        """By how much later the signal is read than it is stamped."""
        if self.corrected:
            return self.seconds
        return 0.0


def _overlap(a: Array, b: Array, k: int) -> float:
    """Inner product of (n,) ``a`` and ``b``, the latter taken ``k`` samples later."""
    return float(a[max(0, -k) : len(a) - max(0, k)] @ b[max(0, k) : len(b) - max(0, -k)])


def rotor_delay(ctx: Context, grid: Grid) -> Delay:
    """How late the rotor speeds (or outputs) are stamped, from lift against the accelerometer.

    A telemetry delay makes speeds late, the IMU's filter makes them early by a few hundredths of a second: both are
    taken out. Thrust that comes still later than the speed is physics (``motor_lag``) and stays.
    """
    lift = ctx.thrust.sum(axis=1)
    heave = -ctx.vehicle.mass_kg * ctx.state.specific_force[:, 2]
    best, correlation = _lag(heave, lift, grid.rate)
    corrected = bool(
        correlation > SEEN_ROTORS
        and best > -(SPEED_LEAD_S if ctx.vehicle.telemetered else OUTPUT_LEAD_S)
    )
    if ctx.vehicle.telemetered:
        signal = "rotor speed"
    else:
        signal = "servo outputs"
    return Delay(signal, best, correlation, corrected)


def commanded(rotors: Delay, seconds: float) -> float:
    """Probability that the lift changed by command in a flight, and not only in response to disturbances.

    Commanded changes of the lift are felt by the accelerometer; responses take off a disturbance that it would feel.
    Fisher's z = artanh(r) of their correlation r over N independent samples is normal with the variance 1 / N (Fisher
    1921, Metron 1, 3-32). The border between both lies at z = artanh(``BORDER``), give or take ``BORDER_SD``:

        P = Phi((z - artanh(BORDER)) / sqrt(BORDER_SD^2 + 1 / N))
    """
    # What is slower than the running mean is taken out: samples that far apart are independent.
    samples = max(seconds / DETREND_S, 1.0)
    z = math.atanh(min(max(rotors.correlation, -SURE), SURE))
    spread = math.sqrt(BORDER_SD**2 + 1.0 / samples)
    return float(ndtr((z - math.atanh(BORDER)) / spread))


def range_delay_of(
    log: FlightLog, vehicle: Vehicle, t: Array, rotation: Array, velocity: Array, position: Array
) -> Delay | None:
    """How late the ground rangefinder is stamped, from its rate against the velocity."""
    cg = ground_height(log, vehicle, t, rotation, position, 0.0)
    if cg is None or not np.isfinite(velocity[:, 2]).any():
        return None
    rate = 1.0 / float(t[1] - t[0])
    climb = np.gradient(running_mean(cg, max(int(CLIMB_S * rate), 1)), 1.0 / rate)
    climb = np.where(np.abs(climb) < FASTEST_CLIMB_M_S, climb, np.nan)
    best, correlation = _lag(-velocity[:, 2], climb, rate)
    return Delay("ground range", best, correlation, bool(correlation > SEEN_RANGES and best > 0.0))


def _lag(reference: Array, signal: Array, rate: float) -> tuple[float, float]:
    """Lag [s] by which ``signal`` is behind ``reference`` (positive: late), and the correlation there."""
    a, b = (band(x, rate, SMOOTH_S, DETREND_S) for x in (reference, signal))
    both = np.isfinite(a) & np.isfinite(b)
    if both.sum() < FEWEST_SAMPLES:
        return 0.0, 0.0
    a = np.where(both, a, 0.0)
    b = np.where(both, b, 0.0)
    reach = max(int(LONGEST_DELAY_S * rate), 1)
    norm = float(np.sqrt((a @ a) * (b @ b)))
    if norm <= 0.0:
        return 0.0, 0.0
    lags = np.arange(-reach, reach + 1)
    scores = np.array([_overlap(a, b, int(k)) / norm for k in lags])
    i = int(scores.argmax())
    return float((lags[i] + _between(scores, i)) / rate), float(scores[i])


def _between(scores: Array, i: int) -> float:
    """Where the parabola through the scores about ``i`` has its top, in steps from ``i``."""
    if not 0 < i < len(scores) - 1:
        return 0.0
    left, mid, right = scores[i - 1 : i + 2]
    bend = left - 2 * mid + right
    if bend < 0:
        return float(0.5 * (left - right) / bend)
    return 0.0
