"""Mutated MAVLink through the live decoder and the flight program, and mutated files through every log reader.

``python tests/benchmarks safety.fuzz [--frames 1000000] [--flight-frames 1000000] [--log-frames 1000000] [--files 300]
[--seed 0]``

Stages:

- decoder: frames of every message that is read, of any content and with a right checksum, run together into a stream;
  in every other stream bytes are changed, cut out, inserted and repeated. Fed in pieces of any length.
- flight: between the messages of a vehicle that hovers, their own payloads with some bytes changed, frames of any
  content, and damaged ones, all through ``step``. Setpoints that come out must be sound.
- tlog, bin, ulg: small logs whose records are mutated one by one, mostly with their framing and checksum right,
  through the reader of each format.
- files: small logs of each format with damage all over, through the reader of their suffix.

Nothing may raise (readers: but for UserError), warn, take longer than --hang seconds for one input, or keep memory. An
input that fails is written to --keep, as the seed of a test.
"""

from __future__ import annotations

import gc
import json
import math
import random
import struct
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Any

import command_line
import numpy as np
from log_writers import bin_flight, ulg_flight
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from result_file import add_option, figure, write_result

import models
from companion.config import PipelineConfig
from companion.mavlink.message_filter import Intake
from companion.mavlink.message_table import LAYOUTS
from companion.mavlink.setpoints import AttitudeCommand, Command
from companion.mavlink.wire_frames import FrameReader, cut, pack
from companion.pipeline import initial_state, step
from companion.vehicles import default_vehicle
from models.common.errors import UserError
from models.common.progress import Bars
from safety.fuzz_logs import LogKind, bin_kind, tlog_kind, ulg_kind

Mutation = Callable[[bytearray, random.Random], bytearray]

STREAM_FRAMES = 2000
"""Frames of one stream of the first stage; reader and intake are new for each."""
TICKS = 600
"""Of 20 ms: the vehicle that hovers, 12 s; then everything is new."""
MUTATED_PER_TICK = 16
START_US = 1_700_000_000_000_000


def flip_bits(data: bytearray, rng: random.Random) -> bytearray:
    for _ in range(rng.choice((1, 1, 2, 8))):
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return data


def cut_off(data: bytearray, rng: random.Random) -> bytearray:
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


RAW: tuple[Mutation, ...] = (flip_bits, cut_off, insert, repeat, noise)
SPECIAL = (0x00, 0xFF, 0x7F, 0x80)
ODD_FLOATS = struct.pack("<4f", math.nan, math.inf, -math.inf, 3.4e38)
NUMBERS = sorted(LAYOUTS)
SENDERS = ((1, 1), (1, 1), (1, 1), (1, 50), (2, 1), (255, 190), (1, 191))


def payload_of(length: int, rng: random.Random) -> bytes:
    """A payload of any content: random, of one byte, with NaN and infinity, or with a few changed bytes of zeros."""
    way = rng.randrange(4)
    if way == 0:
        return rng.randbytes(length)
    if way == 1:
        return bytes([rng.choice(SPECIAL)]) * length
    if way == 2:
        return (ODD_FLOATS * (length // 16 + 1))[:length]
    data = bytearray(length)
    for _ in range(rng.randrange(1, 6)):
        data[rng.randrange(length)] = rng.randrange(256)
    return bytes(data)


def proper_frame(number: int, rng: random.Random) -> bytes:
    """A frame with a right checksum and any payload: what gets past the checksum."""
    size = LAYOUTS[number].wire.dtype.itemsize
    payload = payload_of(rng.choice((size, size, size, rng.randrange(1, 256))), rng)
    system, component = rng.choice(SENDERS)
    return pack(number, payload, system, component, rng.randrange(256))


def changed(payload: bytes, rng: random.Random) -> bytes:
    """A sound payload with up to four bytes changed, its first four (a time stamp, mostly) as they are, mostly."""
    data = bytearray(payload)
    first = 0 if rng.random() < 0.02 or len(data) < 6 else 4
    for _ in range(rng.randrange(1, 5)):
        data[rng.randrange(first, len(data))] = rng.choice((*SPECIAL, rng.randrange(256)))
    return bytes(data)


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
    memory_mib: list[float] = field(default_factory=list)
    """Resident, a sample at every twentieth of the stage."""

    def fail(self, folder: Path, name: str, data: bytes, error: Exception) -> None:
        """Keep an input that failed."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
        self.failures.append(f"{name}: {type(error).__name__}: {error}")

    def took(self, seconds: float, hang_s: float, what: str) -> None:
        """Note how long one input took."""
        self.slowest_s = max(self.slowest_s, seconds)
        if seconds > hang_s:
            self.failures.append(f"{what}: {seconds:.1f} s")

    def progress(self, done: int, total: int, name: str, bars: Bars) -> None:
        """Show how far it is, and sample the memory."""
        bars(name, done, total)
        if done * 20 >= len(self.memory_mib) * total:
            gc.collect()
            self.memory_mib.append(round(resident_mib(), 1))


def resident_mib() -> float:
    """Resident set of this process."""
    line = next(
        s for s in Path("/proc/self/status").read_text().splitlines() if s.startswith("VmRSS")
    )
    return int(line.split()[1]) / 1024.0


@dataclass(frozen=True)
class Limits:
    """What every stage is held to."""

    seed: int
    hang_s: float
    keep: Path
    bars: Bars


@cache
def sound_payloads(k: int) -> tuple[tuple[int, bytes], ...]:
    """What a vehicle that hovers 0.5 m over the ground, 0.6 m from a wall, says at tick ``k``."""
    ms = 20 * (k + 1)
    messages: list[Any] = [
        mavlink.MAVLink_heartbeat_message(2, 3, 128, 4, 4, 3),
        mavlink.MAVLink_extended_sys_state_message(0, 2),
        mavlink.MAVLink_param_value_message(b"GUID_OPTIONS", 8.0, 9, 1, 0),
        mavlink.MAVLink_distance_sensor_message(ms, 3, 4000, 45 + k % 2, 0, 0, 25, 255),
        mavlink.MAVLink_distance_sensor_message(ms, 3, 4000, 60 + k % 2, 0, 1, 2, 255),
        mavlink.MAVLink_esc_telemetry_1_to_4_message(
            [20] * 4, [0] * 4, [0] * 4, [0] * 4, [4000] * 4, [k] * 4
        ),
        mavlink.MAVLink_local_position_ned_message(ms, 0.0, 0.0, -0.5, 0.0, 0.0, 0.0),
        mavlink.MAVLink_attitude_target_message(ms, 0, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, 0.5),
        mavlink.MAVLink_attitude_quaternion_message(ms, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    ]
    mav = mavlink.MAVLink(None, 1, 1)
    return tuple((m.get_msgId(), cut(m.pack(mav), 0).payload) for m in messages)


@cache
def sound_flight(k: int) -> bytes:
    """The same as frames."""
    return b"".join(pack(number, payload, 1, 1, k % 256) for number, payload in sound_payloads(k))


def mutated(k: int, rng: random.Random) -> bytes:
    """One mutated frame at tick ``k``: a sound payload changed, a frame of any content, or a damaged one."""
    way = rng.random()
    if way < 0.6:
        # Heartbeat and land detector seldom: a vehicle that lands at every tick is never flown.
        number, payload = rng.choice(sound_payloads(k)[2 if rng.random() < 0.98 else 0 :])
        return pack(number, changed(payload, rng), 1, 1, rng.randrange(256))
    raw = proper_frame(rng.choice(NUMBERS), rng)
    if way < 0.62:
        return raw
    return bytes(rng.choice(RAW)(bytearray(raw), rng))


def damaged_stream(frames: list[bytes], rng: random.Random) -> bytes:
    """Frames run together, every third or so hit by a changed byte, some lost, doubled or shifted."""
    data = np.frombuffer(b"".join(frames), np.uint8).copy()
    shots = np.random.default_rng(rng.getrandbits(64))
    hits = shots.integers(0, len(data), len(frames) // 3)
    data[hits] = shots.integers(0, 256, len(hits), dtype=np.uint8)
    pieces = []
    at = 0
    for end in sorted(rng.randrange(len(data)) for _ in range(len(frames) // 50)):
        pieces.append(data[at:end].tobytes())
        at = end + rng.choice((0, 0, 1, 7, 40)) - rng.choice((0, 0, 3, 60))
        at = min(max(at, 0), len(data))
        if rng.random() < 0.3:
            pieces.append(rng.randbytes(rng.randrange(1, 20)))
    return b"".join((*pieces, data[at:].tobytes()))


def decoder(number: int, limits: Limits) -> Counts:
    """``number`` frames through reader and intake."""
    rng = random.Random(f"decoder {limits.seed}")
    counts = Counts()
    while counts.inputs < number:
        counts.progress(counts.inputs, number, "decoder", limits.bars)
        frames = [
            sound_flight(0),
            *(proper_frame(rng.choice(NUMBERS), rng) for _ in range(STREAM_FRAMES)),
        ]
        whole = counts.inputs // STREAM_FRAMES % 2 == 0
        data = b"".join(frames) if whole else damaged_stream(frames, rng)
        counts.inputs += STREAM_FRAMES
        reader = FrameReader()
        intake = Intake()
        now_us = START_US
        at = 0
        started = time.perf_counter()
        try:
            while at < len(data):
                end = at + rng.randrange(1, 3000)
                now_us += 20_000
                for frame in reader.feed(data[at:end]):
                    counts.frames += 1
                    counts.samples += intake.sample(frame, now_us) is not None
                at = end
        except Exception as error:
            counts.fail(limits.keep, f"decoder-{limits.seed}-{counts.inputs}.bin", data, error)
        counts.took(time.perf_counter() - started, limits.hang_s, f"decoder input {counts.inputs}")
    return counts


def live(number: int, limits: Limits) -> Counts:
    """``number`` mutated frames through reader, intake and ``step``, between those of a vehicle that hovers."""
    rng = random.Random(f"live {limits.seed}")
    counts = Counts()
    config = PipelineConfig(vehicle=default_vehicle(), model=models.load())
    reader = FrameReader()
    intake = Intake()
    state = initial_state(config)
    k = 0
    while counts.inputs < number:
        if k % TICKS == 0:
            counts.progress(counts.inputs, number, "flight", limits.bars)
            reader = FrameReader()
            intake = Intake()
            state = initial_state(config)
        # The first three seconds are quiet, so that the hold engages.
        hit = MUTATED_PER_TICK if k % TICKS > 150 else 0
        data = sound_flight(k % TICKS) + b"".join(mutated(k % TICKS, rng) for _ in range(hit))
        counts.inputs += hit
        started = time.perf_counter()
        try:
            for frame in reader.feed(data):
                counts.frames += 1
                sample = intake.sample(frame, START_US + 20_000 * k)
                if sample is None:
                    continue
                counts.samples += 1
                state, decision = step(state, sample, config)
                if decision is not None:
                    counts.decisions += 1
                    counts.commands += decision.command is not None
                    check_sound(decision.command)
        except Exception as error:
            counts.fail(limits.keep, f"live-{limits.seed}-{counts.inputs}.bin", data, error)
            reader = FrameReader()
            intake = Intake()
            state = initial_state(config)
        counts.took(time.perf_counter() - started, limits.hang_s, f"live input {counts.inputs}")
        k += 1
    return counts


def check_sound(command: Command | None) -> None:
    """Raise AssertionError where an attitude is no unit quaternion, or a thrust out of bounds."""
    if isinstance(command, AttitudeCommand):
        size = sum(c * c for c in command.q_ned_frd)
        assert abs(size - 1.0) < 1e-6, command
        assert 0.0 <= command.thrust <= 1.0, command


def seeds_of_logs(folder: Path | None) -> Iterator[tuple[str, bytes]]:
    """Small good files: one of each format made here, and recorded ones where a folder is given."""
    stamps = (struct.pack(">Q", START_US + 20_000 * k) for k in range(150))
    yield ".tlog", b"".join(stamp + frame for k, stamp in enumerate(stamps) for frame in each(k))
    yield ".bin", bin_flight()
    yield ".ulg", ulg_flight()
    if folder is not None:
        for path in sorted(folder.rglob("*")):
            if path.suffix.lower() in (".tlog", ".bin", ".ulg"):
                yield path.suffix.lower(), path.read_bytes()[:200_000]


def each(k: int) -> list[bytes]:
    """The frames of one tick."""
    return [pack(number, payload, 1, 1, k % 256) for number, payload in sound_payloads(k)]


def files(number: int, limits: Limits, logs: Path | None) -> Counts:
    """``number`` mutated files through the log readers."""
    rng = random.Random(f"files {limits.seed}")
    counts = Counts()
    good = list(seeds_of_logs(logs))
    with tempfile.TemporaryDirectory() as folder:
        for k in range(number):
            counts.progress(k, number, "files", limits.bars)
            suffix, data = good[k % len(good)]
            damaged = bytearray(data)
            for _ in range(rng.choice((1, 3, 10, 100))):
                damaged = rng.choice(RAW)(damaged, rng) or bytearray(b"\0")
                if len(damaged) > 4 * len(data):
                    break
            path = Path(folder) / f"f{suffix}"
            path.write_bytes(damaged)
            counts.inputs += 1
            _read(path, counts, limits, f"file-{limits.seed}-{k}")
    return counts


def _read(path: Path, counts: Counts, limits: Limits, label: str) -> None:
    """One damaged file through its reader; what fails is kept under ``label``."""
    from replay.logs.formats import load

    started = time.perf_counter()
    try:
        counts.samples += len(load(path))
    except UserError:
        counts.refused += 1
    except Exception as error:
        counts.fail(limits.keep, f"{label}{path.suffix}", path.read_bytes(), error)
    counts.took(time.perf_counter() - started, limits.hang_s, label)


def log_kinds() -> tuple[LogKind, ...]:
    """A good log of each format, in records."""
    stamps = (struct.pack(">Q", START_US + 20_000 * k) for k in range(150))
    return (
        tlog_kind([stamp + frame for k, stamp in enumerate(stamps) for frame in each(k)]),
        bin_kind(bin_flight()),
        ulg_kind(ulg_flight()),
    )


def records(number: int, limits: Limits, kind: LogKind) -> Counts:
    """``number`` mutated records through the reader of one format, some hundred in a file."""
    name = kind.suffix[1:]
    rng = random.Random(f"{name} {limits.seed}")
    counts = Counts()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"f{kind.suffix}"
        while counts.inputs < number:
            counts.progress(counts.inputs, number, name, limits.bars)
            data, hit = kind.mutated(
                rng, changed, lambda r, g: bytes(g.choice(RAW)(bytearray(r), g))
            )
            path.write_bytes(data)
            counts.inputs += hit
            counts.frames += 1
            _read(path, counts, limits, f"{name}-{limits.seed}-{counts.inputs}")
    return counts


def as_text(name: str, c: Counts) -> str:
    """One line, and one for each failure."""
    early = c.memory_mib[len(c.memory_mib) // 4]
    late = c.memory_mib[-1]
    seen = {
        "decoder": f"{c.inputs} frames sent, {c.frames} good ones cut out, {c.samples} samples",
        "flight": f"{c.inputs} mutated frames, {c.samples} samples, {c.decisions} decisions, {c.commands} setpoints",
        **{
            kind: f"{c.inputs} mutated records in {c.frames} files, {c.samples} flights read, {c.refused} files refused"
            for kind in ("tlog", "bin", "ulg")
        },
        "files": f"{c.inputs} files, {c.samples} flights read, {c.refused} refused in one line",
    }[name]
    line = (
        f"{name}: {seen}; {len(c.failures)} failures; slowest input {c.slowest_s:.3f} s; memory {early:.0f} MiB after "
        f"a quarter, {late:.0f} at the end"
    )
    return "\n".join([line, *c.failures[:20]])


def main() -> int:
    """Fuzz and print."""
    p = command_line.parser(__doc__)
    p.add_argument("--frames", type=int, default=1_000_000, help="through the decoder")
    p.add_argument(
        "--flight-frames", type=int, default=1_000_000, help="through the flight program"
    )
    p.add_argument("--log-frames", type=int, default=1_000_000, help="through each log reader")
    p.add_argument("--files", type=int, default=300, help="damaged as a whole")
    p.add_argument(
        "--logs",
        type=Path,
        metavar="DIR",
        help="recorded logs as seeds, beside those that are made here",
    )
    p.add_argument("--only", action="append", metavar="STAGE", help="this stage; may be repeated")
    p.add_argument("--seed", type=int, default=0)
    p.add_argument("--hang", type=float, default=10.0, metavar="S")
    p.add_argument("--keep", type=Path, default=Path("fuzz-failures"), metavar="DIR")
    p.add_argument("--json", type=Path, metavar="FILE")
    add_option(p)
    a = p.parse_args()
    warnings.simplefilter("error", RuntimeWarning)  # of numpy: something unsound was computed with
    limits = Limits(a.seed, a.hang, a.keep, Bars())
    stages = {
        "decoder": lambda: decoder(a.frames, limits),
        "flight": lambda: live(a.flight_frames, limits),
        **{kind.suffix[1:]: partial(records, a.log_frames, limits, kind) for kind in log_kinds()},
        "files": lambda: files(a.files, limits, a.logs),
    }
    out: dict[str, Counts] = {}
    for name, stage in stages.items():
        if a.only and name not in a.only:
            continue
        started = time.monotonic()
        out[name] = stage()
        limits.bars.close()
        print(f"{as_text(name, out[name])}; {time.monotonic() - started:.0f} s", flush=True)
    if a.json is not None:
        a.json.write_text(
            json.dumps({k: vars(c) for k, c in out.items()}, indent=1) + "\n", encoding="utf-8"
        )
    failed = sum(len(c.failures) for c in out.values())
    figures = [
        figure("failures, hangs, growth of memory", f"{failed}", goal="0", met=not failed),
        figure("slowest input [s]", f"{max(c.slowest_s for c in out.values()):.1f}"),
    ]
    write_result(a, figures, seeds=f"seed {a.seed}; stages {', '.join(out)}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
