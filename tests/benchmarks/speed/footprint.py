"""Start to ready, memory in flight, and what is imported.

    python tests/benchmarks speed.footprint

Ready = the companion's first heartbeat on the link. Printed beside a bare interpreter that imports numpy and mavutil
and sends its first heartbeat, so that the machine's speed cancels. Both start once before they are measured, with a
folder for their bytecode: pip compiles what it installs, a checkout without it would compile each time.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import command_line
from result_file import add_option, figure, write_result

BARE = """
import os, sys, time
os.environ["MAVLINK20"] = "1"; os.environ["MAVLINK_DIALECT"] = "ardupilotmega"
import numpy
from pymavlink import mavutil
link = mavutil.mavlink_connection(sys.argv[1], source_system=1, source_component=191)
link.mav.heartbeat_send(18, 8, 0, 0, 4)
time.sleep(3)
"""


def first_heartbeat(
    command: list[str], server: socket.socket, environment: dict[str, str]
) -> tuple[float, float]:
    """(seconds to the first datagram, resident MiB two seconds later) of one process."""
    start = time.monotonic()
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment
    )
    try:
        server.settimeout(30.0)
        server.recv(4096)
        ready = time.monotonic() - start
        time.sleep(2.0)
        pages = int(Path(f"/proc/{process.pid}/statm").read_text().split()[1])
        return ready, pages * os.sysconf("SC_PAGE_SIZE") / 2**20
    finally:
        process.kill()
        process.wait()
        server.setblocking(False)
        while True:
            try:
                server.recv(4096)
            except OSError:
                break


def main() -> None:
    parser = command_line.parser(__doc__)
    add_option(parser)
    a = parser.parse_args()
    with (
        tempfile.TemporaryDirectory() as folder,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server,
    ):
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
        environment |= {"PYTHONPYCACHEPREFIX": folder, "OMP_NUM_THREADS": "1"}
        server.bind(("127.0.0.1", 0))
        endpoint = f"udpout:127.0.0.1:{server.getsockname()[1]}"
        ours = [
            sys.executable,
            "-m",
            "companion",
            "--vehicle",
            "tandem",
            "--connect",
            endpoint,
            "--quiet",
        ]
        bare = [sys.executable, "-c", BARE, endpoint]
        rows = [
            (first_heartbeat(ours, server, environment), first_heartbeat(bare, server, environment))
            for _ in range(6)
        ][1:]
    median = lambda values: sorted(values)[len(values) // 2]  # noqa: E731
    ready = median([o[0] for o, _ in rows])
    bare_ready = median([b[0] for _, b in rows])
    print(
        f"ready after {ready:.2f} s, bare numpy + mavutil {bare_ready:.2f} s, ratio {ready / bare_ready:.2f}"
    )
    ours_mib = median([o[1] for o, _ in rows])
    bare_mib = median([b[1] for _, b in rows])
    print(f"resident {ours_mib:.0f} MiB, bare {bare_mib:.0f} MiB")
    figures = [
        figure("memory at the start [MiB]", f"{ours_mib:.0f}", goal="45", met=ours_mib <= 45.0),
        figure("numpy and pymavlink alone [MiB]", f"{bare_mib:.0f}"),
        figure("start to first heartbeat [s]", f"{ready:.2f}", goal="0.30", met=ready <= 0.3),
    ]
    write_result(a, figures, seeds="none")
    code = "import sys, models, companion.flight.loop; models.load()\n"
    code += "print([m for m in ('torch', 'scipy') if m in sys.modules])"
    print(
        "torch or scipy imported by flight:",
        subprocess.check_output([sys.executable, "-c", code], text=True).strip(),
    )


if __name__ == "__main__":
    main()
