"""Which method to train for flight, from the numbers of a comparison."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from models.frames import AXES


class Recommendation(NamedTuple):
    """The method to use, and why."""

    method: str
    why: str


def recommend(numbers: Mapping[str, Any]) -> Recommendation:
    """The best on rows that no method learnt; among equals (within one standard deviation over the splits) the one with
    the smallest error where whole regions were left out, because a vehicle flies between and beyond the data.
    """
    honest = numbers["table2"]
    live = [axis for axis in AXES if next(iter(honest.values()))[axis]["test"] is not None]
    score = {m: float(np.mean([row[a]["test"] for a in live])) for m, row in honest.items()}
    best = max(score, key=lambda m: score[m])
    sd = float(np.mean([honest[best][a]["test_sd"] or 0.0 for a in live]))
    equals = [m for m in score if score[m] >= score[best] - sd]
    outside = {
        m: float(np.mean([r["relative_error"][m] for r in numbers["regions"].values()] or [0.0])) for m in equals
    }
    chosen = min(equals, key=lambda m: outside[m])
    why = (
        f"held-out R^2 {score[chosen]:.3f} (best: {best} {score[best]:.3f}); error over the increments' RMS in "
        f"regions left out whole {outside[chosen]:.2f}"
    )
    return Recommendation(chosen, why)
