"""The end of a flight: Ctrl-C, kill -9, and parameters that are asked for until they come."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time

import pytest
from fake_autopilot import FakeAutopilot, free_port
from flight_process import flight_command
from flying import Bench
from paced_flight import PacedFlight
from patience import HANG_S

from companion.control.hand_over import held_off
from companion.flight.hand_over import hand_over_lasts_s
from companion.last_word import LastWord, Word
from companion.mavlink.link import Arrivals, open_link
from models.common.errors import LinkError

ARDUPILOT, PX4 = 3, 12


def test_ctrl_c_hands_over_to_a_place_and_leaves_no_tilt():
    with PacedFlight() as run:
        autopilot = run.autopilot
        run.wait_for("SET_ATTITUDE_TARGET", 30)
        run.end()
        kinds = [m.get_type() for m in autopilot.received if m.get_type().startswith("SET_")]
        places = autopilot.of_type("SET_POSITION_TARGET_LOCAL_NED")
    assert kinds[-1] == "SET_POSITION_TARGET_LOCAL_NED"
    assert kinds.count("SET_POSITION_TARGET_LOCAL_NED") >= 5, "one lost message must not matter"
    assert (places[-1].x, places[-1].y, places[-1].z) == pytest.approx((0.0, 0.0, -0.3), abs=0.02)
    assert places[-1].target_component == 1
    assert not [m for m in autopilot.of_type("COMMAND_LONG") if m.command == 176], (
        "the mode is not ours"
    )


@pytest.mark.parametrize(
    ("autopilot", "wall_m", "lasts_s"), [(PX4, 0.5, 6.0), (PX4, 50.0, 1.0), (ARDUPILOT, 0.5, 1.0)]
)
def test_px4_beside_a_wall_is_told_the_place_until_its_trim_balances_the_pull(
    autopilot, wall_m, lasts_s
):
    beside = Bench(autopilot=autopilot, wall=wall_m, mode=0)
    beside.run(2.0)
    assert hand_over_lasts_s(beside.state) == lasts_s


def test_parameters_are_asked_for_as_long_as_they_are_missing(monkeypatch):
    monkeypatch.setattr("companion.flight.requests._RETRY_S", 0.05)
    monkeypatch.setattr("companion.flight.requests._SLOW_RETRY_S", 0.05)
    with PacedFlight(parameters={}) as run:
        asked = run.wait_for("PARAM_REQUEST_READ", 400)
        assert sum(m.param_id == "GUID_OPTIONS" for m in asked) > 15
        run.autopilot.parameters["GUID_OPTIONS"] = 8.0
        run.wait_for("SET_ATTITUDE_TARGET", 5)


def test_the_second_process_speaks_once_the_first_is_dead_and_only_then():
    """A parent that is killed outright; its child inherits the socket."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        vehicle.bind(("127.0.0.1", 0))
        vehicle.settimeout(HANG_S)
        code = (
            "import socket, sys, time; from companion.last_word import LastWord, Word\n"
            "s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM); w = LastWord(s.fileno())\n"
            f"w.renew(Word(b'old', 5), [('127.0.0.1', {vehicle.getsockname()[1]})])\n"
            f"w.renew(Word(b'stay here', 10), [('127.0.0.1', {vehicle.getsockname()[1]})])\n"
            "print(w.pid, flush=True); time.sleep(600)\n"
        )
        with subprocess.Popen(
            [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True
        ) as parent:
            child = int(parent.stdout.readline())
            time.sleep(0.3)
            vehicle.setblocking(False)
            with pytest.raises(BlockingIOError):
                vehicle.recv(100)
            vehicle.setblocking(True)
            vehicle.settimeout(HANG_S)
            parent.kill()
            assert {vehicle.recv(100) for _ in range(5)} == {b"stay here"}
        end = time.monotonic() + HANG_S
        while time.monotonic() < end and os.path.exists(f"/proc/{child}/cmdline") and _alive(child):
            time.sleep(0.1)
        assert not _alive(child), "it leaves nothing running"


def test_the_second_process_speaks_while_the_first_stands_still_and_is_quiet_again_when_it_is_back():
    """A parent that renews five times a second, stopped as swap or a slow SD card would."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        vehicle.bind(("127.0.0.1", 0))
        code = (
            "import socket, time; from companion.last_word import LastWord, Word\n"
            "s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM); w = LastWord(s.fileno())\n"
            f"a = [('127.0.0.1', {vehicle.getsockname()[1]})]\n"
            "while True: w.renew(Word(b'stay here', 10), a); s.sendto(b'renewed', a[0]); time.sleep(0.1)\n"
        )
        vehicle.settimeout(HANG_S)
        with subprocess.Popen([sys.executable, "-c", code]) as parent:
            try:
                assert {vehicle.recv(100) for _ in range(3)} == {b"renewed"}
                parent.send_signal(signal.SIGSTOP)
                words = []
                while words.count(b"stay here") < 10:
                    words.append(vehicle.recv(100))
                vehicle.settimeout(1.0)
                with pytest.raises(TimeoutError):
                    vehicle.recv(100)  # said for a second, and enough
                parent.send_signal(signal.SIGCONT)
                vehicle.settimeout(HANG_S)
                assert {vehicle.recv(100) for _ in range(5)} == {b"renewed"}
            finally:
                parent.kill()


def _alive(pid: int) -> bool:
    try:
        with open(f"/proc/{pid}/stat", encoding="utf-8") as file:
            return file.read().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_a_restart_after_kill_9_relieves_the_second_process_and_takes_its_port():
    port = free_port()
    endpoint = f"udpin:127.0.0.1:{port}"
    code = (
        "import socket, time; from companion.last_word import LastWord, Word\n"
        "s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)\n"
        f"s.bind(('127.0.0.1', {port})); w = LastWord(s.fileno(), '{endpoint}')\n"
        "w.renew(Word(b'stay here', 100000), [('127.0.0.1', 9)])\n"
        "print(w.pid, flush=True); time.sleep(60)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True
    ) as parent:
        child = int(parent.stdout.readline())
        parent.kill()
    assert _alive(child)
    link = open_link(endpoint, Arrivals())
    link.close()
    end = time.monotonic() + 10.0
    while _alive(child) and time.monotonic() < end:
        time.sleep(0.05)
    assert not _alive(child)


def test_a_port_that_another_program_keeps_is_refused():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        with pytest.raises(LinkError, match="in use by another program"):
            open_link(f"udpin:127.0.0.1:{other.getsockname()[1]}", Arrivals())


def test_an_orderly_end_says_nothing_more():
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own,
    ):
        vehicle.bind(("127.0.0.1", 0))
        word = LastWord(own.fileno())
        word.renew(Word(b"stay here", 10), [vehicle.getsockname()])
        word.close()
        assert not _alive(word.pid)
        vehicle.setblocking(False)
        with pytest.raises(BlockingIOError):
            vehicle.recv(100)


@pytest.mark.parametrize(("lean", "off"), [(-0.1, 0.0556), (-2.0, 0.15), (0.3, 0.0)])
def test_the_place_at_the_end_is_off_the_wall_by_what_the_autopilots_controller_sags(lean, off):
    """Never towards the wall."""
    assert held_off((1.0, 2.0, -3.0), (0.5, lean), (0.0, 1.0)) == pytest.approx(
        (1.0, 2.0 - off, -3.0), abs=1e-3
    )


def test_a_killed_companion_leaves_the_autopilot_holding_its_place():
    """The whole program, killed outright on loopback."""
    port = free_port()
    command = flight_command(port, "--quiet")
    with FakeAutopilot(port) as autopilot, subprocess.Popen(command) as companion:
        try:
            autopilot.wait_for("SET_ATTITUDE_TARGET", 50)
            time.sleep(0.5)
        finally:
            companion.send_signal(signal.SIGKILL)
        place = autopilot.wait_for("SET_POSITION_TARGET_LOCAL_NED", 3)[-1]
    assert (place.x, place.y, place.z) == pytest.approx((0.0, 0.0, -0.3), abs=0.02)
    assert (place.target_component, place.coordinate_frame) == (1, 1)
