"""PySINDy beside the other peers: it finds the terms that made a force, and is left out where it is not installed."""

from __future__ import annotations

import numpy as np
import pytest
from measured import sparse_peer, transfer


@pytest.fixture(scope="module")
def learnt():
    pytest.importorskip("pysindy")
    rng = np.random.default_rng(0)
    x = rng.normal(size=(400, 3))
    y = np.stack([2.0 * x[:, 0] * x[:, 1] + 1.0, -3.0 * x[:, 2], 0.0 * x[:, 0]], axis=1)
    return x, sparse_peer.SparseRegression().fit(x, y + rng.normal(size=y.shape) * 0.01)


def test_the_terms_that_made_a_force_stand_first(learnt):
    _, model = learnt
    product, single, _ = model.named(["a", "b", "c"])
    assert product[0][0] == "a b"
    assert single[0][0] == "c"


def test_what_was_learnt_holds_elsewhere(learnt):
    _, model = learnt
    x = np.array([[1.0, -0.5, 0.2], [0.3, 0.8, -0.4]])
    expected = np.stack([2.0 * x[:, 0] * x[:, 1] + 1.0, -3.0 * x[:, 2], 0.0 * x[:, 0]], axis=1)
    assert model.predict(x) == pytest.approx(expected, abs=0.1)


def test_without_pysindy_this_peer_is_left_out_and_that_is_said(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(sparse_peer, "pysindy", None)
    assert "sparse regression" not in transfer.black_boxes()
    assert transfer.main(["--source", "--cache", str(tmp_path)]) == 0
    assert "pysindy is not installed" in capsys.readouterr().err
