"""Which barometer is alive."""

from __future__ import annotations

import numpy as np

from replay.flightlog import FlightLog, Series, Stated
from replay.sources.candidates import Candidate

_LOWEST_PA = 2.0e4
_HIGHEST_PA = 1.2e5
"""Air between 12 km of altitude and the lowest dry land (standard atmosphere)."""
_PRIMARY = ("BARO_PRIMARY", "GND_PRIMARY")
"""ArduPilot's number of the barometer in use, from 0."""


def pressures(log: FlightLog) -> list[Candidate]:
    """Every barometer of the log."""
    return [Candidate(name=name, fault=_fault(series)) for name, series in log.pressures.items()]


def stated_pressure(log: FlightLog) -> Stated | None:
    """The barometer that ArduPilot's parameters name."""
    names = list(log.pressures)
    for key in _PRIMARY:
        number = int(log.parameters.get(key, -1))
        if 0 <= number < len(names):
            return Stated(names[number], key)
    return None


def _fault(series: Series) -> str:
    pressure = series.values[:, 0]
    known = pressure[np.isfinite(pressure)]
    if not known.size:
        return "no number"
    median = float(np.median(known))
    if not _LOWEST_PA <= median <= _HIGHEST_PA:
        return f"reads {median:.0f} Pa"
    return ""
