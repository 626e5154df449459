"""The rule: of several instances take the one that is asked for, else the one that the autopilot says it uses, else the
one that is alive and agrees best with the motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from models.common.errors import ConfigError
from replay.flightlog import SourceChoice, Stated

_SIMILAR = 0.5
"""Agreements whose ratio is above this are alike: then the firmware's own order decides. Two packs that share the load
differ by less; a pack and the supply of a receiver differ by a factor of ten and more."""


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """One instance of a quantity."""

    name: str
    fault: str = ""
    """Why it cannot be the one; empty where it is alive."""
    agreement: float = 0.0
    """How well it agrees with the motion, 0 or more; compared among instances of one quantity only."""
    because: str = ""
    """What ``agreement`` measures, in words."""


def pick(
    quantity: str,
    candidates: Sequence[Candidate],
    stated: Stated | None = None,
    wanted: str | None = None,
) -> SourceChoice | None:
    """The instance to read; None where there is none, or none is alive.

    ``stated``: the instance that the autopilot says it uses. ``wanted``: a name, or a number from 1. Raises ConfigError
    where no instance is called so.
    """
    if wanted is not None:
        named = _wanted(quantity, candidates, wanted)
        return _choice(quantity, named, candidates, "set by --set")
    alive = [candidate for candidate in candidates if not candidate.fault]
    if not alive:
        return None
    if len(candidates) == 1:
        return _choice(quantity, alive[0], candidates, "the only one")
    if stated is not None:
        used = next((candidate for candidate in alive if candidate.name == stated.name), None)
        if used is not None:
            return _choice(quantity, used, candidates, f"the autopilot uses it ({stated.by})")
    if len(alive) == 1:
        dead = ", ".join(f"{c.name}: {c.fault}" for c in candidates if c.fault)
        return _choice(quantity, alive[0], candidates, f"the only one that is alive ({dead})")
    best = max(candidate.agreement for candidate in alive)
    alike = [candidate for candidate in alive if candidate.agreement >= _SIMILAR * best]
    first = alike[0]
    why = "the first of those that are alike"
    if len(alike) < len(alive) and first.because:
        why = first.because
    return _choice(quantity, first, candidates, why)


def _wanted(quantity: str, candidates: Sequence[Candidate], wanted: str) -> Candidate:
    for number, candidate in enumerate(candidates, 1):
        if wanted.lower() in (candidate.name.lower(), str(number)):
            return candidate
    names = ", ".join(candidate.name for candidate in candidates) or "none"
    raise ConfigError(f"--set {quantity}={wanted}: the log has no such instance; it has: {names}")


def _choice(
    quantity: str, chosen: Candidate, candidates: Sequence[Candidate], why: str
) -> SourceChoice:
    others = tuple(candidate.name for candidate in candidates if candidate is not chosen)
    return SourceChoice(quantity=quantity, chosen=chosen.name, others=others, why=why)
