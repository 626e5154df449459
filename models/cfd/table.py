"""The table of all computed cases: one line a case, with everything that was judged; written, read, never edited."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path

from models.cfd.campaign import Row
from models.cfd.case_run import Result
from models.cfd.position import MODELS, Position
from models.errors import ModelError
from models.frames import AXES

UNITS = ("N", "N", "N", "Nm", "Nm", "Nm")
PARTS = ("upper", "lower", "duct")
COLUMNS = (
    *("model", "h_over_r", "d_over_r", "rpm", "level", "approach", "status"),
    *(f"{a}_{u}" for a, u in zip(AXES, UNITS, strict=True)),
    *(f"swing_{a}_{u}" for a, u in zip(AXES, UNITS, strict=True)),
    *(f"drift_{a}_{u}" for a, u in zip(AXES, UNITS, strict=True)),
    *(f"Fz_{part}_N" for part in PARTS),
    *(f"error_{a}_{u}" for a, u in zip(AXES, UNITS, strict=True)),
    *(f"iterated_{a}_{u}" for a, u in zip(AXES, UNITS, strict=True)),
    *(f"iterated_error_{a}_{u}" for a, u in zip(AXES, UNITS, strict=True)),
    *("cells", "iterations", "steps", "seconds", "start", "note"),
)


def write(path: Path, rows: Sequence[Row]) -> None:
    """Write the cases, six digits. Raises ModelError where the file cannot be written."""
    text = io.StringIO()
    out = csv.writer(text, lineterminator="\n")
    out.writerow(COLUMNS)
    for p, r in ((row.position, row.result) for row in rows):
        numbers = (*r.wrench, *r.swing, *r.drift, *r.parts, *r.error, *r.iterated, *r.iterated_error)
        out.writerow(
            [
                *(p.model, f"{p.h:g}", f"{p.d:g}", f"{p.rpm:g}", f"{p.level:g}", p.approach),
                *(r.status, *(f"{v:.6g}" for v in numbers), r.cells, r.iterations, r.steps, f"{r.seconds:.0f}"),
                *(r.start, r.note),
            ]
        )
    try:
        path.write_text(text.getvalue(), encoding="utf-8")
    except OSError as error:
        raise ModelError(f"case table {path}: cannot be written ({error.strerror})") from None


def read(path: Path) -> list[Row]:
    """Read the cases. Raises ModelError naming the file and the line."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise ModelError(f"case table {path}: cannot be read ({reason})") from None
    lines = csv.reader(io.StringIO(text))
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
    def six(kind: str) -> tuple[float, ...]:
        return tuple(float(cell[f"{kind}{a}_{u}"]) for a, u in zip(AXES, UNITS, strict=True))

    if cell["model"] not in MODELS:
        raise ValueError(f"model '{cell['model']}' is none of {', '.join(MODELS)}")
    h, d, rpm, level = (float(cell[name]) for name in ("h_over_r", "d_over_r", "rpm", "level"))
    if any(math.isnan(v) for v in (h, d, rpm, level)):
        raise ValueError("h, d, rpm and level must be numbers")
    upper, lower, duct = (float(cell[f"Fz_{part}_N"]) for part in PARTS)
    return Row(
        Position(h, d, rpm, MODELS[cell["model"]], level, cell["approach"]),
        Result(
            wrench=six(""),
            swing=six("swing_"),
            drift=six("drift_"),
            parts=(upper, lower, duct),
            status=cell["status"],
            cells=int(cell["cells"]),
            iterations=int(cell["iterations"]),
            steps=int(cell["steps"]),
            seconds=float(cell["seconds"]),
            start=cell["start"],
            note=cell["note"],
            error=six("error_"),
            iterated=six("iterated_"),
            iterated_error=six("iterated_error_"),
        ),
    )
