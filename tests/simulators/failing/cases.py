"""What happens in each flight, and what an answer has to say of it: fixed before any flight was diagnosed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FAILURES = ("stopped", "desync", "thrown", "partial", "commanded")
"""A motor gives less from a time on: its number and that time are to be named."""
OTHERS = (
    "ordinary",
    "dive",
    "wall",
    "battery",
    "gust",
    "glitch",
    "attitude",
    "landing",
    "flip",
    "drop",
    "exchanged",
)
"""No motor fails: none may be named (of exchanged ones: none may be said to fail)."""
_SIZES = {
    "partial": (0.3, 0.7),
    "dive": (4.0, 8.0),
    "wall": (2.0, 6.0),
    "battery": (0.3, 0.5),
    "gust": (8.0, 14.0),
    "glitch": (15.0, 60.0),
    "attitude": (0.3, 1.0),
    "landing": (1.5, 3.0),
    "flip": (4.0, 7.0),
    "drop": (0.1, 0.35),
}
"""Of each kind: share lost, speeds [m/s], share of the voltage lost, metres, rad/s, share of the mass."""
_AFTER_S = 7.0


@dataclass(frozen=True, kw_only=True)
class Case:
    """One flight: what happens, to which motors (from 1), from when on [s], and how large it is."""

    kind: str
    motors: tuple[int, ...]
    since_s: float
    size: float
    end_s: float
    height_m: tuple[float, float]

    @property
    def fails(self) -> bool:
        """Whether a motor fails."""
        return self.kind in FAILURES


def draw(kind: str, motors: int, rng: np.random.Generator) -> Case:
    """A flight of that kind with a vehicle of so many motors."""
    since = float(rng.uniform(24.0, 45.0))
    which: tuple[int, ...] = ()
    if kind in FAILURES:
        which = (int(rng.integers(1, motors + 1)),)
    if kind == "exchanged":
        pair = rng.choice(motors, 2, replace=False) + 1
        which = (int(pair[0]), int(pair[1]))
        since = 4.0
    low, high = _SIZES.get(kind, (1.0, 1.0))
    end = since + _AFTER_S
    if kind in ("partial", "ordinary", "drop", "gust"):
        end = since + 20.0
    height = (4.0, 10.0) if kind == "landing" else (8.0, 30.0)
    return Case(
        kind=kind,
        motors=which,
        since_s=since,
        size=float(rng.uniform(low, high)),
        end_s=end,
        height_m=height,
    )
