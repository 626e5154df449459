"""``models compare --report`` as one HTML page: the method to use first, then what each method reaches."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from models.frames import AXES
from models.pages.document import document, folded, items, pictures, table, verdict, write_document
from models.training.compare import text


def write_page(directory: Path, numbers: Mapping[str, Any], command: str) -> Path:
    """Write ``report.html`` with the figures that lie in ``directory`` inside it; ``command``: what to type next."""
    figures = sorted(directory.glob("*.png"))
    return write_document("--report", directory / "report.html", page(numbers, figures, command))


def page(numbers: Mapping[str, Any], figures: list[Path], command: str) -> str:
    """The page of the numbers of a comparison (``Comparison.numbers``)."""
    use = numbers["use"]
    about = (
        f"{numbers['rows']} rows at {numbers['places']} places of {numbers['data']}, "
        f"{numbers['splits']} splits by place, seed {numbers['seed']}."
    )
    steps = [f"Next: {command}", f"Why: {use['why']}."]
    return document(
        "Surrogates compared",
        [
            "<h1>Surrogates compared</h1>",
            verdict(f"Use this one: {use['method']}.", steps),
            f'<p class="dim">{escape(about)}</p>',
            items(numbers["notes"]),
            "<h2>Every method</h2><p>R² of what ground and wall add to the free-air lift, on places that the method "
            "never saw: 1 is perfect, 0 as good as the mean. Regions: error where a whole region was left out, over "
            "the increments there; 1 is as bad as no model.</p>",
            table(("method", "mean R²", "worst component", "regions"), _methods(numbers), numbers=(1, 2, 3)),
            folded("Every table, and what the paper states", f"<pre>{escape(text(numbers))}</pre>"),
            "<h2>Figures</h2>",
            pictures(figures),
        ],
    )


def _methods(numbers: Mapping[str, Any]) -> list[list[str]]:
    """Method, mean and worst held-out R², mean error in regions left out; the best first."""
    out = []
    for method, row in numbers["table2"]["honest"].items():
        live = {a: row[a]["test"] for a in AXES if row[a]["test"] is not None}
        worst = min(live, key=lambda a: live[a])
        regions = [r["relative_error"][method] for r in numbers["regions"].values()]
        error = f"{np.mean(regions):.2f}" if regions else ""
        out.append((float(np.mean(list(live.values()))), method, f"{worst} {live[worst]:.3f}", error))
    chosen = numbers["use"]["method"]
    return [
        [f"<b>{escape(m)}</b>" if m == chosen else escape(m), f"{mean:.3f}", worst, error]
        for mean, m, worst, error in sorted(out, reverse=True)
    ]
