"""The built-in vehicle and the flight program on one clock: the same seed gives the same flight, bit for bit."""

from __future__ import annotations

import dataclasses
import hashlib
import time
from pathlib import Path

import numpy as np
import pytest
from lockstep_faults import BUFFER_DATAGRAMS, FaultyLockstep, Wire
from simflight import sent_and_decided, vehicle
from simulated import simulated
from truth_file import read_truth

import models
from companion.config import PipelineConfig
from companion.sim import compare
from companion.sim.air import NOMINAL
from companion.sim.compare import CompareSettings
from companion.sim.flown import Leg
from companion.sim.pilot import ScriptedPilot
from companion.sim.scenario import build

SHORT_S = 16.0


class UntilPilot(ScriptedPilot):
    """The scripted pilot, for a few seconds; ``then`` is called once, at 14 s."""

    def __init__(self, world: FaultyLockstep, end_s: float = SHORT_S, then: str = "") -> None:
        super().__init__(world.flight, world.link, companion=True)
        self.world, self.end_s, self.then = world, end_s, then

    @property
    def over(self) -> bool:
        return self.world.flight.time_s >= self.end_s

    def step(self) -> None:
        super().step()
        if self.then and self.world.flight.time_s >= 14.0:
            name, _, seconds = self.then.partition(" ")
            getattr(self.world, name)(*([float(seconds)] if seconds else []))
            self.then = ""


def short_flight(folder: Path, *, slow: bool = False, **pilot: object) -> FaultyLockstep:
    v = vehicle()
    flight = simulated(v, build("corner", v), 4, law=NOMINAL)
    world = FaultyLockstep(flight, lambda w: UntilPilot(w, **pilot), folder / "truth.csv")  # type: ignore[arg-type]
    if slow:
        late, calls = world.recv, iter(range(10**9))

        def recv(size: int) -> bytes:
            if next(calls) % 50 == 0:
                time.sleep(0.01)
            return late(size)

        world.recv = recv  # type: ignore[method-assign]
    world.fly(PipelineConfig(vehicle=v, model=models.load()), folder / "flight.tlog")
    return world


def digest(folder: Path) -> tuple[str, str]:
    return tuple(
        hashlib.sha256((folder / n).read_bytes()).hexdigest() for n in ("truth.csv", "flight.tlog")
    )  # type: ignore[return-value]


@pytest.mark.slow
def test_the_same_seed_gives_the_same_flight_bit_for_bit_however_slow_the_machine(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        short_flight(tmp_path / name, slow=name == "b")
    assert digest(tmp_path / "a") == digest(tmp_path / "b")


@pytest.mark.slow
def test_the_recording_replays_to_the_same_decisions(tmp_path):
    short_flight(tmp_path)
    assert np.mean(read_truth(tmp_path / "truth.csv")["streamed"]) > 0.98
    sent, decided = sent_and_decided(
        tmp_path / "flight.tlog", PipelineConfig(vehicle=vehicle(), model=models.load())
    )
    assert len(sent) > 500
    # All but the last second: a recording does not say when the flight was told to stop.
    assert sent[:-60] == decided[: len(sent) - 60]


@pytest.mark.slow
def test_a_killed_companion_leaves_the_autopilot_with_its_timeout(tmp_path):
    world = short_flight(tmp_path, then="kill", end_s=19.0)
    assert world.companion is not None
    assert world.flight.time_s - world.link.attitude_stream_s > 4.5
    assert not world.flight.autopilot.landed


def test_the_watchdog_of_a_killed_companion_tells_the_autopilot_where_to_stay(tmp_path):
    world = short_flight(tmp_path, then="kill", end_s=17.0)
    assert world.flight.autopilot.guided.value == "position"
    assert world.last_word


def test_a_killed_companion_that_is_restarted_flies_again(tmp_path):
    world = short_flight(tmp_path, then="kill 0.5", end_s=19.0)
    assert world.link.attitude_stream_s > 18.9


@pytest.mark.slow
def test_an_interrupted_companion_hands_back(tmp_path):
    world = short_flight(tmp_path, then="interrupt", end_s=17.0)
    assert world.flight.time_s - world.link.attitude_stream_s > 1.5
    assert world.flight.autopilot.guided.value == "position"


def test_a_stalled_companion_sends_nothing_and_what_does_not_fit_into_the_socket_is_lost(tmp_path):
    world = short_flight(tmp_path, then="stall 1.5", end_s=15.2)
    assert world.flight.time_s - world.link.attitude_stream_s > 1.1
    assert world.wire.lost > 0


@pytest.mark.slow
def test_the_watchdog_of_a_stalled_companion_tells_the_autopilot_where_to_stay(tmp_path):
    world = short_flight(tmp_path, then="stall 1.5", end_s=15.2)
    assert world.flight.autopilot.guided.value == "position"


@pytest.mark.slow
def test_after_a_stall_of_its_own_it_says_so_and_blames_nobody(tmp_path):
    world = short_flight(tmp_path, then="stall 2.4", end_s=20.0)
    said = (tmp_path / "flight.tlog").read_bytes()
    assert b"stood still for 2.4 s" in said
    for blamed in (b"too late", b"no heartbeat", b"missing or old", b"Hz only"):
        assert blamed not in said[said.index(b"stood still") :], blamed
    assert world.flight.time_s - world.link.attitude_stream_s < 0.1, "it flies again"


def test_the_wire_delays_and_keeps_order():
    wire = Wire()
    wire.down_delay_s = 0.5
    wire.send_down(b"a", 1.0)
    wire.down_delay_s = 0.0
    wire.send_down(b"b", 1.2)
    assert not wire.ready(1.4)
    assert wire.read_down(1.4) == b""
    assert wire.read_down(1.5) == b"ab"
    for _ in range(BUFFER_DATAGRAMS + 5):
        wire.send_down(b"x", 2.0)
    assert wire.lost == 5
    assert wire.read_down(2.0) == b"x" * BUFFER_DATAGRAMS


@pytest.mark.slow
def test_a_comparison_repeats_itself_and_does_not_depend_on_its_neighbours(monkeypatch):
    short = build("hover", vehicle())
    waypoints = (*short.waypoints[:-1], dataclasses.replace(short.waypoints[-1], time_s=7.0))
    monkeypatch.setattr(
        compare, "build", lambda *_a, **_k: dataclasses.replace(short, waypoints=waypoints)
    )
    settings = CompareSettings(scenario="hover")
    first, again = (compare.run_compare([2], settings, legs=(Leg.ON,), workers=1) for _ in range(2))
    assert first[0].height.tolist() == again[0].height.tolist()
    assert first[0].lateral.tolist() == again[0].lateral.tolist()
    other = compare.run_compare([3], settings, legs=(Leg.ON,), workers=1)
    assert other[0].height.tolist() != first[0].height.tolist()
