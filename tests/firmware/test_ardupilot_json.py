"""ArduPilot's JSON physics protocol, spoken by a fake autopilot."""

from __future__ import annotations

import itertools
import json
import math
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from ardupilot_json import JsonPhysics, parse
from physics import main

from companion.sim.scenario import build
from companion.vehicles import default_vehicle

RATE = 400
COMMAND = str(Path(__file__).with_name("physics.py"))


def packet(count: int, pwm: list[int], magic: int = 18458, rate: int = RATE) -> bytes:
    channels = 16 if magic == 18458 else 32
    return struct.pack(f"<HHI{channels}H", magic, rate, count, *(pwm + [0] * channels)[:channels])


OFF = [1000] * 4 + [1500] * 2
HOVER = [1669] * 4 + [1500] * 2


@pytest.fixture
def physics() -> JsonPhysics:
    return JsonPhysics(default_vehicle(), build("corner", default_vehicle()), seed=1)


def state(reply: bytes | None) -> dict:
    assert reply is not None
    assert reply[:1] == b"\n"
    assert reply[-1:] == b"\n"
    return json.loads(reply)


def test_each_frame_is_one_step_of_its_rate(physics):
    for count in range(1, 11):
        s = state(physics.answer(packet(count, OFF)))
    assert s["timestamp"] == pytest.approx(10 / RATE)
    assert s["imu"]["accel_body"][2] == pytest.approx(-9.80665, abs=0.05)
    assert (
        len(s["imu"]["gyro"])
        == len(s["position"])
        == len(s["velocity"])
        == len(s["velocity_wind"])
        == 3
    )
    assert math.hypot(*s["quaternion"]) == pytest.approx(1.0)
    assert s["battery"]["voltage"] > 20.0
    assert {"rng_1", "rng_2"} <= set(s)


def test_a_repeated_frame_gets_the_same_answer_and_no_step(physics):
    physics.answer(packet(1, OFF))
    first = physics.answer(packet(2, HOVER))
    assert physics.answer(packet(2, HOVER)) == first
    assert state(physics.answer(packet(3, HOVER)))["timestamp"] == pytest.approx(3 / RATE)


def test_a_frame_count_that_goes_back_restarts_the_vehicle(physics):
    for count in range(1, 800):
        s = state(physics.answer(packet(count, [1800] * 4 + [1500] * 2)))
    assert s["position"][2] < -0.2
    s = state(physics.answer(packet(0, OFF)))
    assert physics.restarts == 1
    assert s["timestamp"] == pytest.approx(1 / RATE)
    assert s["position"][2] == pytest.approx(-0.126, abs=1e-3)


def test_a_rate_that_changes_changes_the_step_and_restarts_nothing(physics):
    """The real ArduCopter goes from 1200 to SIM_RATE_HZ by one hertz a frame."""
    times = []
    for k, rate in enumerate((1200, 1200, 1199, 1198, 800, 800)):
        times.append(state(physics.answer(packet(k, HOVER, rate=rate)))["timestamp"])
    steps = [b - a for a, b in itertools.pairwise([0.0, *times])]
    assert steps == pytest.approx(
        [1 / 1200, 1 / 1200, 1 / 1199, 1 / 1198, 1 / 800, 1 / 800], rel=1e-6
    )
    assert physics.restarts == 0


def test_both_packet_sizes_and_any_rate_are_understood(physics):
    assert state(physics.answer(packet(1, OFF, magic=29569, rate=1200)))[
        "timestamp"
    ] == pytest.approx(1 / 1200)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\x1a\x48",
        struct.pack("<HHI", 18458, 400, 1),
        packet(1, OFF)[:-1],
        b"x" * 40,
        packet(1, OFF, rate=0),
    ],
)
def test_anything_else_is_ignored(physics, data):
    assert parse(data) is None
    assert physics.answer(data) is None


def test_no_pulse_means_motor_off_and_vane_neutral(physics):
    for count in range(1, 50):
        s = state(physics.answer(packet(count, [0] * 16)))
    assert physics.body.rpm == [0.0] * 4
    assert physics.body.deflection == [0.0] * 2
    assert s["position"][2] == pytest.approx(-0.126, abs=1e-3)


@pytest.fixture
def server() -> Iterator[int]:
    process = subprocess.Popen(
        [sys.executable, COMMAND, "--ardupilot-json", "0", "--seed", "1"],
        stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    try:
        yield json.loads(process.stdout.readline())["ardupilot_json"]
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def test_a_fake_autopilot_flies_it_over_udp(server):
    """Lock-step with a height and attitude controller of a few lines: climbs to 1 m and stays."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.settimeout(5.0)
        integral, s = 0.0, None
        pwm = OFF
        for count in range(1, 5 * RATE):
            sock.sendto(packet(count, pwm), ("127.0.0.1", server))
            s = json.loads(sock.recv(4096))
            assert s["timestamp"] == pytest.approx(count / RATE)
            w, x, y, z = s["quaternion"]
            roll, pitch, yaw = 2 * (w * x + y * z), 2 * (w * y - z * x), 2 * (w * z + x * y)
            p, q, r = s["imu"]["gyro"]
            error = -1.0 - s["position"][2]  # down positive
            integral += 0.3 * error / RATE
            lift = 1665.0 - 250.0 * (error + integral) + 220.0 * s["velocity"][2]
            tip = -700.0 * pitch - 150.0 * q
            lean, turn = 500.0 * roll + 120.0 * p, 300.0 * yaw + 200.0 * r
            fans = [lift + tip, lift + tip, lift - tip, lift - tip]
            vanes = [1500.0 + lean - turn, 1500.0 + lean + turn]
            pwm = [int(min(1950.0, max(1000.0, v))) for v in fans + vanes]
        assert s is not None
        assert s["position"][2] == pytest.approx(-1.0, abs=0.15)
        assert abs(s["velocity"][2]) < 0.2
        assert s["rng_1"] == pytest.approx(0.95, abs=0.2)


def test_a_port_in_use_is_one_line_and_exit_4(capsys):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("0.0.0.0", 0))
        assert main(["--ardupilot-json", str(sock.getsockname()[1])]) == 4
    err = capsys.readouterr().err.strip().splitlines()
    assert len(err) == 1
    assert "--ardupilot-json" in err[0]
