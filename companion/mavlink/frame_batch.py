"""Checksums of many frames at once, for files: the same walk as ``frames.walk``, some times as fast.

A CRC is linear over exclusive or: every byte contributes by its value and its distance from the end alone, the initial
register by the length (Williams 1993, A painless guide to CRC error detection algorithms, chapter 9). So the frames'
last bytes are looked up together, then the last but one, and so on.
"""

from __future__ import annotations

from array import array
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from companion.mavlink.frames import CRC_EXTRAS, SIGNATURE_BYTES, V1, V2, Counts, good_run, walk

_BLOCK = 16384
"""Frames checked together: their bytes stay in the processor's cache."""
_CHUNK = 1 << 18
"""Bytes searched together, for the same reason."""
_ONE_BY_ONE = 2048
"""After damage so many are checked one by one first: where it is dense, blocks would be checked in vain."""
_LONGEST = 9 + 255 + 1
"""Bytes under a checksum: header without its first, payload, extra."""
_POLYNOMIAL = 0x8408
"""x^16 + x^12 + x^5 + 1, bits reversed: CRC-16/MCRF4XX, as MAVLink has it."""


def walk_file(data: bytes, counts: Counts, ahead: int = 0, *, whole: bool = True) -> tuple[array[int], int]:
    """``frames.walk`` of a file, or of a stretch of one (``whole`` False): the same offsets and counts."""
    return walk(data, counts, ahead, whole=whole, run=_BlockRun(data))


class _BlockRun:
    """``frames.good_run`` that checks blocks once a run is long."""

    def __init__(self, data: bytes) -> None:
        self._bytes = np.frombuffer(data, np.uint8)
        self._chain: tuple[NDArray[np.int64], NDArray[np.int64]] | None = None

    def __call__(self, data: bytes, i: int, ahead: int, starts: array[int]) -> int:
        while True:
            before = len(starts)
            i = good_run(data, i, ahead, starts, _ONE_BY_ONE)
            if len(starts) - before < _ONE_BY_ONE:
                return i
            while len(places := self._following(i, ahead)) > _ONE_BY_ONE:
                good = _good(self._bytes, places[:-1] + ahead)
                count = len(good) if good.all() else int(good.argmin())
                starts.frombytes(places[:count].tobytes())
                i = int(places[count])
                if count < len(good):
                    return i

    def _following(self, i: int, ahead: int) -> NDArray[np.int64]:
        """Offsets of frames from ``i`` on, a block at most, each where the last one ends, and where the last ends."""
        if self._chain is None:
            self._chain = _chained(self._bytes, ahead)
        magic, end = self._chain
        first = int(np.searchsorted(magic, i + ahead))
        starts, ends = magic[first : first + _BLOCK] - ahead, end[first : first + _BLOCK]
        apart = np.flatnonzero(np.concatenate([[i], ends[:-1]]) != starts)
        count = int(apart[0]) if apart.size else len(starts)
        return np.concatenate([starts[:count], ends[count - 1 : count]])


def _chained(data: NDArray[np.uint8], ahead: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Places of the bytes that may begin a frame, and where it ends.

    Of all bytes that look like the first of a frame these are followed, and all but the first of a run preceded, by
    another at the distance that their lengths say. That leaves hardly any but true ones.
    """
    n = len(data)
    parts = [np.flatnonzero(data[k : k + _CHUNK] >= V2) + k for k in range(0, n, _CHUNK)]
    magic = np.concatenate([*parts, np.empty(0, np.int64)])
    magic = magic[magic <= n - 3]
    magic = magic[data[magic] <= V1]
    length = data[magic + 1].astype(np.int64)
    v2 = data[magic] == V2
    end = magic + length + np.where(v2, np.where(data[magic + 2] & 1, 12 + SIGNATURE_BYTES, 12), 8)
    lead = data[np.minimum(end + ahead, n - 1)]
    kept = (end == n) | (end + ahead < n) & ((lead == V2) | (lead == V1))
    magic, end = magic[kept], end[kept]
    reached = np.zeros(n + ahead + 1, bool)
    reached[end + ahead] = True
    # The first of a run, after damage or at the start, was found good before the run became a block.
    kept = reached[magic]
    return magic[kept], end[kept]


def _good(data: NDArray[np.uint8], magic: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which of the frames that begin at ``magic`` (n,) are of a known message and pass their checksum."""
    initial, parts, extras = _tables()
    v2 = data[magic] == V2
    head = np.where(v2, 9, 5)  # bytes of the header behind the first
    number = data[magic + np.where(v2, 7, 5)].astype(np.int64)
    wide = magic[v2]
    number[v2] |= data[wide + 8].astype(np.int64) << 8 | data[wide + 9].astype(np.int64) << 16
    extra = np.where(number < len(extras), extras[np.minimum(number, len(extras) - 1)], -1)
    length = data[magic + 1] + head
    order = np.argsort((-length).astype(np.int16), kind="stable")  # of 16 bits: numpy sorts these by their digits
    end = (magic + 1 + length)[order]
    # How many frames are longer than k, for every k: those whose byte at distance k counts.
    longer = len(length) - np.cumsum(np.bincount(length, minlength=_LONGEST))
    crc = initial[length[order] + 1] ^ parts[0][extra[order]]
    at = end.copy()
    for k, m in enumerate(longer[: int(length.max())].tolist()):
        at[:m] -= 1
        crc[:m] ^= parts[k + 1].take(data.take(at[:m]))
    stored = data[end].astype(np.uint16) | data[end + 1].astype(np.uint16) << 8
    good = np.empty(len(magic), bool)
    good[order] = crc == stored
    return good & (extra >= 0)


@lru_cache(maxsize=1)
def _tables() -> tuple[NDArray[np.uint16], list[NDArray[np.uint16]], NDArray[np.int16]]:
    """What the initial register adds by length, what a byte adds by distance from the end, extra by id (-1: none)."""
    byte = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        byte = np.where(byte & 1, byte >> 1 ^ _POLYNOMIAL, byte >> 1).astype(np.uint16)
    parts, initial = [byte], [np.uint16(0xFFFF)]
    for _ in range(_LONGEST + 1):
        parts.append((parts[-1] >> 8) ^ byte[parts[-1] & 0xFF])
        initial.append((initial[-1] >> np.uint16(8)) ^ byte[initial[-1] & np.uint16(0xFF)])
    extras = np.full(max(CRC_EXTRAS) + 1, -1, np.int16)
    for number, extra in CRC_EXTRAS.items():
        extras[number] = extra
    return np.array(initial), parts, extras
