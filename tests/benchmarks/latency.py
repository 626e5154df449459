"""Message in -> command out against a bare pymavlink receiver on the same stream, in one run.

    python tests/benchmarks/latency.py [--seconds 20] [--rate 400 1300] [--floor] [--held-to 0.1] [--json FILE]

One generator process sends a hovering vehicle's stream over loopback UDP at a steady rate. In turns, (a) a bare
pymavlink receiver answers each ATTITUDE_QUATERNION with a fixed SET_ATTITUDE_TARGET, (b) the companion answers it with
what it decides. Latency = the generator's clock from sending the attitude to getting the setpoint that carries its time
stamp. CPU = the answering process's own user + system time over the wall clock. Prints a table; ratios are what counts.
``--rate`` 1300 is what a real ArduCopter sends. ``--floor`` also measures (c) a loop that reads, checks and answers
with the companion's own frames and nothing else, and (d) the companion with an empty decision: all is decoded, a fixed
setpoint sent; what (b) takes beyond (d) is what deciding costs. ``--held-to`` 0.1 stops the companion for nine tenths
of the time, in turns of 20 ms, as a computer of a tenth of the speed would; prints what it answered and what it said.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import resource
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
from flight_process import flight_command
from result_file import add_option, figure, write_result

from companion.mavlink.dialect import mavlink
from models.common.frames import quaternion_from_euler

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
from companion import flight
from companion.cli import main
from companion.control.compensation import Offset
from companion.mavlink.samples import Attitude
from companion.mavlink.setpoints import AttitudeCommand
from companion.state.decision import Decision

def answer(state, sample, config):
    if type(sample) is not Attitude:
        return state, None
    command = AttitudeCommand(sample.t_s, (1.0, 0.0, 0.0, 0.0), 0.5)
    return state, Decision(sample.t_s, command, (), 0.0, Offset(), None, None)

flight.answer, flight.settle = answer, lambda state, config: state
sys.exit(main(["--vehicle", "tandem", "--connect", sys.argv[1], "--duration", sys.argv[2], "--quiet"]))
"""
FLOOR = {"loop": LOOP, "empty decision": EMPTY}


FIGURES = (
    ("p50 over the plain pipeline's", "p50_of_plain", 0.8),
    ("processor time over the plain pipeline's", "cpu_of_plain", 0.6),
    ("memory over the plain pipeline's", "memory_of_plain", 0.25),
    ("p99 above the bare receiver's [ms]", "p99_over_ms", 0.3),
    ("p50 over the bare receiver's", "p50", 1.0),
    ("processor time over the bare receiver's", "cpu", 1.0),
)
"""What, its key in the answer, and its goal: at most this."""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=20.0)
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
    answer = {
        f"{rate:g}": compare(a.seconds, rate, tuple(FLOOR) if a.floor else ()) for rate in a.rate
    }
    if a.held_to is not None:
        with tempfile.TemporaryDirectory() as folder:
            p50, p99, _, share, _ = measure(
                "companion", a.seconds, a.rate[0], a.held_to, Path(folder)
            )
            print(
                f"held to {a.held_to:g} of a core: p50 {p50:.1f} ms, p99 {p99:.1f} ms, answered {share:.3f}"
            )
            answer["held"] = {
                "share_of_core": a.held_to,
                "p50_ms": p50,
                "p99_ms": p99,
                "answered": share,
            }
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
    if a.json is not None:
        a.json.write_text(json.dumps(answer, indent=2) + "\n")
    figures = [
        figure(f"{rate:g} messages/s: {what}", f"{value:.2f}", goal=f"{goal:g}", met=value <= goal)
        for rate in a.rate
        for what, key, goal in FIGURES
        for value in [answer[f"{rate:g}"][key]]
    ]
    write_result(a, figures, seeds=f"{a.seconds:g} s a turn, twice")


def compare(seconds: float, rate: float, floor: tuple[str, ...]) -> dict[str, float]:
    """All in turns at one rate: prints the table, returns the ratios companion / bare."""
    print(f"{rate:g} messages/s")
    names = ("bare", "plain", "companion", *floor)
    rows = {
        name: measure(name, seconds, rate)
        for name in (*names, *(f"{name} again" for name in names))
    }
    print(f"{'':22}{'p50 ms':>9}{'p99 ms':>9}{'CPU %':>8}{'answered':>10}{'RSS MiB':>9}")
    for name, (p50, p99, cpu, share, rss) in rows.items():
        print(f"{name:22}{p50:9.3f}{p99:9.3f}{cpu:8.1f}{share:10.3f}{rss:9.1f}")
    bare, plain, ours = (
        np.mean([rows[n], rows[f"{n} again"]], axis=0) for n in ("bare", "plain", "companion")
    )
    over = float(ours[1] - bare[1])
    for name, other in (("bare", bare), ("plain", plain)):
        p50, p99, cpu, _, rss = ours / other
        print(
            f"ratio companion / {name}: p50 {p50:.2f}, p99 {p99:.2f}, CPU {cpu:.2f}, memory {rss:.2f}"
        )
    print(f"p99 over the bare receiver's: {over:+.2f} ms")
    return {
        "p50": float(ours[0] / bare[0]), "p99": float(ours[1] / bare[1]), "p99_over_ms": over,
        "cpu": float(ours[2] / bare[2]), "rss_mib": float(ours[4]), "p50_of_plain": float(ours[0] / plain[0]),
        "cpu_of_plain": float(ours[2] / plain[2]), "memory_of_plain": float(ours[4] / plain[4]),
    }  # fmt: skip


def hold_back(pid: int, share: float, over: threading.Event) -> None:
    """Let a process run for ``share`` of every 20 ms only."""
    with contextlib.suppress(ProcessLookupError):
        while not over.is_set():
            os.kill(pid, signal.SIGSTOP)
            time.sleep(0.02 * (1.0 - share))
            os.kill(pid, signal.SIGCONT)
            time.sleep(0.02 * share)


def measure(
    name: str, seconds: float, rate: float, held_to: float = 1.0, folder: Path | None = None
) -> tuple[float, float, float, float, float]:
    """(p50 ms, p99 ms, CPU %, share answered, peak RSS MiB) of one answering process.

    ``folder`` takes what the companion says and its report.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    endpoint = f"udpin:127.0.0.1:{port}"
    script = {"bare": BARE, "plain": PLAIN, **FLOOR}.get(name.removesuffix(" again"))
    if script is not None:
        command = [sys.executable, "-c", script, endpoint, str(seconds + 8.0)]
    else:
        said_how = ("--quiet",) if folder is None else ("--json", str(folder / "report.json"))
        command = flight_command(port, "--duration", str(seconds + 8.0), *said_how)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.monotonic()
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
        latencies, sent, rss = stream(port, seconds, rate, process.pid)
        over.set()
        process.wait(60)
    finally:
        over.set()
        process.kill()
        process.wait()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime) / (
        time.monotonic() - start
    )
    ms = 1e3 * np.array(latencies or [np.nan])
    return (
        float(np.percentile(ms, 50)),
        float(np.percentile(ms, 99)),
        100.0 * cpu,
        len(latencies) / max(sent, 1),
        rss,
    )


def stream(port: int, seconds: float, rate: float, pid: int) -> tuple[list[float], int, float]:
    """Send for ``seconds`` after a 5 s warm-up; returns latencies [s], attitudes sent and peak RSS [MiB]."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.bind(("127.0.0.1", 0))
    sock.connect(("127.0.0.1", port))
    mav, parser = mavlink.MAVLink(None, srcSystem=1, srcComponent=1), mavlink.MAVLink(None)
    parser.robust_parsing = True
    sent_at: dict[int, float] = {}
    latencies: list[float] = []
    cycle, others = (8.0 / rate, 0) if rate <= 500.0 else (0.02, round(0.02 * rate) - 8)
    begin = time.monotonic() + 5.0
    due, tick, sent, rss = time.monotonic(), 0, 0, 0.0

    def send(message: object) -> None:
        raw = message.pack(mav)  # type: ignore[attr-defined]
        mav.seq = (mav.seq + 1) % 256
        with contextlib.suppress(ConnectionRefusedError):
            sock.send(raw)

    def receive(until: float) -> None:
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
        sent += now > begin
        send(mav.attitude_quaternion_encode(ms, *q, 0, 0, 0))
        due += cycle
        tick += 1
        receive(due)
        if tick % 100 == 0:
            with contextlib.suppress(OSError):
                pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
                rss = max(rss, pages * resource.getpagesize() / 2**20)
    sock.close()
    return latencies, sent, rss


if __name__ == "__main__":
    main()
