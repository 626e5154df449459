"""The comparison on a small data set, the report written."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from browser import CHROMIUM, DESKTOP, PHONE, Browser

pytest.importorskip("torch", reason="training extra not installed")
pytest.importorskip("sklearn", reason="training extra not installed")
from pages import without_script

from models.common.errors import ModelError
from models.common.frames import AXES
from models.corner_law import ClosedForm
from models.surrogate import kriging
from models.training import compare, genetic, levenberg, train
from models.training.scores import r_squared


@pytest.fixture(scope="module")
def result() -> compare.Comparison:
    data = ClosedForm().data_set()
    rng = np.random.default_rng(0)
    quick = genetic.Settings(population=10, generations=5)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(genetic, "Settings", lambda: quick)
        patch.setattr(levenberg, "EVALUATIONS", 10)
        patch.setattr(kriging, "ROWS_FOR_LENGTHS", 40)
        return compare.compare(
            data.take((rng.random(len(data)) < 0.12) | data.free_air), splits=2, epochs=30
        )


def test_the_table_has_every_method_and_component(result: compare.Comparison) -> None:
    table = result.numbers["r2"]
    assert set(table) == set(train.METHODS)
    for row in table.values():
        assert set(row) == set(AXES)
    json.dumps(result.numbers)


def test_the_test_rows_are_not_learnt(result: compare.Comparison) -> None:
    for task in result.tasks:
        y = np.where(task.test[:, None], 1e3, task.problem.y)
        wrong = replace(task, problem=replace(task.problem, y=y))
        fitted = [compare._fit("polynomial", t, 1, np.random.default_rng(0)) for t in (task, wrong)]
        np.testing.assert_array_equal(*(f.predict(task.problem.x)[0] for f in fitted))
        if task.kind == "split":
            assert task.test.mean() == pytest.approx(0.2, abs=0.02)


def test_regions_are_left_out_whole(result: compare.Comparison) -> None:
    names = {t.name for t in result.tasks if t.kind == "region"}
    assert {"nearest heights", "nearest walls", "fastest rotor"} <= names
    assert set(result.numbers["regions"]) == names


def test_means_are_means_over_splits(result: compare.Comparison) -> None:
    values = [
        r_squared(t.problem.y[t.test], a[t.test])[2]
        for t, a in zip(result.tasks, result.answers["polynomial"], strict=True)
        if t.kind == "split"
    ]
    assert result.numbers["r2"]["polynomial"]["Fz"]["test"] == pytest.approx(np.mean(values))


def test_a_single_split_has_no_standard_deviation() -> None:
    assert np.isnan(compare.spread(np.ones((1, 2, 6)))).all()
    np.testing.assert_allclose(compare.spread(np.array([[1.0], [3.0]])), [np.sqrt(2.0)])


def test_data_without_any_effect_are_refused() -> None:
    data = ClosedForm().data_set()
    alone = ClosedForm().wrench(np.inf, np.inf, data.rpm)
    with pytest.raises(ModelError, match="no component depends on the place beyond noise"):
        compare.compare(replace(data, wrench=alone))


def test_the_page_says_first_which_method_to_use(
    result: compare.Comparison, tmp_path: Path
) -> None:
    use = result.numbers["use"]["method"]
    command = f"models train --data fan.csv --method {use} --out DIR"
    html = compare.write_page(tmp_path, result, command).read_text()
    assert f"Next: {command}" in html
    assert (
        html.index(f"Use {use}.")
        < html.index(f"--method {use} --out DIR")
        < html.index("Held-out R^2")
    )
    assert html.count("<svg") == len(train.METHODS)
    for method in train.METHODS:
        assert method in html
    assert "http" not in without_script(html)
    assert "<script" not in without_script(html)
    shown(html, tmp_path)


def shown(html: str, tmp_path: Path) -> None:
    """No console error, nothing cut, nothing asked for, on a phone and a desktop."""
    if CHROMIUM is None:
        return
    (tmp_path / "shown.html").write_text(html, encoding="utf-8")
    with Browser() as browser:
        for size in (PHONE, DESKTOP):
            seen = browser.open((tmp_path / "shown.html").as_uri(), size)
            assert (seen.width <= size[0], seen.cut_cells, seen.console, seen.requests) == (
                True,
                0,
                (),
                (),
            )
