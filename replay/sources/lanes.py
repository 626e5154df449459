"""Which lane (core) of the autopilot's estimator gives position and velocity."""

from __future__ import annotations

import numpy as np

from replay.flightlog import FlightLog, Lane, Stated
from replay.sources.candidates import Candidate

_FILTERS = {2: "NKF1", 3: "XKF1"}
"""AHRS_EKF_TYPE of ArduPilot to the message of its filter."""


def lanes(log: FlightLog) -> list[Candidate]:
    """Every lane of the log, newest filter first."""
    return [Candidate(name=name, fault=_fault(lane)) for name, lane in log.lanes.items()]


def stated_lane(log: FlightLog) -> Stated | None:
    """What the log says of the primary lane, else the first lane of the filter that AHRS_EKF_TYPE names."""
    if "position" in log.stated:
        return log.stated["position"]
    kind = _FILTERS.get(int(log.parameters.get("AHRS_EKF_TYPE", 0)))
    if kind is None:
        return None
    first = next((name for name in log.lanes if name.startswith(kind)), None)
    if first is None:
        return None
    return Stated(first, "AHRS_EKF_TYPE")


def _fault(lane: Lane) -> str:
    if lane.position is None:
        return "no position"
    known = lane.position.values[np.isfinite(lane.position.values).all(axis=1)]
    if len(known) < 2:
        return "no position"
    return ""
