"""Targets that start and stop abruptly, with and without their velocity, on the way to a wall."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from faults.campaign import config
from flight_case import POSITION_ONLY, Case, CasePilot, surroundings
from lockstep_faults import FaultyLockstep
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.sim.flight import Flight

WALL_M, GAP_M, SPEED_M_S = 1.2, 0.24, 0.3
PLACE_AND_VELOCITY = POSITION_ONLY & ~0x38


@pytest.mark.parametrize("mask", [POSITION_ONLY, PLACE_AND_VELOCITY])
@pytest.mark.parametrize("px4", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_ramp_that_stops_at_the_wall_is_overshot_by_less_than_8_cm(px4, mask):
    end = WALL_M - GAP_M
    seen: list[tuple[float, float]] = []

    def script(pilot: CasePilot) -> Iterator[float]:
        flight = pilot.flight
        yield from pilot.take_off(0.9)
        yield from pilot.hand_over()
        pilot.go(0.0, 0.0, 0.6)
        yield 4.0
        start_s = flight.time_s
        pilot.judge()

        def target() -> Any:
            east = SPEED_M_S * (flight.time_s - start_s)
            velocity = (0.0, SPEED_M_S if east < end else 0.0, 0.0)
            return pilot._position(mavlink.MAV_FRAME_LOCAL_NED, mask, 0.0, min(east, end), -0.6, v=velocity)

        pilot._target = target
        while flight.time_s < start_s + end / SPEED_M_S + 4.0:
            seen.append((flight.time_s - start_s - end / SPEED_M_S, flight.body.position[1]))
            yield 0.02

    own = config()
    case = Case("ramp", "a ramp into the wall", script, px4=px4, wall_m=WALL_M)
    world = FaultyLockstep(
        Flight(own.vehicle, surroundings(case, own.vehicle), 1, px4=px4), lambda w: CasePilot(w, script)
    )
    world.fly(own, None)
    assert max(east for _, east in seen) < end + 0.08
    assert next(t for t, east in seen if east > end - 0.05) < 0.5
    assert abs(seen[-1][1] - end) < 0.03
