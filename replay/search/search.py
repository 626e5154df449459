"""Which effects of the catalogue carry a flight's residual: forward search with honest nulls (docs/diagnose.md)."""

from __future__ import annotations

from collections.abc import Sequence

from models.effects import Effect, catalogue
from replay.residual.record import Record
from replay.search.backward import backward, believed, merged, sound
from replay.search.forward import step
from replay.search.library import Candidate
from replay.search.results import Estimate, Found, Rejected, Trace, report
from replay.search.shapes import refined, sharpened
from replay.search.workspace import MOST_EFFECTS, Workspace

__all__ = ["Estimate", "Found", "Rejected", "Trace", "trace"]


def trace(record: Record, effects: Sequence[Effect] | None = None, seed: int = 0) -> Trace:
    """Search one record; ``effects`` instead of the whole catalogue."""
    w = Workspace(record, catalogue() if effects is None else effects, seed)
    chosen: list[Candidate] = []
    p_of: dict[str, float] = {}
    for _ in range(MOST_EFFECTS):
        found = step(w, chosen)
        if found is None:
            break
        candidate, p = found
        p_of[candidate.effect.name] = p
        chosen = refined(w, [*chosen, candidate])
        w.learn_noise(chosen)
    chosen = merged(w, sharpened(w, chosen), p_of)
    chosen = believed(w, sound(w, backward(w, chosen)))
    return report(w, chosen, p_of)
