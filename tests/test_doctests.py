"""Examples in the docstrings of what is public: they run, and each call that is listed as stable has one."""

from __future__ import annotations

import doctest
import inspect
import re
from pathlib import Path
from typing import Any

import pytest

import companion
import models
import replay
from models.surrogate.fan_surrogate import FanSurrogate
from models.vehicle import load_vehicle

EXAMPLES: dict[str, Any] = {
    "models.load": models.load,
    "models.train": models.train,
    "load_vehicle": load_vehicle,
    "FanSurrogate.wrench": FanSurrogate.wrench,
    "FanSurrogate.trust": FanSurrogate.trust,
    "companion.step": companion.step,
    "replay.load": replay.load,
    "replay.diagnose": replay.diagnose,
    "replay.Diagnosis": replay.Diagnosis,
    "replay.rollout": replay.rollout,
}


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_runs(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    of = EXAMPLES[name]
    docstring = inspect.getdoc(of) or ""
    example = doctest.DocTestParser().get_doctest(docstring, {}, name, None, None)
    assert example.examples, "has no example"
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    said: list[str] = []
    assert runner.run(example, out=said.append).failed == 0, "".join(said)


def test_what_is_listed_as_stable_can_be_called():
    page = Path(__file__).resolve().parents[1] / "docs" / "stability.md"
    rows = re.findall(r"^\| `([a-z_.]+)` \| (.*) \|$", page.read_text("utf-8"), re.M)
    found = dict(rows)
    for package in (models, companion, replay):
        names = re.findall(r"`(\w+)`", found[package.__name__].split(";")[0])
        for name in names:
            assert inspect.getdoc(getattr(package, name)), f"{package.__name__}.{name}"
