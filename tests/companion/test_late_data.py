"""Telemetry that is read late: its age is its arrival against the smallest offset of the boot clock."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from flying import bench

import models
from companion.config import Base, PipelineConfig
from companion.control.reasons import Reason
from companion.mavlink.boot_clock import BootClock, Stamp
from companion.mavlink.dialect import mavlink
from companion.mavlink.message_table import decode
from companion.mavlink.wire_frames import cut
from models.vehicle import load_vehicle
from replay.logs.tlog import read_tlog
from replay.rerun.harness import Replay

START_US = 1_700_000_000_000_000


def heard(clock: BootClock, boot_ms: int, late_ms: int) -> float:
    """``late_s`` of a position that arrives ``late_ms`` after the usual 5 ms."""
    message = mavlink.MAVLink_local_position_ned_message(boot_ms, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0)
    frame = cut(bytes(message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1))), 0)
    sample = decode(frame, START_US + (boot_ms + 5 + late_ms) * 1000, clock)
    assert sample is not None
    assert sample.t_s == boot_ms / 1000.0
    return sample.late_s


def test_a_message_read_late_says_by_how_much():
    clock = BootClock(1)
    assert [heard(clock, 20_000 + 20 * k, 0) for k in range(250)] == pytest.approx(
        [0.0] * 250, abs=1e-3
    )
    late = [heard(clock, 25_000 + 20 * k, 600) for k in range(500)]
    assert min(late) > 0.58, "ten seconds of late data do not become the measure"
    assert heard(clock, 35_020, 0) == pytest.approx(0.0, abs=0.012)


def test_clocks_that_drift_apart_are_not_late():
    clock = BootClock(1)
    worst = 0.0
    for k in range(0, 1_200_000, 200):
        worst = max(
            worst, heard(clock, 20_000 + k, k * 200 // 1_000_000)
        )  # 200 ppm over 20 minutes
    assert worst < 0.01


@pytest.mark.parametrize("slower", [0.02, 0.10, 0.25])
def test_a_simulator_slower_than_the_clock_is_not_late_and_a_step_on_top_is(slower):
    """Half the drift of each tick is random, as on a loaded machine."""
    clock, rng, behind, late = BootClock(1), np.random.default_rng(0), 0.0, []
    for k in range(3000):
        behind += 20.0 * slower * rng.uniform(0.5, 1.5)
        step = 600 if k >= 2000 else 0
        late.append(heard(clock, 20_000 + 20 * k, round(behind) + step))
    assert max(late[:100]) < 0.3
    assert max(late[100:2000]) < 0.15
    assert min(late[2000:2030]) > 0.3


def test_a_reboot_starts_the_measure_anew():
    clock = BootClock(1)
    heard(clock, 60_000, 0)
    for k in range(4):
        arrival = START_US + 70_000_000 + k * 20_000
        clock.stamped(1, 1, Stamp.BOOT_MS, 2_000 + 20 * k, arrival)
        assert k < 2 or clock.late(2.0 + 0.02 * k, arrival) == pytest.approx(0.0, abs=0.03)
    assert clock.boot == 1


def test_late_data_fade_the_offsets_and_say_why():
    b = bench(height=0.2)
    assert b.run(4.0).offset.thrust < -0.01
    b.late = 0.17
    decision = b.run(0.6)
    assert Reason.LATE in decision.reasons
    assert decision.offset.thrust == 0.0
    assert decision.command is not None
    assert decision.late_s == 0.17


@pytest.mark.parametrize("base", [Base.HOLD, Base.UPSTREAM])
def test_data_too_late_to_fly_on_end_the_hold(base):
    b = bench(height=1.0, base=base)
    assert b.run(3.0).command is not None
    b.late = 0.6
    b.run(1.2)  # half a second of letting go included
    decision = b.tick()
    assert Reason.TOO_LATE in decision.reasons
    assert decision.command is None
    assert b.state.held.hold is None
    b.late = 0.0
    assert Reason.TOO_LATE not in b.tick().reasons


def test_a_burst_after_a_gap_is_caught_up_with():
    b = bench(height=1.0)
    b.run(3.0)
    for k in range(15):
        b.late = 0.5 - k * 0.02
        decision = b.tick()
        assert decision.command is not None, "0.2 s of backlog do not end the hold"
    b.late = 0.0
    assert b.tick().command is not None


def test_the_recorded_starved_machine_lets_go(shared_data: Path):
    folder = shared_data / "firmware" / "px4"
    if not (folder / "late_data.tlog").exists():
        pytest.skip(f"no recording at {folder / 'late_data.tlog'}")
    config = PipelineConfig(vehicle=load_vehicle(folder / "quad.toml"), model=models.load())
    decisions = list(Replay(config).decisions(read_tlog(folder / "late_data.tlog").frames()))
    late = [d for d in decisions if d.late_s > 0.6]
    assert len(late) > 20
    assert all({Reason.LATE, Reason.TOO_LATE}.intersection(d.reasons) for d in late)
    assert any(Reason.TOO_LATE in d.reasons and d.command is None for d in late)
    on_time = [d for d in decisions if d.late_s < 0.1]
    assert not any({Reason.LATE, Reason.TOO_LATE}.intersection(d.reasons) for d in on_time)
    assert np.mean([d.late_s < 0.1 for d in decisions]) > 0.8
