"""The benchmark that learns on one flight and predicts another: its sums, and data that are not there."""

from __future__ import annotations

import numpy as np
import pytest
import transfer


def test_an_error_is_a_geometric_mean_over_axes_of_what_is_left():
    before = np.ones((100, 6))
    after = before * np.array([0.5, 2.0, 0.25, 9.0, 9.0, 9.0])
    assert transfer.ratio(after, before, np.ones(100, bool), (0, 1)) == pytest.approx(1.0)
    assert transfer.ratio(after, before, np.ones(100, bool), (0, 2)) == pytest.approx(np.sqrt(0.125))


def test_an_interval_holds_the_mean_over_pairs():
    mean, low, high = transfer.interval([0.2, 0.4, 0.8])
    assert low < mean < high
    assert mean == pytest.approx(0.4)


def test_the_table_counts_pairs_that_are_worse_than_nothing():
    rows = [{"source": "a", transfer.FROZEN: {"ours": ours, "mean": 0.9}, transfer.TWENTY: {}} for ours in (0.5, 1.2)]
    last = transfer.table(rows, transfer.FROZEN).splitlines()[-1].split()
    assert last[0] == "all"
    assert last[-2:] == ["1", "1"]


def test_absent_flights_are_said(tmp_path, capsys):
    assert transfer.main(["--data", str(tmp_path / "none"), "--cache", str(tmp_path / "c")]) == 2
    assert "no flights" in capsys.readouterr().err
