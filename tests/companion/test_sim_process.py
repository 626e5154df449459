"""The built-in vehicle in a process of its own: it starts, tells its phases and its end, and ends with its parent."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from multiprocessing import Pipe
from pathlib import Path

import pytest
from patience import HANG_S
from pymavlink import mavutil
from simulated import Nobody

from companion.cli import main, scenario_name
from companion.sim.flight import SimulatedFlight
from companion.sim.process import Narrator, follow, launch
from companion.sim.scenario import build
from companion.vehicles import default_vehicle
from models.common.errors import LinkError


def hover() -> SimulatedFlight:
    return SimulatedFlight(default_vehicle(), build("hover", default_vehicle()), 1)


def test_launch_speaks_mavlink_where_it_says():
    with launch(hover(), Nobody) as sim:
        link = mavutil.mavlink_connection(sim.endpoint)
        try:
            beat = link.wait_heartbeat(timeout=HANG_S)
            assert beat is not None
            assert beat.get_srcSystem() == 1
            assert sim.process.is_alive()
        finally:
            link.close()
    assert not sim.process.is_alive()


def test_ctrl_c_is_left_to_the_companion():
    with launch(hover()) as sim:
        assert sim.process.pid is not None
        os.kill(sim.process.pid, signal.SIGINT)
        sim.process.join(0.5)
        assert sim.process.is_alive()


def test_it_ends_with_its_parent():
    code = (
        "from test_sim_process import hover\nfrom companion.sim.process import launch\nimport time\n"
        "with launch(hover()) as sim:\n"
        "    print(sim.process.pid, flush=True)\n    time.sleep(600)\n"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    parent = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, env=environment
    )
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    parent.stdout.close()
    for _ in range(6000):
        try:
            state = (
                Path(f"/proc/{child}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()[0]
            )
        except OSError:
            return
        if state == "Z":
            return
        time.sleep(0.05)
    os.kill(child, signal.SIGKILL)
    pytest.fail("the simulator outlived its parent")


class Broken(Nobody):
    """Ends its process."""

    def __init__(self, *_: object, **__: object) -> None:
        sys.exit(1)


def test_a_vehicle_that_does_not_start_is_said():
    with (
        pytest.raises(LinkError, match="sim:hover: the built-in vehicle did not start"),
        launch(hover(), Broken),
    ):
        pass


def test_every_phase_once_and_one_end():
    flight, said = SimulatedFlight(default_vehicle(), build("corner", default_vehicle()), 0), []
    narrator = Narrator(flight, said.append)
    narrator.step()  # the script has not begun
    assert said == []
    for k in range(math.ceil(flight.scenario.duration_s * 10) + 20):
        flight.script_began_s = -0.1 * (k + 1)
        narrator.step()
    ground = ["free", "descend", "ground", "climb", "free"]
    corner = [
        "approach",
        "wall",
        "descend at wall",
        "corner",
        "climb at wall",
        "wall",
        "retreat",
        "free",
    ]
    assert [text.partition(" (")[0] for text in said] == [*ground, *corner, ""]


def test_the_flight_program_says_the_phases_and_stops():
    said, ended = [], []
    news, tell = Pipe(duplex=False)
    for text in ("descend (22 s to go)", ""):
        tell.send(text)
    follow(news, said.append, lambda: ended.append(True)).join(HANG_S)
    assert said[0] == "sim: descend (22 s to go)"
    assert "over" in said[1]
    assert ended == [True]


def test_a_vehicle_that_has_ended_says_nothing():
    news, tell = Pipe(duplex=False)
    tell.close()
    ended: list[bool] = []
    follow(news, lambda _: None, lambda: ended.append(True)).join(HANG_S)
    assert ended == []


def test_sim_alone_is_the_corner(capsys):
    assert scenario_name("sim:") == "corner"
    assert scenario_name("sim:hover") == "hover"
    assert main(["--connect", "sim:nowhere"]) == 2
    assert "corner" in capsys.readouterr().err
