"""The page of the paper's figures: two commands fill one page."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from browser import CHROMIUM, DESKTOP, PHONE, Browser

from models import paper_page
from models.errors import ConfigError
from models.paper_page import Entry

FIGURES = Path(__file__).parents[2] / "docs" / "paper-figures"


def entry(number: int, title: str, verdict: str = "agrees") -> Entry:
    return Entry(number, title, f"fig{number}.png", "rises", "1.2 at 1 R", verdict)


def test_entries_of_two_commands_stand_on_one_page_in_the_papers_order(tmp_path):
    paper_page.add(tmp_path, [entry(14, "Fig. 14"), entry(15, "Fig. 15")])
    page = paper_page.add(tmp_path, [entry(7, "Fig. 7"), entry(14, "Fig. 14", "disagrees")]).read_text()
    titles = [line for line in page.splitlines() if line.startswith("## ")]
    assert titles == ["## Fig. 7", "## Fig. 14", "## Fig. 15"]
    assert "| rises | 1.2 at 1 R | disagrees |" in page.split("## Fig. 14")[1].split("## Fig. 15")[0]
    assert page.count("![Fig. 7](fig7.png)") == 1


def test_a_figure_without_a_picture_has_its_table_alone(tmp_path):
    page = paper_page.add(tmp_path, [Entry(8, "Fig. 8", "", "a bench", "none", "not comparable")]).read_text()
    assert "![" not in page
    assert "| a bench | none | not comparable |" in page


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
@pytest.mark.parametrize("size", [PHONE, DESKTOP])
def test_a_real_browser_shows_the_page_without_asking_for_anything(tmp_path, size):
    names = ("fig5_9_lift_ratio_ground.png", "fig16_error_histograms.png")
    for name in names:
        shutil.copy(FIGURES / name, tmp_path)
    entries = [
        Entry(5, "Figs 5 and 9: lift", names[0], "rises <b>", "1.2 at 1 R", "agrees"),
        Entry(16, "Fig. 16: errors", names[1], "within 10 %", "60 %", "disagrees"),
        Entry(8, "Fig. 8: the bench", "", "a photograph", "none", "not comparable"),
    ]
    paper_page.add(tmp_path, entries)
    with Browser() as browser:
        for dark in (False, True):
            seen = browser.open((tmp_path / paper_page.BROWSER_PAGE).as_uri(), size, dark=dark)
            assert (seen.cut_cells, seen.console, seen.requests) == (0, (), ())
            assert seen.width <= size[0]
            assert seen.text.index("1 of 3 figures agree") < seen.text.index("Figs 5 and 9") < seen.text.index("Fig. 8")
            assert "rises <b>" in seen.text
            assert browser.value("[...document.images].filter(i => i.naturalWidth > 0).length") == 2


def test_a_broken_list_is_named(tmp_path):
    (tmp_path / paper_page.ENTRIES).write_text("[{}]")
    with pytest.raises(ConfigError, match=r"paper\.json: is not a list of figures"):
        paper_page.add(tmp_path, [])
