"""``models cfd check --report`` as one HTML page: what the simulation is good for first, then every statement."""

from __future__ import annotations

from collections import Counter
from html import escape
from pathlib import Path

from models.cfd.check import AGREES, DISAGREES, OPEN, Checked, text
from models.cfd.config import Setup
from models.pages.document import document, folded, pictures, table, verdict, write_document

_MOST = 0.75
"""Share of published statements from which on the set may be flown after a look at those that disagree."""


def write_page(directory: Path, c: Checked, setup: Setup) -> Path:
    """Write ``report.html`` with the figures that lie in ``directory`` inside it."""
    return write_document("--report", directory / "report.html", page(c, setup, sorted(directory.glob("*.png"))))


def page(c: Checked, setup: Setup, figures: list[Path]) -> str:
    """The page of one check."""
    counts = Counter(s.verdict for s in c.statements)
    met = counts[AGREES]
    listed = ", ".join(f"{n} {name}" for name, n in counts.most_common())
    steps = [_action(met, len(c.statements)), f"Of all: {listed}." if listed else ""]
    order = {DISAGREES: 0, OPEN: 1}
    said = sorted(c.statements, key=lambda s: order.get(s.verdict, 2))
    rows = [
        [
            f"<b>{escape(s.verdict)}</b>",
            f'{escape(s.claim)}<br><span class="dim">{escape(s.source)}</span>',
            escape(s.ours),
        ]
        for s in said
    ]
    s = c.summary
    return document(
        f"Flow simulation: {setup.fan.name}",
        [
            f"<h1>Flow simulation of the {escape(setup.fan.name)}</h1>",
            verdict(f"{met} of {len(c.statements)} published statements agree.", [t for t in steps if t]),
            f'<p class="dim">{s["cases"]} cases, {s["positions"]} positions, {s["cpu_hours"]:.1f} hours in the solver. '
            f"Free lift {c.free:.2f} N.</p>",
            "<h2>What was published, and what came out</h2>",
            table(("", "statement", "here"), rows),
            "<h2>Figures</h2>",
            pictures(figures),
            folded("Everything that was computed", f"<pre>{escape(text(c))}</pre>"),
        ],
    )


def _action(met: int, said: int) -> str:
    if not said:
        return "Next: run more positions; nothing can be compared yet."
    if met >= _MOST * said:
        return "Next: models cfd assemble, then models compare on the set. Look at the statements that disagree first."
    return (
        "Next: look at the statements that disagree; until they are understood, fly the closed form and use this set "
        "beside it."
    )
