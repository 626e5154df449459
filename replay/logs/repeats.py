"""Messages that a .tlog holds twice, because two links of one vehicle were recorded into it: each is taken once.

Two links differ in delay, losses, sequence numbers, signatures and protocol version. What they deliver does not differ:
the same sender, message and payload. A message with a boot stamp is never sent twice, so it shows that there are two
links, and how far behind the second is. What has no stamp is a repeat where it follows no further behind.
"""

from __future__ import annotations

import math

import numpy as np

from companion.mavlink import AUTOPILOT_COMPONENT
from companion.mavlink.message_table import LAYOUTS
from companion.mavlink.wire_frames import cut
from models.common.frames import Whole
from replay.logs.tlog import Tlog
from replay.spill import BLOCK, Spool, blocks, spans

_UNIQUE = ("ATTITUDE", "ATTITUDE_QUATERNION", "LOCAL_POSITION_NED")
"""Sent once for every boot stamp."""
_FEW = 10
"""A link may deliver a frame again now and then."""
_LONGEST_MS = 10_000
"""Links never delay by ten seconds; what comes later is another recording, joined."""
_SHORTEST_MS = 0.1
"""No message is sent ten thousand times a second."""
_MOST = 0.99
"""Share of the repeats that show how far the second link is behind."""


def without_repeats(log: Tlog) -> tuple[Tlog, int]:
    """The log with every message once, the first to arrive; how many were left out."""
    behind = _frames_behind(log)
    if behind is None:
        return log, 0
    seen: dict[int, int] = {}
    kept = np.ones(len(log), bool)
    for place, (_, raw) in enumerate(log.frames()):
        frame = cut(raw, 0)
        # MAVLink 2 cuts trailing zeros, MAVLink 1 does not.
        key = hash((frame.id, frame.system, frame.component, frame.payload.rstrip(b"\0")))
        first = seen.get(key)
        if first is not None and place - first <= behind:
            kept[place] = False
        else:
            seen[key] = place
    return log.taken(np.flatnonzero(kept)), int((~kept).sum())


def _frames_behind(log: Tlog) -> int | None:
    """How many frames lie between a message and its repeat at most; None where nothing is repeated."""
    found = [np.empty(0, np.int64)]
    for layout in LAYOUTS.values():
        if layout.name not in _UNIQUE:
            continue
        index = log.indices(layout.id)
        index = index[log.component[index] == AUTOPILOT_COMPONENT]
        if len(index):
            found.append(_repeats(log, layout.id, index))
    distances = np.concatenate(found)
    if len(distances) <= _FEW:
        return None
    # Between others lie up to twice as many: messages come in bursts.
    return 2 * int(np.quantile(distances, _MOST)) + _FEW


def _repeats(log: Tlog, message_id: int, index: Whole) -> Whole:
    """Frames between the messages at ``index`` and their repeats, of those that a second link explains."""
    stamps = Spool(np.uint32)
    for rows in spans(index):
        records = log.records(message_id, index[rows])
        stamps.append(records["time_boot_ms"])
    distinct_ms = np.unique(stamps.array())
    span_ms = distinct_ms[-1] - distinct_ms[0]
    period_ms = span_ms / max(len(distinct_ms) - 1, 1)
    # Between a message and its repeat lie others, and the repeats of others.
    apart = math.floor(2 * _LONGEST_MS / max(period_ms, _SHORTEST_MS))
    found = [np.empty(0, np.int64)]
    for rows in blocks(len(index), max(BLOCK, 4 * apart)):
        own = index[rows.start : rows.stop + apart]
        first, repeat = _same(log, message_id, own)
        near = repeat - first <= apart
        near &= first < rows.stop - rows.start
        first = own[first[near]]
        repeat = own[repeat[near]]
        # A vehicle that starts again counts from the same stamps; that takes longer than a link delays.
        apart_us = np.abs(log.arrival_us[repeat] - log.arrival_us[first])
        by_a_link = apart_us < _LONGEST_MS * 1000
        found.append((repeat - first)[by_a_link])
    return np.concatenate(found)


def _same(log: Tlog, message_id: int, index: Whole) -> tuple[Whole, Whole]:
    """Which of the messages (n,) are alike: numbers of the one and of the next of its content, each (m,)."""
    records = log.records(message_id, index)
    payload = records.view(np.uint8).reshape(len(records), -1)
    content = np.column_stack([log.system[index], payload])
    rows = np.ascontiguousarray(content).view(f"V{content.shape[1]}")
    _, group = np.unique(rows.reshape(-1), return_inverse=True)
    order = np.argsort(group, kind="stable")
    again = np.diff(group[order]) == 0
    return order[:-1][again], order[1:][again]
