"""The page of the paper's figures: two commands fill one page."""

from __future__ import annotations

import pytest

from models import paper_page
from models.errors import ConfigError
from models.paper_page import Entry


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


def test_a_broken_list_is_named(tmp_path):
    (tmp_path / paper_page.ENTRIES).write_text("[{}]")
    with pytest.raises(ConfigError, match=r"paper\.json: is not a list of figures"):
        paper_page.add(tmp_path, [])
