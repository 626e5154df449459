"""A range that leaps from near to nothing without motion is lost, not far; one that ignores motion is frozen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from flying import CONFIG, DOWN, RIGHT, Bench

from companion.config import PipelineConfig
from companion.control.reasons import Reason
from companion.estimation.estimates import Estimates, blank_estimates
from companion.estimation.estimator import take_attitude, take_position
from companion.estimation.readings import take_range as take
from companion.estimation.surfaces import Seen, surface
from companion.mavlink.samples import Attitude, LocalPosition, Range, RangeVerdict
from models.common.frames import quaternion_from_euler

GROUND, WALL = "ground", "wall"
BEAMS = {GROUND: DOWN, WALL: RIGHT}


@dataclass
class Room:
    """A vehicle that is moved about over a floor; a wall stands to the east of it."""

    north: float = 0.0
    east: float = 0.0
    height: float = 0.3
    yaw: float = 0.0
    t: float = 10.0
    config: PipelineConfig = CONFIG
    estimates: Estimates = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        self.estimates = blank_estimates(self.config.vehicle)

    def tick(
        self, readings: dict[str, float], velocity=(0.0, 0.0, 0.0), limit: float = 40.0
    ) -> None:
        self.t += 0.02
        q = quaternion_from_euler(0.0, 0.0, self.yaw)
        self.estimates = take_attitude(
            self.estimates, Attitude(self.t, 1, 1, q, (0.0, 0.0, 0.0), "ATTITUDE")
        )
        place = LocalPosition(self.t, 1, 1, (self.north, self.east, -self.height), velocity)
        self.estimates = take_position(self.estimates, place)
        for target, distance in readings.items():
            verdict = RangeVerdict.ABOVE_MAX if distance >= limit else RangeVerdict.OK
            reading = Range(
                self.t,
                1,
                1,
                direction_frd=BEAMS[target],
                orientation=0,
                sensor_id=0,
                distance_m=distance,
                min_m=0.05,
                max_m=limit,
                sigma_m=None,
                quality=None,
                verdict=verdict,
                source="x",
            )
            self.estimates = take(self.estimates, reading, self.config)

    def seen(self, target: str) -> Seen:
        return surface(self.estimates, self.config, target, self.t).seen


@pytest.mark.parametrize("target", [GROUND, WALL])
@pytest.mark.parametrize("limit", [40.0, 100.0])
def test_a_near_surface_that_is_gone_without_motion_is_a_lost_echo(target, limit):
    room = Room()
    for _ in range(50):
        room.tick({target: 0.2}, limit=limit)
    for _ in range(100):
        room.tick({target: 60.0}, limit=limit)
    assert room.seen(target) is Seen.LOST
    for k in range(30):
        room.tick({target: 0.2 + 0.01 * (k % 2)}, limit=limit)
    assert room.seen(target) is Seen.SURFACE, "it comes back with its echo"


def test_one_lost_reading_is_nothing():
    room = Room()
    for k in range(200):
        room.tick({GROUND: 60.0 if k % 20 == 0 else 0.2 + 0.01 * (k % 2)})
        assert k < 5 or room.seen(GROUND) is Seen.SURFACE


def test_a_wall_that_ends_is_gone():
    room = Room()
    for k in range(150):
        room.north += 0.01
        room.tick({WALL: (0.4 + 0.01 * (k % 2)) if room.north < 0.7 else 60.0}, (0.5, 0.0, 0.0))
    assert room.seen(WALL) is Seen.NOTHING


def test_a_wall_turned_away_from_is_gone():
    room = Room()
    for _ in range(50):
        room.tick({WALL: 0.4})
    for k in range(60):
        room.yaw = min(0.02 * k, 0.6)
        room.tick({WALL: 60.0})
    assert room.seen(WALL) is Seen.NOTHING


def test_flying_away_leaves_a_surface_behind():
    room = Room()
    for _ in range(300):
        room.height += 0.05
        distance = room.height - 0.05
        room.tick({GROUND: distance if distance < 12.0 else 60.0}, (0.0, 0.0, -2.5))
    assert room.seen(GROUND) is Seen.NOTHING


@pytest.mark.parametrize("target", [GROUND, WALL])
def test_a_reading_that_ignores_motion_is_frozen(target):
    room = Room()
    rng = np.random.default_rng(0)
    for _ in range(50):
        room.tick({target: 0.4 + rng.normal(0.0, 0.003)})
    assert room.seen(target) is Seen.SURFACE
    for _ in range(100):
        room.height -= 0.002
        room.east += 0.002
        room.tick({target: 0.4}, (0.0, 0.1, 0.1))
    assert room.seen(target) is Seen.FROZEN


def test_a_ground_range_that_may_correct_the_height_is_known_as_frozen_at_any_such_height():
    room = Room(height=3.0)
    for _ in range(100):
        room.height += 0.004
        room.tick({GROUND: 3.0, WALL: 3.0}, (0.0, 0.0, -0.2))
    assert room.seen(GROUND) is Seen.FROZEN
    assert room.seen(WALL) is Seen.SURFACE  # of a wall that is far, nothing is made


def test_a_frozen_reading_stays_frozen_until_it_changes_wherever_the_vehicle_goes():
    room = Room()
    for k in range(200):
        climb = 0.2 if k < 100 else -0.2
        room.height += 0.02 * climb
        room.tick({GROUND: 0.3}, (0.0, 0.0, -climb))
        assert k < 60 or room.seen(GROUND) is Seen.FROZEN
    room.tick({GROUND: 0.31})
    assert room.seen(GROUND) is Seen.SURFACE


def test_a_still_vehicle_may_read_the_same_forever():
    room = Room()
    for _ in range(1000):
        room.tick({GROUND: 0.4, WALL: 0.5})
    assert room.seen(GROUND) is Seen.SURFACE
    assert room.seen(WALL) is Seen.SURFACE


def test_a_position_that_is_set_anew_is_no_motion():
    room = Room()
    for _ in range(50):
        room.tick({WALL: 0.4})
    room.east += 1.0
    for _ in range(50):
        room.tick({WALL: 0.4})
    assert room.seen(WALL) is Seen.SURFACE


@pytest.mark.parametrize(
    ("reading", "reason"), [(60.0, Reason.RANGE_LOST), (0.4, Reason.RANGE_FROZEN)]
)
def test_flight_says_so_and_gives_no_offset(reading, reason):

    bench = Bench(wall=0.4)
    bench.run(3.0)
    for _ in range(100):
        bench.position = (
            0.0,
            bench.position[1] + (0.002 if reason is Reason.RANGE_FROZEN else 0.0),
        )
        bench.wall = reading
        decision = bench.tick()
    assert reason in decision.reasons
    assert (decision.offset.thrust, decision.offset.roll) == (0.0, 0.0)
    assert decision.command is not None


JUMPS = [("wall", 0.4, 0.8), ("wall", 0.8, 0.4), ("height", 0.3, 0.7), ("height", 0.7, 0.3)]


def lying(target: str, honest: float, lie: float) -> Bench:
    """A flight over which one range has been lying for 8 s."""
    bench = Lying(**{target: honest}, lies=target)
    assert not bench.run(4.0).reasons
    bench.by = lie - honest
    decision = bench.run(8.0)
    assert decision.reasons == (Reason.RANGE_JUMPED,)
    assert decision.offset.share == 0.0
    assert decision.command is not None
    return bench


@dataclass
class Lying(Bench):
    """One of the ranges reads ``by`` more than it is."""

    lies: str = "wall"
    by: float = 0.0

    def range(self, direction, distance, sensor=0) -> Range:
        return super().range(
            direction,
            distance + (self.by if (self.lies == "wall") == (sensor == 1) else 0.0),
            sensor,
        )


@pytest.mark.parametrize(("target", "honest", "lie"), JUMPS)
def test_no_offset_on_a_range_that_jumped_while_the_vehicle_stayed_until_it_is_back(
    target, honest, lie
):
    bench = lying(target, honest, lie)
    bench.by = 0.0
    decision = bench.run(4.0)
    assert not decision.reasons
    assert decision.offset.share > 0.9


@pytest.mark.parametrize(("target", "honest", "lie"), JUMPS)
def test_an_edge_that_is_left_behind_is_followed(target, honest, lie):
    bench = lying(target, honest, lie)
    for _ in range(50):
        bench.position = (bench.position[0] + 0.008, 0.0)
        bench.tick()
    decision = bench.run(2.0)
    assert not decision.reasons
    assert decision.offset.share > 0.9


def test_a_position_that_is_set_anew_leaves_no_edge_behind():
    bench = lying("wall", 0.4, 0.8)
    bench.position = (1.0, 0.0)
    assert Reason.RANGE_JUMPED in bench.run(4.0).reasons
