"""sd_notify towards a fake systemd: ready, alive while the loop runs, stopping; and the unit file that asks for it."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import time
from configparser import ConfigParser
from pathlib import Path

import pytest
from fake_autopilot import FakeAutopilot, free_port
from flight_process import flight_command
from patience import HANG_S

from companion.cli import parser
from companion.watchdog import Watchdog

UNIT = Path(__file__).resolve().parents[2] / "docs" / "companion.service"


def systemd(name: str) -> socket.socket:
    out = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    out.bind("\0" + name[1:] if name.startswith("@") else name)
    out.settimeout(HANG_S)
    return out


@pytest.mark.parametrize("abstract", [False, True])
def test_it_speaks_when_due_and_no_more_often(tmp_path, abstract):
    name = f"@corner-{os.getpid()}" if abstract else str(tmp_path / "notify")
    with systemd(name) as heard:
        dog = Watchdog({"NOTIFY_SOCKET": name, "WATCHDOG_USEC": "2000000"})
        dog.ready()
        for k in range(100):
            dog.alive(0.02 * k)
        dog.status("two\nlines")
        dog.stopping()
        dog.close()
        dog.alive(99.0)
        heard.setblocking(False)
        said = []
        while True:
            try:
                said.append(heard.recv(4096).decode())
            except BlockingIOError:
                break
    assert said == ["READY=1", *["WATCHDOG=1"] * 4, "STATUS=two lines", "STOPPING=1"]


@pytest.mark.parametrize(
    "environment",
    [
        {},
        {"NOTIFY_SOCKET": "/nowhere/at/all", "WATCHDOG_USEC": "1000"},
        {"NOTIFY_SOCKET": "/nowhere", "WATCHDOG_USEC": "no"},
    ],
)
def test_without_systemd_it_costs_nothing(environment):
    dog = Watchdog(environment)
    dog.ready()
    dog.alive(1.0)
    dog.stopping()
    dog.close()


def test_the_watchdog_of_another_process_is_not_ours():
    assert Watchdog({"WATCHDOG_USEC": "1000", "WATCHDOG_PID": "1"}).period_s == float("inf")


def test_a_flight_under_systemd(tmp_path):
    name, port = str(tmp_path / "notify"), free_port()
    environment = {**os.environ, "NOTIFY_SOCKET": name, "WATCHDOG_USEC": "400000"}
    command = flight_command(port, "--quiet", scheme="udp")
    with systemd(name) as heard, FakeAutopilot(port) as autopilot:
        process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL)
        said: list[str] = []
        try:
            autopilot.wait_for("SET_ATTITUDE_TARGET", 20)
            until = time.monotonic() + HANG_S
            while said.count("WATCHDOG=1") < 5 and time.monotonic() < until:
                said.append(heard.recv(4096).decode())
            process.send_signal(signal.SIGTERM)
            while "STOPPING=1" not in said and time.monotonic() < until:
                said.append(heard.recv(4096).decode())
            process.wait(HANG_S)
        finally:
            process.kill()
    assert said[0] == "READY=1"
    assert said.count("WATCHDOG=1") >= 5
    assert any(text.startswith("STATUS=companion: connected to system 1") for text in said)
    assert said[-1] == "STOPPING=1" or "STOPPING=1" in said
    assert process.returncode == 130


def test_the_unit_uses_the_watchdog_and_never_overwrites_a_flight():
    unit = ConfigParser(strict=False)
    unit.optionxform = str  # type: ignore[assignment,method-assign]
    unit.read(UNIT)
    service = unit["Service"]
    assert service["Type"] == "notify"
    assert float(service["WatchdogSec"]) <= 2.0
    assert service["KillMode"] == "process", "the second process must outlive the first"
    program, *arguments = service["ExecStart"].split()
    assert program.endswith("/companion")
    options = parser().parse_args(arguments)
    assert str(options.record) == "/var/lib/corner"
    assert "-delete" in service["ExecStartPre"], "old recordings go"
    assert service["ExecStartPre"].startswith("-"), (
        "a failure of it does not keep the program from starting"
    )
