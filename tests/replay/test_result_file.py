"""``--result FILE``: what a benchmark measured, as a file that results_page.py reads."""

import argparse
import json

import pytest
import result_file
from documents import results_page
from result_file import counted, figure


def given(*words):
    p = argparse.ArgumentParser()
    result_file.add_option(p)
    return p.parse_args(words)


def typed(monkeypatch, file, *arguments):
    monkeypatch.setattr("sys.argv", [str(result_file.HERE / file), *arguments])


def test_a_new_file_is_one_that_the_page_of_results_can_show(tmp_path, monkeypatch):
    typed(monkeypatch, "speed/latency.py", "--rate", "400", "--result", "x.json")
    path = tmp_path / "speed.json"
    result_file.write_result(
        given("--result", str(path)),
        [figure("p50 [ms]", "0.23", goal="0.3", met=True)],
        seeds="none",
    )
    found = results_page.load(path)
    assert found.command == "python tests/benchmarks speed.latency --rate 400"
    assert found.title == "speed"
    assert found.figures[0].met is True
    assert "| p50 [ms] | 0.23 | 0.3 | yes |" in results_page.page([found])


def test_words_of_a_person_stay_and_figures_not_measured_name_their_commit(tmp_path, monkeypatch):
    typed(monkeypatch, "faults/__main__.py", "--seed", "2")
    path = tmp_path / "08_faults.json"
    old = {
        "title": "Faults in flight", "command": "x", "commit": "abc1234", "date": "2026-01-01", "machine": "any",
        "seeds": "1", "simulated": True, "seen": "looked at in development", "older": True, "notes": ["A note."],
        "figures": [
            {"what": "right", "value": "1 %", "goal": "all", "met": False, "readme": [6, "faults"]},
            {"what": "by hand", "value": "7"},
        ],
    }  # fmt: skip
    path.write_text(json.dumps(old), encoding="utf-8")
    a = given("--result", str(path), "--first-seen")
    result_file.write_result(
        a, [figure("right", "99 %")], seeds="2", simulated=True, repeatable=True
    )
    found = results_page.load(path)
    assert (found.title, found.seen, found.notes, found.older) == (
        "Faults in flight",
        "first seen",
        ("A note.",),
        False,
    )
    assert found.command == "python tests/benchmarks faults --seed 2"
    assert found.machine == result_file.ANY_MACHINE
    assert [f.what for f in found.figures] == ["right", "by hand (commit abc1234)"]
    assert found.figures[0].readme == (6, "faults")
    assert found.figures[0].met is None


def test_without_a_file_nothing_is_written():
    result_file.write_result(given(), [], seeds="none")


@pytest.mark.parametrize(
    ("flags", "least", "met"), [([True] * 9 + [False], 0.9, True), ([True, False], 0.9, False)]
)
def test_a_share_comes_with_counts_interval_and_goal(flags, least, met):
    found = counted("right", flags, least=least)
    assert found["detail"].startswith(f"{sum(flags)} of {len(flags)}, [")
    assert found["goal"] == "90 %"
    assert found["met"] is met
    assert counted("wrong", [False] * 5, most=0.03)["met"] is True
