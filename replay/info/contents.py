"""What a flight log holds: every quantity with its count, rate and gaps."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from replay.flightlog import FlightLog, Series
from replay.spill import release

_GAP_PERIODS = 5.0
_GAP_S = 0.3
"""A pause is a gap where it lasts five periods and 0.3 s or more. Shorter pauses are interpolated by those who read."""


@dataclass(frozen=True, kw_only=True)
class Stream:
    """One quantity of a log."""

    name: str
    source: str
    """Message or topic that it was read from."""
    count: int
    rate_hz: float | None
    """One over the median step; None below two samples."""
    gaps: int
    longest_gap_s: float
    start_s: float
    end_s: float
    share_good: float | None = None
    """Of a rangefinder: readings that are neither too near, too far nor weak."""


def streams(log: FlightLog) -> list[Stream]:
    """Every quantity of one boot that holds a sample."""
    return [
        _stream(name, series, good)
        for name, series, good in _series(log)
        if series is not None and len(series)
    ]


def _stream(name: str, series: Series, share_good: float | None) -> Stream:
    steps = np.diff(series.t_s)
    rate = series.rate_hz
    release()
    return Stream(
        name=name,
        source=series.source,
        count=len(series),
        rate_hz=rate if math.isfinite(rate) else None,
        gaps=int((steps > max(_GAP_PERIODS / rate, _GAP_S)).sum()),
        longest_gap_s=float(steps.max()) if steps.size else 0.0,
        start_s=float(series.t_s[0]),
        end_s=float(series.t_s[-1]),
        share_good=share_good,
    )


def _series(log: FlightLog) -> Iterator[tuple[str, Series | None, float | None]]:
    for name in ("attitude", "rates", "position", "velocity"):
        yield name, getattr(log, name), None
    for imu in log.imus:
        yield "specific force", imu.specific_force, None
        yield "gyro", imu.gyro, None
    for beam in log.beams:
        # A reading out of range counts as a sample, but gives no height: the share of good readings says so.
        yield f"range {beam.name}", beam.distance, beam.share_good
    for number, esc in sorted(log.escs.items()):
        yield f"rotor speed {number}", esc.rpm, None
        yield f"ESC temperature {number}", esc.temperature_c, None
    for port, servo in sorted(log.servo_ports.items()):
        yield f"servo outputs{'' if not port else f' of port {port}'}", servo, None
    for name in (
        "battery",
        "pressure",
        "thrust_command",
        "attitude_target",
        "commands",
        "wind",
        "vibration",
    ):
        yield name.replace("_", " "), getattr(log, name), None
