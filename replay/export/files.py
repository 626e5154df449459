"""Writes tables as Parquet or CSV, some ten thousand rows at a time: memory does not grow with the file.

Tables come one after another and are gone through twice: once for the names of all columns, once for the rows.
"""

from __future__ import annotations

import csv
import itertools
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from models.errors import ConfigError
from models.frames import Array
from replay.export.columns import Table

_ROWS = 20_000
"""Rows in memory at a time: 16 MB with 100 columns, six times that as text."""
_KEYS = (("boot", "1", "start of the vehicle, from 1"), ("time_s", "s", "since the vehicle's boot"))
"""Columns that every row has: name, unit, description."""


@dataclass(frozen=True)
class Written:
    """What a file holds; ``columns`` beside the keys."""

    rows: int
    columns: int


def write_csv(path: Path, tables: Iterable[Table], metadata: dict[str, str]) -> Written:
    """Names in the first line, empty cells where a column has no sample.

    Units and descriptions stand beside it in ``FILE.csv-metadata.json`` (W3C, CSV on the Web: Metadata Vocabulary).
    """
    columns = _all_columns(tables)
    about: dict[str, Any] = {
        "@context": "http://www.w3.org/ns/csvw",
        "url": path.name,
        "notes": metadata,
        "tableSchema": {"columns": [{"name": n, "dc:description": d, "unit": u} for n, u, d in (*_KEYS, *columns)]},
    }
    path.with_name(f"{path.name}-metadata.json").write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
    rows = 0
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([name for name, _, _ in (*_KEYS, *columns)])
        for boot, t, values in _rows(tables, [name for name, _, _ in columns]):
            rows += len(t)
            cells = [[_cell(v) for v in column.tolist()] for column in values]
            writer.writerows(zip(itertools.repeat(boot + 1), map(_cell, t.tolist()), *cells, strict=False))
    return Written(rows, len(columns))


def _cell(value: float) -> str:
    return "" if value != value else f"{value:.10g}"


def write_parquet(path: Path, tables: Iterable[Table], metadata: dict[str, str]) -> Written:
    """Units and descriptions stand in the metadata of every column (keys ``unit``, ``description``).

    Raises ConfigError where pyarrow is not installed.
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
        pa.field(name, pa.int16() if name == "boot" else pa.float64(), nullable, {"unit": unit, "description": text})
        for nullable, described in ((False, _KEYS), (True, columns))
        for name, unit, text in described
    ]
    schema = pa.schema(fields, metadata=metadata)
    rows = 0
    with parquet.ParquetWriter(path, schema) as writer:
        for boot, t, values in _rows(tables, [name for name, _, _ in columns]):
            rows += len(t)
            arrays: list[Any] = [np.full(len(t), boot + 1, np.int16), t]
            arrays += [pa.array(column, from_pandas=True) for column in values]  # NaN is null
            writer.write_table(pa.table(arrays, schema=schema))
    return Written(rows, len(columns))


def _all_columns(tables: Iterable[Table]) -> list[tuple[str, str, str]]:
    """(name, unit, description) of every column but the keys, in the order of first appearance."""
    seen: dict[str, tuple[str, str, str]] = {}
    for table in tables:
        for c in table.columns:
            seen.setdefault(c.name, (c.name, c.unit, c.description))
    return list(seen.values())


def _rows(tables: Iterable[Table], names: Sequence[str]) -> Iterator[tuple[int, Array, list[Array]]]:
    for table in tables:
        own = {c.name: c for c in table.columns}
        for start in range(0, len(table.t_s), _ROWS):
            end = min(start + _ROWS, len(table.t_s))
            nothing = np.full(end - start, np.nan)
            values = [table.values(own[name], start, end) if name in own else nothing for name in names]
            yield table.boot, table.t_s[start:end], values
