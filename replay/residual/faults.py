"""Faults of a log, or of the vehicle file it is read with: told, left out, and never named as an effect."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.frames import Array

DERIVED_M_S2 = 0.02
"""RMS disagreement with the velocity's own derivative below which no accelerometer has measured."""


@dataclass(frozen=True)
class LogFault:
    """A channel that is not to be believed, and why."""

    channel: str
    what: str


def derived_accelerometer(kinematic_bias: Array) -> bool:
    """Whether the specific force is the derivative of the logged velocity; (n, 3), NaN where unknown."""
    known = kinematic_bias[np.isfinite(kinematic_bias).all(axis=1)]
    return bool(len(known) > 50 and np.sqrt(np.median(known**2, axis=0)).max() < DERIVED_M_S2)
