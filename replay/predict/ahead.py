"""Motion ahead as JSON and as text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from replay.predict.horizon import QUANTITIES, Foretold, errors_ahead, worst_windows


def ahead_as_json(flights: Sequence[Foretold]) -> dict[str, Any]:
    """The keys that docs/formats.md describes."""
    horizon = {}
    for quantity, errors in errors_ahead(flights).items():
        horizon[quantity] = [error.as_json() for error in errors]
    return {
        "horizon": horizon,
        "horizon_units": {quantity: QUANTITIES[quantity] for quantity in horizon},
        "windows": {
            "judged": sum(len(f.windows.at_s) - f.diverged for f in flights),
            "left_out": sum(f.windows.left_out for f in flights),
            "diverged": sum(f.diverged for f in flights),
        },
        "worst_windows": worst_windows(flights),
    }


def counted(flights: Sequence[Foretold]) -> str:
    """How many windows were judged, and how many were not."""
    judged = sum(len(f.windows.at_s) - f.diverged for f in flights)
    lost = sum(f.windows.left_out for f in flights)
    diverged = sum(f.diverged for f in flights)
    return (
        f"{judged} windows; {lost} left out (a gap, or not judged), {diverged} diverged and are in "
        "no mean."
    )


def ahead_as_text(flights: Sequence[Foretold]) -> list[str]:
    """A few lines for a person: the error at half of the horizon and at its end."""
    lines = [
        f"motion ahead of measured states: {counted(flights)}",
        "  mean error, nothing changes / declared model / with effects",
    ]
    for quantity, errors in errors_ahead(flights).items():
        for error in (errors[len(errors) // 2 - 1], errors[-1]):
            low, high = error.interval
            means = error.means
            lines.append(
                f"  {quantity:9s} {error.s:5.2f} s  {means['naive']:8.3g} / "
                f"{means['declared']:8.3g} / {means['model']:8.3g} {QUANTITIES[quantity]} "
                f"[{low:.3g}, {high:.3g}]"
            )
    return lines
