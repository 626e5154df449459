"""Which method ``models compare`` recommends."""

import pytest

from models.common.frames import AXES
from models.training.compare import recommend


def numbers(scores, sd, outside):
    honest = {
        m: {a: {"test": None if a == "Fy" else r, "test_sd": sd} for a in AXES}
        for m, r in scores.items()
    }
    return {"r2": honest, "regions": {"near wall": {"rows": 9, "relative_error": outside}}}


@pytest.mark.parametrize(
    ("sd", "method"),
    [(0.001, "kriging"), (0.02, "ensemble")],
    ids=["clearly better wins", "among equals the one that is best outside the data"],
)
def test_best_held_out_then_best_outside(sd, method):
    advice = recommend(
        numbers(
            {"bp": 0.90, "kriging": 0.98, "ensemble": 0.97},
            sd,
            {"bp": 0.1, "kriging": 0.9, "ensemble": 0.3},
        )
    )
    assert advice["method"] == method
    assert "held-out R^2" in advice["why"]


def test_without_regions_the_best_held_out():
    found = numbers({"bp": 0.90, "kriging": 0.98}, 0.001, {})
    assert recommend({**found, "regions": {}})["method"] == "kriging"
