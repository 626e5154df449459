"""A season as tables: a view of it as rows, for CSV and Parquet."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import Any

from models.common.errors import ConfigError
from models.common.extras import how_to_install
from models.common.text_file import replaced
from replay.fleet.season import Season

Row = dict[str, Any]
BLOCK = 10_000
"""Rows of a table that memory holds."""


def _sizes(found: Season) -> Iterator[Row]:
    """Every parameter of every log."""
    for v in found.vehicles:
        for course in v.courses:
            for size in course.sizes:
                yield {
                    "vehicle": v.vehicle,
                    "date": size.date,
                    "log": size.log,
                    "effect": course.effect,
                    "parameter": course.parameter,
                    "value": size.value,
                    "low": size.low,
                    "high": size.high,
                    "unit": course.unit,
                }


def _changes(found: Season) -> Iterator[Row]:
    """Every parameter that is another one from a log on."""
    for v in found.vehicles:
        for course in v.changed:
            assert course.change is not None
            yield {
                "vehicle": v.vehicle,
                "date": course.change.date,
                "log": course.change.since,
                "effect": course.effect,
                "parameter": course.parameter,
                "before": course.change.before,
                "after": course.change.after,
                "unit": course.unit,
                "log_odds": course.change.log_odds,
            }


def _vehicles(found: Season) -> Iterator[Row]:
    """Every vehicle."""
    for v in found.vehicles:
        yield {
            "vehicle": v.vehicle,
            "board": v.board,
            "firmware": v.firmware,
            "frame": v.frame,
            "first": v.first,
            "last": v.last,
            "judged": v.judged,
            "not_judged": len(v.not_judged),
            "changed": len(v.changed),
            "new": " ".join(v.new),
        }


def _unjudged(found: Season) -> Iterator[Row]:
    """Every log without an answer."""
    for v in found.vehicles:
        for log, why in v.not_judged:
            yield {"vehicle": v.vehicle, "log": log, "why": why}
    for log, why in found.unknown:
        yield {"vehicle": "", "log": log, "why": why}


@dataclass(frozen=True)
class View:
    """Rows, and their columns by type."""

    rows: Callable[[Season], Iterator[Row]]
    columns: Mapping[str, type]


def _columns(words: str, numbers: str = "", counts: str = "") -> dict[str, type]:
    """In this order; names are separated by spaces."""
    columns: dict[str, type] = dict.fromkeys(words.split(), str)
    columns |= dict.fromkeys(numbers.split(), float)
    return columns | dict.fromkeys(counts.split(), int)


_OF_LOG = "vehicle date log effect parameter"
VIEWS = {
    "sizes": View(_sizes, {**_columns(_OF_LOG, "value low high"), "unit": str}),
    "changes": View(_changes, {**_columns(_OF_LOG, "before after log_odds"), "unit": str}),
    "vehicles": View(
        _vehicles,
        _columns("vehicle board firmware frame first last new", "", "judged not_judged changed"),
    ),
    "unjudged": View(_unjudged, _columns("vehicle log why")),
}
"""By the name that ``--view`` gives."""


def write_csv(found: Season, view: str, path: Path) -> None:
    """The columns' names in the first line. Raises ConfigError."""
    with replaced("--csv", path) as part, part.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(VIEWS[view].columns), lineterminator="\n")
        writer.writeheader()
        writer.writerows(VIEWS[view].rows(found))


def check_parquet() -> None:
    """Raises ConfigError where the package is missing."""
    if find_spec("pyarrow") is None:
        raise ConfigError(
            f"--parquet: needs the package pyarrow: {how_to_install('export')}, or --csv"
        )


def write_parquet(found: Season, view: str, path: Path) -> None:
    """The same with types. Raises ConfigError."""
    import pyarrow as pa
    from pyarrow import parquet

    kinds = {str: pa.string(), float: pa.float64(), int: pa.int64()}
    schema = pa.schema([(name, kinds[kind]) for name, kind in VIEWS[view].columns.items()])
    rows = VIEWS[view].rows(found)
    with replaced("--parquet", path) as part, parquet.ParquetWriter(part, schema) as file:
        while block := list(islice(rows, BLOCK)):
            file.write_table(pa.Table.from_pylist(block, schema))
