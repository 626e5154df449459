"""What the live page costs the flight loop: two companions side by side, one with ``--page`` and a browser that asks.

    python tests/benchmarks speed.page_cost [--seconds 30] [--rate 400] [--json FILE]

Both get the same stream at the same time on the same machine, each from a generator process of its own. Latency: from
an attitude sent to the setpoint that answers it. CPU: of the flight process alone (the page's own process is given
beside it). Also bytes of the page, the time to fetch it over loopback, and the time to the first paint in a real
browser (with a Chromium on this machine; median of five, after the latencies).
"""

from __future__ import annotations

import json
import multiprocessing as mp
import os
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from pathlib import Path
from typing import Any

import command_line
import numpy as np
from browser import CHROMIUM, Browser

from speed.latency import cpu_s, stream


def free_port(kind: socket.SocketKind) -> int:
    """A port that nobody has."""
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def child_of(pid: int) -> int | None:
    """The page's process."""
    for entry in Path("/proc").iterdir():
        try:
            parent = (
                (entry / "stat").read_text().rsplit(")", 1)[1].split()[1]
                if entry.name.isdigit()
                else ""
            )
            if parent == str(pid) and b"companion.page" in (entry / "cmdline").read_bytes():
                return int(entry.name)
        except OSError:
            continue
    return None


def browse(port: int, over: threading.Event, out: dict[str, float]) -> None:
    """Ask as the page does, five times a second."""
    last = 0
    while not over.is_set():
        try:
            if "bytes" not in out:
                start = time.perf_counter()
                out["bytes"] = len(
                    urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=5).read()
                )
                out["fetch_ms"] = 1e3 * (time.perf_counter() - start)
            url = f"http://127.0.0.1:{port}/snapshots?since={last}"
            last = json.loads(urllib.request.urlopen(url, timeout=5).read())["last"]
            out["snapshots"] = last
        except OSError:
            pass
        time.sleep(0.2)


def generate(port: int, seconds: float, rate: float, pid: int, answers: Any) -> None:
    """A generator process."""
    answers.send(stream(port, seconds, rate, pid))


def first_paint_ms(url: str) -> float:
    """From the begin of the navigation to the first contentful paint, median of five."""
    times = []
    with Browser() as browser:
        for _ in range(5):
            browser.open(url)
            paint = None
            while paint is None:
                paint = browser.value(
                    "performance.getEntriesByName('first-contentful-paint')[0]?.startTime"
                )
                time.sleep(0.05)
            times.append(float(paint))
    return float(np.median(times))


def main() -> int:
    """Run both and print."""
    p = command_line.parser(__doc__)
    p.add_argument("--seconds", type=float, default=30.0)
    p.add_argument("--rate", type=float, default=400.0)
    p.add_argument("--json", type=Path)
    a = p.parse_args()
    page = free_port(socket.SOCK_STREAM)
    over = threading.Event()
    seen = {}
    rows: dict[str, dict[str, float]] = {}
    running = {}
    for name, extra in (("without", []), ("with page", ["--page", f"127.0.0.1:{page}"])):
        port = free_port(socket.SOCK_DGRAM)
        command = [sys.executable, "-m", "companion", "--vehicle", "tandem", "--connect", f"udpin:127.0.0.1:{port}",
                   "--quiet", "--duration", str(a.seconds + 12.0), *extra]  # fmt: skip
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        running[name] = (
            subprocess.Popen(command, stdout=subprocess.DEVNULL, env=environment),
            port,
        )
    time.sleep(2.0)
    threading.Thread(target=browse, args=(page, over, seen), daemon=True).start()
    generators = {}
    for name, (process, port) in running.items():
        ours, theirs = mp.Pipe(duplex=False)
        worker = mp.Process(target=generate, args=(port, a.seconds, a.rate, process.pid, theirs))
        worker.start()
        generators[name] = (ours, worker)
    before = {name: cpu_s(process.pid) for name, (process, _) in running.items()}
    start = time.monotonic()
    time.sleep(a.seconds)
    wall = time.monotonic() - start
    used = {name: cpu_s(process.pid) - before[name] for name, (process, _) in running.items()}
    served = child_of(running["with page"][0].pid)
    page_cpu = 0.0 if served is None else cpu_s(served)
    for name, (ours, worker) in generators.items():
        known = ours.recv()
        worker.join()
        ms = 1e3 * np.array(known.latencies_s or [np.nan])
        rows[name] = {
            "p50_ms": float(np.percentile(ms, 50)), "p99_ms": float(np.percentile(ms, 99)),
            "cpu_percent": 100.0 * used[name] / wall,
            "answered": len(known.latencies_s) / max(known.sent, 1), "rss_mib": known.rss_mib,
        }  # fmt: skip
    over.set()
    if CHROMIUM is not None and served is not None:
        seen["first_paint_ms"] = first_paint_ms(f"http://127.0.0.1:{page}/")
    for process, _ in running.values():
        process.kill()
        process.wait()
    for name, row in rows.items():
        print(f"{name:10}" + "".join(f"  {key} {value:.3f}" for key, value in row.items()))
    print(f"page's own process: {page_cpu:.2f} s; {seen}")
    if a.json:
        a.json.write_text(
            json.dumps({**rows, "page": seen, "page_cpu_s": page_cpu}, indent=1) + "\n",
            encoding="utf-8",
        )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
