"""When the hold takes over and how it lets go: by messages, each case one that put a real firmware on the ground."""

from __future__ import annotations

import math

import numpy as np
import pytest
from flying import bench

from companion.control import position_target
from companion.control.position_target import Target, advance, expected, start_reference
from companion.control.reasons import Notice, Reason
from companion.mavlink.samples import (
    Attitude,
    AttitudeTarget,
    Heartbeat,
    LandedState,
    LocalPosition,
    SetPositionTarget,
)
from companion.mavlink.setpoints import AttitudeCommand, PositionCommand
from companion.pipeline import ready_to_leave, stopped
from models.common.frames import quaternion_from_euler
from models.vehicle import Limits

OFFBOARD, POSCTL = 6 << 16, 3 << 16
POSITION_ONLY = 0x38 | 0x1C0 | 0x400 | 0x800
VELOCITY_ONLY = 0x7 | 0x1C0 | 0x400 | 0x800


class Flown:
    """A vehicle that is where it is told to be: messages of any motion, one tick at a time."""

    def __init__(self, **changes):
        self.bench = bench(height=1.0, **changes)
        self.position, self.velocity = np.array([0.0, 0.0, -1.0]), np.zeros(3)
        self.thrust: float | None = 0.437
        self.yaw = 0.0

    def tick(self, dt=0.02):
        b = self.bench
        b.t += dt
        if "GUID_OPTIONS" not in b.state.heard.parameters and b.guid_options is not None:
            b.tick(0.0)
        b.feed(Heartbeat(b.t, 1, 1, b.armed, b.mode, b.autopilot, b.vehicle_type))
        b.feed(LandedState(b.t, 1, 1, b.landed))
        b.feed(LocalPosition(b.t, 1, 1, tuple(self.position), tuple(self.velocity)))
        if self.thrust is not None:
            b.feed(AttitudeTarget(b.t, 1, 1, (1.0, 0.0, 0.0, 0.0), self.thrust))
        q = quaternion_from_euler(b.roll, b.pitch, self.yaw)
        return b.feed(Attitude(b.t, 1, 1, q, (0.0, 0.0, 0.0), "ATTITUDE_QUATERNION"))

    def run(self, seconds, move=True):
        out = []
        for _ in range(round(seconds / 0.02)):
            if move:
                self.position = self.position + 0.02 * self.velocity
            out.append(self.tick())
        return [d for d in out if d is not None]

    def target(self, mask, position=(0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0), frame=1, yaw=0.0):
        self.bench.feed(
            SetPositionTarget(
                self.bench.t,
                255,
                190,
                mask,
                frame,
                position,
                velocity,
                (0.0, 0.0, 0.0),
                yaw,
                1,
                191,
            )
        )


def tilt_deg(command: AttitudeCommand) -> float:
    _, x, y, _ = command.q_ned_frd
    return math.degrees(math.acos(min(max(1.0 - 2.0 * (x * x + y * y), -1.0), 1.0)))


# -- PX4: before OFFBOARD, hover thrust


def test_before_offboard_the_stream_has_no_place_and_the_hold_begins_at_the_switch():
    flown = Flown(autopilot=12, mode=POSCTL)
    assert flown.run(4.0)[-1].command is not None, "OFFBOARD is refused without a stream"
    flown.position = np.array([4.0, -2.0, -1.5])  # the pilot flies away
    flown.velocity, flown.yaw = np.array([0.5, 0.0, 0.0]), 0.7
    waiting = flown.run(1.0)[-1]
    assert flown.bench.state.held.hold is None
    assert waiting.command.q_ned_frd == pytest.approx(quaternion_from_euler(0.0, 0.0, 0.7)), (
        "level, own heading"
    )
    assert waiting.command.thrust == pytest.approx(0.437, abs=0.002)
    assert waiting.offset.share == 0.0
    flown.velocity[:] = 0.0
    flown.run(0.5)
    flown.bench.mode = OFFBOARD
    begun = flown.run(1.0)
    hold = flown.bench.state.held.hold
    assert np.linalg.norm(hold.reference.position - flown.position) < 0.05
    assert max(tilt_deg(d.command) for d in begun) < 2.5, "nothing to fly back to"


def test_the_hover_thrust_is_learned_while_px4_flies_whatever_its_parameter_says():
    flown = Flown(autopilot=12, mode=POSCTL)
    flown.thrust = 0.70
    flown.bench.feed(parameter(flown, "MPC_THR_HOVER", 0.5))
    flown.run(4.0)
    flown.bench.mode = OFFBOARD
    engaged = flown.run(1.0, move=False)
    assert all(d.command.thrust == pytest.approx(0.70, abs=0.014) for d in engaged), "2 % at most"


def test_a_hover_parameter_that_contradicts_the_vehicle_file_is_refused_where_nothing_was_learned():
    flown = Flown()
    flown.thrust = None
    flown.bench.feed(parameter(flown, "MOT_THST_HOVER", 0.25))  # the vehicle file says 0.5
    assert Reason.HOVER_IMPLAUSIBLE in flown.run(4.0)[-1].reasons
    assert flown.bench.state.held.hold is None
    flown.bench.feed(parameter(flown, "MOT_THST_HOVER", 0.47))
    assert flown.run(0.5)[-1].command is not None


def parameter(flown, name, value):
    from companion.mavlink.samples import Parameter

    return Parameter(flown.bench.t, 1, 1, name, value)


# -- ArduPilot: take-off


def test_a_guided_take_off_is_the_autopilots_own():
    flown = Flown(landed=1)
    flown.position = np.zeros(3)
    flown.run(1.0)
    flown.bench.landed, flown.velocity = 3, np.array([0.0, 0.0, -0.7])  # MAV_LANDED_STATE_TAKEOFF
    assert all(d.command is None for d in flown.run(2.1))
    flown.bench.landed, flown.velocity = 2, np.zeros(3)
    begun = flown.run(3.0)
    assert begun[0].command is None
    assert begun[-1].command is not None
    assert flown.bench.state.held.hold.reference.position[2] == pytest.approx(-1.5, abs=0.05)


def test_without_a_landed_state_a_climb_is_still_a_take_off():
    flown = Flown(landed=0)
    flown.position, flown.velocity = np.zeros(3), np.array([0.0, 0.0, -0.5])
    assert all(d.command is None for d in flown.run(3.0))


# -- bumpless


@pytest.mark.parametrize("stack", [{"autopilot": 3, "mode": 5}, {"autopilot": 12, "mode": POSCTL}])
@pytest.mark.parametrize("pitch", [0.0, -0.12])
def test_engaging_is_bumpless(stack, pitch):
    """A pitch that balances a wind, and a thrust off the parameter's: the first setpoints are what flies."""
    flown = Flown(**stack)
    flown.bench.pitch = pitch
    flown.run(6.0)
    flown.bench.mode = 4 if stack["autopilot"] == 3 else OFFBOARD
    first = flown.run(0.4, move=False)
    sent = [d.command for d in first if d.command is not None]
    assert len(sent) >= 15
    pitches = [pitch] + [2.0 * math.asin(c.q_ned_frd[2]) for c in sent]
    assert max(abs(np.diff(pitches))) < math.radians(1.0)
    assert max(abs(c.thrust - 0.437) for c in sent) <= 0.02 * 0.437


def test_engaging_in_motion_brakes_within_the_limits():
    flown = Flown(mode=5)
    flown.velocity = np.array([1.2, 0.0, 0.0])
    flown.run(4.0)
    flown.bench.mode = 4
    tilts = [0.0]
    for _ in range(100):  # the vehicle follows as late as its loop
        command = flown.tick().command
        tilts.append(2.0 * math.asin(command.q_ned_frd[2]))
        reference = expected(
            flown.bench.state.held.hold.reference, flown.bench.state.plant.tuned.gains.lag_s
        )
        flown.velocity = np.array(reference.velocity)
        flown.position = reference.position + 0.02 * flown.velocity
        flown.bench.pitch += 0.2 * (tilts[-1] - flown.bench.pitch)
    assert max(abs(np.diff(tilts))) < math.radians(1.0)
    assert abs(flown.velocity[0]) < 0.1
    assert flown.position[0] - 4.0 * 1.2 < 1.5, "it stops where it can, and does not fly back"
    assert flown.position[0] > 4.0 * 1.2


def test_letting_go_leaves_no_tilt_behind_where_no_place_can_be_given():
    flown = Flown(mode=20)  # GUIDED_NOGPS takes no places
    flown.run(3.0)
    flown.target(POSITION_ONLY, (3.0, 0.0, -1.0))
    before = flown.run(0.6, move=False)[-1]
    assert tilt_deg(before.command) > 2.0
    b = flown.bench
    sent = []
    for _ in range(60):  # positions stop, attitudes go on
        b.t += 0.02
        b.feed(Heartbeat(b.t, 1, 1, True, b.mode, 3, 2))
        q = quaternion_from_euler(0.0, 0.0, 0.0)
        sent.append(b.feed(Attitude(b.t, 1, 1, q, (0.0, 0.0, 0.0), "ATTITUDE_QUATERNION")))
    commands = [d.command for d in sent if d.command is not None]
    hand_over = [
        d.command for d in sent if d.command is not None and Reason.POSITION_STALE in d.reasons
    ]
    assert sent[-1].command is None
    assert tilt_deg(commands[-1]) < 0.01
    assert max(abs(np.diff([tilt_deg(c) for c in hand_over]))) < 1.0


def test_thrust_does_not_leap_while_positions_are_late():
    flown = Flown()
    flown.run(3.0)
    flown.velocity = np.array([0.0, 0.0, 0.03])  # sinks a little when positions stop
    flown.run(0.1)
    b, thrusts = flown.bench, []
    for _ in range(24):
        b.t += 0.02
        b.feed(Heartbeat(b.t, 1, 1, True, 4, 3, 2))
        decision = b.feed(
            Attitude(b.t, 1, 1, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), "ATTITUDE_QUATERNION")
        )
        thrusts.append(decision.command.thrust)
    assert np.abs(np.diff(thrusts)).max() < 0.02


def test_positions_that_stop_while_the_autopilot_trusts_its_own_leave_it_the_place():
    flown = Flown()
    flown.run(3.0)
    b, commands = flown.bench, []
    for _ in range(60):
        b.t += 0.02
        b.feed(Heartbeat(b.t, 1, 1, True, 4, 3, 2))
        decision = b.feed(
            Attitude(b.t, 1, 1, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), "ATTITUDE_QUATERNION")
        )
        commands += [] if decision.command is None else [decision.command]
    assert isinstance(commands[0], AttitudeCommand)
    assert isinstance(commands[-1], PositionCommand)
    assert commands[-1].position_ned == pytest.approx((0.0, 0.0, -1.0), abs=0.02)


def test_a_hold_that_is_refused_tells_the_autopilot_where_to_stay():
    flown = Flown()
    flown.run(3.0)
    flown.bench.feed(
        parameter(flown, "GUID_OPTIONS", 0.0)
    )  # thrust would be a climb rate from now on
    command = flown.tick().command
    assert isinstance(command, PositionCommand)
    assert command.position_ned == pytest.approx((0.0, 0.0, -1.0), abs=0.01)
    assert flown.run(1.0)[-1].command is None


# -- gaps and reboots


def stalled_at_a_target(**late: float) -> Flown:
    """Sent to 0.3 m north, blown 0.1 m further, and then everything is read late for a second."""
    flown = Flown()
    flown.run(3.0)
    flown.position = np.array([0.3, 0.0, -1.0])
    for _ in range(250):
        flown.target(POSITION_ONLY, (0.3, 0.0, -1.0))
        flown.tick()
    flown.position = np.array([0.4, 0.0, -1.0])
    b = flown.bench
    for _ in range(50):
        b.t += 0.02
        b.feed(LocalPosition(b.t, 1, 1, tuple(flown.position), (0.0, 0.0, 0.0), late_s=2.0))
        q = quaternion_from_euler(0.0, 0.0, 0.0)
        b.feed(Attitude(b.t, 1, 1, q, (0.0, 0.0, 0.0), "ATTITUDE_QUATERNION", late_s=2.0))
    assert b.state.held.hold is None
    return flown


def test_after_a_stall_it_goes_back_to_the_place_that_the_pilot_gave():
    flown = stalled_at_a_target()
    flown.run(2.0)
    assert flown.bench.state.held.hold.target.position == pytest.approx((0.3, 0.0, -1.0), abs=0.01)


def test_after_a_stall_and_a_change_of_mode_it_stays_where_it_is():
    flown = stalled_at_a_target()
    flown.bench.mode = 5
    flown.run(0.5)
    flown.bench.mode = 4
    flown.run(2.0)
    assert flown.bench.state.held.hold.reference.position[0] == pytest.approx(0.4, abs=0.01)


def test_a_stall_is_no_reboot():
    """Heartbeats by arrival jump ahead, stamped messages follow from the backlog: nothing that was learned is lost."""
    flown = Flown()
    flown.run(5.0)
    b = flown.bench
    learned, known = b.state.learned.hover.learned, dict(b.state.heard.parameters)
    b.feed(Heartbeat(b.t + 3.0, 1, 1, True, 4, 3, 2))
    for k in range(150):
        t = b.t + 0.02 * k
        b.feed(LocalPosition(t, 1, 1, (0.0, 0.0, -1.0), (0.0, 0.0, 0.0)))
        b.feed(Attitude(t, 1, 1, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), "ATTITUDE_QUATERNION"))
    assert b.state.learned.hover.learned == learned
    assert dict(b.state.heard.parameters) == known
    assert b.state.heard.heartbeat is not None


def test_after_a_gap_the_way_to_the_target_begins_where_the_vehicle_is():
    flown = Flown()
    flown.run(3.0)
    flown.bench.t += 2.0
    flown.position = np.array([0.8, 0.0, -1.0])
    decision = flown.tick()
    assert tilt_deg(decision.command) < 1.0
    hold = flown.bench.state.held.hold
    assert hold.target.position[0] == pytest.approx(0.0, abs=0.01)
    assert hold.reference.position[0] == pytest.approx(0.8, abs=0.01)


# -- targets


@pytest.mark.parametrize(
    ("frame", "asked", "expected"),
    [
        (1, (0.3, 0.4, -1.2), (0.3, 0.4, -1.2)),
        (7, (0.3, 0.4, -0.2), (2.3, 3.4, -1.2)),
        (8, (0.3, 0.4, -0.2), (2.0 - 0.4, 3.0 + 0.3, -1.2)),
        (9, (0.3, 0.4, -0.2), (2.0 - 0.4, 3.0 + 0.3, -1.2)),
    ],
)
def test_all_four_local_frames_are_honoured(frame, asked, expected):
    flown = Flown()
    flown.position, flown.yaw = np.array([2.0, 3.0, -1.0]), math.pi / 2.0
    flown.run(3.0)
    flown.target(POSITION_ONLY, asked, frame=frame)
    assert flown.bench.state.held.hold.target.position == pytest.approx(expected, abs=1e-3)


def test_another_frame_is_refused_aloud_and_moves_nothing():
    flown = Flown()
    flown.run(3.0)
    before = flown.bench.state.held.hold.target
    flown.target(POSITION_ONLY, (0.0, 0.0, -0.2), frame=6)
    assert flown.bench.state.held.hold.target is before
    assert flown.tick().notice[0] is Notice.FRAME_REFUSED


def test_velocity_targets_move_the_hold_while_they_last():
    flown = Flown()
    flown.run(3.0)
    for _ in range(50):  # 10 Hz for 5 s; the vehicle follows
        flown.target(VELOCITY_ONLY, velocity=(0.3, 0.0, 0.0))
        for _ in range(5):
            flown.tick()
            reference = flown.bench.state.held.hold.reference
            flown.position, flown.velocity = (
                np.array(reference.position),
                np.array(reference.velocity),
            )
    assert flown.position[0] == pytest.approx(1.35, abs=0.1), (
        "1.5 m less the start within the limits"
    )
    for _ in range(150):
        flown.tick()
        reference = flown.bench.state.held.hold.reference
        flown.position, flown.velocity = np.array(reference.position), np.array(reference.velocity)
    assert np.abs(flown.velocity).max() < 0.01
    assert 1.4 < flown.position[0] < 1.75, "it stays where it was brought"


def test_after_another_mode_it_holds_where_it_is_until_a_new_target_comes():
    flown = Flown()
    flown.run(3.0)
    flown.target(POSITION_ONLY, (0.46, 0.0, -1.0))
    flown.bench.mode = 5
    flown.run(0.5)
    flown.target(POSITION_ONLY, (0.46, 0.0, -1.0))  # runs on during LOITER
    flown.run(0.1)
    flown.bench.mode = 4
    assert max(tilt_deg(d.command) for d in flown.run(1.0, move=False)) < 0.5
    assert flown.bench.state.held.hold.reference.position[0] == pytest.approx(
        flown.position[0], abs=0.01
    )


def test_a_far_target_is_approached_within_the_limits_of_the_vehicle_file():
    flown = Flown()
    limits = flown.bench.config.vehicle.limits
    flown.run(3.0)
    flown.target(POSITION_ONLY, (6.0, -8.0, -3.0))
    speeds, steps, old = [], [], np.zeros(3)
    for _ in range(1200):
        flown.tick()
        reference = flown.bench.state.held.hold.reference
        flown.position, flown.velocity = np.array(reference.position), np.array(reference.velocity)
        speeds.append([math.hypot(*reference.velocity[:2]), abs(reference.velocity[2])])
        steps.append(np.abs(np.subtract(reference.velocity, old)).max() / 0.02)
        old = reference.velocity
    assert flown.position == pytest.approx([6.0, -8.0, -3.0], abs=0.02)
    assert np.max(speeds, axis=0)[0] <= limits.speed_m_s + 0.05
    assert np.max(speeds, axis=0)[1] <= limits.climb_m_s + 0.05
    assert max(steps[:-300]) <= limits.acceleration_m_s2 * 1.05 + 0.05


@pytest.mark.parametrize("has_both", [False, True])
@pytest.mark.parametrize("acceleration", [0.5, 2.0, 4.0])
@pytest.mark.parametrize("speed", [0.5, 1.5, 4.0])
@pytest.mark.parametrize(
    ("way", "moving"), [(0.05, 0.0), (0.3, 0.0), (0.3, 0.4), (1.0, 0.0), (8.0, 0.0)]
)
def test_an_approach_neither_overshoots_nor_creeps(
    acceleration, speed, way, moving, has_both, monkeypatch
):
    """A centimetre too far is the wall's: the way ends on the target, and 5 cm are done in 1.2 s."""
    monkeypatch.setattr(position_target, "_FOLLOW_M", 0.0)
    limits = Limits(speed_m_s=speed, climb_m_s=speed, acceleration_m_s2=acceleration)
    target = Target(
        position=(way, 0.0, -way),
        velocity=(0.0, 0.0, 0.0),
        yaw=0.0,
        set_s=0.0,
        has_both=has_both,
    )
    reference = start_reference((0.0, 0.0, 0.0), (moving, 0.0, -moving), (0.0, 0.0, 0.0))
    gone = []
    for k in range(1, 1501):
        reference = advance(reference, target, limits, 0.02 * k, 0.02)
        gone.append(np.array([reference.position[0], -reference.position[2]]))
    assert np.max(gone) < way + 0.005
    assert gone[-1] == pytest.approx([way, way], abs=0.01)
    if way == 0.05:
        assert np.min(gone[60]) > way - 0.02


def test_the_limits_of_the_way_are_optional_keys_of_the_vehicle_file(tmp_path):
    from companion.vehicles import QUAD
    from models.common.errors import ConfigError
    from models.vehicle import load_vehicle

    text = QUAD.read_text()
    assert load_vehicle(QUAD).limits.speed_m_s == 1.5
    path = tmp_path / "slow.toml"
    path.write_text(text + "speed_m_s = 0.4\nacceleration_m_s2 = 0.5\n")
    assert (load_vehicle(path).limits.speed_m_s, load_vehicle(path).limits.acceleration_m_s2) == (
        0.4,
        0.5,
    )
    path.write_text(text + "speed_m_s = 0.0\n")
    with pytest.raises(ConfigError, match="speed_m_s"):
        load_vehicle(path)


# -- stopping


def test_a_stop_brings_the_vehicle_to_rest_before_it_leaves():
    flown = Flown()
    flown.run(3.0)
    flown.target(POSITION_ONLY, (5.0, 0.0, -1.0))
    for _ in range(100):
        flown.tick()
        reference = flown.bench.state.held.hold.reference
        flown.position, flown.velocity = np.array(reference.position), np.array(reference.velocity)
    assert flown.velocity[0] > 0.5
    flown.bench.state = stopped(flown.bench.state)
    flown.tick()
    assert not ready_to_leave(flown.bench.state)
    flown.target(POSITION_ONLY, (5.0, 0.0, -1.0))  # nobody moves it any more
    for _ in range(150):
        flown.tick()
        reference = flown.bench.state.held.hold.reference
        flown.position, flown.velocity = np.array(reference.position), np.array(reference.velocity)
    assert ready_to_leave(flown.bench.state)
    assert flown.position[0] < 3.5


def test_a_changed_mode_of_others_leaves_nothing_to_say():
    flown = Flown()
    flown.run(3.0)
    flown.bench.mode = 5
    assert all(d.command is None for d in flown.run(1.0))
    assert flown.bench.state.held.hold is None
