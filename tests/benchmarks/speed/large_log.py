"""Peak memory of the commands on a large log.

    python tests/benchmarks speed.large_log --size 2000 [--commands info table diagnose] [--limit 3600] [--keep FILE]
    python tests/benchmarks speed.large_log --log FILE

Writes one long flight of ``--size`` MB: a simulated hover of a minute again and again, with stamps that go on and
checksums that are right. Every command runs in a process of its own; after ``--limit`` seconds it is stopped, and its
peak so far is printed. ``--keep FILE``: the log is left there, and used again where it has the size. ``--log FILE``: a
log that is there, such as one that ``repeat_log.py`` made long. ``table`` is ``export --no-decisions``. Needs Linux.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import command_line
from fastcrc.crc16 import mcrf4xx as crc
from log_writers import flight, record

from companion.mavlink.dialect import mavlink
from companion.mavlink.wire_frames import V2
from companion.mavlink.wire_layout import wire_format

SECONDS = 60.0
COMMANDS = {
    "info": ["info", "{log}"],
    "run": ["run", "{log}", "--quiet"],
    "export": ["export", "{log}", "--to", "csv", "--out", "{out}", "--quiet"],
    "table": ["export", "{log}", "--no-decisions", "--to", "csv", "--out", "{out}", "--quiet"],
    "diagnose": ["diagnose", "{log}", "--model", "none", "--quiet"],
}


@dataclass(frozen=True)
class Stamp:
    """Where a frame of the block holds a time: offset and bytes of the field, and what a repetition adds."""

    frame: int
    end: int
    at: int
    size: int
    per_round: int


def stamps(block: bytes) -> list[Stamp]:
    """Of every frame of a .tlog: its boot stamp, if it has one. Only version 2 frames that are not signed."""
    out = []
    i = 0
    while i < len(block):
        magic = block[i + 8]
        length = block[i + 9]
        header = 10 if magic == V2 else 6
        number = int.from_bytes(block[i + 15 : i + 18], "little") if magic == V2 else block[i + 13]
        end = i + 8 + header + length
        fields = wire_format(number).dtype.fields or {}
        for name, unit in (("time_boot_ms", 1000), ("time_usec", 1_000_000)):
            if name in fields and fields[name][1] + fields[name][0].itemsize <= length:
                at = i + 8 + header + fields[name][1]
                out.append(Stamp(i, end, at, fields[name][0].itemsize, round(SECONDS * unit)))
        i = end + 2
    return out


def write_log(path: Path, size: int) -> float:
    """One long flight of about ``size`` bytes, unless it is there; returns its length [s]."""
    block = bytearray(b"".join(record(arrival, raw) for arrival, raw in flight(SECONDS)))
    rounds = max(size // len(block), 1)
    if path.exists() and path.stat().st_size == rounds * len(block):
        return rounds * SECONDS
    starts = []
    i = 0
    while i < len(block):
        starts.append(i)
        i += 8 + (12 if block[i + 8] == V2 else 8) + block[i + 9]
    times = stamps(bytes(block))
    extra = {n: bytes([m.crc_extra]) for n, m in mavlink.mavlink_map.items()}
    with path.open("wb") as file:
        for _ in range(rounds):
            file.write(block)
            for s in starts:
                block[s : s + 8] = (
                    int.from_bytes(block[s : s + 8], "big") + round(SECONDS * 1e6)
                ).to_bytes(8, "big")
            for t in times:
                value = int.from_bytes(block[t.at : t.at + t.size], "little") + t.per_round
                block[t.at : t.at + t.size] = (value % 256**t.size).to_bytes(t.size, "little")
                head = t.frame + 8
                number = (
                    int.from_bytes(block[head + 7 : head + 10], "little")
                    if block[head] == V2
                    else block[head + 5]
                )
                sum_ = crc(bytes(block[head + 1 : t.end]) + extra.get(number, b""))
                block[t.end : t.end + 2] = sum_.to_bytes(2, "little")
    return rounds * SECONDS


def peak(command: list[str], limit_s: float) -> tuple[float, float, int | None]:
    """(peak MiB, seconds, exit code or None where it was stopped) of one command."""
    start = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-m", "replay", *command], stdout=subprocess.DEVNULL
    )
    most = 0
    while process.poll() is None:
        try:
            status = Path(f"/proc/{process.pid}/status").read_text()
            most = max(
                most,
                *(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM")),
                0,
            )
        except (OSError, ValueError):
            pass
        if time.perf_counter() - start > limit_s:
            os.kill(process.pid, signal.SIGKILL)
            process.wait()
            return most / 1024.0, limit_s, None
        time.sleep(0.1)
    ended = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    return max(most, 0 if most else ended) / 1024.0, time.perf_counter() - start, process.returncode


def main() -> int:
    """Write the log, run the commands, print."""
    p = command_line.parser(__doc__)
    p.add_argument("--size", type=float, default=2000.0, metavar="MB")
    p.add_argument("--commands", nargs="+", choices=sorted(COMMANDS), default=sorted(COMMANDS))
    p.add_argument("--limit", type=float, default=3600.0, metavar="S")
    p.add_argument("--keep", type=Path, metavar="FILE")
    p.add_argument("--log", type=Path, metavar="FILE")
    p.add_argument("--json", type=Path)
    a = p.parse_args()
    out = []
    with tempfile.TemporaryDirectory() as folder:
        if a.log is not None:
            log = a.log
        else:
            log = Path(folder) / "large.tlog" if a.keep is None else a.keep
            length_s = write_log(log, round(a.size * 1e6))
            print(f"{length_s / 3600.0:.1f} h of flight")
        size = log.stat().st_size
        print(f"{size / 1e6:.0f} MB", flush=True)
        for name in a.commands:
            command = [
                part.format(log=log, out=Path(folder) / "out.csv") for part in COMMANDS[name]
            ]
            mib, seconds, code = peak(command, a.limit)
            ratio = mib * 2**20 / size
            out.append(
                {
                    "command": name,
                    "mb": size / 1e6,
                    "peak_mib": mib,
                    "bytes_per_byte": ratio,
                    "s": seconds,
                    "exit": code,
                }
            )
            ended = "stopped" if code is None else f"exit {code}"
            print(
                f"{name:9} peak {mib:7.0f} MiB, {ratio:.2f} bytes a byte of log, {seconds:.0f} s, {ended}",
                flush=True,
            )
    if a.json:
        a.json.write_text(json.dumps(out, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
