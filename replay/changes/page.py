"""``--since`` as one HTML page: what changed, since which log, and how sure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from models.vehicle import Vehicle
from replay.changes.since import Comparison
from replay.diagnosis.words import estimate_text, listed, plain
from replay.report import render


def page(answer: Comparison, vehicle: Vehicle, faults: Sequence[Mapping[str, str]] = ()) -> str:
    """The whole page. ``faults``: ``channel`` and ``what`` of a model or vehicle file of another vehicle."""
    findings = [f"{plain(c.name).capitalize()} changed since {c.since}" for c in answer.changed]
    good = ", ".join(r.name for r in answer.good.records)
    return render(
        "since.html",
        answer=answer,
        vehicle=vehicle,
        head="; ".join(findings) or "Nothing changed",
        verdict=f"{vehicle.name}: {len(findings) or 'no'} change{'' if len(findings) == 1 else 's'}",
        sentences=[
            f"Compared with the good flights: {good}. Differences as large as among the good flights are not named.",
            *(f"{f['channel']}: {f['what']}." for f in faults),
        ],
        bad=bool(answer.changed or faults),
        changed=zip(findings, answer.changed, strict=True),
        flights=[(f.record.name, listed([plain(c.name) for c in f.changed]) or "nothing") for f in answer.flights],
        estimate_text=estimate_text,
    )
