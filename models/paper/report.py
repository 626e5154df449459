"""The page and the tables of ``models paper``."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Sequence
from html import escape
from pathlib import Path

from models.common.pages.document import document, verdict, write_document
from models.paper.exhibit import Exhibit

SOURCE = (
    "Ai, Xu, Xiang, Fan and Zhang 2020, Modeling of a novel coaxial ducted fan aerial robot "
    "combined with corner environment by using artificial neural network, Sensors 20(20), 5805."
)


def text(exhibits: Sequence[Exhibit]) -> str:
    """A line each, and the count of verdicts."""
    lines = [f"[{one.verdict}] {one.title}: {one.paper}; here: {one.here}" for one in exhibits]
    return "\n".join([*lines, counted(exhibits)])


def counted(exhibits: Sequence[Exhibit]) -> str:
    """How many of each verdict."""
    counts = Counter(one.verdict for one in exhibits)
    return ", ".join(f"{count} {name}" for name, count in counts.most_common())


def write(directory: Path, exhibits: Sequence[Exhibit]) -> Path:
    """``report.html`` with all figures and tables, and each table as CSV. Raises ConfigError."""
    parts = [
        "<h1>The paper's figures and tables from our data</h1>",
        verdict(counted(exhibits), [SOURCE, "Its data were never published; these are our own."]),
    ]
    for one in exhibits:
        parts.append(_section(one))
        if one.rows:
            name = one.title.replace(" ", "_")
            write_document("--out", directory / f"{name}.csv", _csv(one))
    page = document("The paper's figures from our data", parts)
    return write_document("--out", directory / "report.html", page)


def _section(one: Exhibit) -> str:
    title = one.title[0].upper() + one.title[1:]
    said = [("the paper", one.paper), ("here", one.here), ("", one.verdict)]
    lines = "".join(f"<tr><td>{escape(a)}</td><td>{escape(b)}</td></tr>" for a, b in said)
    plots = f'<div class="plots">{"".join(one.plots)}</div>' if one.plots else ""
    return f"<h2>{escape(title)}</h2><table>{lines}</table>{plots}{_table(one)}"


def _table(one: Exhibit) -> str:
    if not one.rows:
        return ""
    head = "".join(f"<th>{escape(cell)}</th>" for cell in one.head)
    body = []
    for row in one.rows:
        cells = "".join(f"<td>{escape(cell)}</td>" for cell in row)
        body.append(f"<tr>{cells}</tr>")
    return f'<div class="wide" tabindex="0"><table><tr>{head}</tr>{"".join(body)}</table></div>'


def _csv(one: Exhibit) -> str:
    out = io.StringIO(newline="")
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(one.head)
    writer.writerows(one.rows)
    return out.getvalue()
