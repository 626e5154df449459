"""Writes tables as MCAP, for Foxglove: a topic for the columns of one message, JSON with its schema.

Times are nanoseconds on the vehicle's boot clock; a later boot begins a second after the one before has ended.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from replay.export.columns import Column, LogTable
from replay.export.files import blocks

_BETWEEN_BOOTS_NS = 10**9
_ROWS = 2000
"""Rows in memory at a time: 10 MB as messages."""


def write_mcap(
    path: Path, tables: Sequence[LogTable], columns: Sequence[Column], about: Mapping[str, str]
) -> None:
    """A message for every row of a topic that holds a value."""
    from mcap.writer import Writer

    boot_now = -1
    shift_ns = 0
    last_ns = 0
    topics = defaultdict[str, list[int]](list)
    for k, column in enumerate(columns):
        topics[column.topic].append(k)
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(library=about["made_by"])
        writer.add_metadata("export", dict(about))
        channels = {}
        for topic, own in topics.items():
            schema = json.dumps(_schema([columns[k] for k in own])).encode()
            schema_id = writer.register_schema(f"corner_compensator.{topic}", "jsonschema", schema)
            channels[topic] = writer.register_channel(f"/{topic}", "json", schema_id)
        for boot, t_s, values in blocks(tables, columns, _ROWS):
            times = [round(t * 1e9) for t in t_s.tolist()]
            if boot != boot_now:  # a time of MCAP cannot be negative
                if boot_now < 0:
                    shift_ns = max(-times[0], 0)
                else:
                    shift_ns = last_ns + _BETWEEN_BOOTS_NS - times[0]
            boot_now = boot
            last_ns = times[-1] + shift_ns
            cells = [column.tolist() for column in values]
            for row, time_ns in enumerate(times):
                for topic, own in topics.items():
                    known = {
                        columns[k].name: v
                        for k in own
                        if (v := cells[k][row]) is not None and v == v
                    }
                    if known:
                        content = json.dumps({"boot": boot + 1, **known}).encode()
                        writer.add_message(
                            channels[topic], time_ns + shift_ns, content, time_ns + shift_ns
                        )
        writer.finish()


def _schema(columns: Sequence[Column]) -> dict[str, Any]:
    """JSON schema of a topic, units in the descriptions."""
    properties: dict[str, Any] = {
        "boot": {"type": "integer", "description": "start of the vehicle, from 1"}
    }
    for c in columns:
        if c.words is None:
            kind = "number"
        else:
            kind = "string"
        properties[c.name] = {"type": kind, "description": f"{c.description} [{c.unit}]"}
    return {"type": "object", "properties": properties}
