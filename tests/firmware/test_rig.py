"""What the rig does to messages and beams, without a firmware."""

from __future__ import annotations

import socket
import subprocess
import sys

import pytest
from physics import freeze_or_release
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from rig import Relay, speaks

from companion.sim.sensors import RangeFault, RangeSensor
from companion.vehicles import QUAD
from models.vehicle import load_vehicle


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        return int(sock.getsockname()[1])


def test_positions_are_thinned_and_nothing_else():
    relay = Relay(free_port(), free_port(), 10.0)
    sender = mavlink.MAVLink(None, srcSystem=1)
    out = b""
    for k in range(100):  # two seconds at 50 Hz
        position = mavlink.MAVLink_local_position_ned_message(
            1000 + 20 * k, 1.0, 2.0, -3.0, 0.0, 0.0, 0.0
        )
        attitude = mavlink.MAVLink_attitude_message(1000 + 20 * k, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        out += relay.thinned(position.pack(sender) + attitude.pack(sender))
    kinds = [m.get_type() for m in mavlink.MAVLink(None).parse_buffer(out)]
    assert kinds.count("ATTITUDE") == 100
    assert 20 <= kinds.count("LOCAL_POSITION_NED") <= 21


def test_a_signal_freezes_a_beam_and_the_next_releases_it():
    beam = RangeSensor(load_vehicle(QUAD).rangefinders[0], "")
    freeze_or_release(beam)
    assert beam.fault is RangeFault.FROZEN
    freeze_or_release(beam)
    assert beam.fault is None


def test_a_companion_that_ended_does_not_speak_whoever_does():
    """One that an earlier flight left at the port flew nineteen flights in the place of the one that was started."""
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    with pytest.raises(RuntimeError, match="ended with 0"):
        speaks(ended, heartbeat=object())


def test_a_companion_speaks_once_its_heartbeat_is_heard():
    running = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    try:
        assert not speaks(running, heartbeat=None)
        assert speaks(running, heartbeat=object())
    finally:
        running.kill()
        running.wait()
