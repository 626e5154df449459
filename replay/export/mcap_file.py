"""Writes tables as MCAP, for Foxglove: a topic for the columns of one message, JSON with its schema, and transforms.

Times are nanoseconds on the vehicle's boot clock; a later boot begins a second after the one before has ended. The
transforms show the vehicle in a 3D panel: ``world`` (z up) to ``ned``, its position in it, its attitude at that.
"""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any

from replay.export.columns import Column
from replay.export.files import Written, blocks, missing, whole
from replay.export.tables import Tables

_BETWEEN_BOOTS_NS = 10**9
_ROWS = 2000
"""Rows in memory at a time: 10 MB as messages."""
_TRANSFORM = "foxglove.FrameTransform"
_NO_TURN = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
_HERE = {"x": 0.0, "y": 0.0, "z": 0.0}
_Message = tuple[int, str, Mapping[str, Any]]
"""Row, topic, content."""


def _transform(parent: str, child: str, place: Mapping[str, float], turn: Mapping[str, float]) -> Mapping[str, Any]:
    return {"parent_frame_id": parent, "child_frame_id": child, "translation": place, "rotation": turn}


_HALF = math.sqrt(0.5)
_TO_NED = _transform("world", "ned", _HERE, {"x": _HALF, "y": _HALF, "z": 0.0, "w": 0.0})
"""North is y and east is x of ``world``."""


def _stamp(time_ns: int) -> Mapping[str, int]:
    sec, nsec = divmod(time_ns, 10**9)
    return {"sec": sec, "nsec": nsec}


def write_mcap(path: Path, tables: Tables, metadata: dict[str, str]) -> Written:
    """A message for every row of a topic that holds a value. Raises ConfigError where mcap is not installed."""
    try:
        from mcap.writer import Writer
    except ImportError:
        raise missing("mcap", "mcap") from None
    rows, boot_now, shift_ns, last_ns = 0, -1, 0, 0
    with whole(path) as part, part.open("wb") as file:
        columns = tables.columns()
        writer = Writer(file)
        writer.start(library=metadata["made_by"])
        writer.add_metadata("export", metadata)
        topics = defaultdict[str, list[int]](list)
        for k, column in enumerate(columns):
            topics[column.topic].append(k)
        schemas = {t: (f"corner_compensator.{t}", _schema([columns[k] for k in own])) for t, own in topics.items()}
        schemas["tf"] = (_TRANSFORM, _schema_like({"timestamp": _stamp(0), **_TO_NED}))
        channels = {}
        for topic, (name, schema) in schemas.items():
            schema_id = writer.register_schema(name, "jsonschema", json.dumps(schema).encode())
            channels[topic] = writer.register_channel(f"/{topic}", "json", schema_id)
        for boot, t_s, values in blocks(tables, columns, _ROWS):
            rows += len(t_s)
            times = [round(t * 1e9) for t in t_s.tolist()]
            new = boot != boot_now
            if new:  # a time of MCAP cannot be negative
                shift_ns = max(-times[0], 0) if boot_now < 0 else last_ns + _BETWEEN_BOOTS_NS - times[0]
            boot_now = boot
            cells = {t: {columns[k].name: values[k].tolist() for k in own} for t, own in topics.items()}
            for row, topic, content in _messages(cells, boot, new=new):
                last_ns = times[row] + shift_ns
                if topic == "tf":
                    content = {"timestamp": _stamp(last_ns), **content}
                writer.add_message(channels[topic], last_ns, json.dumps(content).encode(), last_ns)
        writer.finish()
    return Written(rows, len(columns))


def _messages(cells: Mapping[str, Mapping[str, list[Any]]], boot: int, *, new: bool) -> list[_Message]:
    """Everything in some rows, in order of time. ``cells``: values by topic and name. ``new``: the boot begins here."""
    out: list[_Message] = [(0, "tf", _TO_NED)] if new else []
    for topic, own in cells.items():
        for row, numbers in enumerate(zip(*own.values(), strict=True)):
            known = {n: v for n, v in zip(own, numbers, strict=True) if v is not None and v == v}
            if known:
                out.append((row, topic, {"boot": boot + 1, **known}))
                out.extend((row, "tf", transform) for transform in _pose(topic, known))
    out.sort(key=itemgetter(0))
    return out


def _pose(topic: str, known: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """The transform that a position or an attitude is."""
    if topic == "position" and len(known) == 3:
        place = {axis: known[name] for axis, name in zip("xyz", ("north_m", "east_m", "down_m"), strict=True)}
        yield _transform("ned", "vehicle_ned", place, _NO_TURN)
    if topic == "attitude" and len(known) == 4:
        yield _transform("vehicle_ned", "vehicle", _HERE, {axis: known[f"attitude_q{axis}"] for axis in "xyzw"})


def _schema(columns: Sequence[Column]) -> dict[str, Any]:
    """JSON schema of a topic, units in the descriptions."""
    properties: dict[str, Any] = {"boot": {"type": "integer", "description": "start of the vehicle, from 1"}}
    for c in columns:
        kind = "number" if c.words is None else "string"
        properties[c.name] = {"type": kind, "description": f"{c.description} [{c.unit}]"}
    return {"type": "object", "properties": properties}


def _schema_like(content: Any) -> dict[str, Any]:
    """JSON schema of messages like this one."""
    if isinstance(content, Mapping):
        return {"type": "object", "properties": {name: _schema_like(value) for name, value in content.items()}}
    return {"type": {str: "string", float: "number", int: "integer"}[type(content)]}
