"""The live loop against a scripted autopilot on loopback: real sockets, real MAVLink, no physics."""

import struct
import threading
import time
from dataclasses import replace

import pytest
from fake_autopilot import FakeAutopilot, free_port
from flying import CONFIG

from companion.config import Base
from companion.flight.loop import Flight
from companion.flight.options import FlightOptions
from companion.mavlink.dialect import mavlink
from companion.mavlink.link import Arrivals, open_link
from companion.mavlink.message_filter import Intake
from companion.mavlink.tlog_writer import Recorder
from companion.mavlink.wire_frames import cut
from companion.pipeline import initial_state, step
from models.common.errors import ConfigError, LinkError


class Run:
    """A Flight in a thread, stopped and joined at the end."""

    def __init__(self, port, config=CONFIG, upstream_port=None, record=None, options=None):
        arrivals = Arrivals()
        self.link = open_link(f"udpin:127.0.0.1:{port}", arrivals)
        self.upstream = None
        if upstream_port is not None:
            self.upstream = open_link(f"udpin:127.0.0.1:{upstream_port}", arrivals, number=1)
        self.recorder = None if record is None else Recorder(record)
        self.flight = Flight(
            config=config,
            link=self.link,
            upstream=self.upstream,
            recorder=self.recorder,
            arrivals=arrivals,
            options=options or FlightOptions(),
        )
        self.thread = threading.Thread(target=self.flight.run, daemon=True)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.flight.stop()
        self.thread.join(5.0)
        assert not self.thread.is_alive()
        if self.recorder is not None:
            self.recorder.close()
        self.link.close()
        if self.upstream is not None:
            self.upstream.close()


@pytest.mark.slow
def test_it_connects_asks_and_compensates():
    port = free_port()
    with FakeAutopilot(port) as autopilot, Run(port) as run:
        beats = autopilot.wait_for("HEARTBEAT", 2)
        setpoints = autopilot.wait_for("SET_ATTITUDE_TARGET", 100)
        asked = {int(m.param1) for m in autopilot.of_type("COMMAND_LONG") if m.command == 511}
        names = {m.name for m in autopilot.wait_for("NAMED_VALUE_FLOAT", 12)}
        texts = [m.text for m in autopilot.wait_for("STATUSTEXT")]
    assert (
        beats[-1].get_srcSystem(),
        beats[-1].get_srcComponent(),
        beats[-1].type,
        beats[-1].autopilot,
    ) == (
        1,
        191,
        18,
        8,
    )
    assert {31, 32, 132, 11030} <= asked
    assert all(abs(sum(c * c for c in m.q) - 1.0) < 1e-5 and m.type_mask == 7 for m in setpoints)
    assert all(0.0 <= m.thrust <= 1.0 for m in setpoints)
    assert {"cc_auth", "cc_h", "cc_d"} <= names
    assert texts
    assert run.flight.summary.commands >= 100
    assert not {m.get_type() for m in autopilot.received} & {"SET_MODE"}
    assert not [m for m in autopilot.of_type("COMMAND_LONG") if m.command in (176, 400)], (
        "never arms, never changes mode"
    )


@pytest.mark.slow
def test_another_program_with_the_same_identity_is_named_and_an_echo_is_not():
    port = free_port()
    with FakeAutopilot(port) as autopilot, Run(port) as run:
        other = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)
        for beat in autopilot.wait_for("HEARTBEAT", 3):
            autopilot.send_raw(bytes(beat.get_msgbuf()))
        time.sleep(0.3)
        assert not run.flight.pilot.was_told("twin")
        autopilot.send_raw(mavlink.MAVLink_heartbeat_message(18, 8, 64, 0, 4, 3).pack(other))
        for _ in range(100):
            joined = " ".join("".join(m.text for m in autopilot.of_type("STATUSTEXT")).split())
            if "another program is component 191" in joined:
                break
            time.sleep(0.05)
    assert "another program is component 191" in joined


@pytest.mark.slow
def test_dry_run_sends_no_setpoint():
    port = free_port()
    with FakeAutopilot(port) as autopilot, Run(port, replace(CONFIG, dry_run=True)) as run:
        autopilot.wait_for("NAMED_VALUE_FLOAT", 20)
        time.sleep(1.0)
    assert not autopilot.of_type("SET_ATTITUDE_TARGET")
    assert run.flight.summary.decisions > 20


@pytest.mark.slow
def test_without_bit_3_it_refuses_until_the_pilot_sets_it():
    port = free_port()
    with FakeAutopilot(port, parameters={"GUID_OPTIONS": 0.0}) as autopilot, Run(port):
        autopilot.wait_for("NAMED_VALUE_FLOAT", 20)
        assert not autopilot.of_type("SET_ATTITUDE_TARGET")
        assert any("GUID_OPTIONS" in m.text for m in autopilot.wait_for("STATUSTEXT"))
        autopilot.parameters["GUID_OPTIONS"] = 8.0
        autopilot.wait_for("SET_ATTITUDE_TARGET", 5)


@pytest.mark.slow
def test_silence_of_the_vehicle_is_silence_of_the_companion_and_it_comes_back():
    port = free_port()
    with FakeAutopilot(port) as autopilot, Run(port):
        autopilot.wait_for("SET_ATTITUDE_TARGET", 20)
        autopilot.silent = True
        time.sleep(0.3)
        count = len(autopilot.of_type("SET_ATTITUDE_TARGET"))
        time.sleep(1.0)
        assert len(autopilot.of_type("SET_ATTITUDE_TARGET")) == count
        autopilot.silent = False
        autopilot.wait_for("SET_ATTITUDE_TARGET", count + 20)


@pytest.mark.slow
def test_a_reboot_is_survived_and_rates_are_asked_for_again():
    port = free_port()
    with FakeAutopilot(port) as autopilot, Run(port) as run:
        autopilot.wait_for("SET_ATTITUDE_TARGET", 20)
        before = len([m for m in autopilot.of_type("COMMAND_LONG") if m.command == 511])
        autopilot.boot_s = 2.0
        time.sleep(1.5)
        assert run.flight.incoming.reboots == 1
        assert len([m for m in autopilot.of_type("COMMAND_LONG") if m.command == 511]) > before
        count = len(autopilot.of_type("SET_ATTITUDE_TARGET"))
        autopilot.wait_for("SET_ATTITUDE_TARGET", count + 20)


@pytest.mark.slow
def test_another_vehicle_on_the_link_is_ignored():
    port = free_port()
    with FakeAutopilot(port) as autopilot, Run(port) as run:
        autopilot.wait_for("SET_ATTITUDE_TARGET", 20)
        with FakeAutopilot(port, system=7) as other:
            other.height = 0.07
            other.armed = False
            time.sleep(1.0)
        assert run.flight.as_json()["ignored_systems"] == [7]
        assert run.flight.as_json()["system"] == 1
        assert run.flight.incoming.state.heard.heartbeat.armed


@pytest.mark.slow
def test_an_upstream_controller_is_forwarded_and_hears_the_vehicle():
    port, upstream_port = free_port(), free_port()
    config = replace(CONFIG, base=Base.UPSTREAM)
    with (
        FakeAutopilot(port) as autopilot,
        Run(port, config, upstream_port),
        FakeAutopilot(upstream_port, 255) as controller,
    ):
        controller.silent = True
        end = time.monotonic() + 40.0
        while time.monotonic() < end and len(autopilot.of_type("SET_ATTITUDE_TARGET")) < 150:
            controller.send(
                controller._mav.set_attitude_target_encode(
                    0, 1, 1, 7, [1.0, 0.0, 0.0, 0.0], 0, 0, 0, 0.5
                )
            )
            time.sleep(0.02)
        setpoints = autopilot.of_type("SET_ATTITUDE_TARGET")
        assert len(setpoints) >= 100
        assert setpoints[-1].thrust < 0.5, "the cushion is taken off"
        assert setpoints[-1].q[1] < 0.0, "it leans away from the wall on its right"
        assert controller.of_type("ATTITUDE_QUATERNION")


@pytest.mark.slow
def test_replaying_what_was_recorded_decides_the_same_bit_for_bit(tmp_path):
    log = tmp_path / "flight.tlog"
    port = free_port()
    live = []
    run = Run(port, record=log)
    original = run.flight.summary.add
    run.flight.summary.add = lambda d: (live.append(d), original(d))  # before the first decision
    with FakeAutopilot(port) as autopilot, run:
        autopilot.wait_for("SET_ATTITUDE_TARGET", 100)
    data, at = log.read_bytes(), 0
    state, intake, replayed = initial_state(CONFIG), Intake(), []
    while at < len(data):
        (stamp,) = struct.unpack_from(">Q", data, at)
        length = data[at + 9] + 12
        sample = intake.sample(cut(data, at + 8), stamp)
        if sample is not None:
            state, decision = step(state, sample, CONFIG)
            replayed += [] if decision is None else [decision]
        at += 8 + length
    before_stop = [d for d in live if "STOPPING" not in {r.name for r in d.reasons}]
    assert len(before_stop) >= 100
    for a, b in zip(before_stop, replayed, strict=False):
        assert a.t_s == b.t_s
        assert a.command == b.command
        assert a.offset == b.offset
        assert a.reasons == b.reasons


def test_a_port_in_use_is_one_line():
    port = free_port()
    first = open_link(f"udpin:127.0.0.1:{port}", Arrivals())
    with pytest.raises(LinkError, match="in use"):
        open_link(f"udp:127.0.0.1:{port}", Arrivals())
    first.close()


@pytest.mark.parametrize(
    "endpoint",
    ["udpx:1.2.3.4:5", "14550", "udp:nohost", "udp:127.0.0.1:notaport", "udp::14550", ""],
)
def test_an_unknown_endpoint_is_one_line(endpoint):
    with pytest.raises(ConfigError, match="endpoint"):
        open_link(endpoint, Arrivals())


def test_a_missing_device_is_one_line():
    with pytest.raises(LinkError, match="no such device"):
        open_link("/dev/ttyNONE9", Arrivals())


def test_a_closed_tcp_port_is_one_line():
    with pytest.raises(LinkError, match="refused"):
        open_link("tcp:127.0.0.1:1", Arrivals())
