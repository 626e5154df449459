"""A real firmware on the body of ``companion.sim``, a ground station, and the companion as a user starts it.

Time is the autopilot's own: on a slow machine both firmwares wait for their physics, so a flight stretches.
"""

from __future__ import annotations

import contextlib
import csv
import math
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("MAVLINK20", "1")

import wrong_sensors
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.vehicles import QUAD

ARDUCOPTER, PX4 = "ARDUCOPTER_BIN", "PX4_BIN"
GUIDED, LOITER = (4, 0), (5, 0)
OFFBOARD, POSITION, TAKEOFF = (6, 0), (3, 0), (4, 2)
SLOW_MACHINE = 6.0
"""Wall-clock seconds allowed for each second of the autopilot."""
TAKE_OFF_M = 1.5
SPEEDS_PORT = 14590
"""UDP: rotor speeds on their way from the physics to the companion."""
ESC_STATUS_ID = (291).to_bytes(3, "little")
RELAYED = 30
"""Added to the companion's port where a relay stands between it and the firmware."""

ARDUCOPTER_PARAMETERS = {
    "FRAME_CLASS": 1, "FRAME_TYPE": 1, "SIM_RATE_HZ": 800, "GUID_OPTIONS": 8, "GUID_TIMEOUT": 0.5, "ARMING_CHECK": 0,
    "COMPASS_OFS_X": 5, "COMPASS_OFS_Y": 13, "COMPASS_OFS_Z": -18, "COMPASS_OFS2_X": 5, "COMPASS_OFS2_Y": 13,
    "COMPASS_OFS2_Z": -18, "COMPASS_OFS3_X": 5, "COMPASS_OFS3_Y": 13, "COMPASS_OFS3_Z": -18, "FS_THR_ENABLE": 0,
    "FS_GCS_ENABLE": 0, "FENCE_ENABLE": 0, "LOG_BACKEND_TYPE": 0, "BATT_MONITOR": 4, "BATT_CAPACITY": 10000,
    "RNGFND1_TYPE": 100, "RNGFND1_ORIENT": 25, "RNGFND1_MIN_CM": 2, "RNGFND1_MAX_CM": 4000, "RNGFND1_POS_Z": 0.05,
    "RNGFND2_TYPE": 100, "RNGFND2_ORIENT": 0, "RNGFND2_MIN_CM": 2, "RNGFND2_MAX_CM": 4000, "RNGFND2_POS_X": 0.12,
    "SIM_ESC_TELEM": 0, "SERIAL0_PROTOCOL": 2, "SERIAL1_PROTOCOL": 2, "MOT_THST_HOVER": 0.42,
    "RC1_MIN": 1000, "RC1_MAX": 2000, "RC1_TRIM": 1500, "RC2_MIN": 1000, "RC2_MAX": 2000, "RC2_TRIM": 1500,
    "RC3_MIN": 1000, "RC3_MAX": 2000, "RC3_TRIM": 1500, "RC4_MIN": 1000, "RC4_MAX": 2000, "RC4_TRIM": 1500,
}  # fmt: skip
PX4_PARAMETERS = {
    "CA_ROTOR0_PX": 0.225, "CA_ROTOR0_PY": 0.225, "CA_ROTOR1_PX": -0.225, "CA_ROTOR1_PY": -0.225,
    "CA_ROTOR2_PX": 0.225, "CA_ROTOR2_PY": -0.225, "CA_ROTOR3_PX": -0.225, "CA_ROTOR3_PY": 0.225,
    "MPC_THR_HOVER": 0.42, "MIS_TAKEOFF_ALT": TAKE_OFF_M, "COM_RC_IN_MODE": 1, "COM_DISARM_PRFLT": -1,
    "NAV_DLL_ACT": 0, "SDLOG_MODE": -1, "SIM_BAT_MIN_PCT": 95, "IMU_GYRO_FFT_EN": 0, "SYS_FAILURE_EN": 1,
}  # fmt: skip


@dataclass(frozen=True)
class Moment:
    """One row of the truth: NED [m], degrees."""

    time_s: float
    north: float
    east: float
    height: float
    tilt_deg: float
    contact: bool


def speaks(companion: subprocess.Popen[bytes], heartbeat: object) -> bool:
    """Whether the companion that was started speaks.

    RuntimeError where it has ended: a heartbeat is then of another one, which an earlier flight left at its port.
    """
    if companion.poll() is not None:
        raise RuntimeError(f"the companion ended with {companion.returncode}: see companion.log")
    return heartbeat is not None


class Relay:
    """Between firmware and companion (UDP, 127.0.0.1): rotor speeds of the physics, and not all positions.

    ArduCopter has no speeds over its interface. PX4 computes them from its outputs: its ESC_STATUS
    is withheld. Positions are LOCAL_POSITION_NED.
    """

    def __init__(
        self,
        firmware_port: int,
        companion_port: int,
        position_hz: float = 0.0,
        speeds_port: int | None = None,
    ) -> None:
        """``position_hz`` 0: all positions."""
        self._firmware = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._firmware.bind(("127.0.0.1", firmware_port))
        self._companion = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._to_companion = ("127.0.0.1", companion_port)
        self._heard = [self._firmware, self._companion]
        self._speeds: socket.socket | None = None
        if speeds_port is not None:
            self._speeds = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._speeds.bind(("127.0.0.1", speeds_port))
            self._heard.append(self._speeds)
        self._period_ms = 1000.0 / position_hz if position_hz else 0.0
        self._next_ms = 0.0

    def thinned(self, data: bytes) -> bytes:
        """The frames of one datagram (MAVLink 2) without speeds, and positions that come too soon."""
        out, at = b"", 0
        while at + 12 <= len(data) and data[at] == 0xFD:
            end = at + 12 + data[at + 1] + (13 if data[at + 2] & 1 else 0)
            frame = data[at:end]
            at = end
            if self._speeds is not None and frame[7:10] == ESC_STATUS_ID:
                continue
            if self._period_ms and frame[7:10] == b"\x20\x00\x00":
                stamp_ms = int.from_bytes(frame[10:14], "little")
                if stamp_ms < self._next_ms:
                    continue
                self._next_ms = (
                    max(self._next_ms, stamp_ms - 0.5 * self._period_ms) + self._period_ms
                )
            out += frame
        return out + data[at:]

    def run(self, alive: Callable[[], bool]) -> None:
        """Until ``alive`` says no."""
        peer = None
        while alive():
            for sock in select.select(self._heard, [], [], 0.5)[0]:
                try:
                    data, sender = sock.recvfrom(65536)
                except OSError:  # nobody listens yet
                    continue
                if sock is self._firmware:
                    peer, data = sender, self.thinned(data)
                    if data:
                        self._companion.sendto(data, self._to_companion)
                elif sock is self._speeds:
                    if peer is not None:
                        self._companion.sendto(data, self._to_companion)
                elif peer is not None:
                    self._firmware.sendto(data, peer)


class Rig:
    """Everything that runs. Use it as a context manager; every process ends with it."""

    def __init__(
        self,
        firmware: str,
        binary: str,
        folder: Path,
        parameters: dict[str, float] | None = None,
        *,
        seed: int = 0,
        position_hz: float = 0.0,
        air: str = "calm",
        mass_times: float = 1.0,
        options: Sequence[str] = ("--no-offsets",),
        vehicle: Path = QUAD,
    ) -> None:
        """``seed`` draws air and sensors; ``position_hz``: no more positions than this reach the companion (0: all).

        ``air``: as in rough_air.py; ``mass_times``: of the vehicle file's mass; ``options``: of the companion;
        ``vehicle``: the file.
        """
        self.px4 = firmware == PX4
        self._air = ["--seed", str(seed), "--air", air, "--mass-times", str(mass_times)]
        self._options = tuple(options)
        self._vehicle = vehicle
        self._position_hz = position_hz
        self.folder = folder
        self._wrong_file = folder / "wrong.json"
        self._binary = Path(binary).resolve()
        self._parameters = parameters or {}
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._latest: dict[tuple[str, int], Any] = {}
        self._alive = True
        self._sticks = False
        self._lock = threading.Lock()
        self._companions = 0
        self.texts: list[str] = []
        self.estimates: list[tuple[float, float, float, float]] = []
        """Boot time [s] and place NED [m], as the autopilot believes."""
        self.heading_deg: float | None = None
        """Of all places that the companion is asked for; None: whichever it has."""

    def __enter__(self) -> Rig:
        try:
            self._boot()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End every process of ours."""
        self._alive = False
        for name in ("companion", "firmware", "physics"):
            process = self._processes.pop(name, None)
            if process is None:
                continue
            with contextlib.suppress(ProcessLookupError):
                process.send_signal(signal.SIGCONT)
                process.send_signal(signal.SIGINT if name == "companion" else signal.SIGKILL)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(10)
            if process.poll() is None:
                process.kill()

    # -- start ------------------------------------------------------------------------------------------------------

    def _start(self, name: str, command: list[Any], **how: Any) -> None:
        log = (self.folder / f"{name}.log").open("ab")
        self._processes[name] = subprocess.Popen(
            [str(c) for c in command],
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            **how,
        )

    def _boot(self) -> None:
        link = ["--px4-hil", 4560] if self.px4 else ["--ardupilot-json", 9002]
        link += ["--wrong", self._wrong_file, "--speeds-port", SPEEDS_PORT]
        physics = [
            sys.executable,
            Path(__file__).with_name("physics.py"),
            "--vehicle",
            self._vehicle,
            "--scenario",
            "corner",
        ]
        self._start("physics", [*physics, *self._air, *link, "--truth", self.folder / "truth.csv"])
        give_up = time.monotonic() + 60.0
        while b"{" not in (self.folder / "physics.log").read_bytes():
            assert time.monotonic() < give_up, (
                f"the physics did not start; see {self.folder}/physics.log"
            )
            time.sleep(0.1)
        (self._boot_px4 if self.px4 else self._boot_arducopter)()
        station = 14550 if self.px4 else 14551
        self._link = mavutil.mavlink_connection(
            f"udpin:127.0.0.1:{station}", source_system=255, source_component=190
        )
        if self._link.wait_heartbeat(timeout=180) is None:
            raise RuntimeError(f"no heartbeat; see {self.folder}/firmware.log")
        threading.Thread(target=self._listen, daemon=True).start()
        threading.Thread(target=self._beat, daemon=True).start()
        for number, hz in ((30, 10), (32, 25), (193, 2), (230, 2), (245, 2), (83, 5)):
            self._command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, 1e6 / hz)

    def _boot_arducopter(self) -> None:
        values = {**ARDUCOPTER_PARAMETERS, **self._parameters}
        defaults = self.folder / "defaults.parm"
        defaults.write_text("".join(f"{k} {v}\n" for k, v in values.items()), encoding="utf-8")
        self._start(
            "firmware",
            [self._binary, "--model", "JSON:127.0.0.1", "--wipe", "--speedup", "1", "--defaults", defaults,
             "--home", "-35.363262,149.165237,584,0", "--serial0", "udpclient:127.0.0.1:14551",
             "--serial1", "udpclient:127.0.0.1:14550"],
            cwd=self.folder,
        )  # fmt: skip

    def _boot_px4(self) -> None:
        values = {**PX4_PARAMETERS, **self._parameters}
        environment = dict(os.environ, PX4_SIM_MODEL="none_iris", PX4_SYS_AUTOSTART="10016")
        environment |= {f"PX4_PARAM_{k}": str(v) for k, v in values.items()}
        root = self.folder / "rootfs"
        root.mkdir(exist_ok=True)
        etc = self._binary.parent.parent / "etc"
        self._start("firmware", [self._binary, "-d", "-w", root, etc], cwd=root, env=environment)

    # -- ground station ---------------------------------------------------------------------------------------------

    def _listen(self) -> None:
        while self._alive:
            try:
                message = self._link.recv_match(blocking=True, timeout=0.5)
            except OSError:
                continue
            if message is None:
                continue
            self._latest[message.get_type(), message.get_srcComponent()] = message
            if message.get_type() == "STATUSTEXT":
                self.texts.append(message.text)
            elif message.get_type() == "LOCAL_POSITION_NED":
                self.estimates.append(
                    (message.time_boot_ms / 1000.0, message.x, message.y, message.z)
                )

    def _beat(self) -> None:
        n = 0
        while self._alive:
            with self._lock:
                if n % 10 == 0:
                    self._link.mav.heartbeat_send(6, 8, 0, 0, 0)
                if self._sticks and self.px4:
                    self._link.mav.manual_control_send(1, 0, 0, 500, 0, 0)
                elif self._sticks:
                    self._link.mav.rc_channels_override_send(
                        1, 1, 1500, 1500, 1500, 1500, 0, 0, 0, 0
                    )
            n += 1
            time.sleep(0.1)

    def latest(self, kind: str, component: int = 1) -> Any:
        """The last message of a kind, or None."""
        return self._latest.get((kind, component))

    @property
    def now_s(self) -> float:
        """The autopilot's boot time."""
        attitude = self.latest("ATTITUDE")
        return 0.0 if attitude is None else attitude.time_boot_ms / 1000.0

    def sleep(self, seconds: float) -> None:
        """In the autopilot's time."""
        self.until(
            lambda end=self.now_s + seconds: self.now_s >= end, seconds + 5.0, "time to pass"
        )

    def until(self, reached: Callable[[], bool], seconds: float, what: str) -> None:
        """Wait for something; raises AssertionError after ``seconds`` of the autopilot."""
        give_up = time.monotonic() + SLOW_MACHINE * seconds
        while not reached():
            if self._processes["firmware"].poll() is not None:
                raise AssertionError(f"the firmware ended; see {self.folder}/firmware.log")
            assert time.monotonic() < give_up, f"waited for {what}; last words: {self.texts[-3:]}"
            time.sleep(0.02)

    def _command(self, number: int, *values: float) -> None:
        p = [*values, *[0.0] * (7 - len(values))]
        with self._lock:
            self._link.mav.command_long_send(1, 1, number, 0, *p)

    def mode(self, mode: tuple[int, int]) -> None:
        """Ask for a mode: ArduCopter's number, or PX4's main and sub mode."""
        self._command(mavlink.MAV_CMD_DO_SET_MODE, 1.0 if not self.px4 else 129.0, *mode)

    @property
    def in_mode(self) -> int:
        """ArduCopter's mode number, or PX4's main mode."""
        beat = self.latest("HEARTBEAT")
        return (
            -1
            if beat is None
            else (beat.custom_mode >> 16 & 0xFF if self.px4 else beat.custom_mode)
        )

    @property
    def armed(self) -> bool:
        """Whether the motors may turn."""
        beat = self.latest("HEARTBEAT")
        return beat is not None and bool(beat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)

    def take_off(self) -> None:
        """Arm and climb to 1.5 m by the firmware's own take-off."""
        self._sticks = True
        self.until(
            lambda: self.latest("LOCAL_POSITION_NED") is not None, 90.0, "a position estimate"
        )
        self.sleep(12.0)

        def arm() -> bool:
            self.mode(TAKEOFF if self.px4 else GUIDED)
            time.sleep(0.3)
            self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
            time.sleep(1.0)
            return self.armed

        self.until(arm, 90.0, "arming")
        if not self.px4:
            self._command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, TAKE_OFF_M)
        self.until(lambda: self.height > 0.85 * TAKE_OFF_M, 40.0, "the take-off's height")
        self.sleep(4.0)

    @property
    def height(self) -> float:
        """As the autopilot believes."""
        position = self.latest("LOCAL_POSITION_NED")
        return 0.0 if position is None else -float(position.z)

    def go(
        self,
        north: float,
        east: float,
        height: float,
        velocity: tuple[float, float, float] | None = None,
    ) -> None:
        """One place for the companion, north, east and up; with a velocity it is one that moves."""
        mask = (0x38 if velocity is None else 0) | 0x1C0 | 0x800
        if self.heading_deg is None:
            mask |= 0x400
        yaw = math.radians(self.heading_deg or 0.0)
        vn, ve, up = velocity or (0.0, 0.0, 0.0)
        with self._lock:
            self._link.mav.set_position_target_local_ned_send(
                0, 1, 191, 1, mask, north, east, -height, vn, ve, -up, 0, 0, 0, yaw, 0
            )

    def lose_gps(self) -> None:
        """No fix from now on."""
        if self.px4:
            self._command(mavlink.MAV_CMD_INJECT_FAILURE, 4, 1)  # sensor GPS, off
        else:
            for name, value in (("SIM_GPS1_ENABLE", 0.0), ("SIM_GPS_DISABLE", 1.0)):
                self.set_parameter(name, value)

    def go_wrong(self, wrong: wrong_sensors.Wrong) -> None:
        """What is wrong with the sensors from now on."""
        wrong_sensors.write(self._wrong_file, wrong)

    def set_parameter(self, name: str, value: float) -> None:
        """One parameter of ArduCopter, in flight."""
        with self._lock:
            self._link.mav.param_set_send(1, 1, name.encode(), value, mavlink.MAV_PARAM_TYPE_REAL32)

    def freeze_ground_range(self) -> None:
        """The beam that looks down repeats itself; asked again, it works again."""
        self._processes["physics"].send_signal(signal.SIGUSR1)

    def stand_still(self, seconds: float) -> None:
        """Physics and, in lockstep with it, the autopilot: their time stops while everybody else's goes on."""
        self._processes["physics"].send_signal(signal.SIGSTOP)
        time.sleep(seconds)
        self._processes["physics"].send_signal(signal.SIGCONT)

    # -- the companion ----------------------------------------------------------------------------------------------

    def start_companion(self) -> None:
        """As a user does, at the firmware's own endpoint."""
        port = 14540 if self.px4 else 14550
        if self._companions == 0:
            relay = Relay(port, port + RELAYED, self._position_hz, SPEEDS_PORT)
            threading.Thread(target=relay.run, args=(lambda: self._alive,), daemon=True).start()
        port += RELAYED
        self._companions += 1
        self._latest.pop(("HEARTBEAT", 191), None)  # of the one before
        name = self.folder / ("flight" if self._companions == 1 else f"flight{self._companions}")
        command = [
            sys.executable,
            "-m",
            "companion",
            "--connect",
            f"udp:127.0.0.1:{port}",
            "--vehicle",
            self._vehicle,
        ]
        environment = dict(os.environ, OMP_NUM_THREADS="1")
        self._start(
            "companion",
            [
                *command,
                *self._options,
                "--record",
                self.folder / f"{name}.tlog",
                "--json",
                self.folder / f"{name}.json",
            ],
            env=environment,
        )

    def signal_companion(self, number: int) -> None:
        """SIGINT, SIGKILL, SIGSTOP, SIGCONT."""
        self._processes["companion"].send_signal(number)

    def engage(self) -> None:
        """Companion up, the mode that obeys it, and its stream in command."""
        self.start_companion()
        started = self._processes["companion"]
        self.until(
            lambda: speaks(started, self.latest("HEARTBEAT", 191)),
            30.0,
            "the companion's heartbeat",
        )
        self.sleep(4.0)
        wanted = OFFBOARD if self.px4 else GUIDED

        def entered() -> bool:
            self.mode(wanted)
            time.sleep(0.3)
            return self.in_mode == wanted[0]

        self.until(entered, 20.0, "OFFBOARD or GUIDED")
        self.sleep(4.0)

    # -- the truth --------------------------------------------------------------------------------------------------

    @property
    def true_time_s(self) -> float:
        """Of the last row of the truth."""
        with (self.folder / "truth.csv").open("rb") as file:
            file.seek(-400, os.SEEK_END)
            return float(file.read().split(b"\n")[-2].split(b",")[0])

    def truth(self) -> list[Moment]:
        """Everything up to now."""
        from math import acos, cos, degrees

        out = []
        with (self.folder / "truth.csv").open(encoding="utf-8", newline="") as file:
            for r in csv.DictReader(file):
                try:
                    tilt = degrees(
                        acos(max(-1.0, min(1.0, cos(float(r["roll"])) * cos(float(r["pitch"])))))
                    )
                    place = float(r["n"]), float(r["e"]), -float(r["d"])
                    out.append(Moment(float(r["time_s"]), *place, tilt, r["contact"] == "1"))
                except (TypeError, ValueError):  # the row that is being written
                    break
        return out
