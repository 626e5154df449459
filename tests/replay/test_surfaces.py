"""The map of surfaces: beside the laws that it corrects or in their place, whichever is likelier, or not at all."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import pytest

from models.effects import get
from replay.search import surfaces
from replay.search.posterior import Walked
from replay.search.thresholds import MARGIN

LAWS = ("ground_effect", "vertical_inflow")
WITHOUT = 100.0
"""Log posterior of these effects without a map."""


@dataclass(frozen=True)
class Named:
    """A term."""

    name: str


@dataclass(frozen=True)
class Fitted:
    """A set by the names of its terms."""

    terms: tuple[Named, ...]
    score_at_any_size: float
    significance: float = 0.0

    @property
    def names(self) -> set[str]:
        return {t.name for t in self.terms}


def with_map(monkeypatch, beside: float, instead: float) -> Walked:
    """What is taken, where the map gains so much beside all effects, and beside those that are no law of surfaces."""
    terms = tuple(Named(name) for name in LAWS)

    def with_map_of(_, others, effect):
        gain = {2: beside, 1: instead}[len(others)]
        return Fitted(terms=(*others, Named(effect.name)), score_at_any_size=WITHOUT + gain)

    monkeypatch.setattr(surfaces, "_with_map", with_map_of)
    monkeypatch.setattr(surfaces, "_lighter", lambda _, fit: fit)
    library = SimpleNamespace(remainders=[get("surface_law")])
    best = Fitted(terms=terms, score_at_any_size=WITHOUT)
    walked = Walked(evidence=SimpleNamespace(library=library), fits={}, best=best)
    return surfaces.with_surface_law(walked)


@pytest.mark.parametrize(
    ("beside", "instead", "names"),
    [
        (MARGIN + 2.0, MARGIN + 1.0, {*LAWS, "surface_law"}),
        (-1.0, MARGIN + 1.0, {"vertical_inflow", "surface_law"}),
        (MARGIN - 1.0, MARGIN - 1.0, set(LAWS)),
    ],
)
def test_the_likelier_set_with_a_map_is_taken_where_it_is_clearly_likelier(
    monkeypatch, beside: float, instead: float, names: set[str]
) -> None:
    assert with_map(monkeypatch, beside, instead).best.names == names


def test_the_odds_of_the_map_are_those_of_the_set_that_was_taken(monkeypatch) -> None:
    assert with_map(monkeypatch, -1.0, MARGIN + 1.0).map_log_odds == pytest.approx(MARGIN + 1.0)
