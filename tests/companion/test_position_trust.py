"""A position that the estimator does not trust is no position; one that it sets anew moves the hold along."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from flying import bench

import models
from companion.config import PipelineConfig
from companion.control.reasons import Reason
from companion.estimation.position_trust import PositionTrust, position_reset
from companion.mavlink.boot_clock import BootClock
from companion.mavlink.dialect import mavlink
from companion.mavlink.firmware import Stack
from companion.mavlink.message_table import decode
from companion.mavlink.samples import EstimatorStatus, LocalPosition
from companion.mavlink.stream_rates import wanted_streams
from companion.mavlink.wire_frames import cut
from companion.vehicles import default_vehicle
from models.vehicle import load_vehicle
from replay.logs.tlog import read_tlog
from replay.rerun.harness import Replay

GOOD = 895  # what a PX4 with GPS sends
ARDUPILOT_GOOD = 831


def status(
    flags: int,
    accuracy: float = math.nan,
    innovation: float = 0.1,
    source: str = "ESTIMATOR_STATUS",
):
    return EstimatorStatus(20.0, 1, 1, flags, accuracy, innovation, source)


def decoded(message):
    raw = bytes(message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1)))
    return decode(cut(raw, 0), 10**15, BootClock(1))


def test_both_messages_are_read():
    px4 = decoded(
        mavlink.MAVLink_estimator_status_message(5_000_000, 101, 0.2, 0.5, 0, 0, 0, 0, 1.5, 0.3)
    )
    assert (px4.flags, px4.innovation) == (101, pytest.approx(0.5))
    assert px4.horizontal_accuracy_m == pytest.approx(1.5)
    ardupilot = decoded(
        mavlink.MAVLink_ekf_status_report_message(831, 0.1, 0.3, 0.2, 0.1, 0.0, 0.0)
    )
    assert (ardupilot.flags, ardupilot.innovation) == (831, pytest.approx(0.3))
    assert math.isnan(ardupilot.horizontal_accuracy_m)


@pytest.mark.parametrize("stack", [Stack.ARDUPILOT, Stack.PX4])
def test_the_estimators_status_is_asked_for(stack):
    wanted = {w.message_id for w in wanted_streams(default_vehicle(), stack)}
    assert ({230, 193} & wanted) == ({230} if stack is Stack.PX4 else {193})


@pytest.mark.parametrize(
    ("told", "trusted"),
    [
        (status(GOOD), True),
        (status(GOOD, 0.6), True),
        (status(101), False),  # no horizontal position any more
        (status(GOOD | 128), False),  # assumes that it stands still
        (status(GOOD & ~4), False),
        (status(GOOD, innovation=1.4), False),
        (status(GOOD | 1024), True),  # PX4: a glitch that came and went
        (status(0x12F, 0.05), True),  # PX4 on vision: no place on Earth
        (status(0x16F, 0.05), True),  # and on optical flow: height over ground
        (status(0x12F | 128), False),  # PX4's fake position: neither vision nor flow
        (status(ARDUPILOT_GOOD, source="EKF_STATUS_REPORT"), True),
        (
            status(0x16F, source="EKF_STATUS_REPORT"),
            True,
        ),  # ArduPilot on optical flow: relative position alone
        (status(0b10100111, source="EKF_STATUS_REPORT"), False),  # AID_NONE: constant position
        (status(ARDUPILOT_GOOD | 1024, source="EKF_STATUS_REPORT"), False),
        (status(ARDUPILOT_GOOD | 32768, source="EKF_STATUS_REPORT"), False),
        (status(0b100111, source="EKF_STATUS_REPORT"), False),
    ],
)
def test_what_a_status_is_worth(told, trusted):
    assert PositionTrust().after(told).trusted is trusted


def test_an_accuracy_that_grows_is_dead_reckoning():
    trust = PositionTrust()
    for accuracy in (0.5, 0.45, 0.5, 0.9, 1.5):
        trust = trust.after(status(GOOD, accuracy))
        assert trust.trusted, accuracy
    assert not trust.after(status(GOOD, 2.0)).trusted


@pytest.mark.parametrize("height", [1.0, 2.0, 4.0])
def test_an_accuracy_that_walks_away_on_optical_flow_is_no_dead_reckoning(height):
    """0.15 rad/s of noise at 20 Hz, from 5 cm: the variance grows by (0.15 h)^2 / 20 a second."""
    trust = PositionTrust()
    for k in range(1500):
        accuracy = math.sqrt(0.05**2 + (0.15 * height) ** 2 / 20.0 * 0.2 * k)
        trust = trust.after(replace(status(GOOD & ~16, accuracy), t_s=0.2 * k))
        assert trust.trusted, (k, accuracy)


def test_an_untrusted_position_ends_the_hold():
    b = bench(height=0.3)
    b.feed(replace(status(GOOD), t_s=b.t))
    assert b.run(3.0).reasons == ()
    b.feed(replace(status(101), t_s=b.t))
    decision = b.tick()
    assert Reason.POSITION_UNTRUSTED in decision.reasons
    assert b.state.held.hold is None
    assert b.run(0.6).command is None, "letting go takes half a second"
    b.feed(replace(status(GOOD), t_s=b.t))
    assert Reason.POSITION_UNTRUSTED not in b.tick().reasons


def test_a_reset_of_the_position_moves_the_hold_with_it():
    b = bench(height=1.0)
    before = b.run(3.0)
    b.position = (1.0, -0.5)
    after = b.tick()
    assert b.state.held.hold.reference.position == pytest.approx([1.0, -0.5, -1.0])
    assert after.base.pitch == pytest.approx(before.base.pitch, abs=math.radians(0.5))
    assert after.base.roll == pytest.approx(before.base.roll, abs=math.radians(0.5))


def test_a_relocalisation_of_a_quarter_metre_moves_the_hold_with_it():
    b = bench(height=1.0)
    before = b.run(3.0)
    b.position = (0.0, -0.25)
    after = b.tick()
    assert b.state.held.hold.reference.position == pytest.approx([0.0, -0.25, -1.0])
    assert after.base.roll == pytest.approx(before.base.roll, abs=math.radians(0.5))


def test_an_estimator_that_is_pulled_to_its_sensors_is_no_reset():
    """0.7 m/s past what the velocity explains: the most in five real flights at 10 Hz."""
    for dt in (0.02, 0.1, 0.4):
        first, second = (
            LocalPosition(t, 1, 1, (0.7 * t, 0.0, -1.0), (0.0, 0.0, 0.0)) for t in (1.0, 1.0 + dt)
        )
        assert position_reset(first, second) is None


def test_fast_flight_is_no_reset():
    def at(t, north, speed):
        return LocalPosition(t, 1, 1, (north, 0.0, -1.0), (speed, 0.0, 0.0))

    assert position_reset(at(1.0, 0.0, 5.0), at(1.2, 1.0, 5.2)) is None
    jump = position_reset(at(1.0, 0.0, 5.0), at(1.2, 2.0, 5.0))
    assert jump.by_ned == pytest.approx((1.0, 0.0, 0.0))
    assert position_reset(at(1.0, 0.0, 0.0), at(3.0, 5.0, 0.0)) is None, (
        "after a gap nothing can be said"
    )


def test_the_recorded_loss_of_gps_ends_the_hold(shared_data: Path):
    folder = shared_data / "firmware" / "px4"
    if not (folder / "gps_lost.tlog").exists():
        pytest.skip(f"no recording at {folder / 'gps_lost.tlog'}")
    config = PipelineConfig(vehicle=load_vehicle(folder / "quad.toml"), model=models.load())
    decisions = list(Replay(config).decisions(read_tlog(folder / "gps_lost.tlog").frames()))
    untrusted = [d.t_s for d in decisions if Reason.POSITION_UNTRUSTED in d.reasons]
    # The last good fix is 11 s into the recording, PX4 drops its flags at 16.3 s.
    start = decisions[0].t_s
    assert 12.0 < untrusted[0] - start < 15.5
    assert all(d.command is None for d in decisions if untrusted[0] + 0.6 < d.t_s < start + 38.0)
    assert (
        np.mean([Reason.POSITION_UNTRUSTED in d.reasons for d in decisions if d.t_s > untrusted[0]])
        > 0.8
    )
