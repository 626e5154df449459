"""The simulated autopilot against figures measured on a real ArduCopter 4.6.3; the tolerances say how close it is."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from simflight import HEIGHT_M, Peer, hovering, vehicle
from simulated import simulated

from companion.sim.autopilot import Guided, Mode
from companion.sim.flown import Leg, flown
from companion.sim.link import VehicleLink
from companion.sim.pilot import ScriptedPilot
from companion.sim.scenario import build


def stream(peer: Peer, seconds: float, **command: float) -> list[tuple[float, float, float]]:
    """Send an attitude at 50 Hz; (time, true roll, true pitch) of every step."""
    history = []
    start = peer.flight.time_s

    def each() -> None:
        if len(history) % 8 == 0:
            peer.attitude(**command)
        roll, pitch, _ = peer.flight.body.euler()
        history.append((peer.flight.time_s - start, math.degrees(roll), math.degrees(pitch)))

    peer.run(seconds, each)
    return history


@pytest.mark.parametrize(
    ("name", "axis"), [("tandem", "roll"), ("tandem", "pitch"), ("quad", "roll"), ("quad", "pitch")]
)
def test_attitude_step_takes_as_long_as_measured(name, axis):
    """3 degrees: 10 % at 0.09 s, 63 % at 0.22 s, 90 % at 0.31 s."""
    peer = hovering(name)
    thrust = peer.flight.autopilot.throttle
    stream(peer, 1.0, thrust=thrust)
    column = 1 if axis == "roll" else 2
    history = stream(peer, 0.6, thrust=thrust, **{axis: 3.0})
    start = history[0][column]
    reached = {
        share: next(
            t for t, *angles in history if angles[column - 1] - start >= share * (3.0 - start)
        )
        for share in (0.10, 0.63, 0.90)
    }
    assert reached[0.10] == pytest.approx(0.09, abs=0.035)
    assert reached[0.63] == pytest.approx(0.22, abs=0.05)
    assert reached[0.90] == pytest.approx(0.31, abs=0.06)


@pytest.fixture(scope="module")
def approach():
    """The corner approach with sharp corners in free air, flown by the autopilot's own position control."""
    v = vehicle()
    flight = simulated(v, replace(build("corner", v, air=False), rounding_s=0.0), 1)
    link = VehicleLink(flight, lambda frame: None)
    pilot = ScriptedPilot(flight, link, companion=False)
    rows = []
    while flight.script_s <= flight.scenario.duration_s:
        flight.step()
        pilot.step()
        link.step()
        if flight.script_s >= 0.0 and len(rows) < (flight.script_s + 0.02) / 0.02:
            b = flight.body
            need = flight.needed_tilt()
            rows.append(
                (
                    flight.script_s,
                    *b.position,
                    *flight.reference.position,
                    *b.euler()[:2],
                    *need,
                    b.contact,
                )
            )
    names = (
        "script_s",
        "n",
        "e",
        "d",
        "ref_n",
        "ref_e",
        "ref_d",
        "roll",
        "pitch",
        "need_roll",
        "need_pitch",
        "contact",
    )
    columns = dict(zip(names, np.array(rows, dtype=float).T, strict=True))
    return flown(Leg.AUTOPILOT, 1, {**columns, "phase": np.zeros(len(rows))})


@pytest.mark.slow
def test_own_position_hold_is_as_good_as_measured(approach):
    """Height 33 RMS, 120 peak; along the wall's normal 39 RMS, 147 peak [mm], 0.3 m/s ramps in free air."""
    towards = 1e3 * np.abs(approach.lateral[:, 1])
    assert approach.rms("height") == pytest.approx(33.0, rel=0.2)
    assert approach.peak("height") == pytest.approx(120.0, rel=0.2)
    assert np.sqrt(np.mean(towards**2)) == pytest.approx(39.0, rel=0.25)
    assert np.max(towards) == pytest.approx(147.0, rel=0.25)


@pytest.mark.slow
def test_in_free_air_it_touches_nothing(approach):
    assert approach.touched_s == 0.0


def test_stopped_stream_is_held_for_guid_timeout_then_levels_and_holds_height():
    peer = hovering()
    thrust = peer.flight.autopilot.throttle
    stream(peer, 1.0, pitch=-2.0, thrust=thrust)
    peer.run(2.5)
    assert math.degrees(peer.flight.body.euler()[1]) == pytest.approx(-2.0, abs=0.6)
    peer.run(3.0)
    assert math.degrees(peer.flight.body.euler()[1]) == pytest.approx(0.0, abs=0.5)
    height = peer.flight.body.position[2]
    n = peer.flight.body.position[0]
    peer.run(2.0)
    assert peer.flight.body.position[2] == pytest.approx(height, abs=0.1)
    assert peer.flight.body.position[0] > n + 0.02  # height is held, position is not
    assert peer.flight.autopilot.guided is Guided.ATTITUDE


def test_guid_timeout_is_a_parameter():
    peer = hovering()
    peer.say(mavlink.MAVLink_param_set_message(1, 1, b"GUID_TIMEOUT", 0.5, 9), 255, 190)
    stream(peer, 1.0, roll=3.0)
    peer.run(1.5)
    assert abs(math.degrees(peer.flight.body.euler()[0])) < 1.0


def test_attitude_stream_replaces_position_hold_and_wins_over_one_target():
    peer = hovering()
    peer.position(0.0, 0.0, -2.5)
    assert peer.flight.autopilot.guided is Guided.POSITION
    stream(peer, 0.5, thrust=peer.flight.autopilot.throttle)
    peer.position(0.0, 0.0, -2.5)
    stream(peer, 0.5, thrust=peer.flight.autopilot.throttle)
    assert peer.flight.autopilot.guided is Guided.ATTITUDE


def test_hand_back_by_a_position_target_is_smooth():
    """3 cm, measured."""
    peer = hovering()
    stream(peer, 1.0, thrust=peer.flight.autopilot.throttle)
    start = list(peer.flight.body.position)
    peer.position(*start)
    moved = []
    peer.run(4.0, lambda: moved.append(math.dist(start, peer.flight.body.position)))
    assert max(moved) < 0.08


def test_without_bit_three_thrust_is_a_climb_rate():
    heights = {}
    for options in (0.0, 8.0):
        peer = hovering()
        peer.say(mavlink.MAVLink_param_set_message(1, 1, b"GUID_OPTIONS", options, 9), 255, 190)
        stream(peer, 1.5, thrust=0.5 if options == 0.0 else 0.6)
        heights[options] = -peer.flight.body.position[2]
    assert heights[0.0] == pytest.approx(HEIGHT_M, abs=0.1)
    assert heights[8.0] > HEIGHT_M + 0.5


def test_angle_boost_is_applied_for_the_sender():
    peer = hovering()
    peer.attitude(roll=10.0, thrust=0.5)
    peer.run(0.5)
    assert peer.flight.autopilot.throttle == 0.5
    tilted = sum(peer.flight.autopilot.mixer.pwm[:4])
    peer.attitude(thrust=0.5)
    peer.run(0.5)
    assert tilted > sum(peer.flight.autopilot.mixer.pwm[:4]) + 4


@pytest.mark.parametrize(
    "bad",
    [{"mask": 7 | 64}, {"scale": 0.9}, {"mask": 7 | 128}],
    ids=["no throttle", "not unit", "nothing"],
)
def test_unusable_attitude_targets_are_dropped_silently(bad):
    peer = hovering()
    peer.frames.clear()
    peer.attitude(**bad)
    assert peer.flight.autopilot.guided is not Guided.ATTITUDE
    assert peer.link.dropped == 1
    assert peer.messages() == []


def test_a_partial_rate_mask_stops_the_vehicle_at_every_message():
    peer = hovering()
    stream(peer, 0.5, roll=3.0)
    peer.attitude(roll=3.0, mask=1)
    assert peer.flight.autopilot.guided is Guided.HOLD


@pytest.mark.parametrize("mask", [0, 7, 128])
def test_whole_rate_masks_are_taken(mask):
    peer = hovering()
    peer.attitude(mask=mask)
    assert peer.link.taken == 1


def test_acceleration_does_not_cancel_a_disturbance():
    """Position + 0.3 m/s^2 for 8 s moves the hold point and leaves no lean (1.7 degrees would be the cancel)."""
    peer = hovering()
    before = math.degrees(peer.flight.body.euler()[1])

    def each() -> None:
        if round(peer.flight.time_s * 400) % 20 == 0:
            peer.position(0.0, 0.0, -HEIGHT_M, accel_n=0.3)

    peer.run(8.0, each)
    assert 0.02 < peer.flight.body.position[0] < 0.25
    assert abs(math.degrees(peer.flight.body.euler()[1]) - before) < 0.7


@pytest.mark.parametrize(
    ("px4", "lean_deg"), [(True, -math.degrees(math.atan(0.3 / 9.80665))), (False, 0.0)]
)
def test_only_px4_adds_the_acceleration_behind_the_velocity_controller(px4, lean_deg):
    commands = []
    for accel in (0.0, 0.3):
        peer = hovering(px4=px4)
        peer.flight.autopilot.set_mode(Mode.GUIDED, peer.flight.estimate)
        peer.position(0.0, 0.0, -HEIGHT_M, accel_n=accel)
        peer.run(0.0025)
        commands.append(math.degrees(peer.flight.autopilot.command[1]))
    assert commands[1] - commands[0] == pytest.approx(lean_deg, abs=0.3)


def test_alt_hold_ignores_the_stream_and_guided_nogps_ignores_positions():
    peer = hovering()
    peer.flight.autopilot.set_mode(Mode.ALT_HOLD, peer.flight.estimate)
    peer.attitude(roll=5.0)
    assert peer.link.taken == 0
    peer.flight.autopilot.set_mode(Mode.GUIDED_NOGPS, peer.flight.estimate)
    peer.position(1.0, 0.0, -HEIGHT_M)
    assert peer.flight.autopilot.guided is not Guided.POSITION
    peer.attitude(roll=5.0)
    assert peer.link.taken == 1


def test_landing_disarms_on_the_ground():
    peer = hovering()
    peer.flight.autopilot.set_mode(Mode.LAND, peer.flight.estimate)
    peer.run(8.0)
    assert peer.flight.autopilot.landed
    assert not peer.flight.autopilot.armed


def test_armed_on_the_ground_enough_thrust_lifts_off():
    v = vehicle()
    peer = Peer(simulated(v, build("hover", v), 2))
    peer.run(0.1)
    peer.flight.autopilot.set_mode(Mode.GUIDED, peer.flight.estimate)
    peer.flight.autopilot.arm(True)
    stream(peer, 1.0, thrust=0.3)
    assert peer.flight.autopilot.landed
    assert min(peer.flight.body.rpm) > 1000.0
    stream(peer, 1.5, thrust=0.6)
    assert not peer.flight.autopilot.landed


def test_at_rest_beside_a_wall_it_leans_as_the_truth_says_it_must():
    """The vanes hold the wall's moment and push towards it: the lean balances both (here more than the pull alone)."""
    peer = hovering(scenario="corner", air=True)
    flight = peer.flight
    start = flight.time_s
    goal = 1.6 - 1.2 * 0.165

    def each() -> None:
        if round(flight.time_s * 400) % 20 == 0:
            peer.position(0.0, min(goal, 0.2 * (flight.time_s - start)), -HEIGHT_M)

    peer.run(14.0, each)
    rows = []
    peer.run(10.0, lambda: (each(), rows.append((flight.body.euler()[0], flight.needed_tilt()[0]))))
    roll, need = np.degrees(np.mean(rows, axis=0))
    pull_alone = -math.degrees(flight.body.causes.corner[1] / (4.6 * 9.80665))
    assert need < 2.0 * pull_alone < 0.0
    assert roll == pytest.approx(need, abs=0.35)
