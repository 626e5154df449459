"""What a fault of a log is, and how two signals of a flight are compared."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.frames import Array
from models.vehicle import Vehicle
from replay.residual.grid import Mask, running_mean

FEWEST = 200
"""Common samples from which on a correlation counts."""


@dataclass(frozen=True)
class LogFault:
    """A channel that is not to be believed, and why."""

    channel: str
    what: str


def rotor_channel(vehicle: Vehicle, k: int) -> str:
    """Channel of rotor ``k`` of the vehicle file: its speed, or its output."""
    rotor = vehicle.rotors[k]
    return f"rpm_{rotor.esc}" if rotor.servo is None else f"servo_{rotor.servo}"


def band(x: Array, rate: float, fast_s: float, slow_s: float) -> Array:
    """What of (n,) varies between two half widths of running means."""
    return running_mean(x, max(int(fast_s * rate), 1)) - running_mean(x, max(int(slow_s * rate), 1))


def correlations(cause: Array, effect: Array, flying: Mask, most: int) -> Array:
    """Correlation (m,) of an effect 0 to ``most`` samples behind its cause; 0 where too little is known."""
    out = []
    for lag in range(0, most + 1, max(most // 10, 1)):
        a, b = cause[: len(cause) - lag], effect[lag:]
        use = flying[lag:] & np.isfinite(a) & np.isfinite(b)
        known = use.sum() >= FEWEST and a[use].std() > 0.0 and b[use].std() > 0.0
        out.append(float(np.corrcoef(a[use], b[use])[0, 1]) if known else 0.0)
    return np.array(out)
