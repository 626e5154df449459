"""``models paper``: every figure and table of the paper, from the shipped data."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import cast

import numpy as np
import pytest

pytest.importorskip("torch", reason="training extra not installed")
pytest.importorskip("sklearn", reason="training extra not installed")
from models.cfd import statements
from models.cfd.assemble import Assembled
from models.cfd.labels import Label
from models.cfd.position import FREE
from models.cfd.statements import AGREES, Checked, Statement
from models.cli import main
from models.paper.flow import flow_exhibits
from models.paper.nets import paper_r2, percent_error, roughness
from models.surrogate import kriging
from models.training import compare, genetic, levenberg

FIGURES = ("figs 5 and 9", "figs 6 and 10", "fig. 7", "fig. 14", "fig. 15", "fig. 16")
SURFACES = ("fig. 17", "fig. 18", "fig. 19")


def test_the_paper_s_table_is_whole() -> None:
    table = paper_r2()
    assert len(table) == 4
    assert table["bp"]["Fx"] == (0.7351, 0.7537)
    assert table["ga-adam-bp"]["Mz"] == (0.9408, 0.9354)


def test_percent_errors_have_a_floor() -> None:
    truth = np.array([0.0, 10.0])
    np.testing.assert_allclose(percent_error(truth, np.array([0.1, 9.0])), [50.0, 10.0])


def test_a_plane_is_not_rough() -> None:
    h, d = np.meshgrid(np.arange(5.0), np.arange(5.0), indexing="ij")
    assert roughness(h + 2.0 * d) == pytest.approx(0.0)
    assert roughness(h**2) == pytest.approx(2.0)


def test_a_wrong_number_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["paper", "--out", str(tmp_path), "--splits", "0"]) == 2
    assert "--splits 0: must be at least 1" in capsys.readouterr().err


def made_up() -> Checked:
    """Ground and wall on two places each, as the flow simulation gives them."""

    def label(lift: float, tilt: float) -> Label:
        wrench = np.array([0.0, 0.0, lift, 0.0, tilt, 0.0])
        return Label(wrench, np.zeros(6), np.zeros(6), np.zeros(6), "steady", 1)

    places = {
        FREE: label(20.0, 0.0),
        (1.0, math.inf): label(25.0, 0.0),
        (4.0, math.inf): label(20.0, 0.0),
        (math.inf, 0.5): label(20.1, 0.2),
        (math.inf, 2.0): label(20.0, 0.0),
    }
    said = [
        Statement("lift rises", "paper, figs 5 and 9", "1.250 at 1 R", AGREES),
        Statement("lift rises slightly", "paper, figs 6 and 10", "+0.5 %", AGREES),
        Statement("the fan tilts", "paper, fig. 7", "0.2 N m at 0.5 R", AGREES),
        Statement("a duct carries", "another, table 1", "40 %", AGREES),
    ]
    made = cast(Assembled, None)
    return Checked(
        labels=places,
        parts={},
        mesh=np.zeros(6),
        full={},
        half={},
        made=made,
        statements=tuple(said),
    )


def test_the_flow_has_a_plot_for_each_figure_of_the_paper_alone() -> None:
    shown = list(flow_exhibits(made_up()))
    assert [one.title for one in shown] == ["figs 5 and 9", "figs 6 and 10", "fig. 7"]
    assert all(len(one.plots) == 1 for one in shown)
    assert {one.verdict for one in shown} == {AGREES}


@pytest.mark.slow
def test_one_command_makes_all_of_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    quick = genetic.Settings(population=4, generations=2)
    monkeypatch.setattr(genetic, "Settings", lambda: quick)
    monkeypatch.setattr(levenberg, "EVALUATIONS", 4)
    monkeypatch.setattr(kriging, "ROWS_FOR_LENGTHS", 30)
    monkeypatch.setattr(compare, "MAX_ROWS", 120)
    monkeypatch.setattr(statements, "check", lambda *_: made_up())
    target = tmp_path / "numbers.json"
    out = tmp_path / "paper"
    more = ["--splits", "1", "--epochs", "5", "--quiet", "--json", str(target)]
    assert main(["paper", "--out", str(out), *more]) == 0
    page = (out / "report.html").read_text()
    assert page.count("<figure>") == 3 + 4 + 4 + 1 + 3
    told = {one["title"]: one for one in json.loads(target.read_text())["exhibits"]}
    for name in (*FIGURES, *SURFACES, "table 2", "table 3"):
        (title,) = [title for title in told if title.startswith(name)]
        assert title[0].upper() + title[1:] in page
    with (out / "table_3.csv").open() as file:
        rows = {row["method"]: row for row in csv.DictReader(file)}
    assert float(rows["kriging"]["learnt [N²]"]) > 0.0
    assert rows["polynomial"]["paper"] == "2.40e-01"
