"""``models`` as a library: train, predict, show."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import companion
import models
from models.common.errors import ModelError
from models.corner_law import ClosedForm


def test_a_surrogate_in_one_call_predicts_its_data() -> None:
    data = ClosedForm().data_set()
    model = models.train(data, method="polynomial", fan_radii_m=(0.13, 0.14))
    answer = model.predict(data.h, data.d, data.rpm)
    spread = data.wrench[:, 2].std()
    assert np.abs(answer[:, 2] - data.wrench[:, 2]).mean() < 0.1 * spread
    assert "method='polynomial'" in repr(model)


def test_an_unknown_method_names_those_that_are_known() -> None:
    with pytest.raises(ModelError, match="ga-adam-bp"):
        models.train(ClosedForm().data_set(), method="magic")


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"none\.csv"):
        models.train(tmp_path / "none.csv")


def test_the_shipped_surrogate_shows_itself(tmp_path: Path) -> None:
    model = models.load()
    assert repr(model).startswith("FanSurrogate(method=")
    page = model.plot()
    assert page.html.count("<figure>") == 3
    assert model._repr_html_().startswith("<iframe")


def test_the_flight_program_is_a_library() -> None:
    assert companion.__version__ == models.__version__
    assert callable(companion.step)
    assert callable(companion.initial_state)
