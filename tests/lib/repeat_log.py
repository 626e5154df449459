"""Makes a recorded log long: the same flight again and again, with stamps that go on.

LOG: .tlog, .BIN or .ulg. What a log says once at its start (formats, parameters) comes once. Checksums are right.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from fastcrc.crc16 import mcrf4xx as crc
from numpy.typing import NDArray

from companion.mavlink.wire_frames import EXTRA, SIGNATURE_BYTES, V2
from companion.mavlink.wire_layout import wire_format
from replay.logs.bin import read_boots
from replay.logs.bin_flightlog import read
from replay.logs.formats import suffix_of
from replay.logs.tlog import read_tlog

_PAUSE_US = 20_000
"""Between the end of a flight and the next beginning."""
_ULG_HEADER = 16
_DECLARED_ONCE = ("FMT", "FMTU", "UNIT", "MULT", "PARM")


@dataclass(frozen=True)
class Times:
    """Time fields of one kind in the part that is repeated: ``at`` (n,) offsets; units a second."""

    at: NDArray[np.int64]
    dtype: str
    per_s: int


@dataclass(frozen=True)
class Parts:
    """What comes once, what is repeated, how long that is [us], and what changes in it from round to round."""

    head: bytes
    body: bytearray
    length_us: int
    times: list[Times]
    sums: list[tuple[int, int, bytes]]
    """Frames with a checksum: begin and end of what it covers, and its extra."""


def write_repeated(log: Path, size: int, out: Path) -> int:
    """Write about ``size`` bytes; returns how often the flight comes."""
    parts = {".tlog": _tlog, ".bin": _bin, ".ulg": _ulg}[suffix_of(log)](log)
    rounds = max((size - len(parts.head)) // len(parts.body), 1)
    with out.open("wb") as file:
        file.write(parts.head)
        for _ in range(rounds):
            file.write(parts.body)
            _move_on(parts)
    return rounds


def _move_on(parts: Parts) -> None:
    """Stamps of the next round, and the checksums over them."""
    body = np.frombuffer(parts.body, np.uint8)
    for times in parts.times:
        width = np.dtype(times.dtype).itemsize
        places = times.at[:, None] + np.arange(width)
        values = np.ascontiguousarray(body[places]).view(times.dtype).reshape(-1)
        moved = values + np.asarray(parts.length_us * times.per_s // 1_000_000, times.dtype)
        body[places] = moved.view(np.uint8).reshape(-1, width)
    for start, end, extra in parts.sums:
        covered = bytes(body[start:end]) + extra
        body[end : end + 2] = np.frombuffer(crc(covered).to_bytes(2, "little"), np.uint8)


def _tlog(path: Path) -> Parts:
    log = read_tlog(path)
    body = bytearray()
    stamps: list[int] = []
    fields: dict[tuple[str, int], list[int]] = {}
    sums = []
    for arrival_us, raw in log.frames():
        at = len(body)
        body += struct.pack(">Q", arrival_us) + raw
        stamps.append(at)
        head = 10 if raw[0] == V2 else 6
        number = int.from_bytes(raw[7:10], "little") if raw[0] == V2 else raw[5]
        end = at + 8 + head + raw[1]
        if number not in EXTRA:
            continue
        signed = raw[0] == V2 and raw[2] & 1
        assert end + 2 + (SIGNATURE_BYTES if signed else 0) == len(body)
        known = wire_format(number).dtype.fields or {}
        for name, per_s in (("time_boot_ms", 1000), ("time_usec", 1_000_000)):
            if name not in known:
                continue
            dtype, offset = known[name][:2]
            if offset + dtype.itemsize <= raw[1]:
                fields.setdefault((dtype.str, per_s), []).append(at + 8 + head + offset)
                sums.append((at + 9, end, EXTRA[number]))
    times = [Times(np.array(at), dtype, per_s) for (dtype, per_s), at in fields.items()]
    times.append(Times(np.array(stamps), ">u8", 1_000_000))
    length_us = int(log.arrival_us.max() - log.arrival_us.min()) + _PAUSE_US
    return Parts(b"", body, length_us, times, sums)


def _bin(path: Path) -> Parts:
    (log, *_) = read_boots(path)
    data = np.frombuffer(log.data, np.uint8)
    once = np.zeros(len(data), bool)
    stamped: dict[tuple[str, str], list[NDArray[np.int64]]] = {}
    for kind, offsets in log.places.items():
        if kind.name in _DECLARED_ONCE:
            once[(offsets[:, None] + np.arange(kind.length)).reshape(-1)] = True
        elif kind.stamp and kind.readable and kind.dtype is not None:
            dtype, offset = (kind.dtype.fields or {})[kind.stamp][:2]
            stamped.setdefault((dtype.str, kind.stamp), []).append(offsets + offset)
    new_place = np.cumsum(~once) - 1
    body = bytearray(data[~once].tobytes())
    times = []
    for (dtype, field), places in stamped.items():
        at = new_place[np.concatenate(places)]
        per_s = 1_000_000 if field == "TimeUS" else 1000
        times.append(Times(at, dtype, per_s))
    (flown, *_) = read(path)
    length_us = round(flown.duration_s * 1e6) + _PAUSE_US
    return Parts(data[once].tobytes(), body, length_us, times, [])


def _ulg(path: Path) -> Parts:
    data = path.read_bytes()
    head = bytearray(data[:_ULG_HEADER])
    body = bytearray()
    at = []
    for kind, message in _ulg_messages(data):
        if kind != ord("D"):
            head += message
            continue
        at.append(len(body) + 5)
        body += message
    places = np.array(at)
    stamps = np.frombuffer(body, np.uint8)[places[:, None] + np.arange(8)]
    times_us = np.ascontiguousarray(stamps).view("<u8")
    length_us = int(times_us.max() - times_us.min()) + _PAUSE_US
    return Parts(bytes(head), body, length_us, [Times(places, "<u8", 1_000_000)], [])


def _ulg_messages(data: bytes) -> Iterator[tuple[int, bytes]]:
    at = _ULG_HEADER
    while at + 3 <= len(data):
        end = at + 3 + int.from_bytes(data[at : at + 2], "little")
        yield data[at + 2], data[at:end]
        at = end
