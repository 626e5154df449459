from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from pymavlink import mavutil

from companion.sim.__main__ import main
from companion.sim.flown import read_truth
from companion.sim.launch import launch
from models.errors import LinkError


def test_launch_speaks_mavlink_where_it_says():
    with launch("hover", seed=1, speed=4.0, pilot="none") as sim:
        link = mavutil.mavlink_connection(sim.endpoint)
        try:
            beat = link.wait_heartbeat(timeout=5)
            assert beat is not None
            assert beat.get_srcSystem() == 1
            assert sim.process.poll() is None
        finally:
            link.close()
    assert sim.process.poll() is not None


def test_it_ends_with_its_parent():
    code = (
        "from companion.sim.launch import launch\nimport time\n"
        "with launch('hover', pilot='none') as sim:\n"
        "    print(sim.process.pid, flush=True)\n    time.sleep(60)\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    parent.stdout.close()
    for _ in range(100):
        try:
            state = Path(f"/proc/{child}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()[0]
        except OSError:
            return
        if state == "Z":
            return
        time.sleep(0.05)
    os.kill(child, signal.SIGKILL)
    pytest.fail("the simulator outlived its parent")


def test_truth_is_written_and_the_flight_ends_when_told(tmp_path):
    truth = tmp_path / "truth.csv"
    with launch("corner", seed=2, speed=50.0, pilot="autopilot", truth=truth, duration_s=13.0) as sim:
        assert sim.process.wait(90) == 0
        assert sim.announcement["seed"] == 2
    columns = read_truth(truth)
    assert columns["time_s"][-1] == pytest.approx(13.0, abs=0.1)
    assert columns["script_s"][0] >= 0.0
    assert columns["rpm_1"].min() > 3000.0
    weight = -(columns["free_Fz"] + columns["corner_Fz"] + columns["unsteady_Fz"]).mean()
    assert weight == pytest.approx(4.6 * 9.80665, rel=0.01)


def test_the_announcement_is_one_json_line(capsys):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        port = sock.getsockname()[1]
        assert main(["--scenario", "hover", "--port", str(port), "--speed", "50", "--duration", "0.5"]) == 0
    line = json.loads(capsys.readouterr().out)
    assert line["endpoint"] == f"udpin:127.0.0.1:{port}"


def test_an_unreadable_vehicle_is_one_line_and_exit_2(capsys, tmp_path):
    assert main(["--vehicle", str(tmp_path / "none.toml")]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--speed", "0"], "--speed"),
        (["--speed", "nan"], "--speed"),
        (["--duration", "-1"], "--duration"),
        (["--port", "70000"], "--port"),
        (["--truth", "/nowhere/at/all.csv"], "--truth"),
    ],
)
def test_a_bad_argument_is_one_line_that_names_it(capsys, arguments, named):
    assert main(arguments) == 2
    err = capsys.readouterr().err.strip().splitlines()
    assert len(err) == 1
    assert named in err[0]


def test_launch_passes_on_why_it_did_not_start(tmp_path):
    with pytest.raises(LinkError, match=r"none\.toml"), launch("hover", vehicle=tmp_path / "none.toml"):
        pass
