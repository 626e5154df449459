"""Errors of the first seed's flights over the script, as a picture: height and lateral, its phases shaded."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from companion.sim.compare_report import LegComparison
from companion.sim.flown import PHASES, UNITS, Flown, Leg
from models.common.errors import ConfigError
from models.common.pages.svg import Band, Line, picture

_KINDS = {Leg.AUTOPILOT: "d", Leg.OFF: "before", Leg.ON: "after", Leg.ADAPTED: "fit"}
"""Legs that are drawn, and their colours."""
_POINTS = 800
"""Of a curve: one a unit of its width."""


def write_plot(path: Path, found: LegComparison) -> None:
    """Write the SVG file; ConfigError where that fails."""
    flights = [f for f in found.flights if f.seed == found.seeds[0] and f.leg in _KINDS]
    panels = {}
    for axis in ("height", "lateral"):
        panels[f"{axis} error [{UNITS[axis]}]"] = [_line(f, axis) for f in flights]
    title = f"sim:{found.scenario}, simulated, seed {found.seeds[0]}"
    drawn = picture(title, panels, f"time of the script [s] ({title})", _bands(flights[0]))
    try:
        path.write_text(drawn, "utf-8")
    except OSError as error:
        raise ConfigError(f"--plot {path}: cannot be written ({error.strerror})") from None


def _line(flight: Flown, axis: str) -> Line:
    every = max(len(flight.time_s) // _POINTS, 1)
    time_s = flight.time_s[::every]
    error = flight.size(axis)[::every]
    return Line(time_s, error, _KINDS[flight.leg], flight.leg.value)


def _bands(flight: Flown) -> list[Band]:
    """Where the vehicle stays low, at the wall and in the corner."""
    changes = np.flatnonzero(np.diff(flight.phase)) + 1
    out = []
    for start, end in pairwise([0, *changes.tolist(), len(flight.phase) - 1]):
        name = PHASES[flight.phase[start]]
        if name != "between":
            out.append(Band(float(flight.time_s[start]), float(flight.time_s[end]), "d", name))
    return out
