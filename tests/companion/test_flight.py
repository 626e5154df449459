"""The live loop against a scripted autopilot: real MAVLink, simulated time, no physics. And endpoints that are none."""

import struct
from dataclasses import replace

import pytest
from fake_autopilot import free_port
from flying import CONFIG
from paced_flight import PacedAutopilot, PacedFlight

from companion.config import Base
from companion.mavlink.dialect import mavlink
from companion.mavlink.link import Arrivals, open_link
from companion.mavlink.message_filter import Intake
from companion.mavlink.wire_frames import cut
from companion.pipeline import initial_state, step
from models.common.errors import ConfigError, LinkError


def test_it_connects_asks_and_compensates():
    with PacedFlight() as run:
        autopilot = run.autopilot
        beats = run.wait_for("HEARTBEAT", 2)
        setpoints = run.wait_for("SET_ATTITUDE_TARGET", 100)
        asked = {int(m.param1) for m in autopilot.of_type("COMMAND_LONG") if m.command == 511}
        names = {m.name for m in run.wait_for("NAMED_VALUE_FLOAT", 12)}
        texts = [m.text for m in run.wait_for("STATUSTEXT")]
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


def test_another_program_with_the_same_identity_is_named_and_an_echo_is_not():
    with PacedFlight() as run:
        other = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)
        for beat in run.wait_for("HEARTBEAT", 3):
            run.autopilot.send_raw(bytes(beat.get_msgbuf()))
        run.run(0.3)
        assert "another program" not in run.said()
        run.autopilot.send_raw(mavlink.MAVLink_heartbeat_message(18, 8, 64, 0, 4, 3).pack(other))
        run.until(lambda: "another program is component 191" in run.said())


def test_dry_run_sends_no_setpoint():
    with PacedFlight(replace(CONFIG, dry_run=True)) as run:
        run.wait_for("NAMED_VALUE_FLOAT", 20)
        run.run(1.0)
    assert not run.autopilot.of_type("SET_ATTITUDE_TARGET")
    assert run.flight.summary.decisions > 20


def test_without_bit_3_it_refuses_until_the_pilot_sets_it():
    with PacedFlight(parameters={"GUID_OPTIONS": 0.0}) as run:
        run.wait_for("NAMED_VALUE_FLOAT", 20)
        assert not run.autopilot.of_type("SET_ATTITUDE_TARGET")
        assert any("GUID_OPTIONS" in m.text for m in run.wait_for("STATUSTEXT"))
        run.autopilot.parameters["GUID_OPTIONS"] = 8.0
        run.wait_for("SET_ATTITUDE_TARGET", 5)


def test_silence_of_the_vehicle_is_silence_of_the_companion_and_it_comes_back():
    with PacedFlight() as run:
        run.wait_for("SET_ATTITUDE_TARGET", 20)
        run.autopilot.silent = True
        run.run(0.3)
        count = len(run.autopilot.of_type("SET_ATTITUDE_TARGET"))
        run.run(1.0)
        assert len(run.autopilot.of_type("SET_ATTITUDE_TARGET")) == count
        run.autopilot.silent = False
        run.wait_for("SET_ATTITUDE_TARGET", count + 20)


def test_a_reboot_is_survived_and_rates_are_asked_for_again():
    with PacedFlight() as run:
        autopilot = run.autopilot
        run.wait_for("SET_ATTITUDE_TARGET", 20)
        before = len([m for m in autopilot.of_type("COMMAND_LONG") if m.command == 511])
        autopilot.boot_s = 2.0
        run.run(1.5)
        assert run.flight.incoming.reboots == 1
        assert len([m for m in autopilot.of_type("COMMAND_LONG") if m.command == 511]) > before
        count = len(autopilot.of_type("SET_ATTITUDE_TARGET"))
        run.wait_for("SET_ATTITUDE_TARGET", count + 20)


def test_another_vehicle_on_the_link_is_ignored():
    with PacedFlight() as run:
        run.wait_for("SET_ATTITUDE_TARGET", 20)
        other = PacedAutopilot(run.wire, system=7)
        other.height = 0.07
        other.armed = False
        run.run(1.0)
        assert run.flight.as_json()["ignored_systems"] == [7]
        assert run.flight.as_json()["system"] == 1
        assert run.flight.incoming.state.heard.heartbeat.armed


def test_an_upstream_controller_is_forwarded_and_hears_the_vehicle():
    with PacedFlight(replace(CONFIG, base=Base.UPSTREAM), upstream=True) as run:
        controller = run.controller
        for _ in range(300):
            controller.send(
                controller._mav.set_attitude_target_encode(
                    0, 1, 1, 7, [1.0, 0.0, 0.0, 0.0], 0, 0, 0, 0.5
                )
            )
            run.run(0.02)
        setpoints = run.autopilot.of_type("SET_ATTITUDE_TARGET")
        assert len(setpoints) >= 100
        assert setpoints[-1].thrust < 0.5, "the cushion is taken off"
        assert setpoints[-1].q[1] < 0.0, "it leans away from the wall on its right"
        assert controller.of_type("ATTITUDE_QUATERNION")


def test_replaying_what_was_recorded_decides_the_same_bit_for_bit(tmp_path):
    log = tmp_path / "flight.tlog"
    live = []
    run = PacedFlight(record=log)
    original = run.flight.summary.add
    run.flight.summary.add = lambda d: (live.append(d), original(d))  # before the first decision
    with run:
        run.wait_for("SET_ATTITUDE_TARGET", 100)
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
