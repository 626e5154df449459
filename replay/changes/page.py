"""``--since`` as one HTML page: what changed, since which log, how sure, and the size of each over the logs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

from models.pages.document import document, items, table, verdict
from models.vehicle import Vehicle
from replay.changes.since import Changed, Since
from replay.diagnosis.over_logs import plot
from replay.diagnosis.words import estimate_words, listed, plain


def page(answer: Since, vehicle: Vehicle, faults: Sequence[Mapping[str, str]] = ()) -> str:
    """The whole page. ``faults``: ``channel`` and ``what`` of a model or vehicle file of another vehicle."""
    head = "; ".join(map(_finding, answer.changed)) or "Nothing changed"
    good = ", ".join(r.name for r in answer.good.records)
    reasons = [
        f"Compared with the good flights: {good}. Differences as large as among the good flights are not named.",
        *(f"{f['channel']}: {f['what']}." for f in faults),
    ]
    return document(
        f"{vehicle.name}: {head}",
        [
            f"<h1>{escape(head)}</h1>",
            verdict(f"{vehicle.name}: {_count(len(answer.changed))}", reasons, bad=bool(answer.changed or faults)),
            *(_change(c) for c in answer.changed),
            *(["<h2>Sizes over the logs</h2>"] if any(f.sizes for f in answer.flights) else []),
            *(_sizes(answer, name) for name in dict.fromkeys(n for f in answer.flights for n in f.sizes)),
            "<h2>Flights</h2>",
            table(
                ("log", "changed"),
                [
                    [escape(f.record.name), escape(listed([plain(c.name) for c in f.changed]) or "nothing")]
                    for f in answer.flights
                ],
            ),
            *(["<h2>Notes</h2>", items(answer.notes)] if answer.notes else []),
        ],
    )


def _finding(c: Changed) -> str:
    """``Fan imbalance changed since friday.tlog``."""
    name = plain(c.change.name)
    return f"{name[:1].upper() + name[1:]} changed since {c.since}"


def _count(changes: int) -> str:
    return {0: "no change", 1: "one change"}.get(changes, f"{changes} changes")


def _change(c: Changed) -> str:
    change = c.change
    sizes = ", ".join(estimate_words(e) for e in change.estimates)
    lines = [
        f"<p>Probability {change.probability:.2f}: {escape(sizes)}.</p>",
        f"<p>{escape(change.effect.sign)}.</p>",
    ]
    if change.aliases:
        others = listed([plain(name) for name in change.aliases])
        lines.append(
            f"<p><b>It can also be {escape(others)}.</b> To separate them: {escape(change.effect.excite)}.</p>"
        )
    return f"<h2>{escape(_finding(c))}</h2>{''.join(lines)}"


def _sizes(answer: Since, name: str) -> str:
    """The size of one effect on every log, as a change since the good flights."""
    found = [f.sizes[name] for f in answer.flights]
    sizes = [(i, e.value, 0.5 * (e.ci95[1] - e.ci95[0])) for i, e in enumerate(found, 1)]
    since = {c.since for c in answer.changed if c.change.name == name}
    first = next((i for i, f in enumerate(answer.flights, 1) if f.record.name in since), None)
    return plot(name, found[0].name, found[0].unit, sizes, "change since the good flights", first)
