"""Walls from a ring of range directions: geometry, wire format, bad input, and the tracks they reach."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from flying import CONFIG, Bench
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.check import CheckSetup, Listener, Verdict, _ranges
from companion.config import PipelineConfig
from companion.estimation import surfaces
from companion.estimation.ring_planes import placed, ring_view
from companion.estimation.surfaces import Seen
from companion.mavlink import OWN_COMPONENT
from companion.mavlink.boot_clock import BootClock
from companion.mavlink.message_table import decode
from companion.mavlink.samples import Ring
from companion.mavlink.setpoints import SET_ATTITUDE_TARGET, encode
from companion.mavlink.wire_frames import cut
from companion.sim.compare import CompareSettings
from companion.sim.flight import SimulatedFlight
from companion.sim.flown import Leg, fly_judged
from companion.sim.scenario import build
from companion.vehicles import default_vehicle
from models.common.errors import ConfigError
from models.common.frames import quaternion_from_euler, rotation_rows
from models.vehicle import Rangefinder, parse_vehicle
from models.vehicle.toml_text import vehicle_text
from replay.logs.tlog import read_tlog
from replay.rerun.harness import Replay

VEHICLE = default_vehicle()
RING = Rangefinder(target="wall", position_m=(0.0, 0.0, 0.0), ring=8)
RINGED = replace(VEHICLE, rangefinders=(VEHICLE.rangefinders[0], RING))
LEVEL = rotation_rows(1.0, 0.0, 0.0, 0.0)


def ring_of(count, walls, rows=LEVEL, start=0.0, northward=False, reach=8.0, change=None):
    """Ranges of an exact ring at the CG to upright walls (bearing, distance); ``change`` by place: another reading."""
    bearings = tuple(start + 2.0 * math.pi * k / count for k in range(count))
    out = []
    for bearing in bearings:
        level = (math.cos(bearing), math.sin(bearing), 0.0)
        beam = (
            level
            if northward
            else tuple(sum(a * b for a, b in zip(row, level, strict=True)) for row in rows)
        )
        hits = [
            d / toward
            for b, d in walls
            if (toward := beam[0] * math.cos(b) + beam[1] * math.sin(b)) > 1e-6
            and d / toward < reach
        ]
        out.append(min(hits, default=math.inf))
    for k, value in (change or {}).items():
        out[k] = value
    return Ring(10.0, 1, 1, bearings, tuple(out), northward)


def seen(ring, rows=LEVEL, height=math.inf):
    """(bearing in degrees, distance) of each wall."""
    view = ring_view(ring, rows, (0.0, 0.0, 0.0), height, VEHICLE)
    return [
        (math.degrees(math.atan2(p.normal_ned[1], p.normal_ned[0])), p.distance_m)
        for p in view.planes
    ]


@pytest.mark.parametrize("count", [8, 12, 36, 72])
@pytest.mark.parametrize("degrees", range(-170, 190, 17))
def test_a_wall_at_any_bearing_is_one_plane_with_its_distance_and_direction(count, degrees):
    ((bearing, distance),) = seen(ring_of(count, [(math.radians(degrees), 0.9)]))
    assert distance == pytest.approx(0.9, abs=1e-6)
    assert abs(math.remainder(bearing - degrees, 360.0)) < 1e-4


@pytest.mark.parametrize("count", [8, 72])
def test_tilt_of_the_vehicle_and_slant_of_the_beams_do_not_matter(count):
    rows = rotation_rows(*quaternion_from_euler(0.15, -0.1, 0.7))
    ((bearing, distance),) = seen(ring_of(count, [(0.5, 1.1)], rows), rows)
    assert (bearing, distance) == pytest.approx((math.degrees(0.5), 1.1), abs=1e-6)


def test_a_level_ring_counts_its_bearings_from_north():
    rows = rotation_rows(*quaternion_from_euler(0.1, 0.1, 2.0))
    ((bearing, distance),) = seen(ring_of(36, [(0.5, 1.1)], rows, northward=True), rows)
    assert (bearing, distance) == pytest.approx((math.degrees(0.5), 1.1), abs=1e-6)


@pytest.mark.parametrize("count", [8, 36, 72])
@pytest.mark.parametrize("degrees", [0.0, 10.0, 22.5, 30.0])
def test_both_walls_of_a_corner(count, degrees):
    turned = math.radians(degrees)
    walls = seen(ring_of(count, [(turned, 1.0), (turned + 0.5 * math.pi, 0.8)]))
    assert [d for _, d in walls] == pytest.approx([0.8, 1.0], abs=0.03)
    assert [b for b, _ in walls] == pytest.approx([degrees + 90.0, degrees], abs=8.0)


@pytest.mark.parametrize("count", [8, 36, 72])
def test_both_walls_of_a_corridor(count):
    walls = seen(ring_of(count, [(0.5 * math.pi + 0.1, 0.9), (-0.5 * math.pi + 0.1, 1.1)]))
    assert sorted(d for _, d in walls) == pytest.approx([0.9, 1.1], abs=1e-6)


def test_own_arms_are_left_out():
    arms = {k: 0.25 for k in range(0, 72, 18)}
    ((_, distance),) = seen(ring_of(72, [(0.0, 0.9)], change=arms))
    assert distance == pytest.approx(0.9, abs=1e-6)
    assert seen(ring_of(72, [], change=arms)) == []


def test_a_wall_closer_than_the_span_is_no_part_of_the_vehicle():
    """Returns beside a long vehicle: nearer than its nose, and outside its outline."""
    ((bearing, distance),) = seen(ring_of(8, [(0.5 * math.pi, 0.31)], change={2: math.inf}))
    assert (bearing, distance) == pytest.approx((90.0, 0.31))


def test_ground_met_by_a_tilted_ring_is_no_wall():
    rows = rotation_rows(*quaternion_from_euler(0.0, -0.2, 0.0))
    clear = ring_of(36, [], rows)
    ahead = {k: rows[2][0] * math.cos(k * math.pi / 18.0) for k in range(36)}
    down = {k: 0.3 / slope for k, slope in ahead.items() if slope > 0.1}
    assert len(down) > 9
    assert seen(ring_of(36, [], rows, change=down), rows, height=0.3) == []
    assert seen(clear, rows, height=0.3) == []


def test_a_direction_that_is_unknown_hides_a_wall_and_one_that_is_clear_does_not():
    toward = (0.0, 1.0, 0.0)
    view = ring_view(ring_of(8, []), LEVEL, (0.0, 0.0, 0.0), math.inf, VEHICLE)
    assert view.sees(toward)
    assert view.sees(None)
    view = ring_view(
        ring_of(8, [], change={2: math.nan}), LEVEL, (0.0, 0.0, 0.0), math.inf, VEHICLE
    )
    assert not view.sees(toward)
    blind = ring_view(
        ring_of(8, [], change=dict.fromkeys(range(8), math.nan)),
        LEVEL,
        (0.0,) * 3,
        math.inf,
        VEHICLE,
    )
    assert not blind.sees(None)


def test_a_single_return_is_a_wall_of_a_coarse_ring_only():
    assert seen(ring_of(8, [], change={2: 1.0})) == [pytest.approx((90.0, 1.0))]
    assert seen(ring_of(72, [], change={18: 1.0})) == []


def test_walls_keep_their_places_when_the_other_comes_nearer():
    def view(left, right):
        walls = [(-0.5 * math.pi, left), (0.5 * math.pi, right)]
        return ring_view(ring_of(8, walls), LEVEL, (0.0, 0.0, 0.0), math.inf, VEHICLE)

    before = [p.normal_ned for p in placed(view(0.9, 1.0), [None, None])]
    assert [p.distance_m for p in placed(view(1.0, 0.9), before)] == pytest.approx([1.0, 0.9])
    assert [p.distance_m for p in placed(view(100.0, 0.9), before)] == pytest.approx(
        [math.inf, 0.9]
    )


@pytest.mark.parametrize("place", [1, 2, 3])
def test_a_lost_echo_leaves_the_wall_where_it_is_and_makes_no_other(place):
    ((bearing, distance),) = seen(ring_of(8, [(0.5 * math.pi, 0.4)], change={place: math.inf}))
    assert (bearing, distance) == pytest.approx((90.0, 0.4))


def decoded(distances, *, increment=0, fine=0.0, offset=0.0, frame=12, low=5, high=800):
    message = mavlink.MAVLink_obstacle_distance_message(
        10_000_000, 0, (distances + [65535] * 72)[:72], increment, low, high, fine, offset, frame
    )
    raw = message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1))
    return decode(cut(raw, 0), 10_000_000, BootClock(1))


def test_distances_on_the_wire_are_metres_nothing_or_unknown():
    ring = decoded([100, 801, 65535, 5, 0, 250], increment=45)
    assert ring.distances_m[:6] == pytest.approx(
        (1.0, math.inf, math.nan, math.nan, math.nan, 2.5), nan_ok=True
    )
    assert len(ring.distances_m) == 8
    assert ring.bearings_rad == pytest.approx([k * math.pi / 4.0 for k in range(8)])
    assert not ring.northward


def test_the_fine_increment_the_offset_and_the_frame():
    ring = decoded([100] * 72, increment=5, fine=7.5, offset=-90.0, frame=0)
    assert len(ring.bearings_rad) == 48
    assert ring.bearings_rad[:2] == pytest.approx((math.radians(-90.0), math.radians(-82.5)))
    assert ring.northward


@pytest.mark.parametrize(
    "bad", [{"increment": 0}, {"fine": math.nan}, {"fine": -5.0}, {"increment": 5, "frame": 3}]
)
def test_a_ring_without_directions_is_no_ring(bad):
    assert decoded([100] * 72, **bad) is None


@pytest.mark.parametrize("bad", [{"offset": math.nan}, {"offset": math.inf}])
def test_an_offset_that_is_no_number_is_no_ring(bad):
    assert decoded([100] * 72, increment=5, **bad) is None


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ('ring = 8\norientation = 0\ntarget = "wall"', "orientation"),
        ('ring = 8\ntarget = "ground"', "target"),
        ('ring = 100\ntarget = "wall"', "ring"),
        ('target = "wall"', "orientation"),
    ],
)
def test_a_ring_that_cannot_be_is_refused_by_its_key(keys, told):
    text = vehicle_text(VEHICLE) + f"\n[[rangefinder]]\nposition_m = [0.0, 0.0, 0.0]\n{keys}\n"
    with pytest.raises(ConfigError, match=told):
        parse_vehicle(text, "x.toml")


def test_a_vehicle_with_a_ring_is_written_and_read_back():
    assert parse_vehicle(vehicle_text(RINGED), "x.toml") == RINGED


class Hovering:
    """A vehicle at ``gap`` m from a wall on its right; ``change`` turns the ring's readings into others."""

    def __init__(self, vehicle=None, change=lambda ring: ring, start=lambda t: 0.0):
        self.bench = Bench(config=replace(CONFIG, vehicle=vehicle or RINGED))
        self.change, self.start, self.gap, self.walls = change, start, 0.8, None

    def run(self, seconds, speed=0.0):
        for k in range(round(seconds / 0.02)):
            self.gap -= 0.02 * speed
            self.bench.position = (0.0, 1.0 - self.gap)
            self.bench.wall = 100.0  # a DISTANCE_SENSOR that nobody declared
            self.bench.tick()
            if k % 5 == 0:
                walls = self.walls or [(0.5 * math.pi, self.gap)]
                ring = ring_of(8, walls, start=self.start(self.bench.t))
                self.bench.feed(self.change(replace(ring, t_s=self.bench.t)))
        return surfaces.walls(self.bench.state.estimates, self.bench.config, self.bench.t)


def test_a_declared_ring_gives_the_wall_and_an_undeclared_one_nothing():
    wall, other = Hovering().run(1.0)
    assert wall.seen is Seen.SURFACE
    assert wall.distance_m == pytest.approx(0.8, abs=0.01)
    assert other.seen is Seen.NOTHING
    plain = replace(RINGED, rangefinders=RINGED.rangefinders[:1])
    assert Hovering(plain).run(1.0)[0].seen is Seen.UNDECLARED


def test_a_ring_that_rotates_sees_the_wall_where_it_is():
    wall, other = Hovering(start=lambda t: 2.5 * t).run(3.0)
    assert (wall.distance_m, other.seen) == (pytest.approx(0.8, abs=0.01), Seen.NOTHING)


def test_a_ring_whose_frame_and_offset_change_sees_the_wall_where_it_is():
    """Each message counts its directions by its own frame and offset: nose or north, from anywhere."""
    flight = Hovering()
    flight.bench.roll = 0.1
    tilted = rotation_rows(*quaternion_from_euler(0.1, 0.0, 0.0))
    turn = iter(range(10_000))

    def change(ring):
        k = next(turn)
        north = k % 2 == 1
        walls = [(0.5 * math.pi, flight.gap)]
        return replace(ring_of(8, walls, LEVEL if north else tilted, 0.3 * k, north), t_s=ring.t_s)

    flight.change = change
    wall, other = flight.run(3.0)
    assert (wall.distance_m, other.seen) == (pytest.approx(0.8, abs=0.01), Seen.NOTHING)


@pytest.mark.parametrize("shift", [-0.9, 0.9])
def test_ground_far_away_is_no_wall_where_attitude_and_reading_differ_by_a_degree(shift):
    """Low over ground: what a tilted ring sees 4 m away is the ground, though by its attitude it ends above it."""
    true, said = (
        rotation_rows(*quaternion_from_euler(math.radians(a), 0.0, 0.0))
        for a in (-3.0, -3.0 + shift)
    )
    x, y, _ = true[2]
    slopes = {
        k: x * math.cos(k * math.pi / 36.0) + y * math.sin(k * math.pi / 36.0) for k in range(72)
    }
    ground = {k: 0.2 / slope for k, slope in slopes.items() if slope > 0.03}
    assert len(ground) > 20
    assert seen(ring_of(72, [], true, change=ground), said, height=0.2) == []


def test_own_arms_reach_no_track():
    """All that a ring reports is the vehicle itself, ahead and behind: that is no wall."""
    arms = (0.3, math.inf, math.inf, math.inf) * 2
    flight = Hovering(change=lambda ring: replace(ring, distances_m=arms))
    flight.gap = 100.0
    wall, _ = flight.run(2.0)
    assert wall.seen is not Seen.SURFACE


def test_both_walls_of_a_corridor_reach_the_tracks():
    flight = Hovering()
    flight.walls = [(0.5 * math.pi, 0.9), (-0.5 * math.pi, 0.8)]
    assert [w.distance_m for w in flight.run(1.0)] == pytest.approx([0.8, 0.9], abs=0.01)


def test_directions_that_freeze_while_the_vehicle_moves_are_doubted():
    held = ring_of(8, [(0.5 * math.pi, 0.8)]).distances_m
    wall, _ = Hovering(change=lambda ring: replace(ring, distances_m=held)).run(2.0, speed=0.15)
    assert wall.seen is Seen.FROZEN


def test_a_ring_that_knows_nothing_or_falls_silent_is_no_clear_sight():
    blind = Hovering()
    blind.run(1.0)
    blind.change = lambda ring: replace(ring, distances_m=(math.nan,) * 8)
    assert not blind.run(1.0)[0].known
    lost = Hovering()
    lost.run(1.0)
    lost.walls = [(0.5 * math.pi, 100.0)]
    assert lost.run(1.0)[0].seen is Seen.LOST


@pytest.fixture(scope="module")
def corner_flights(tmp_path_factory):
    """The corner approach with the shipped sensors and with a ring of eight, and the recording of the second."""
    log = tmp_path_factory.mktemp("ring") / "ring.tlog"
    model = CompareSettings(scenario="corner").choice.model

    def fly(vehicle, record=None):
        flight = SimulatedFlight(vehicle, build("corner", vehicle), 1)
        return fly_judged(
            flight, PipelineConfig(vehicle=vehicle, model=model), Leg.ON, record=record
        )

    return fly(VEHICLE), fly(RINGED, log), log, model


@pytest.mark.slow
def test_a_corner_is_flown_by_a_ring_of_eight_as_by_a_beam(corner_flights):
    plain, ringed, _, _ = corner_flights
    assert ringed.touched_s == 0.0
    for axis in ("height", "lateral", "tilt"):
        assert ringed.rms(axis) < 1.25 * plain.rms(axis)


@pytest.mark.slow
def test_replay_of_the_recording_decides_the_same(corner_flights):
    _, _, path, model = corner_flights
    frames = list(read_tlog(path).frames())
    heard = [cut(raw, 0) for _, raw in frames]
    sent = [
        f.payload for f in heard if f.component == OWN_COMPONENT and f.id == SET_ATTITUDE_TARGET
    ]
    replay = Replay(PipelineConfig(vehicle=RINGED, model=model))
    decided = {encode(d.command, 1)[1] for d in replay.decisions(frames) if d.command is not None}
    assert replay.samples["Ring"] > 500
    assert len(sent) > 1000
    # MAVLink 2 cuts trailing zeros.
    size = len(next(iter(decided)))
    assert {payload[:size].ljust(size, b"\0") for payload in sent} <= decided


def test_check_names_a_ring_that_nobody_declared_and_one_that_is_silent():
    listener = Listener(config=replace(CONFIG, vehicle=VEHICLE))
    listener.samples[Ring] = [ring_of(8, [(0.0, 1.0)])]
    (item,) = [
        i
        for i in _ranges(listener, CheckSetup(config=listener.config, vehicle_file="x.toml"))
        if i.name == "ring"
    ]
    assert item.verdict is Verdict.WARN
    assert "ring = 8" in (item.do or "")
    listener = Listener(config=replace(CONFIG, vehicle=RINGED))
    (item,) = [
        i
        for i in _ranges(listener, CheckSetup(config=listener.config, vehicle_file="x.toml"))
        if i.name == "ring"
    ]
    assert item.verdict is Verdict.FAIL
