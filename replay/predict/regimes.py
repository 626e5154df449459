"""Where a flight was, and how it flew: the parts of which an error is reported by itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from replay.residual.record import Record
from replay.search.regimes import FAST_M_S, masks

Mask = NDArray[np.bool_]
STILL_M_S, CLIMBING_M_S = 0.3, 0.3
"""Speed of a hover, and climb or descent of a climbing flight [m/s]."""


def regimes(record: Record) -> dict[str, Mask]:
    """Masks (n,) over judged samples, of the regimes that occur."""
    velocity = record.context.state.velocity_ned
    surface = masks(record)
    low, wall = surface["near the ground"], surface["near a wall"]
    with np.errstate(invalid="ignore"):
        speed, climb = np.linalg.norm(velocity, axis=1), np.abs(velocity[:, 2])
        out = {
            "hover": speed < STILL_M_S,
            "fast": speed > FAST_M_S,
            "climbing": climb > CLIMBING_M_S,
            "low": low & ~wall,
            "wall": wall & ~low,
            "corner": low & wall,
            "far": ~low & ~wall,
        }
    return {name: mask & record.valid for name, mask in out.items()}
