"""Rules that the fault campaign asked for, each by itself."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from flying import CONFIG, bench

from companion.control.reasons import Reason
from companion.mavlink.samples import Attitude, RotorSpeeds
from companion.mavlink.setpoints import AttitudeCommand, PositionCommand
from models.common.frames import quaternion_from_euler


def compensating(**changes):
    b = bench(**changes)
    decision = b.run(4.0)
    assert decision.reasons == ()
    assert decision.authority == 1.0
    return b


def speeds(b, rpm, count):
    esc = tuple(rpm) if isinstance(rpm, tuple) else (rpm,) * 4
    b.feed(RotorSpeeds(b.t, 1, 1, 1, esc, "ESC_TELEMETRY_1_TO_4", (count,) * 4))


def test_telemetry_that_stops_counting_is_lost():
    b = compensating()
    b.send_rpm = False
    for k in range(100):
        speeds(b, 4000.0, k)
        decision = b.tick()
    assert decision.reasons == ()
    for _ in range(20):
        speeds(b, 4000.0, 99)
        decision = b.tick()
    assert decision.reasons == (Reason.RPM_MISSING,)


def test_a_counter_that_never_moved_tells_nothing():
    b = compensating()
    b.send_rpm = False
    for _ in range(100):
        speeds(b, 4000.0, 0)
        decision = b.tick()
    assert decision.reasons == ()


@pytest.mark.parametrize("rpm", [(0.0, 4000.0, 4000.0, 4000.0), (65535.0,) * 4])
def test_a_zero_beside_turning_rotors_and_a_speed_beyond_sound_are_no_speeds(rpm):
    b = compensating()
    b.send_rpm = False
    for k in range(100):
        speeds(b, rpm, k)
        decision = b.tick()
    assert decision.reasons == (Reason.RPM_MISSING,)


def test_an_attitude_that_was_overtaken_decides_nothing():
    b = compensating()
    before = b.state
    old = Attitude(
        b.t - 0.1,
        1,
        1,
        quaternion_from_euler(0.2, 0.0, 0.0),
        (0.0, 0.0, 0.0),
        "ATTITUDE_QUATERNION",
    )
    assert b.feed(old) is None
    assert b.state.estimates is before.estimates


def test_letting_go_ends_where_the_pilot_has_taken_over():
    b = compensating()
    b.send_position = False
    while (
        not isinstance((decision := b.tick()).command, AttitudeCommand | PositionCommand)
        or not decision.reasons
    ):
        continue
    b.mode = 5
    assert b.tick().command is None


def test_after_a_gap_nothing_old_is_sent():
    b = compensating(roll=0.05)
    b.t += 5.0
    q = quaternion_from_euler(0.05, 0.0, 0.0)
    decision = b.feed(Attitude(b.t, 1, 1, q, (0.0, 0.0, 0.0), "ATTITUDE_QUATERNION"))
    assert Reason.NO_HEARTBEAT in decision.reasons
    assert decision.command is None


@pytest.mark.parametrize("lost", ["send_range", "send_rpm", "send_position"])
def test_offsets_are_zero_half_a_second_after_an_input_is_lost(lost):
    b = compensating()
    setattr(b, lost, False)
    since = b.t
    while b.t - since < 0.5 - 1e-9:
        decision = b.tick()
    offset = decision.offset
    assert max(abs(offset.thrust), abs(offset.roll), abs(offset.pitch)) < 1e-9


def test_applied_offsets_keep_the_slew_rates_while_they_fade():
    b = compensating()
    limits = CONFIG.vehicle.limits
    b.config = replace(
        b.config, vehicle=replace(b.config.vehicle, limits=replace(limits, slew_thrust_per_s=0.05))
    )
    before = b.tick().offset
    b.send_range = False
    for _ in range(40):
        now = b.tick().offset
        assert abs(now.thrust - before.thrust) <= 0.05 * 0.02 + 1e-9
        assert abs(now.roll - before.roll) <= math.radians(limits.slew_tilt_deg_per_s) * 0.02 + 1e-9
        before = now


def test_a_hold_lets_go_of_data_a_fifth_of_a_second_late():
    """At that the simulated vehicle swung into a wall 0.3 m away."""
    b = compensating()
    b.late = 0.2
    assert Reason.TOO_LATE in b.run(0.6).reasons


@pytest.mark.parametrize("lost", ["send_range", "send_rpm"])
def test_what_a_fading_offset_balanced_the_hold_balances(lost):
    """The air does not change because a sensor is silent: neither does the sum of tilt and thrust."""
    b = compensating()
    whole = b.tick()
    offset, base = whole.offset, whole.base
    assert abs(offset.roll) > math.radians(0.5)
    assert abs(offset.thrust) > 0.005
    setattr(b, lost, False)
    without = b.run(0.6)
    assert without.offset.roll == without.offset.thrust == 0.0
    assert without.base.roll == pytest.approx(base.roll + offset.roll, abs=0.1 * abs(offset.roll))
    assert without.base.thrust == pytest.approx(whole.command.thrust, abs=0.1 * abs(offset.thrust))
