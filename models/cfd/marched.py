"""What a march in time says of cheaper means: those of the iterations before it, and those of half models."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from models.cfd.campaign import Row
from models.cfd.labels import Kind, Label, kind_of
from models.cfd.mean_error import in_circles
from models.cfd.position import Place
from models.frames import AXES, Array

LOW = 2.0
"""Heights over R below which the flow tips over."""
CLOSE = 0.5
"""Wall distances over R up to which a place counts as near the wall."""


@dataclass(frozen=True)
class Compared:
    """Rms (6,) in N and N m over ``count`` places of what a cheaper mean ``missed``.

    ``stated``: what it says of its own error (of a half model nothing: zero). ``known``: what is said of the error of
    the mean that it is compared with.
    """

    name: str
    count: int
    missed: Array
    stated: Array
    known: Array


def compared(
    rows: Sequence[Row], rpm: float, kind: Kind, full: Mapping[Place, Label], half: Mapping[Place, Label]
) -> list[Compared]:
    """All comparisons that there are cases for, at one speed."""
    here = [r for r in rows if kind_of(r.position) == kind and r.position.rpm == rpm]
    by_march = [r for r in here if r.result.steps and np.isfinite(r.result.iterated).all()]
    known_at = {r.position.place for r in here if not in_circles(r.result)}
    out = []
    for name, chosen in _groups():
        cases = [r.result for r in by_march if chosen(r.position.place)]
        if cases:
            apart = [np.subtract(r.iterated, r.wrench) for r in cases]
            own = [np.nan_to_num(r.error) for r in cases]
            out.append(
                Compared(
                    f"iterations, {name}",
                    len(cases),
                    _rms(apart),
                    _rms([np.array(r.iterated_error) for r in cases]),
                    _rms(own),
                )
            )
    for name, chosen in _groups():
        places = [
            p for p in known_at if p in half and p in full and math.isfinite(p[0]) and math.isfinite(p[1]) and chosen(p)
        ]
        if places:
            apart = [half[p].wrench - full[p].wrench for p in places]
            out.append(
                Compared(
                    f"half models, {name}", len(places), _rms(apart), np.zeros(6), _rms([full[p].error for p in places])
                )
            )
    return out


def text(found: Sequence[Compared]) -> Iterator[str]:
    """One line each, after a heading."""
    if found:
        yield "full models whose mean is known (settled, or marched), and what cheaper means of the same place miss:"
        yield f"{'':44}" + "".join(f"{a:>9}" for a in AXES)
    for c in found:
        for what, values in (("rms missed", c.missed), ("stated", c.stated), ("error of the better mean", c.known)):
            if np.any(values):
                name = f"{c.name} ({c.count})" if what == "rms missed" else ""
                yield f"{name:44}" + "".join(f"{v:9.3f}" for v in values) + f"  {what}"


def _groups() -> Iterator[tuple[str, Callable[[Place], bool]]]:
    yield f"below {LOW:g} R, wall within {CLOSE:g} R", lambda p: p[0] < LOW and p[1] <= CLOSE
    yield f"below {LOW:g} R, wall farther or none", lambda p: p[0] < LOW and p[1] > CLOSE
    yield f"from {LOW:g} R up", lambda p: p[0] >= LOW


def _rms(values: Sequence[Array]) -> Array:
    return np.asarray(np.sqrt(np.mean(np.square(values), axis=0)))
