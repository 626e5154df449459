"""Mutated MAVLink through the live decoder and the flight program, and mutated files through every log reader.

``python tests/benchmarks/fuzz.py [--frames 1000000] [--files 2000] [--seed 0]``. Nothing may raise (readers: but for
UserError), take longer than --hang seconds for one input, or keep memory. An input that fails is written to --keep.
"""

from __future__ import annotations

import argparse
import json
import random
import resource
import struct
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

import models
from companion.config import PipelineConfig
from companion.mavlink.frames import FrameReader
from companion.mavlink.message_filter import Intake
from companion.mavlink.message_table import LAYOUTS
from companion.mavlink.setpoints import AttitudeCommand
from companion.pipeline import initial_state, step
from companion.vehicles import default_vehicle
from models.errors import UserError
from models.progress import Bars

Mutation = Callable[[bytearray, random.Random], bytearray]


def flip_bits(data: bytearray, rng: random.Random) -> bytearray:
    for _ in range(rng.choice((1, 1, 2, 8))):
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return data


def cut(data: bytearray, rng: random.Random) -> bytearray:
    return data[: rng.randrange(1, len(data) + 1)]


def insert(data: bytearray, rng: random.Random) -> bytearray:
    at = rng.randrange(len(data))
    return data[:at] + rng.randbytes(rng.randrange(1, 20)) + data[at:]


def repeat(data: bytearray, rng: random.Random) -> bytearray:
    return data + data[rng.randrange(len(data)) :]


def noise(data: bytearray, rng: random.Random) -> bytearray:
    at = rng.randrange(len(data))
    more = rng.randbytes(rng.randrange(1, 32))
    data[at : at + len(more)] = more
    return data


RAW: tuple[Mutation, ...] = (flip_bits, cut, insert, repeat, noise)
SPECIAL = (0x00, 0xFF, 0x7F, 0x80)


def payload_of(length: int, rng: random.Random) -> bytes:
    """A payload of any content: random, of one byte, with NaN and infinity, or with a few changed bytes of zeros."""
    way = rng.randrange(4)
    if way == 0:
        return rng.randbytes(length)
    if way == 1:
        return bytes([rng.choice(SPECIAL)]) * length
    if way == 2:
        odd = struct.pack("<4f", float("nan"), float("inf"), -float("inf"), 3.4e38)
        return (odd * (length // 16 + 1))[:length]
    data = bytearray(length)
    for _ in range(rng.randrange(1, 6)):
        data[rng.randrange(length)] = rng.randrange(256)
    return bytes(data)


def proper_frame(number: int, rng: random.Random) -> bytes:
    """A frame with a right checksum and any payload: what gets past the checksum."""
    from companion.mavlink.frames import pack

    size = LAYOUTS[number].wire.unpacker.size
    payload = payload_of(rng.choice((size, size, size, rng.randrange(1, 256))), rng)
    system, component = rng.choice(((1, 1), (1, 1), (1, 1), (1, 50), (2, 1), (255, 190), (1, 191)))
    return pack(number, payload, system, component, rng.randrange(256))


@dataclass
class Counts:
    """What went through."""

    inputs: int = 0
    frames: int = 0
    samples: int = 0
    decisions: int = 0
    commands: int = 0
    refused: int = 0
    failures: list[str] = field(default_factory=list)
    slowest_s: float = 0.0


def heartbeat() -> bytes:
    return bytes(mavlink.MAVLink_heartbeat_message(2, 3, 128, 4, 4, 3).pack(mavlink.MAVLink(None, 1, 1)))


def sound_flight(k: int) -> bytes:
    """What a vehicle at rest says in between, so that the flight program decides."""
    mav, ms = mavlink.MAVLink(None, 1, 1), 20 * k % 2**32
    attitude = mavlink.MAVLink_attitude_quaternion_message(ms, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    position = mavlink.MAVLink_local_position_ned_message(ms, 0.0, 0.0, -0.5, 0.0, 0.0, 0.0)
    return heartbeat() + bytes(position.pack(mav)) + bytes(attitude.pack(mav))


def live(frames: int, seed: int, hang_s: float, keep: Path, bars: Bars) -> Counts:
    """``frames`` mutated frames through reader, intake and ``step``."""
    rng, counts = random.Random(f"live {seed}"), Counts()
    config = PipelineConfig(default_vehicle(), models.load())
    numbers = sorted(LAYOUTS)
    reader, intake, state, now_us = FrameReader(), Intake(), initial_state(config), 1_700_000_000_000_000
    while counts.inputs < frames:
        if counts.inputs % 20_000 == 0:
            reader, intake, state = FrameReader(), Intake(), initial_state(config)
            bars("frames", counts.inputs, frames)
        data = b""
        for _ in range(8):
            raw = proper_frame(rng.choice(numbers), rng)
            if rng.random() < 0.5:
                raw = bytes(rng.choice(RAW)(bytearray(raw), rng))
            data += raw
        counts.inputs += 8
        data += sound_flight(counts.inputs // 8)
        now_us += 20_000
        started = time.perf_counter()
        try:
            for frame in reader.feed(data):
                counts.frames += 1
                sample = intake.sample(frame, now_us)
                if sample is None:
                    continue
                counts.samples += 1
                state, decision = step(state, sample, config)
                if decision is None:
                    continue
                counts.decisions += 1
                counts.commands += decision.command is not None
                _sound(decision.command)
        except Exception as error:
            _keep(keep, f"live-{seed}-{counts.inputs}.bin", data, error, counts)
            reader, intake, state = FrameReader(), Intake(), initial_state(config)
        _time(time.perf_counter() - started, hang_s, f"live input {counts.inputs}", counts)
    return counts


def _sound(command: Any) -> None:
    if isinstance(command, AttitudeCommand):
        size = sum(c * c for c in command.q_ned_frd)
        if not (abs(size - 1.0) < 1e-6 and 0.0 <= command.thrust <= 1.0):
            raise AssertionError(f"sends {command}")


def _keep(folder: Path, name: str, data: bytes, error: Exception, counts: Counts) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_bytes(data)
    counts.failures.append(f"{name}: {type(error).__name__}: {error}")


def _time(seconds: float, hang_s: float, what: str, counts: Counts) -> None:
    counts.slowest_s = max(counts.slowest_s, seconds)
    if seconds > hang_s:
        counts.failures.append(f"{what}: {seconds:.1f} s")


def seeds_of_logs(folder: Path | None) -> Iterator[tuple[str, bytes]]:
    """Small good files: one made here, and recorded ones where a folder is given."""
    log = b"".join(struct.pack(">Q", 1_700_000_000_000_000 + 20_000 * k) + sound_flight(k) for k in range(50))
    yield ".tlog", log
    if folder is not None:
        for path in sorted(folder.rglob("*")):
            if path.suffix.lower() in (".tlog", ".bin", ".ulg"):
                yield path.suffix, path.read_bytes()[:200_000]


def files(number: int, seed: int, hang_s: float, keep: Path, logs: Path | None, bars: Bars) -> Counts:
    """``number`` mutated files through the log readers."""
    from replay.logs.formats import read_flightlogs

    rng, counts, good = random.Random(f"files {seed}"), Counts(), list(seeds_of_logs(logs))
    with tempfile.TemporaryDirectory() as folder:
        for k in range(number):
            bars("files", k, number)
            suffix, data = rng.choice(good)
            damaged = bytearray(data)
            for _ in range(rng.randrange(1, 30)):
                damaged = rng.choice(RAW)(damaged, rng) or bytearray(b"\0")
            path = Path(folder) / f"f{suffix}"
            path.write_bytes(damaged)
            counts.inputs += 1
            started = time.perf_counter()
            try:
                counts.frames += len(read_flightlogs(path))
            except UserError:
                counts.refused += 1
            except Exception as error:
                _keep(keep, f"file-{seed}-{k}{suffix}", bytes(damaged), error, counts)
            _time(time.perf_counter() - started, hang_s, f"file {k}", counts)
    return counts


def main() -> int:
    """Fuzz and print."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--frames", type=int, default=1_000_000)
    p.add_argument("--files", type=int, default=2000)
    p.add_argument("--logs", type=Path, metavar="DIR", help="recorded logs as seeds, beside one that is made here")
    p.add_argument("--seed", type=int, default=0)
    p.add_argument("--hang", type=float, default=10.0, metavar="S")
    p.add_argument("--keep", type=Path, default=Path("fuzz-failures"), metavar="DIR")
    p.add_argument("--json", type=Path, metavar="FILE")
    a = p.parse_args()
    bars, out = Bars(), {}
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    live(min(a.frames, 40_000), a.seed + 1, a.hang, a.keep, bars)
    warm = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for name, counts in (
        ("live", live(a.frames, a.seed, a.hang, a.keep, bars)),
        ("files", files(a.files, a.seed, a.hang, a.keep, a.logs, bars)),
    ):
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        bars.close()
        out[name] = vars(counts) | {"peak_mib": round(peak / 1024, 1)}
        print(
            f"{name}: {counts.inputs} inputs, {counts.frames} frames or logs read, {counts.samples} samples, "
            f"{counts.decisions} decisions, {counts.commands} setpoints, {counts.refused} refused in one line, "
            f"{len(counts.failures)} failures; slowest {counts.slowest_s:.3f} s; peak memory {peak / 1024:.0f} MiB "
            f"({before / 1024:.0f} at start, {warm / 1024:.0f} after 40 000 frames)"
        )
        print("\n".join(counts.failures[:20]), end="\n" if counts.failures else "")
    if a.json is not None:
        a.json.write_text(json.dumps(out, indent=1) + "\n", encoding="utf-8")
    return 1 if any(o["failures"] for o in out.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
