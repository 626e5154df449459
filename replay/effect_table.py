"""Effects of an answer as a table: a row a parameter, in plain numbers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from html import escape
from typing import Any

from replay.diagnosis.answer import Diagnosis

COLUMNS = ("effect", "parameter", "value", "low", "high", "unit", "probability", "explains", "kept")


@dataclass(frozen=True, kw_only=True)
class EffectRow:
    """One parameter of one effect."""

    effect: str
    parameter: str
    value: float | None
    """None: not determined by the flights."""
    low: float | None
    high: float | None
    """95 % interval; None: not estimated, as a fan's number."""
    unit: str
    probability: float
    """Of the effect."""
    explains: float
    """Share of the residual's energy on held-out time."""
    kept: bool
    """Whether the amended model takes the effect to the next flight."""


@dataclass(frozen=True)
class EffectTable:
    """Rows of the effects that were found, the largest effect first."""

    rows: tuple[EffectRow, ...]

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[EffectRow]:
        return iter(self.rows)

    @property
    def names(self) -> list[str]:
        """Effects, once each."""
        return list(dict.fromkeys(row.effect for row in self.rows))

    def as_dicts(self) -> list[dict[str, Any]]:
        """Plain values: ``pandas.DataFrame(table.as_dicts())`` makes a frame of it."""
        return [asdict(row) for row in self.rows]

    def __repr__(self) -> str:
        if not self.rows:
            return "no effect was found"
        cells = [list(COLUMNS), *(_cells(row) for row in self.rows)]
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        lines = []
        for line in cells:
            padded = [text.ljust(width) for text, width in zip(line, widths, strict=True)]
            lines.append("  ".join(padded).rstrip())
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        head = "".join(f"<th>{name}</th>" for name in COLUMNS)
        body = ""
        for row in self.rows:
            cells = "".join(f"<td>{escape(text)}</td>" for text in _cells(row))
            body += f"<tr>{cells}</tr>"
        return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def effect_table(answer: Diagnosis) -> EffectTable:
    """The effects of an answer."""
    rows = []
    for found in answer.found:
        for estimate in answer.numbers_of(found):
            low, high = estimate.ci95 or (None, None)
            rows.append(
                EffectRow(
                    effect=found.effect.name,
                    parameter=estimate.name,
                    value=float(estimate.value) if estimate.determined else None,
                    low=None if low is None else float(low),
                    high=None if high is None else float(high),
                    unit=estimate.unit,
                    probability=float(found.probability),
                    explains=float(found.explains),
                    kept=found.kept,
                )
            )
    return EffectTable(tuple(rows))


def _cells(row: EffectRow) -> list[str]:
    out = []
    for name in COLUMNS:
        value = getattr(row, name)
        if value is None:
            out.append("-")
        elif isinstance(value, bool):
            out.append("yes" if value else "no")
        elif isinstance(value, float):
            out.append(f"{value:.4g}")
        else:
            out.append(value)
    return out
