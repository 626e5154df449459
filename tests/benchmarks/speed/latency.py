"""Message in -> command out against a bare pymavlink receiver on the same stream, in one run.

    python tests/benchmarks speed.latency [--seconds 60] [--turns 5] [--rate 400 1300] [--floor] [--held-to 0.1]

One generator process sends a hovering vehicle's stream over loopback UDP at a steady rate. In turns,
(a) a bare pymavlink receiver answers each ATTITUDE_QUATERNION with a fixed SET_ATTITUDE_TARGET,
(b) a plain pipeline of pymavlink, filterpy and torch, (c) the companion answers it with what it
decides, adapting, and again with ``--adapt off``. Latency = the generator's clock from sending the
attitude to getting the setpoint that carries its time stamp. CPU = the answering process's own user
and system time while it is measured, over the wall clock; *start-up* = what it used before that, up
to its first answer. Instructions of user code, where the machine counts them (perf). Prints every
turn, and medians of ratios of the turns.
``--rate`` 1300 is what a real ArduCopter sends. ``--floor`` also measures (d) a loop that reads, checks and answers
with the companion's own frames and nothing else, and (e) the companion with an empty decision: all is decoded, a fixed
setpoint sent; what (c) takes beyond (e) is what deciding costs. ``--held-to`` 0.1 stops the companion for nine tenths
of the time, in turns of 20 ms, as a computer of a tenth of the speed would; prints what it answered and what it said.
At the end: what each kind of message costs the companion, on a recording of this stream (``message_profile.py``).
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import resource
import shutil
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import command_line
import numpy as np
from flight_process import flight_command
from result_file import add_option, figure, write_result

import models
from companion.adapt_options import Adapt
from companion.config import PipelineConfig
from companion.mavlink.dialect import mavlink
from companion.vehicles import vehicle_path
from models.common.frames import quaternion_from_euler
from models.vehicle import load_vehicle
from speed.message_profile import print_profile, profile

PARAMETERS = {"GUID_OPTIONS": 8.0, "GUID_TIMEOUT": 0.5, "MOT_THST_HOVER": 0.5, "ATC_INPUT_TC": 0.15}
"""What the generator answers as an ArduCopter."""

BARE = """
import os, sys, resource, time
os.environ["MAVLINK20"] = "1"; os.environ["MAVLINK_DIALECT"] = "ardupilotmega"
from pymavlink import mavutil
link = mavutil.mavlink_connection(sys.argv[1], source_system=1, source_component=191)
end = time.monotonic() + float(sys.argv[2])
while time.monotonic() < end:
    m = link.recv_match(blocking=True, timeout=0.2)
    if m is not None and m.get_type() == "ATTITUDE_QUATERNION":
        link.mav.set_attitude_target_send(m.time_boot_ms, 1, 1, 7, [1.0, 0.0, 0.0, 0.0], 0, 0, 0, 0.5)
"""

PLAIN = """
import os, sys, time
os.environ["MAVLINK20"] = "1"; os.environ["MAVLINK_DIALECT"] = "ardupilotmega"
import numpy as np
import torch
from filterpy.kalman import KalmanFilter
from pymavlink import mavutil
torch.set_num_threads(1)
net = torch.nn.Sequential(torch.nn.Linear(3, 9), torch.nn.Tanh(), torch.nn.Linear(9, 6))

def track():
    kf = KalmanFilter(dim_x=2, dim_z=1)
    kf.H, kf.R, kf.P = np.array([[1.0, 0.0]]), np.array([[4e-4]]), np.eye(2)
    kf.stamp = None
    return kf

def follow(kf, t, z=None):
    dt = 0.0 if kf.stamp is None else max(t - kf.stamp, 0.0)
    kf.F = np.array([[1.0, dt], [0.0, 1.0]])
    kf.Q = np.array([[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]])
    kf.predict()
    kf.stamp = t
    if z is not None:
        kf.update(z)
    return float(kf.x[0, 0])

down, ahead, rpm, weight = track(), track(), 4000.0, 45.0
link = mavutil.mavlink_connection(sys.argv[1], source_system=1, source_component=191)
end = time.monotonic() + float(sys.argv[2])
while time.monotonic() < end:
    m = link.recv_match(blocking=True, timeout=0.2)
    if m is None:
        continue
    kind = m.get_type()
    if kind == "DISTANCE_SENSOR":
        follow(down if m.orientation == 25 else ahead, 1e-3 * m.time_boot_ms, 1e-2 * m.current_distance)
    elif kind == "ESC_TELEMETRY_1_TO_4":
        rpm = float(np.sqrt(np.mean(np.square(m.rpm))))
    elif kind == "ATTITUDE_QUATERNION":
        t = 1e-3 * m.time_boot_ms
        h, d = follow(down, t), follow(ahead, t)
        with torch.no_grad():
            fans = torch.tensor([[h, d, rpm / 4000.0]] * 2 + [[h, d + 0.02, rpm / 4000.0]] * 2)
            force = net(fans)[:2].sum(dim=0).tolist()
        roll, pitch = np.clip([force[1] / weight, -force[0] / weight], -0.14, 0.14)
        q = [np.cos(roll / 2) * np.cos(pitch / 2), np.sin(roll / 2), np.sin(pitch / 2), 0.0]
        thrust = float(np.clip(0.5 * (1.0 - 1e-3 * force[2]), 0.0, 1.0))
        link.mav.set_attitude_target_send(m.time_boot_ms, 1, 1, 7, q, 0, 0, 0, thrust)
"""

LOOP = """
import select, socket, struct, sys, time
from companion.mavlink.wire_frames import FrameReader, pack
from companion.mavlink.setpoints import AttitudeCommand, encode
_, host, port = sys.argv[1].split(":")
link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
link.bind((host, int(port)))
end, sequence, reader = time.monotonic() + float(sys.argv[2]), 0, FrameReader()
while time.monotonic() < end:
    if not select.select([link], [], [], 0.02)[0]:
        continue
    data, peer = link.recvfrom(65536)
    for frame in reader.feed(data):
        if frame.id == 31:
            (boot_ms,) = struct.unpack_from("<I", frame.payload)
            answer = AttitudeCommand(boot_ms / 1000.0, (1.0, 0.0, 0.0, 0.0), 0.5)
            link.sendto(pack(*encode(answer, 1), 1, 191, sequence), peer)
            sequence = (sequence + 1) % 256
"""

EMPTY = """
import sys
from companion.cli import main
from companion.control.compensation import Offset
from companion.flight import loop
from companion.mavlink.samples import Attitude
from companion.mavlink.setpoints import AttitudeCommand
from companion.state.decision import Decision

def answer(state, sample, config):
    if type(sample) is not Attitude:
        return state, None
    command = AttitudeCommand(sample.t_s, (1.0, 0.0, 0.0, 0.0), 0.5)
    return state, Decision(sample.t_s, command, (), 0.0, Offset(), None, None)

loop.answer, loop.settle = answer, lambda state, sample, decision, config: state
sys.exit(main(["--vehicle", "tandem", "--connect", sys.argv[1], "--duration", sys.argv[2], "--quiet"]))
"""
FLOOR = {"loop": LOOP, "empty decision": EMPTY}


FIGURES = (
    ("p50 over the plain pipeline's", "p50_of_plain", 0.6),
    ("processor time over the plain pipeline's", "cpu_of_plain", 0.55),
    ("instructions over the plain pipeline's", "instructions_of_plain", 0.55),
    ("memory over the plain pipeline's", "memory_of_plain", 0.2),
    ("p99 above the bare receiver's [ms]", "p99_over_ms", 0.3),
    ("p50 over the bare receiver's", "p50_of_bare", 1.0),
    ("processor time over the bare receiver's", "cpu_of_bare", 1.0),
    ("without adaptation: p50 over the plain pipeline's", "p50_off_of_plain", 0.6),
    ("without adaptation: processor time over the plain pipeline's", "cpu_off_of_plain", 0.55),
)
"""What, its key in the answer, and its goal: at most this."""
OFF = "adapt off"
"""The companion again, which then measures no sizes."""
_TICKS = os.sysconf("SC_CLK_TCK")
_PATIENCE_S = 60.0
"""For the first answer."""
_WARM_UP_S = 5.0
"""From the first answer on; then it is measured."""
_RECORDED_S = 10.0
"""Of the stream, for the table by message kind."""


@dataclass(frozen=True, kw_only=True)
class Streamed:
    """What the generator saw of one answering process."""

    latencies_s: list[float]
    sent: int
    """Attitudes."""
    rss_mib: float
    startup_s: float
    """Processor time up to the first answer."""
    cpu_s: float
    """Processor time from the end of the warm-up on."""
    instructions: float
    """Of user code, since then; NaN where the machine counts none."""


@dataclass(frozen=True, kw_only=True)
class Turn:
    """One answering process for one turn. NaN: not known."""

    p50_ms: float
    p99_ms: float
    answered: float
    """Share of the attitudes."""
    cpu_percent: float
    """Of one core, start-up apart."""
    startup_s: float
    rss_mib: float
    minstructions_s: float
    """Million instructions of user code a second."""


def main() -> None:
    parser = command_line.parser(__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="of each turn")
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument(
        "--rate", type=float, nargs="+", default=[400.0], help="messages per second"
    )
    parser.add_argument(
        "--floor", action="store_true", help="also a bare loop and an empty decision"
    )
    parser.add_argument(
        "--held-to", type=float, metavar="SHARE", help="also with this share of a core"
    )
    parser.add_argument("--json", type=Path, metavar="FILE")
    add_option(parser)
    a = parser.parse_args()
    names = ("bare", "plain", "companion", OFF, *(FLOOR if a.floor else ()))
    answer: dict[str, Any] = {}
    for rate in a.rate:
        print(f"{rate:g} messages/s")
        rounds = [{name: measure(name, a.seconds, rate) for name in names} for _ in range(a.turns)]
        print_turns(rounds)
        answer[f"{rate:g}"] = ratios(rounds)
        print_ratios(answer[f"{rate:g}"])
    if a.held_to is not None:
        answer["held"] = held(a.seconds, a.rate[0], a.held_to)
    by_kind(a.rate[0])
    if a.json is not None:
        a.json.write_text(json.dumps(answer, indent=2) + "\n")
    figures = []
    for rate in a.rate:
        for what, key, goal in FIGURES:
            low, value, high = answer[f"{rate:g}"][key]
            if not math.isnan(value):
                shown = f"{value:.2f} ({low:.2f} to {high:.2f})"
                said = f"{rate:g} messages/s: {what}"
                figures.append(figure(said, shown, goal=f"{goal:g}", met=value <= goal))
    write_result(a, figures, seeds=f"{a.turns} turns of {a.seconds:g} s: median and range")


def print_turns(rounds: Sequence[Mapping[str, Turn]]) -> None:
    """A line for every turn, in the order in which they were measured."""
    head = ("p50 ms", "p99 ms", "CPU %", "start-up s", "Minstr/s", "answered", "RSS MiB")
    print(f"{'':16}{''.join(f'{word:>11}' for word in head)}")
    for turns in rounds:
        for name, t in turns.items():
            print(
                f"{name:16}{t.p50_ms:11.3f}{t.p99_ms:11.3f}{t.cpu_percent:11.1f}{t.startup_s:11.2f}"
                f"{t.minstructions_s:11.1f}{t.answered:11.3f}{t.rss_mib:11.1f}"
            )
    if math.isnan(rounds[0]["bare"].minstructions_s):
        print("instructions: not counted; perf counts none on this machine")


def ratios(rounds: Sequence[Mapping[str, Turn]]) -> dict[str, tuple[float, float, float]]:
    """(least, median, largest) over the turns, of the companion's numbers to those of the others in the same turn."""
    out: dict[str, list[float]] = {key: [] for _, key, _ in FIGURES}
    for turns in rounds:
        ours = turns["companion"]
        plain = turns["plain"]
        bare = turns["bare"]
        out["p50_of_plain"].append(ours.p50_ms / plain.p50_ms)
        out["cpu_of_plain"].append(ours.cpu_percent / plain.cpu_percent)
        out["instructions_of_plain"].append(ours.minstructions_s / plain.minstructions_s)
        out["memory_of_plain"].append(ours.rss_mib / plain.rss_mib)
        out["p99_over_ms"].append(ours.p99_ms - bare.p99_ms)
        out["p50_of_bare"].append(ours.p50_ms / bare.p50_ms)
        out["cpu_of_bare"].append(ours.cpu_percent / bare.cpu_percent)
        out["p50_off_of_plain"].append(turns[OFF].p50_ms / plain.p50_ms)
        out["cpu_off_of_plain"].append(turns[OFF].cpu_percent / plain.cpu_percent)
    return {key: (min(v), statistics.median(v), max(v)) for key, v in out.items()}


def print_ratios(known: Mapping[str, tuple[float, float, float]]) -> None:
    """A line for each figure."""
    for what, key, goal in FIGURES:
        low, value, high = known[key]
        print(f"{what:<44}{value:8.2f}  ({low:.2f} to {high:.2f}), goal {goal:g}")


def held(seconds: float, rate: float, share: float) -> dict[str, float]:
    """The companion on a share of a core: prints what it answered and what it said."""
    with tempfile.TemporaryDirectory() as folder:
        turn = measure("companion", seconds, rate, held_to=share, folder=Path(folder))
        print(
            f"held to {share:g} of a core: p50 {turn.p50_ms:.1f} ms, p99 {turn.p99_ms:.1f} ms, "
            f"answered {turn.answered:.3f}"
        )
        print((Path(folder) / "said").read_text())
        with contextlib.suppress(
            OSError
        ):  # the report of a process that was too slow to end in time
            report = json.loads((Path(folder) / "report.json").read_text())
            wanted = (
                "decisions",
                "commands",
                "compensated_s",
                "gravest_s",
                "refusals_s",
                "latency_ms",
            )
            print(json.dumps({key: report[key] for key in wanted}, indent=1))
    return {
        "share_of_core": share,
        "p50_ms": turn.p50_ms,
        "p99_ms": turn.p99_ms,
        "answered": turn.answered,
    }


def by_kind(rate: float) -> None:
    """What each kind of message costs, with adaptation as by default: a recording of the stream is replayed."""
    with tempfile.TemporaryDirectory() as folder:
        record = Path(folder) / "stream.tlog"
        measure("companion", _RECORDED_S, rate, options=("--record", str(record)))
        config = PipelineConfig(
            vehicle=load_vehicle(vehicle_path("tandem")), model=models.load(), adapt=Adapt.FULL
        )
        print_profile(profile(record, config))


def hold_back(pid: int, share: float, over: threading.Event) -> None:
    """Let a process run for ``share`` of every 20 ms only."""
    with contextlib.suppress(ProcessLookupError):
        while not over.is_set():
            os.kill(pid, signal.SIGSTOP)
            time.sleep(0.02 * (1.0 - share))
            os.kill(pid, signal.SIGCONT)
            time.sleep(0.02 * share)


def measure(
    name: str,
    seconds: float,
    rate: float,
    *,
    held_to: float = 1.0,
    folder: Path | None = None,
    options: Sequence[str] = (),
) -> Turn:
    """One turn of one answering process.

    ``folder`` takes what the companion says and its report. ``options``: of the companion.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    endpoint = f"udpin:127.0.0.1:{port}"
    script = {"bare": BARE, "plain": PLAIN, **FLOOR}.get(name)
    # Longer than the stream, whatever its own start takes: it is ended when the stream is over.
    lasts = str(seconds + _WARM_UP_S + _PATIENCE_S)
    if script is not None:
        command = [sys.executable, "-c", script, endpoint, lasts]
    else:
        said_how = ("--quiet",) if folder is None else ("--json", str(folder / "report.json"))
        if name == OFF:
            options = (*options, "--adapt", "off")
        command = flight_command(port, "--duration", lasts, *said_how, *options)
    with open(os.devnull if folder is None else folder / "said", "w", encoding="utf-8") as said:
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        stderr = None if folder is None else said
        process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=stderr, env=environment
        )
    over = threading.Event()
    if held_to < 1.0:
        threading.Thread(target=hold_back, args=(process.pid, held_to, over), daemon=True).start()
    try:
        seen = stream(port, seconds, rate, process.pid)
        over.set()
        process.terminate()
        process.wait(60)
    finally:
        over.set()
        process.kill()
        process.wait()
    ms = 1e3 * np.array(seen.latencies_s or [np.nan])
    return Turn(
        p50_ms=float(np.percentile(ms, 50)),
        p99_ms=float(np.percentile(ms, 99)),
        answered=len(seen.latencies_s) / max(seen.sent, 1),
        cpu_percent=100.0 * seen.cpu_s / seconds,
        startup_s=seen.startup_s,
        rss_mib=seen.rss_mib,
        minstructions_s=seen.instructions / 1e6 / seconds,
    )


def counted(pid: int, seconds: float) -> subprocess.Popen[str] | None:
    """perf, which counts the instructions of a process from now on; None without perf."""
    perf = shutil.which("perf")
    if perf is None:
        return None
    count = [perf, "stat", "-x", ",", "-e", "instructions:u", "-p", str(pid)]
    return subprocess.Popen(
        [*count, "--timeout", f"{1e3 * seconds:.0f}"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )


def instructions(counter: subprocess.Popen[str] | None) -> float:
    """What perf counted; NaN where the machine counts none."""
    if counter is None:
        return math.nan
    _, said = counter.communicate(timeout=60)
    for line in said.splitlines():
        number, _, _ = line.partition(",")
        if number.isdigit():
            return float(number)
    return math.nan


def cpu_s(pid: int) -> float:
    """User and system time of one process [s]; NaN once it is gone."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    except OSError:
        return math.nan
    return (int(fields[11]) + int(fields[12])) / _TICKS


def stream(port: int, seconds: float, rate: float, pid: int) -> Streamed:
    """Send to the process ``pid`` for ``seconds`` from the end of its warm-up on."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.bind(("127.0.0.1", 0))
    sock.connect(("127.0.0.1", port))
    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    sent_at: dict[int, float] = {}
    latencies: list[float] = []
    cycle, others = (8.0 / rate, 0) if rate <= 500.0 else (0.02, round(0.02 * rate) - 8)
    due = time.monotonic()
    begin = due + _PATIENCE_S
    tick = 0
    sent = 0
    rss = 0.0
    startup_s = math.nan
    warm_s = math.nan
    counter = None

    def send(message: object) -> None:
        raw = message.pack(mav)  # type: ignore[attr-defined]
        mav.seq = (mav.seq + 1) % 256
        with contextlib.suppress(ConnectionRefusedError):
            sock.send(raw)

    def receive(until: float) -> None:
        nonlocal startup_s, begin
        while True:
            left = until - time.monotonic()
            if left <= 0:
                return
            sock.settimeout(left)
            try:
                data = sock.recv(65536)
            except (TimeoutError, ConnectionRefusedError):
                continue
            now = time.monotonic()
            for message in parser.parse_buffer(data) or ():
                kind = message.get_type()
                if kind == "SET_ATTITUDE_TARGET":
                    at = sent_at.pop(message.time_boot_ms, None)
                    if math.isnan(startup_s):
                        startup_s = cpu_s(pid)
                        begin = now + _WARM_UP_S
                    if at is not None and at > begin:
                        latencies.append(now - at)
                elif kind == "PARAM_REQUEST_READ" and message.param_id in PARAMETERS:
                    value = PARAMETERS[message.param_id]
                    send(mav.param_value_encode(message.param_id.encode(), value, 9, 1, 0))

    while time.monotonic() < begin + seconds:
        ms = 20000 + round(tick * cycle * 1000)
        h = 0.3 + 0.1 * np.sin(tick / 60.0)
        send(mav.heartbeat_encode(2, 3, 128, 4, 4))
        send(mav.extended_sys_state_encode(0, 2))
        send(mav.highres_imu_encode(ms * 1000, 0, 0, -9.81, 0, 0, 0, 0, 0, 0, 1013, 0, 0, 20, 63))
        send(
            mav.esc_telemetry_1_to_4_encode(
                [20] * 4, [0] * 4, [0] * 4, [0] * 4, [4000] * 4, [tick % 65536] * 4
            )
        )
        send(mav.distance_sensor_encode(ms, 5, 4000, round((h - 0.05) * 100), 0, 0, 25, 0))
        send(mav.distance_sensor_encode(ms, 5, 4000, 40, 0, 1, 2, 0))
        send(mav.local_position_ned_encode(ms, 0, 0, -h, 0, 0, 0))
        for _ in range(others):
            send(mav.vfr_hud_encode(0, 0, 0, 0, 0, 0))
        # The attitude comes by itself, so that its answer is not behind the rest of the cycle in the queue.
        receive(due + 0.5 * cycle)
        q = quaternion_from_euler(0.0, 0.0, 0.1)
        now = time.monotonic()
        sent_at[ms] = now
        if now > begin and math.isnan(warm_s):
            warm_s = cpu_s(pid)
            counter = counted(pid, seconds)
        sent += now > begin
        send(mav.attitude_quaternion_encode(ms, *q, 0, 0, 0))
        due += cycle
        tick += 1
        receive(due)
        if tick % 100 == 0:
            with contextlib.suppress(OSError):
                pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
                rss = max(rss, pages * resource.getpagesize() / 2**20)
    used_s = cpu_s(pid) - warm_s
    sock.close()
    return Streamed(
        latencies_s=latencies,
        sent=sent,
        rss_mib=rss,
        startup_s=startup_s,
        cpu_s=used_s,
        instructions=instructions(counter),
    )


if __name__ == "__main__":
    main()
