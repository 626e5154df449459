"""Finds the whole messages of a cut or damaged PX4 log, so that pyulog reads all of them and nothing else.

A message is two bytes of length, one of type, and its payload (PX4, "ULog File Format"). There is no checksum: where a
length or a type cannot be, the walk looks for the next place from which several messages follow one another.
"""

from __future__ import annotations

import itertools
import re
import struct
from dataclasses import dataclass

from companion.mavlink.wire_frames import Content
from replay.spill import AT_ONCE, release

_FILE_HEADER = 16
_HEADER = 3
_TYPES = frozenset(b"BFIMPQAROLCSD")
_TYPE = re.compile(rb"[BFIMPQAROLCSD]")
_LONGEST = 10_000
_LONG = frozenset(b"FIM")
"""Bytes of a payload, as pyulog has it; reports of faults are longer."""
_FIXED = {ord("O"): 2, ord("S"): 8, ord("R"): 2}
"""Bytes of payloads that have one length: dropouts, synchronisation, the end of a subscription."""
_CHAIN = 8
"""So many messages in a row are no accident."""
_FLAG_BITS = ord("B")
_FLAGS = slice(_HEADER, _HEADER + 40)
"""The first message: flags, and where data was appended."""
_TEXT_FROM = {ord("F"): 0, ord("A"): 3, ord("L"): 9, ord("C"): 11}
"""Where the text of a message begins that is text to its end."""
_KEY_FROM = {ord("I"): 0, ord("P"): 0, ord("M"): 1, ord("Q"): 1}
"""Where the length of a key stands."""


@dataclass(frozen=True)
class Repaired:
    """A log without its damage."""

    data: Content
    first_damage: int
    """Offset of the first damage; the length of the log where there is none."""
    notes: tuple[str, ...]


def repaired(data: Content) -> Repaired:
    """The log itself where it is sound; else its whole messages alone, and what was lost."""
    walk = _Walk(data)
    if not walk.lost:
        return Repaired(data, len(data), ())
    gaps = [(0, 0), *walk.lost, (len(data), len(data))]
    kept = bytearray()
    for (_, start), (end, _) in itertools.pairwise(gaps):
        kept += data[start:end]
    if data[_FILE_HEADER + 2 : _FILE_HEADER + _HEADER] == b"B":
        # Places of appended data are no longer where they were; it follows the rest directly.
        flags = slice(_FILE_HEADER + _FLAGS.start + 8, _FILE_HEADER + _FLAGS.stop)
        kept[flags] = bytes(32)
    return Repaired(bytes(kept), walk.lost[0][0], tuple(walk.notes()))


class _Walk:
    """One pass over the messages."""

    def __init__(self, data: Content) -> None:
        self._data = data
        self.lost: list[tuple[int, int]] = []
        """Damage as start, end."""
        self._cut = 0
        i = before = min(_FILE_HEADER, len(data))
        looked_through = AT_ONCE
        for end in (*_appended(data), len(data)):
            while i < end:
                if i >= looked_through:
                    looked_through = i + AT_ONCE
                    release()
                following = self._end(i)
                within = i < following <= end
                readable = within and self._readable(i, following)
                if readable or (within and self._chain(following, end)):
                    if not readable:
                        self._lose(i, following)
                    before = i
                    i = following
                    continue
                # The length of the message before may be what is wrong.
                resumed = self._resume(before + 1, end)
                if resumed is None:
                    cut_off = following > end and data[i + 2] in _TYPES
                    if end == len(data):
                        self._cut = end - i if cut_off else 0
                    self._lose(i if cut_off else before, end)
                    resumed = end
                else:
                    self._lose(before, resumed)
                before = i = resumed
            i = max(i, end)

    def _lose(self, start: int, end: int) -> None:
        if self.lost and start <= self.lost[-1][1]:
            start = self.lost.pop()[0]
        if start < end:
            self.lost.append((start, end))

    def _end(self, i: int) -> int:
        """Where the message at ``i`` ends; 0 where none can begin there."""
        data = self._data
        if i + _HEADER > len(data) or data[i + 2] not in _TYPES:
            return 0
        kind = data[i + 2]
        length = data[i] | data[i + 1] << 8
        too_long = length > _LONGEST and kind not in _LONG
        if length == 0 or too_long or length != _FIXED.get(kind, length):
            return 0
        return i + _HEADER + length

    def _resume(self, i: int, end: int) -> int | None:
        """The next place from which messages follow one another, to the end where it is near."""
        for found in _TYPE.finditer(self._data, i + 2, end):
            start = found.start() - 2
            if self._chain(start, end):
                return start
        return None

    def _chain(self, i: int, end: int) -> bool:
        """Whether several messages follow one another from ``i``, or two and the end."""
        count = 0
        while count < _CHAIN and i < end:
            following = self._end(i)
            if not i < following <= end or not self._readable(i, following):
                return False
            i = following
            count += 1
        return count == _CHAIN or (count > 1 and i == end)

    def _readable(self, start: int, end: int) -> bool:
        """Whether the texts of a message are text: pyulog takes no other."""
        kind = self._data[start + 2]
        if kind in _TEXT_FROM:
            text = self._data[start + _HEADER + _TEXT_FROM[kind] : end]
        elif kind in _KEY_FROM:
            key = start + _HEADER + _KEY_FROM[kind] + 1
            text = self._data[key : key + self._data[key - 1]]
            if b" " not in text:
                return False
            if text.startswith(b"char["):
                text = self._data[key:end]
        else:
            return True
        try:
            text.decode()
        except UnicodeDecodeError:
            return False
        return True

    def notes(self) -> list[str]:
        """What a reader should know, in words."""
        out = []
        damaged = sum(end - start for start, end in self.lost) - self._cut
        places = len(self.lost) - (self._cut > 0)
        if damaged > 0:
            out.append(f"{damaged} damaged bytes skipped in {places} places")
        if self._cut:
            out.append(f"last message cut off ({self._cut} bytes)")
        return out


def _appended(data: Content) -> list[int]:
    """Where data was appended after the log had been written: there a message may be cut off."""
    first = data[_FILE_HEADER : _FILE_HEADER + _FLAGS.stop]
    if len(first) < _FLAGS.stop or first[2] != _FLAG_BITS or not first[_HEADER + 8] & 1:
        return []
    offsets = struct.unpack("<3Q", first[_HEADER + 16 : _FLAGS.stop])
    return sorted(o for o in offsets if _FILE_HEADER < o < len(data))
