"""``models compare --report`` as one HTML page: the method to use first, then every table and figure."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any

from models.pages.document import document, pictures, verdict, write_document
from models.training.compare import text


def write_page(directory: Path, numbers: Mapping[str, Any], command: str) -> Path:
    """Write ``report.html`` with the figures that lie in ``directory`` inside it; ``command``: what to type next."""
    use = numbers["use"]
    head = f"Best surrogate of this data set: {use['method']}"
    parts = [
        f"<h1>{escape(head)}</h1>",
        verdict(f"Use {use['method']}.", [f"Next: {command}", f"Why: {use['why']}."]),
        f"<pre>{escape(text(numbers))}</pre>",
        "<h2>Figures</h2>",
        pictures(sorted(directory.glob("*.png"))),
    ]
    return write_document("--report", directory / "report.html", document(head, parts))
