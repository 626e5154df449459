"""A set of effects that fits well and foretells unseen time badly is passed over."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
from measured.changes import changed
from measured.known import read

from models.vehicle import load_vehicle
from replay.diagnosis.diagnose import diagnose
from replay.search import pruning
from replay.search.posterior import Walked


def fit(names: tuple[str, ...], score: float):
    terms = tuple(SimpleNamespace(name=n, effect=object()) for n in names)
    return SimpleNamespace(terms=terms, effects=set(names), score=score, key=frozenset(names))


BEFORE = 1000.0
"""Energy of held-out time on an axis, without a model."""


def chosen(monkeypatch, *sets: tuple[tuple[str, ...], float, *tuple[float, ...]]):
    """The answer among sets of (names, score, energy left of held-out time by axis), and the sets that stay."""
    left = {frozenset(names): energies for names, _, *energies in sets}
    fits = {frozenset(names): fit(names, score) for names, score, *_ in sets}
    walked = Walked(evidence=None, fits=fits, best=max(fits.values(), key=lambda f: f.score))

    def flights(_, of):
        energies = left[of.key]
        return [
            SimpleNamespace(
                record=SimpleNamespace(axes=range(len(energies))),
                before=[BEFORE] * len(energies),
                after=energies,
                energy=lambda by_axis, axes: sum(by_axis[a] for a in axes),
            )
        ]

    monkeypatch.setattr(pruning, "flight_fits", flights)
    answer = pruning.predictive(walked)
    return answer.best.key, set(answer.fits)


def test_the_likeliest_set_stays_where_it_foretells_about_as_well(monkeypatch):
    best, kept = chosen(monkeypatch, (("wind",), 0.0, 190.0), (("rotor_drag",), -3.0, 100.0))
    assert best == {"wind"}
    assert len(kept) == 2


def test_a_set_that_leaves_twice_as_much_of_unseen_time_is_passed_over(monkeypatch):
    best, kept = chosen(
        monkeypatch, (("wind", "slung_load"), 0.0, 400.0), (("wind",), -4.0, 250.0), (("rotor_drag",), -15.0, 80.0),
    )  # fmt: skip
    assert best == {"rotor_drag"}
    assert kept == {best}, "what is likelier than the answer stands in nobody's place"


def test_an_axis_that_a_set_makes_worse_is_counted_as_without_it(monkeypatch):
    """It will not act there."""
    fan = (("fan_imbalance",), 0.0, 100.0, 5.0 * BEFORE)
    best, _ = chosen(monkeypatch, fan, (("cg_offset", "thrust_scale"), -3.0, 100.0, 0.6 * BEFORE))
    assert best == {"fan_imbalance"}


def test_one_effect_more_is_no_rival(monkeypatch):
    best, _ = chosen(monkeypatch, (("wind",), 0.0, 400.0), (("wind", "imu_bias"), -3.0, 80.0))
    assert best == {"wind"}


def test_an_unlikely_set_is_not_asked(monkeypatch):
    best, _ = chosen(
        monkeypatch, (("wind",), 0.0, 400.0), (("rotor_drag",), -1.0 - pruning.NEAR, 80.0)
    )
    assert best == {"wind"}


@pytest.mark.slow
def test_a_weak_fan_of_a_real_flight_is_no_wind_with_a_load(shared_data, tmp_path: Path):
    """Four to nine seconds at a time, stitched: wind and a slung load that take each other back fit best."""
    flight = next(f for f in read().flights if f.name == "BL_t06")
    weak = changed(flight, "weak_fan", shared_data, tmp_path)
    assert weak is not None
    answer = diagnose([shared_data / flight.log], load_vehicle(weak.vehicle), None)
    found = {n.effect.name: n.parameters for n in answer.found}
    assert found["fan_imbalance"]["fan"] == 3.0
    assert -0.2 < found["fan_imbalance"]["scale"] < -0.1
    assert not {"wind", "slung_load"} & set(found)
