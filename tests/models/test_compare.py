"""The comparison on a small data set, claims judged by their numbers, the report written."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from browser import CHROMIUM, DESKTOP, PHONE, Browser

pytest.importorskip("torch", reason="training extra not installed")
pytest.importorskip("sklearn", reason="training extra not installed")
from models.corner_law import ClosedForm
from models.errors import ModelError
from models.frames import AXES
from models.surrogate import kriging
from models.training import compare, compare_page, genetic, levenberg, plots


@pytest.fixture(scope="module")
def result() -> compare.Comparison:
    data = ClosedForm().data_set()
    rng = np.random.default_rng(0)
    quick = genetic.Settings(population=10, generations=5)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(genetic, "Settings", lambda: quick)
        patch.setattr(levenberg, "EVALUATIONS", 10)
        patch.setattr(kriging, "ROWS_FOR_LENGTHS", 40)
        return compare.compare(data.take((rng.random(len(data)) < 0.12) | data.free_air), splits=2, epochs=30)


def test_the_table_has_every_method_and_component(result: compare.Comparison) -> None:
    table = result.numbers["table2"]
    assert set(table) == set(compare.METHODS)
    for row in table.values():
        assert set(row) == set(AXES)
    json.dumps(result.numbers)


def test_the_test_rows_are_not_learnt(result: compare.Comparison) -> None:
    for task in result.tasks:
        assert not np.any(task.train & task.test)
        if task.kind == "split":
            assert task.test.mean() == pytest.approx(0.2, abs=0.02)


def test_regions_are_left_out_whole(result: compare.Comparison) -> None:
    names = {t.name for t in result.tasks if t.kind == "region"}
    assert {"nearest heights", "nearest walls", "fastest rotor"} <= names
    assert set(result.numbers["regions"]) == names


def test_the_first_task_is_the_one_plotted(result: compare.Comparison) -> None:
    assert result.tasks[0].kind == "split"
    assert result.surfaces["kriging"].shape == (compare.GRID, compare.GRID)


def test_means_are_means_over_splits(result: compare.Comparison) -> None:
    values = [
        compare.r_squared(t.problem.y[t.test], a[t.test])[2]
        for t, a in zip(result.tasks, result.answers["polynomial"], strict=True)
        if t.kind == "split"
    ]
    assert result.numbers["table2"]["polynomial"]["Fz"]["test"] == pytest.approx(np.mean(values))


def _numbers(order: tuple[float, float, float, float], rough: float = 2.0) -> dict[str, object]:
    r2 = dict(zip(("bp", "ga-bp", "adam-bp", "ga-adam-bp"), order, strict=True))
    cell = {m: {a: {"train": r2.get(m, 0.99), "test": r2.get(m, 0.99)} for a in AXES} for m in compare.METHODS}
    lift = {m: {"mse_train": 1.0, "mse_test": 1.0, "roughness": 1.0} for m in compare.METHODS}
    lift["kriging"] = {"mse_train": 0.1, "mse_test": 0.1, "roughness": rough}
    lift["polynomial"] = {"mse_train": 5.0, "mse_test": 5.0, "roughness": 0.1}
    return {"table2": cell, "table3": lift}


def test_a_single_split_has_no_standard_deviation() -> None:
    assert np.isnan(compare.spread(np.ones((1, 2, 6)))).all()
    np.testing.assert_allclose(compare.spread(np.array([[1.0], [3.0]])), [np.sqrt(2.0)])


def test_claims_follow_the_numbers() -> None:
    verdicts = {c["claim"]: c["reproduced"] for c in compare.claims(_numbers((0.8, 0.85, 0.95, 0.97)))}
    assert verdicts["GA-Adam-BP >= Adam-BP > GA-BP > BP in R^2"]
    assert verdicts["the genetic algorithm helps less than Adam"]
    assert verdicts["kriging is rougher between samples than the net"]
    verdicts = {c["claim"]: c["reproduced"] for c in compare.claims(_numbers((0.8, 0.96, 0.95, 0.94), rough=0.5))}
    assert not any(list(verdicts.values())[:3])
    assert not verdicts["kriging is rougher between samples than the net"]


def test_the_papers_table_is_as_printed() -> None:
    assert compare.PAPER_TABLE_2["ga-adam-bp"]["Mx"] == {"train": 0.9885, "test": 0.9840}
    assert compare.PAPER_TABLE_2["bp"]["Mz"] == {"train": 0.7468, "test": 0.7504}
    above = sum(cell["test"] > cell["train"] for row in compare.PAPER_TABLE_2.values() for cell in row.values())
    assert above == 12


def test_a_wavy_surface_is_rougher_than_a_smooth_one() -> None:
    t = np.linspace(0, 1, 61)
    smooth = np.outer(t, t) + t**2
    assert compare.roughness(smooth + 0.01 * np.sin(60 * t)) > 3 * compare.roughness(smooth)
    assert compare.roughness(np.add.outer(t, 2 * t)) == pytest.approx(0.0, abs=1e-12)


def test_data_without_any_effect_are_refused() -> None:
    data = ClosedForm().data_set()
    alone = ClosedForm().wrench(np.inf, np.inf, data.rpm)
    with pytest.raises(ModelError, match="no component depends on the place beyond noise"):
        compare.compare(replace(data, wrench=alone))


def test_percentage_errors_do_not_blow_up_at_zero() -> None:
    truth = np.array([[0.0], [1.0], [-1.0]])
    np.testing.assert_allclose(plots.percent_error(truth, truth + 0.01)[:, 0], [25.0, 1.0, 1.0])


@pytest.mark.slow
def test_the_report_holds_the_tables_and_figures(result: compare.Comparison, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="plots not installed")
    plots.write_figures(tmp_path, result)
    page = compare_page.write_page(tmp_path, result.numbers, "models train").read_text()
    assert "Table 2: held-out" in page
    assert "reproduced: " in page
    for number in range(14, 20):
        (figure,) = tmp_path.glob(f"fig{number}_*.png")
        assert figure.stat().st_size > 5000


@pytest.mark.slow
def test_the_page_says_first_which_method_to_use(result: compare.Comparison, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="plots not installed")
    plots.write_figures(tmp_path, result)
    use = result.numbers["use"]["method"]
    command = f"models train --data fan.csv --method {use} --out DIR"
    html = compare_page.write_page(tmp_path, result.numbers, command).read_text()
    assert f"Next: {command}" in html
    assert html.index(f"Use {use}.") < html.index(f"--method {use} --out DIR") < html.index("Table 2")
    for method in compare.METHODS:
        assert method in html
    assert html.count("data:image/png;base64,") == len(list(tmp_path.glob("*.png")))
    assert "http" not in html
    assert "<script" not in html
    shown(html, tmp_path)


def shown(html: str, tmp_path: Path) -> None:
    """No console error, nothing cut, nothing asked for, on a phone and a desktop."""
    if CHROMIUM is None:
        return
    (tmp_path / "shown.html").write_text(html, encoding="utf-8")
    with Browser() as browser:
        for size in (PHONE, DESKTOP):
            seen = browser.open((tmp_path / "shown.html").as_uri(), size)
            assert (seen.width <= size[0], seen.cut_cells, seen.console, seen.requests) == (True, 0, (), ())
