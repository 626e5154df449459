"""PX4's simulator link, spoken by a fake PX4 over a real socket."""

from __future__ import annotations

import csv
import itertools
import math
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from body_truth import BodyTruthFile
from physics import main
from px4_hil import HOME_ALT_M, HOME_LAT_DEG, METRES_PER_DEG, Px4Physics, _Answers, serve
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from wrong_sensors import Wrong

from companion.mavlink.esc_messages import ESC_STATUS
from companion.sim.scenario import build
from companion.vehicles import QUAD, TANDEM
from models.vehicle import load_vehicle

HOVER = 0.42


def physics(seed: int = 1, file: Path = QUAD) -> Px4Physics:
    vehicle = load_vehicle(file)
    return Px4Physics(vehicle, build("corner", vehicle), seed)


def parsed(data: bytes) -> list[Any]:
    parser = mavlink.MAVLink(None)
    return list(parser.parse_buffer(data) or [])


def test_the_first_messages_are_a_vehicle_at_rest_on_the_ground():
    found = {m.get_type(): m for m in parsed(physics().sensors())}
    assert list(found)[-1] == "HIL_SENSOR"
    imu = found["HIL_SENSOR"]
    assert imu.zacc == pytest.approx(-9.80665, abs=0.1)
    assert imu.fields_updated & 0x3F == 0x3F
    assert imu.time_usec > 0
    assert math.sqrt(imu.xmag**2 + imu.ymag**2 + imu.zmag**2) == pytest.approx(0.476, abs=0.01)
    assert found["HIL_GPS"].lat == pytest.approx(HOME_LAT_DEG * 1e7, abs=10)
    assert found["HIL_GPS"].alt == pytest.approx(1e3 * HOME_ALT_M, abs=200)
    assert imu.abs_pressure == pytest.approx(956.0, abs=3.0)


def test_each_sensor_has_its_own_rate_and_time_goes_by_four_milliseconds():
    p = physics()
    counts: dict[str, int] = {}
    times, fields = [], []
    for _ in range(250):
        for m in parsed(p.sensors()):
            counts[m.get_type()] = counts.get(m.get_type(), 0) + 1
            if m.get_type() == "HIL_SENSOR":
                times.append(m.time_usec)
                fields.append(m.fields_updated)
        p.step(None)
    assert counts == {"HEARTBEAT": 1, "HIL_GPS": 10, "DISTANCE_SENSOR": 100, "HIL_SENSOR": 250}
    assert {b - a for a, b in itertools.pairwise(times)} == {4000}
    assert sum(bool(f & 0x1C0) for f in fields) == 125
    assert sum(bool(f & 0x200) for f in fields) == 50


def test_outputs_lift_and_turn_the_vehicle_and_gps_follows():
    p = physics()
    for _ in range(250):
        p.step([1.3 * HOVER] * 4 + [0.0] * 12)
    assert -p.body.position[2] > 0.5
    assert p.body.velocity[2] < -0.5
    p = physics()
    for _ in range(60):
        p.step([1.2 * HOVER, 1.2 * HOVER, 1.3 * HOVER, 1.3 * HOVER] + [0.0] * 12)  # ccw pair slower
    assert abs(p.body.rates[2]) > 0.01
    p.body.position[0] = -5.0  # away from the wall
    gps = next(
        m
        for k in range(25)
        if not p.step(None)
        for m in parsed(p.sensors())
        if m.get_type() == "HIL_GPS"
    )
    assert (gps.lat / 1e7 - HOME_LAT_DEG) * METRES_PER_DEG == pytest.approx(-5.0, abs=0.3)


def test_outputs_of_vanes_are_servos():
    p = physics(file=TANDEM)
    v = load_vehicle(TANDEM)
    controls = [0.0] * 16
    controls[v.vanes[0].servo - 1] = 0.5
    for _ in range(50):
        p.step(controls)
    assert p.body.deflection[0] == pytest.approx(0.25, abs=0.02)


class FakePx4(threading.Thread):
    """Connects, answers each HIL_SENSOR once with the outputs of its own simple law, and leaves at the end."""

    def __init__(self, port: int, count: int, *, silent_before: int = 0) -> None:
        super().__init__(daemon=True)
        self.port, self.count, self.silent_before = port, count, silent_before
        self.times: list[int] = []
        self.failure: Exception | None = None

    def run(self) -> None:
        try:
            with socket.create_connection(("127.0.0.1", self.port), timeout=20) as sock:
                self._fly(sock)
        except Exception as error:
            self.failure = error

    def _fly(self, sock: socket.socket) -> None:
        mav, parser = mavlink.MAVLink(None, srcSystem=1, srcComponent=1), mavlink.MAVLink(None)
        parser.robust_parsing = True
        while len(self.times) < self.count:
            for m in parser.parse_buffer(sock.recv(65536)) or []:
                if m.get_type() != "HIL_SENSOR":
                    continue
                self.times.append(m.time_usec)
                if len(self.times) <= self.silent_before:
                    continue
                level = 1.1 * HOVER if len(self.times) < self.count // 2 else HOVER
                controls = [level] * 4 + [0.0] * 12
                sock.sendall(
                    mavlink.MAVLink_hil_actuator_controls_message(
                        m.time_usec, controls, 128, 1
                    ).pack(mav)
                )


@pytest.fixture
def served(tmp_path: Path) -> Iterator[tuple[Px4Physics, FakePx4, Path]]:
    p, ports, ready = physics(), [], threading.Event()
    truth = BodyTruthFile(tmp_path / "truth.csv", p.body)

    def announce(port: int) -> None:
        ports.append(port)
        ready.set()

    server = threading.Thread(
        target=serve, args=(p, 0, announce), kwargs={"speed": 50.0, "truth": truth}, daemon=True
    )
    server.start()
    assert ready.wait(10)
    px4 = FakePx4(ports[0], 500, silent_before=20)
    px4.start()
    yield p, px4, tmp_path / "truth.csv"
    server.join(30)
    assert not server.is_alive()
    truth.close()


def test_a_fake_px4_flies_in_lockstep_and_the_vehicle_ends_when_it_leaves(served):
    _, px4, truth = served
    px4.join(60)
    assert px4.failure is None
    assert {b - a for a, b in itertools.pairwise(px4.times)} == {4000}
    rows = list(csv.DictReader(truth.open()))
    assert len(rows) == pytest.approx(100, abs=3)
    assert float(rows[-1]["d"]) < float(rows[0]["d"]) - 0.05
    assert {row["contact"] for row in rows[:5]} == {"1"}


def test_disarmed_outputs_are_not_flown(tmp_path):
    ours, theirs = socket.socketpair()
    with ours, theirs:
        mav = mavlink.MAVLink(None)
        answers = _Answers(ours)
        theirs.sendall(mavlink.MAVLink_hil_actuator_controls_message(1, [0.7] * 16, 0, 1).pack(mav))
        assert answers.wait() == [0.0] * 16
        theirs.sendall(
            mavlink.MAVLink_hil_actuator_controls_message(2, [0.5] * 16, 128, 1).pack(mav)
        )
        assert answers.wait() == [0.5] * 16
        assert answers.wait() is None
        theirs.close()
        with pytest.raises(EOFError):
            answers.wait()


def test_a_port_in_use_is_one_line_and_exit_4(capsys):
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as sock:
        sock.bind(("127.0.0.1", 0))
        sock.listen(1)
        assert main(["--px4-hil", str(sock.getsockname()[1])]) == 4
    err = capsys.readouterr().err.strip().splitlines()
    assert len(err) == 1
    assert "--px4-hil" in err[0]


def test_rotor_speeds_are_sent_as_the_autopilot_would_and_each_once():
    p = physics()
    for _ in range(100):
        p.sensors()
        p.step([0.4] * 16)
    frames = p.speeds()
    assert p.speeds() == b""
    payload = frames[10:-2].ljust(ESC_STATUS.unpacker.size, b"\0")
    rpm = ESC_STATUS.unpacker.unpack(payload)[1:5]
    assert rpm == pytest.approx(p.body.rpm, rel=0.05)
    assert min(rpm) > 1000.0


def test_a_position_that_steps_reaches_the_autopilot_and_the_vehicle_stays():
    p = physics()
    told = [m for m in parsed(p.sensors()) if m.get_type() == "HIL_GPS"]
    p._wrong.begin(Wrong(position_off_m=(0.5, 0.0, 0.0)), p.body)
    for _ in range(25):
        p.step(None)
        told += [m for m in parsed(p.sensors()) if m.get_type() == "HIL_GPS"]
    north_m = (told[-1].lat - told[0].lat) * 1e-7 * METRES_PER_DEG
    assert north_m == pytest.approx(0.5, abs=0.08)
    assert p.body.position[0] == pytest.approx(0.0, abs=0.01)
