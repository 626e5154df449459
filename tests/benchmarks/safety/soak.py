"""An hour of the flight program on the built-in vehicle at full rate: memory, lost messages, latency, all over time.

``python tests/benchmarks safety.soak [--seconds 3600] [--px4] [--records DIR] [--json FILE]``

The vehicle flies the corner again and again in real time, in a process of its own; the flight program is the command
as installed, with a recording. This process stands between the two on loopback UDP: it asks for more messages, as a
ground station does, until the link carries what a real ArduCopter's carries (1 290 messages per second), and measures
from outside:

- memory: resident set of the flight program, and its slope by least squares after the first tenth of the time;
- lost messages: what the kernel dropped at the flight program's socket, what it counts as damaged, and what was
  passed on and not received;
- latency: from passing on an ATTITUDE_QUATERNION to the SET_ATTITUDE_TARGET with its stamp, p50 and p99 minute by
  minute, and the slope of the p50. It holds the delays of this process and of whatever else the machine does.
"""

from __future__ import annotations

import contextlib
import json
import os
import resource
import select
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path

import command_line
import numpy as np
from flight_process import flight_command
from result_file import add_option, figure, write_result
from simulated import Px4Pilot, simulated

from companion.mavlink.dialect import mavlink
from companion.mavlink.wire_frames import cut
from companion.sim.pilot import ScriptedPilot
from companion.sim.process import free_port, launch
from companion.sim.scenario import build
from companion.vehicles import default_vehicle
from models.common.progress import Bars

ATTITUDE_QUATERNION = 31
SET_ATTITUDE_TARGET = 82
FILLERS = (29, 30, 36, 105)
FILLER_HZ = 230.0
"""SCALED_PRESSURE, ATTITUDE, SERVO_OUTPUT_RAW, HIGHRES_IMU: nobody here needs so many, they fill the link."""
SAMPLE_S = 10.0
WINDOW_S = 60.0
ASK_S = 20.0
STILL_S = 12.0
"""From the start until the vehicle has taken off and the flight program flies."""
_BUFFER = 1 << 20


@dataclass
class Window:
    """One minute: end [s from the start], latencies [ms], attitudes passed on and answered."""

    end_s: float
    p50_ms: float
    p99_ms: float
    attitudes: int
    answered: int


@dataclass
class Soak:
    """What was seen."""

    seconds: float = 0.0
    passed_on: int = 0
    kernel_dropped: int = 0
    rss: list[tuple[float, float]] = field(default_factory=list)
    """Seconds, MiB."""
    windows: list[Window] = field(default_factory=list)
    cpu_share: float = 0.0

    @property
    def memory_slope_mib_h(self) -> float:
        """After the first tenth; NaN for fewer than three samples."""
        late = [(t, m) for t, m in self.rss if t > 0.1 * self.seconds]
        return slope(late) * 3600.0

    @property
    def latency_slope_ms_h(self) -> float:
        """Of the median."""
        return slope([(w.end_s, w.p50_ms) for w in self.answered_windows]) * 3600.0

    @property
    def answered_windows(self) -> list[Window]:
        """Minutes in which the flight program flew."""
        return [w for w in self.windows if w.answered]


def slope(points: list[tuple[float, float]]) -> float:
    """Least squares, per second."""
    if len(points) < 3:
        return float("nan")
    t, y = np.array(points).T
    return float(np.polyfit(t - t.mean(), y, 1)[0])


def resident_mib(pid: int) -> float:
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def cpu_s(pid: int) -> float:
    """User and system time of a process."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def dropped_at(port: int) -> int:
    """Datagrams that the kernel dropped at this UDP port so far."""
    rows = (line.split() for line in Path("/proc/net/udp").read_text().splitlines()[1:])
    return sum(int(row[-1]) for row in rows if row[1].endswith(f":{port:04X}"))


class Between:
    """The wire: everything passes through, and is looked at."""

    def __init__(self, front: socket.socket, to_companion: tuple[str, int]) -> None:
        self.front = front
        self.back = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        for sock in (self.front, self.back):
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
            sock.setblocking(False)
        self.back.bind(("127.0.0.1", 0))
        self._companion = to_companion
        self._vehicle: tuple[str, int] | None = None
        self._station = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self._asked_s = 0.0
        self._answers = False
        self._waiting: dict[int, float] = {}
        self.passed_on = self.attitudes = 0
        self.latencies: list[float] = []

    def turn(self, timeout_s: float) -> None:
        """Pass on what waits."""
        ready, _, _ = select.select([self.front, self.back], [], [], timeout_s)
        for sock in ready:
            with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
                while True:
                    data, peer = sock.recvfrom(65536)
                    self._down(data, peer) if sock is self.front else self._up(data)

    def _down(self, data: bytes, peer: tuple[str, int]) -> None:
        self._vehicle = peer
        frame = cut(data, 0)
        if frame.id == ATTITUDE_QUATERNION:
            self.attitudes += 1
            self._waiting[struct.unpack_from("<I", frame.payload.ljust(4, b"\0"))[0]] = (
                time.monotonic()
            )
            if len(self._waiting) > 200:
                self._waiting.pop(next(iter(self._waiting)))
        self.passed_on += self._answers  # before, there was no socket to receive it
        with contextlib.suppress(ConnectionRefusedError):
            self.back.sendto(data, self._companion)

    def _up(self, data: bytes) -> None:
        now = time.monotonic()
        frame = cut(data, 0)
        self._answers = True
        if frame.id == SET_ATTITUDE_TARGET:
            at = self._waiting.pop(struct.unpack_from("<I", frame.payload.ljust(4, b"\0"))[0], None)
            if at is not None:
                self.latencies.append(now - at)
        if self._vehicle is not None:
            self.front.sendto(data, self._vehicle)

    def fill(self, now_s: float) -> None:
        """Ask for what fills the link."""
        if self._vehicle is None or now_s - self._asked_s < ASK_S:
            return
        self._asked_s = now_s
        for number in FILLERS:
            message = mavlink.MAVLink_command_long_message(
                1, 1, 511, 0, number, 1e6 / FILLER_HZ, 0, 0, 0, 0, 0
            )
            self.front.sendto(message.pack(self._station), self._vehicle)

    def window(self, end_s: float) -> Window:
        """What was seen since the last one."""
        ms = 1e3 * np.array(self.latencies or [np.nan])
        p50, p99 = np.percentile(ms, [50.0, 99.0])
        out = Window(
            end_s, round(float(p50), 3), round(float(p99), 3), self.attitudes, len(self.latencies)
        )
        self.latencies.clear()
        self.attitudes = 0
        return out


def watch(between: Between, pid: int, port: int, seconds: float) -> Soak:
    """Stand between the two for so long; Ctrl-C ends it early."""
    soak = Soak()
    bars = Bars()
    start = time.monotonic()
    sampled = ended = 0.0
    with contextlib.suppress(KeyboardInterrupt, FileNotFoundError):
        while (now := time.monotonic() - start) < seconds:
            between.turn(0.05)
            between.fill(time.monotonic())
            if now - sampled >= SAMPLE_S:
                sampled = now
                soak.rss.append((round(now, 1), round(resident_mib(pid), 3)))
                soak.kernel_dropped = max(soak.kernel_dropped, dropped_at(port))
                soak.cpu_share = cpu_s(pid) / now
                bars("seconds", int(now), int(seconds))
            if now - ended >= WINDOW_S:
                ended = now
                window = between.window(now)
                if now > WINDOW_S + STILL_S:  # the first one holds the take-off
                    soak.windows.append(window)
    bars.close()
    soak.seconds = time.monotonic() - start
    soak.passed_on = between.passed_on
    return soak


def fly(seconds: float, px4: bool, folder: Path, records: Path) -> tuple[Soak, dict[str, object]]:
    """Both processes, and what was seen; the flight program's own report beside it."""
    port = free_port()
    report = folder / "report.json"
    command = flight_command(port, "--quiet", "--json", str(report), "--record", str(records))
    vehicle = default_vehicle()
    front_port = free_port()
    flight = simulated(vehicle, build("corner", vehicle), 0, px4=px4)
    pilot = Px4Pilot if px4 else ScriptedPilot
    with launch(flight, pilot, port=front_port), socket.socket(type=socket.SOCK_DGRAM) as front:
        front.bind(("127.0.0.1", front_port))
        between = Between(front, ("127.0.0.1", port))
        process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, env={**os.environ, "OMP_NUM_THREADS": "1"}
        )
        try:
            soak = watch(between, process.pid, port, seconds)
            process.send_signal(signal.SIGINT)
            until = time.monotonic() + 15.0
            while process.poll() is None and time.monotonic() < until:
                between.turn(0.05)
            soak.passed_on = between.passed_on
        finally:
            process.kill()
            process.wait()
            between.back.close()
    own = json.loads(report.read_text(encoding="utf-8"))
    return soak, {
        k: own[k]
        for k in ("messages", "latency_ms", "reboots", "record", "refusals_s", "slow_messages_hz")
    }


def as_json(soak: Soak, own: dict[str, object]) -> dict[str, object]:
    """Everything that was seen."""
    slopes = {
        "memory_slope_mib_h": soak.memory_slope_mib_h,
        "latency_slope_ms_h": soak.latency_slope_ms_h,
    }
    return {**asdict(soak), **{k: round(v, 4) for k, v in slopes.items()}, "flight_program": own}


def as_text(soak: Soak, own: dict[str, object]) -> str:
    """For a person."""
    messages = own["messages"]
    assert isinstance(messages, dict)
    first = soak.rss[0][1]
    last = soak.rss[-1][1]
    p50s, p99s = (
        [w.p50_ms for w in soak.answered_windows],
        [w.p99_ms for w in soak.answered_windows],
    )
    attitudes, answered = (
        sum(w.attitudes for w in soak.windows),
        sum(w.answered for w in soak.windows),
    )
    lines = [
        f"{soak.seconds:.0f} s at {soak.passed_on / soak.seconds:.0f} messages/s, {100.0 * soak.cpu_share:.0f} % of a "
        "core",
        f"memory     {first:.1f} MiB after {SAMPLE_S:g} s, {last:.1f} MiB at the end; "
        f"slope {soak.memory_slope_mib_h:+.2f} MiB/h after the first tenth",
        f"messages   {soak.passed_on} passed on, {messages['received']} received, {soak.kernel_dropped} dropped by the "
        f"kernel, {messages['bad']} damaged",
    ]
    if p50s:
        lines.append(
            f"latency    p50 {p50s[0]:.2f} ms in the first minute, {p50s[-1]:.2f} in the last, {min(p50s):.2f} to "
            f"{max(p50s):.2f} between; slope {soak.latency_slope_ms_h:+.3f} ms/h; p99 {np.median(p99s):.2f} "
            f"(median), {max(p99s):.2f} (worst minute); {answered} of {attitudes} attitudes answered"
        )
    return "\n".join(lines)


def main() -> int:
    """Fly, and print."""
    p = command_line.parser(__doc__)
    p.add_argument("--seconds", type=float, default=3600.0)
    p.add_argument("--px4", action="store_true")
    p.add_argument(
        "--records", type=Path, metavar="DIR", help="keep the recordings here, for replay audit"
    )
    p.add_argument("--json", type=Path, metavar="FILE")
    add_option(p)
    a = p.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        soak, own = fly(a.seconds, a.px4, Path(folder), a.records or Path(folder))
    print(as_text(soak, own))
    if a.json is not None:
        a.json.write_text(json.dumps(as_json(soak, own), indent=1) + "\n", encoding="utf-8")
    dropped = soak.kernel_dropped
    figures = [
        figure("growth of memory [MiB/h]", f"{soak.memory_slope_mib_h:.2f}"),
        figure("messages dropped", f"{dropped}", f"of {soak.passed_on}", goal="0", met=not dropped),
    ]
    seeds = f"{a.seconds:.0f} s at {soak.passed_on / soak.seconds:.0f} messages/s"
    write_result(a, figures, seeds=seeds, simulated=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
