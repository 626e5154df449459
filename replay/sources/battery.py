"""Which battery feeds the motors."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from replay.flightlog import FlightLog, Series
from replay.sources.candidates import Candidate

LEAST_V = 2.5
"""A cell of lithium below this is destroyed: no pack that flies reads less."""
_LOW_PERCENTILE = 5.0
_HIGH_PERCENTILE = 95.0
"""The swing of a voltage without its outliers."""


def batteries(log: FlightLog) -> list[Candidate]:
    """Every battery of the log. That with the most power feeds the motors; without currents, that which sags most."""
    measures = _powers(log.batteries)
    because = "it gives the most power"
    if measures is None:
        measures = {name: _sag(series) for name, series in log.batteries.items()}
        because = "it sags the most in flight"
    return [
        Candidate(name=name, fault=_fault(series), agreement=measures[name], because=because)
        for name, series in log.batteries.items()
    ]


def _fault(series: Series) -> str:
    voltage = series.values[:, 0]
    known = voltage[np.isfinite(voltage)]
    if not known.size:
        return "no voltage"
    median = float(np.median(known))
    if median < LEAST_V:
        return f"reads {median:.2f} V"
    return ""


def _powers(found: Mapping[str, Series]) -> dict[str, float] | None:
    """Median power [W] of every battery; None where one that has a voltage has no current."""
    out = {}
    for name, series in found.items():
        with np.errstate(invalid="ignore", over="ignore"):  # a damaged log holds any number
            power = series.values[:, 0] * series.values[:, 1]
        known = power[np.isfinite(power)]
        if known.size:
            out[name] = float(np.median(known))
        elif _fault(series):
            out[name] = 0.0
        else:
            return None
    if any(power > 0.0 for power in out.values()):
        return out
    return None


def _sag(series: Series) -> float:
    """Swing of the voltage over its median."""
    voltage = series.values[:, 0]
    known = voltage[np.isfinite(voltage)]
    if not known.size:
        return 0.0
    low, middle, high = np.percentile(known, (_LOW_PERCENTILE, 50.0, _HIGH_PERCENTILE))
    return float((high - low) / max(abs(middle), 1e-6))
