"""Writes tables as Parquet or CSV, some ten thousand rows at a time: memory does not grow with the file."""

from __future__ import annotations

import csv
import itertools
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from models.errors import ConfigError
from models.frames import Array
from replay.export.columns import Column, Table

_ROWS = 50_000
"""Rows in memory at a time: about 40 MB with 100 columns."""


def write_csv(path: Path, tables: Sequence[Table], metadata: dict[str, str]) -> int:
    """Names in the first line, empty cells where a column has no sample. Returns the number of rows.

    Units and descriptions stand beside it in ``FILE.csv-metadata.json`` (W3C, CSV on the Web: Metadata Vocabulary).
    """
    columns = _all_columns(tables)
    about: dict[str, Any] = {
        "@context": "http://www.w3.org/ns/csvw",
        "url": path.name,
        "notes": metadata,
        "tableSchema": {"columns": [{"name": n, "dc:description": d, "unit": u} for n, u, d in _described(columns)]},
    }
    path.with_name(f"{path.name}-metadata.json").write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
    head = [name for name, _, _ in _described(columns)]
    rows = 0
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(head)
        for boot, t, values in _pieces(tables, columns):
            rows += len(t)
            cells = [[_cell(v) for v in column.tolist()] for column in values]
            writer.writerows(zip(itertools.repeat(boot + 1), map(_cell, t.tolist()), *cells, strict=False))
    return rows


def _cell(value: float) -> str:
    return "" if value != value else f"{value:.10g}"


def write_parquet(path: Path, tables: Sequence[Table], metadata: dict[str, str]) -> int:
    """Units and descriptions stand in the metadata of every column (keys ``unit``, ``description``).

    Raises ConfigError where pyarrow is not installed. Returns the number of rows.
    """
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError:
        raise ConfigError(
            "--to parquet: needs the package pyarrow: pip install 'corner-compensator[export]', or --to csv"
        ) from None
    columns = _all_columns(tables)
    fields = [
        pa.field(
            name, pa.int16() if name == "boot" else pa.float64(), name not in _KEYS, {"unit": unit, "description": text}
        )
        for name, unit, text in _described(columns)
    ]
    schema = pa.schema(fields, metadata=metadata)
    rows = 0
    with parquet.ParquetWriter(path, schema) as writer:
        for boot, t, values in _pieces(tables, columns):
            rows += len(t)
            arrays: list[Any] = [np.full(len(t), boot + 1, np.int16), t]
            arrays += [pa.array(column, from_pandas=True) for column in values]  # NaN is null
            writer.write_table(pa.table(arrays, schema=schema))
    return rows


_KEYS = ("boot", "time_s")


def _described(columns: Sequence[Column]) -> list[tuple[str, str, str]]:
    """(name, unit, description) of every column of a file."""
    first = [("boot", "1", "start of the vehicle, from 1"), ("time_s", "s", "since the vehicle's boot")]
    return first + [(c.name, c.unit, c.description) for c in columns]


def _all_columns(tables: Sequence[Table]) -> list[Column]:
    """Every name once, in the order of first appearance."""
    return list({c.name: c for table in reversed(tables) for c in reversed(table.columns)}.values())[::-1]


def _pieces(tables: Sequence[Table], columns: Sequence[Column]) -> Iterator[tuple[int, Array, list[Array]]]:
    for table in tables:
        own = {c.name: c for c in table.columns}
        for start in range(0, len(table.t_s), _ROWS):
            end = min(start + _ROWS, len(table.t_s))
            nothing = np.full(end - start, np.nan)
            values = [table.values(own[c.name], start, end) if c.name in own else nothing for c in columns]
            yield table.boot, table.t_s[start:end], values
