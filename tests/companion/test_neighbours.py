"""The flight program beside others on one link, all real processes; skipped where a program is not installed."""

from __future__ import annotations

import importlib.util
import subprocess
import time
from pathlib import Path

import pytest
from neighbours import PYTHON, companion, missing, running, wired

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]


def need(kind: str) -> None:
    why = missing(kind)
    if why is not None:
        pytest.skip(why)


def near(station, north: float, east: float, height: float, within: float = 0.15) -> bool:
    return max(abs(a - b) for a, b in zip(station.place, (north, east, height), strict=True)) < within


def flies(station) -> None:
    """Up, in the flight program's hands, and moved by a target that a station gives it."""
    station.take_off()
    station.until(
        lambda: [m for m in station.of("NAMED_VALUE_FLOAT", 191)[-40:] if m.name == "cc_auth" and m.value > 0.9],
        40.0, "authority",
    )  # fmt: skip
    north, east, height = station.place
    station.go(north + 0.5, east, height)
    station.until(lambda: near(station, north + 0.5, east, height), 30.0, "the place that was asked for")


@pytest.mark.parametrize("kind", ["mavlink-router", "mavproxy"])
def test_it_flies_behind_a_hub_and_a_station_moves_its_hold(kind, tmp_path):
    need(kind)
    with wired(kind, tmp_path) as (station, flying, _):
        flies(station)
        print(flying.words)
        result = flying.end()
    beat = station.of("HEARTBEAT", 191)[-1]
    assert (beat.get_srcSystem(), beat.type, beat.autopilot) == (1, 18, 8)
    print(result)
    assert result["messages"]["bad"] == 0
