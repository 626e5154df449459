"""Writes tables as Parquet or CSV, some ten thousand rows at a time: a table with all its empty cells is far larger."""

from __future__ import annotations

import csv
import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.common.frames import Array
from replay.export.columns import Column, LogTable
from replay.spill import release

_ROWS = 20_000
"""Rows in memory at a time: 16 MB with 100 columns."""
_ROWS_OF_TEXT = 4000
"""Rows in memory at a time as text, which takes six times as much."""
_KEYS = (("boot", "1", "start of the vehicle, from 1"), ("time_s", "s", "since the vehicle's boot"))
"""Columns that every row has: name, unit, description."""


def write_csv(
    path: Path, tables: Sequence[LogTable], columns: Sequence[Column], _: Mapping[str, str]
) -> None:
    """Names with their units in the first line, empty cells where a column has no sample."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([*(name for name, _, _ in _KEYS), *(c.name for c in columns)])
        for boot, t, values in blocks(tables, columns, _ROWS_OF_TEXT):
            cells = [map(_cell, column.tolist()) for column in values]
            writer.writerows(
                zip(itertools.repeat(boot + 1), map(_cell, t.tolist()), *cells, strict=False)
            )


def _cell(value: float | str | None) -> str:
    if isinstance(value, float):
        if math.isnan(value):
            return ""
        return f"{value:.10g}"
    return value or ""


def write_parquet(
    path: Path, tables: Sequence[LogTable], columns: Sequence[Column], about: Mapping[str, str]
) -> None:
    """Units and descriptions stand in the metadata of every column (keys ``unit``, ``description``)."""
    import pyarrow as pa
    from pyarrow import parquet

    kinds = [
        pa.int16(),
        pa.float64(),
        *(pa.float64() if c.words is None else pa.string() for c in columns),
    ]
    described = [*_KEYS, *((c.name, c.unit, c.description) for c in columns)]
    fields = [
        pa.field(name, kind, k >= len(_KEYS), {"unit": unit, "description": text})
        for k, (kind, (name, unit, text)) in enumerate(zip(kinds, described, strict=True))
    ]
    schema = pa.schema(fields, metadata=about)
    with parquet.ParquetWriter(path, schema) as writer:
        for boot, t, values in blocks(tables, columns):
            arrays: list[Any] = [np.full(len(t), boot + 1, np.int16), t]
            arrays += [
                pa.array(v, k, from_pandas=True) for v, k in zip(values, kinds[2:], strict=True)
            ]
            writer.write_table(pa.table(arrays, schema=schema))


def blocks(
    tables: Iterable[LogTable], columns: Sequence[Column], rows: int = _ROWS
) -> Iterator[tuple[int, Array, list[NDArray[Any]]]]:
    """Boot, times (n,) and the values (n,) of every column, some rows at a time; NaN, or None for text: no sample."""
    for table in tables:
        own = {c.name: c for c in table.columns}
        for start in range(0, len(table.t_s), rows):
            end = min(start + rows, len(table.t_s))
            values = [table.values(own.get(c.name, c), start, end) for c in columns]
            yield table.boot, table.t_s[start:end], values
            release()
