"""A new effect is one new file: put where the catalogue looks, it is searched for and named; nothing else is edited."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from noise_records import noise_record

import models.effects
from models.effects import catalogue, get
from replay.search.results import summarise
from replay.search.walk import walk


@pytest.fixture
def extended() -> Iterator[None]:
    """The catalogue with the files of ``extra_effects``."""
    models.effects.__path__.append(str(Path(__file__).parent / "extra_effects"))
    catalogue.cache_clear()
    yield
    models.effects.__path__.pop()
    catalogue.cache_clear()


@pytest.mark.slow
@pytest.mark.usefixtures("extended")
def test_an_effect_from_a_file_of_its_own_is_found_in_its_size() -> None:
    record = noise_record(11, 90.0, 0.3)
    effect = get("heading_pull")
    wrench = np.nan_to_num(effect.regressors(record.context, ())) @ np.array([0.08])
    answer = summarise(
        walk([replace(record, residual=record.residual + wrench)], list(catalogue()))
    )
    assert [f.effect.name for f in answer.found] == ["heading_pull"]
    (size,) = answer.found[0].estimates
    assert size.ci95[0] < 0.08 < size.ci95[1]


def test_without_the_file_there_is_no_such_effect() -> None:
    assert "heading_pull" not in [e.name for e in catalogue()]
