"""Logs whose records are mutated one by one: most of them get past the framing of their format, into the reader."""

from __future__ import annotations

import random
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from companion.mavlink.wire_frames import cut, pack

Change = Callable[[bytes, random.Random], bytes]
"""A payload, or a record, to another one."""

SHARES = (0.05, 0.3, 1.0)
"""Of the records of one file that are mutated: seldom ones meet a reader that has understood the rest."""
_DEFINITIONS_TOO = 0.1
"""Of the files: definitions (FMT, formats, subscriptions) are mutated as well."""
_BIN_HEAD = 3
_BIN_FMT = 128
_ULG_HEAD = 16
"""Bytes of a .BIN record's header, its type for FMT, and of a .ulg file's header."""


@dataclass(frozen=True)
class LogKind:
    """A good log of one format, in records."""

    suffix: str
    head: bytes
    """What comes before the first record."""
    definitions: Sequence[bytes]
    records: Sequence[bytes]
    framed: Callable[[bytes, bytes], bytes]
    """A record and a payload: the record with that payload and all else right."""
    payload: Callable[[bytes], bytes]

    def mutated(self, rng: random.Random, change: Change, damage: Change) -> tuple[bytes, int]:
        """A file and how many of its records are mutated: ``change`` makes a payload, ``damage`` a whole record."""
        share = rng.choice(SHARES)
        out = [self.head]
        count = 0
        own = share if rng.random() < _DEFINITIONS_TOO else 0.0
        for part, hit in ((self.definitions, own), (self.records, share)):
            for record in part:
                if rng.random() >= hit:
                    out.append(record)
                    continue
                count += 1
                way = rng.random()
                if way < 0.8:
                    payload = self.payload(record)
                    new = change(payload, rng) if way < 0.6 else rng.randbytes(len(payload))
                    out.append(self.framed(record, new))
                else:
                    out.append(damage(record, rng) if way < 0.95 else record + record)
        return b"".join(out), count


def tlog_kind(records: Sequence[bytes]) -> LogKind:
    """A .tlog: each record a stamp of 8 bytes and a frame. Mutated frames have a right checksum."""

    def framed(record: bytes, payload: bytes) -> bytes:
        head = cut(record[8:], 0)
        return record[:8] + pack(head.id, payload, head.system, head.component, record[12])

    return LogKind(".tlog", b"", (), records, framed, lambda record: cut(record[8:], 0).payload)


def bin_kind(data: bytes) -> LogKind:
    """A .BIN: two magic bytes, a type, and a payload as long as that type's FMT record says."""
    lengths = {_BIN_FMT: 89}
    definitions = []
    records = []
    at = 0
    while at < len(data):
        kind = data[at + 2]
        record = data[at : at + lengths[kind]]
        if kind == _BIN_FMT:
            lengths[record[_BIN_HEAD]] = record[_BIN_HEAD + 1]
        (definitions if kind == _BIN_FMT else records).append(record)
        at += len(record)
    return LogKind(
        ".bin", b"", definitions, records, lambda r, p: r[:_BIN_HEAD] + p, lambda r: r[_BIN_HEAD:]
    )


def ulg_kind(data: bytes) -> LogKind:
    """A .ulg: a header, then records of a length, a type and a payload."""
    definitions = []
    records = []
    at = _ULG_HEAD
    while at < len(data):
        size, kind = struct.unpack_from("<HB", data, at)
        record = data[at : at + 3 + size]
        (records if kind == ord("D") else definitions).append(record)
        at += len(record)
    return LogKind(
        ".ulg", data[:_ULG_HEAD], definitions, records, lambda r, p: r[:3] + p, lambda r: r[3:]
    )
