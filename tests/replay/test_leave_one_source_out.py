"""A number of the search is judged on a source that it was not chosen on."""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules

import pytest
from measured import leave_one_source_out as held
from measured.answers import ask
from measured.judge import Judgement
from measured.settings import parse, used

import replay.search.evidence
import replay.search.results
import replay.search.walk


def flight(source: str, right: bool) -> Judgement:
    return Judgement(source, "measured", "flight", False, "explained", "", refused=not right)


def test_what_a_source_says_does_not_choose_the_number_it_is_judged_by():
    """One setting is right only on source a, the other only on b: each is judged by the one it did not favour."""
    for_a = [flight("a", True), flight("a", True), flight("b", False)]
    for_b = [flight("a", False), flight("a", False), flight("b", True)]
    by_setting = {"favours a": for_a, "favours b": for_b}
    assert held.chosen(by_setting, "a") == "favours b"
    assert held.chosen(by_setting, "b") == "favours a"
    assert "0/3" in held.report(by_setting).splitlines()[-1]


def test_of_equals_the_search_as_it_is_stays():
    rows = [flight("a", False), flight("b", False)]
    assert held.chosen({"": rows, "TRUST=1.0": rows}, "a") == ""


def test_the_same_people_under_another_name_are_left_out_together():
    own = [flight("neural-swarm", False), flight("x", False)]
    other = [flight("neighbour", True), flight("x", False)]
    assert held.chosen({"": own, "TRUST=1.0": other}, "neural-swarm") == ""


def test_a_setting_reaches_every_module_that_holds_the_number_and_no_longer_than_it_is_used():
    before = replay.search.evidence.TRUST
    with used(parse(["TRUST=0.25"])):
        assert replay.search.evidence.TRUST == replay.search.walk.TRUST == 0.25
    assert replay.search.evidence.TRUST == replay.search.walk.TRUST == before


def test_a_function_that_is_off_changes_nothing():
    with used(parse(["predictive=off"])):
        assert replay.search.results.predictive("what the walk came to") == "what the walk came to"


@pytest.mark.parametrize("word", ["TRUTS=0.25", "predictiv=off", "TRUST=off", "predictive=0.0"])
def test_what_no_module_has_is_refused_by_name(word):
    with pytest.raises(ValueError, match=word.split("=")[0]), used(parse([word])):
        pass


def test_every_setting_is_one_that_the_search_has_and_changes_it():
    modules = [
        import_module(f"replay.search.{m.name}") for m in iter_modules(replay.search.__path__)
    ]
    for setting in (*held.SETTINGS, *held.RULES):
        settings = parse(setting.split())
        with used(settings):
            pass
        for name, value in settings.items():
            assert any(getattr(m, name, value) != value for m in modules), setting


def test_what_a_rule_gains_is_said_by_source():
    """Without the rule source a loses a flight, and b gets a wrong name less."""
    with_it = [flight("a", True), flight("b", False)]
    without = [flight("a", False), flight("b", True)]
    head, own, off = held.rules({"": with_it, "MARGIN=0": without}).splitlines()
    assert head.split() == ["a", "b"]
    assert own.split()[-6:] == ["1/1", "0", "0", "0/1", "0", "0"]
    assert off.split() == ["MARGIN=0", "-1", "+0", "+0", "+1", "+0", "+0"]


@pytest.mark.slow
def test_a_flight_is_asked_with_the_setting(tmp_path):
    """The command's own answer to a log that is not there: the settings do not stand in its way."""
    asked = ask(
        [tmp_path / "none.tlog"], tmp_path / "none.toml", "none", 900.0, settings=["TRUST=0.25"]
    )
    assert asked.exit_code == 2
    assert "none.toml" in asked.complaint
