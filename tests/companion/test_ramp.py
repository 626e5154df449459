"""Targets that start and stop abruptly, with and without their velocity, on the way to a wall."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest
from faults.campaign import config
from flight_case import POSITION_ONLY, Case, CasePilot, surroundings
from lockstep_faults import FaultyLockstep
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from safety.firmware_cases import SLOW_LOOP
from simulated import simulated

from companion.config import PipelineConfig
from companion.control.position_target import expected, start_reference
from companion.sim.scenario import wall_azimuth
from companion.vehicles import QUAD
from models.surrogate.empty import empty_model
from models.vehicle import load_vehicle

WALL_M, GAP_M, SPEED_M_S = 1.2, 0.24, 0.3
PLACE_AND_VELOCITY = POSITION_ONLY & ~0x38


def flown_ramp(
    mask: int, *, px4: bool = False, slow: bool = False, wall_m: float = WALL_M
) -> list[tuple[float, float]]:
    """Seconds since the ramp's end, and how far past it the vehicle is [m]; ``slow``: a quadrotor whose loop is."""
    quad = load_vehicle(QUAD)
    own = PipelineConfig(vehicle=quad, model=empty_model(quad)) if slow else config()
    azimuth = wall_azimuth(own.vehicle)
    c, s = math.cos(azimuth), math.sin(azimuth)
    end = WALL_M - GAP_M
    seen: list[tuple[float, float]] = []

    def script(pilot: CasePilot) -> Iterator[float]:
        flight = pilot.flight
        if slow:
            pilot.world.link.position_hz, pilot.world.link.position_late_s = 10.0, 0.05
        yield from pilot.take_off(0.9)
        yield from pilot.hand_over()
        pilot.go(0.0, 0.0, 0.6)
        yield 4.0
        start_s = flight.time_s
        pilot.judge()

        def target() -> Any:
            way = SPEED_M_S * (flight.time_s - start_s)
            speed, place = SPEED_M_S if way < end else 0.0, min(way, end)
            frame, velocity = mavlink.MAV_FRAME_LOCAL_NED, (speed * c, speed * s, 0.0)
            return pilot._position(frame, mask, place * c, place * s, -0.6, v=velocity)

        pilot._target = target
        while flight.time_s < start_s + end / SPEED_M_S + 6.0:
            north, east, _ = flight.body.position
            seen.append((flight.time_s - start_s - end / SPEED_M_S, north * c + east * s - end))
            yield 0.02

    case = Case("ramp", "a ramp into the wall", script, px4=px4, wall_m=wall_m)
    flight = simulated(
        own.vehicle,
        surroundings(case, own.vehicle),
        1,
        px4=px4,
        parameters=SLOW_LOOP if slow else {},
    )
    FaultyLockstep(flight, lambda w: CasePilot(w, script)).fly(own, None)
    return seen


@pytest.mark.parametrize(
    "mask", [POSITION_ONLY, pytest.param(PLACE_AND_VELOCITY, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("px4", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_ramp_that_stops_at_the_wall_is_overshot_by_less_than_3_cm(px4, mask):
    seen = flown_ramp(mask, px4=px4)
    assert max(past for _, past in seen) < 0.03
    # A place that comes with its velocity is followed more closely.
    within_s = 1.3 if mask == POSITION_ONLY else 0.6
    assert next(t for t, past in seen if past > -0.05) < within_s
    assert abs(seen[-1][1]) < 0.03


@pytest.mark.slow
@pytest.mark.parametrize("mask", [POSITION_ONLY, PLACE_AND_VELOCITY])
def test_with_a_slow_attitude_loop_and_late_positions_by_less_than_6_cm(mask):
    assert max(past for _, past in flown_ramp(mask, slow=True, wall_m=9.0)) < 0.06


def test_a_slow_loop_holds_the_pull_of_a_wall_that_it_is_sent_to():
    """Gains softened alike, position and velocity, let it go 0.09 m past the place, 0.15 m from the wall."""
    seen = flown_ramp(POSITION_ONLY, slow=True)
    assert max(past for _, past in seen) < 0.06
    assert abs(seen[-1][1]) < 0.03


@pytest.mark.parametrize("lag_s", [0.0, 0.25, 0.5])
def test_a_reference_starts_where_the_vehicle_is_and_as_it_moves(lag_s):
    place, speed, acceleration = (1.0, -2.0, -3.0), (0.5, -0.3, 0.2), (0.4, 0.6, 0.0)
    begun = expected(start_reference(place, speed, acceleration, lag_s), lag_s)
    assert begun.position == pytest.approx(place)
    assert begun.velocity == pytest.approx(speed)
    assert begun.acceleration == pytest.approx(acceleration)
