"""The table of computed cases: one line a case, with everything that was judged; written, read, never edited."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path

from models.cfd.case_run import Result, Row
from models.cfd.position import MODELS, Position
from models.common.errors import ModelError
from models.common.frames import AXES
from models.common.text_file import read_text, write_text

UNITS = ("N", "N", "N", "Nm", "Nm", "Nm")


def six(kind: str) -> tuple[str, ...]:
    """Columns of the six components of one kind, such as ``swing_``."""
    return tuple(f"{kind}{a}_{u}" for a, u in zip(AXES, UNITS, strict=True))


NUMBERS = {
    **{"wrench": six(""), "swing": six("swing_"), "drift": six("drift_")},
    "parts": ("Fz_upper_N", "Fz_lower_N", "Fz_duct_N"),
    **{name: six(f"{name}_") for name in ("error", "iterated", "iterated_error")},
}
"""Fields of a result that are several numbers, with their columns."""
COUNTS = ("cells", "iterations", "steps")
COLUMNS = (
    *("model", "h_over_r", "d_over_r", "rpm", "level", "approach", "status"),
    *(column for columns in NUMBERS.values() for column in columns),
    *(*COUNTS, "seconds", "start", "note"),
)


def write(path: Path, rows: Sequence[Row]) -> None:
    """Write the cases, six digits. Raises ModelError where the file cannot be written."""
    text = io.StringIO()
    out = csv.writer(text, lineterminator="\n")
    out.writerow(COLUMNS)
    for row in rows:
        p = row.position
        r = row.result
        case = [p.model, f"{p.h:g}", f"{p.d:g}", f"{p.rpm:g}", f"{p.level:g}", p.approach]
        numbers = []
        for name in NUMBERS:
            for value in getattr(r, name):
                numbers.append(f"{value:.6g}")
        course = [r.cells, r.iterations, r.steps, f"{r.seconds:.0f}", r.start, r.note]
        out.writerow([*case, r.status, *numbers, *course])
    write_text("case table", path, text.getvalue(), ModelError)


def read(path: Path) -> list[Row]:
    """Read the cases. Raises ModelError naming the file and the line."""
    lines = csv.reader(io.StringIO(read_text("case table", path, ModelError)))
    if tuple(next(lines, ())) != COLUMNS:
        raise ModelError(f"case table {path}: has another header than this version writes")
    rows = []
    for number, line in enumerate(lines, 2):
        try:
            rows.append(_row(dict(zip(COLUMNS, line, strict=True))))
        except ValueError as error:
            raise ModelError(f"case table {path}: line {number}: {error}") from None
    return rows


def _row(cell: dict[str, str]) -> Row:
    if cell["model"] not in MODELS:
        raise ValueError(f"model '{cell['model']}' is none of {', '.join(MODELS)}")
    h = float(cell["h_over_r"])
    d = float(cell["d_over_r"])
    rpm = float(cell["rpm"])
    level = float(cell["level"])
    if math.isnan(h + d + rpm + level):
        raise ValueError("h, d, rpm and level must be numbers")
    numbers = {}
    for name, columns in NUMBERS.items():
        numbers[name] = tuple(float(cell[c]) for c in columns)
    counts = {name: int(cell[name]) for name in COUNTS}
    words = {name: cell[name] for name in ("status", "start", "note")}
    result = Result(**numbers, **counts, **words, seconds=float(cell["seconds"]))  # type: ignore[arg-type]
    position = Position(
        h=h, d=d, rpm=rpm, swirl=MODELS[cell["model"]], level=level, approach=cell["approach"]
    )
    return Row(position, result)
