"""A figure or table of the paper: what it says, and what came out here."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

AGREES = "agrees"
DISAGREES = "disagrees"


@dataclass(frozen=True, kw_only=True)
class Exhibit:
    """One of them."""

    title: str
    paper: str
    """What the paper says."""
    here: str
    verdict: str
    plots: tuple[str, ...] = field(default=(), repr=False)
    """SVG figures, as HTML."""
    head: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    """A table, where it has one."""

    def as_json(self) -> dict[str, Any]:
        """Without the plots."""
        content = asdict(self)
        del content["plots"]
        return content


def judged(holds: bool) -> str:
    """The verdict."""
    if holds:
        return AGREES
    return DISAGREES
