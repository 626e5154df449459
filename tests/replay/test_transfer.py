"""The benchmark that learns on one flight and predicts another: its sums, and data that are not there."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from measured import transfer


def test_an_error_is_a_geometric_mean_over_axes_of_what_is_left():
    before = np.ones((100, 6))
    after = before * np.array([0.5, 2.0, 0.25, 9.0, 9.0, 9.0])
    assert transfer.ratio(after, before, np.ones(100, bool), (0, 1)) == pytest.approx(1.0)
    assert transfer.ratio(after, before, np.ones(100, bool), (0, 2)) == pytest.approx(
        np.sqrt(0.125)
    )


def test_an_interval_holds_the_mean_over_pairs():
    mean, low, high = transfer.interval([0.2, 0.4, 0.8])
    assert low < mean < high
    assert mean == pytest.approx(0.4)


def test_pairs_that_share_flights_are_known_less_well_than_as_many_others():
    rng = np.random.default_rng(1)
    size = {name: np.exp(rng.normal(0.0, 0.5)) for name in "abcdefgh"}
    pairs = [(a, b) for a in size for b in size if a != b]
    values = [size[b] for _, b in pairs]
    mean, low, high = transfer.interval(values, pairs)
    alone = transfer.interval(values)
    assert mean == pytest.approx(alone[0])
    assert np.log(high / low) > 1.5 * np.log(alone[2] / alone[1])


def test_the_figures_of_the_page_tell_known_vehicles_from_others():
    pair = {"learnt_on": "x", "predicted": "y", transfer.TWENTY: {}}
    rows = [
        pair | {"source": source, transfer.FROZEN: {"ours": ours, "mean": 0.9}}
        for source, ours in (("neural-fly", 0.4), ("elsewhere", 1.2))
    ]
    said = {f["what"]: f for f in transfer.figures(rows)}
    assert said["frozen: ours"]["met"]
    assert not said["frozen, other sources: ours"]["met"]
    assert said["frozen, other sources: worse than nothing"]["value"] == "1"
    assert said["frozen: mean"]["value"] == "0.90"


def test_the_table_counts_pairs_that_are_worse_than_nothing():
    pair = {"source": "a", "learnt_on": "x", "predicted": "y", transfer.TWENTY: {}}
    rows = [pair | {transfer.FROZEN: {"ours": ours, "mean": 0.9}} for ours in (0.5, 1.2)]
    together = transfer.table(rows, transfer.FROZEN).splitlines()[-2].split()
    assert together[0] == "all"
    assert together[-2:] == ["1", "1"]


def test_a_source_with_many_pairs_weighs_no_more_than_another():
    pair = {"learnt_on": "x", "predicted": "y"}
    many = [pair | {"source": "a", transfer.FROZEN: {"ours": 0.2, "mean": 1.0}}] * 9
    rows = [*many, pair | {"source": "b", transfer.FROZEN: {"ours": 0.8, "mean": 1.0}}]
    assert "0.40" in transfer.table(rows, transfer.FROZEN).splitlines()[-1]


def test_a_table_gives_the_flights_of_each_vehicle_file_that_are_there(tmp_path, capsys):
    table = Path(transfer.__file__).with_name("payload.toml")
    for name in (
        "payload_1.toml",
        "payload_2.toml",
        "payload_182.tlog",
        "payload_184.tlog",
        "payload_204.tlog",
    ):
        (tmp_path / name).touch()
    groups = list(transfer.groups_of(table, tmp_path))
    assert [(g.source, g.vehicle.name, [log.stem for log in g.logs]) for g in groups] == [
        ("payload", "payload_1.toml", ["payload_182", "payload_184"]),
        ("payload", "payload_2.toml", ["payload_204"]),
    ]
    assert "payload_183.tlog" in capsys.readouterr().err


def test_a_part_of_the_pairs_is_spread_over_all_flights():
    assert transfer.spread(6, None) == transfer.spread(6, 9) == set(range(6))
    assert transfer.spread(420, 60) == set(range(0, 420, 7))


def test_pairs_that_are_known_are_not_measured_again(monkeypatch, tmp_path):
    names = ("one", "two", "three")
    found = [transfer.Flight(SimpleNamespace(name=name), None) for name in names]
    monkeypatch.setattr(transfer, "flights", lambda group, cache: found)
    monkeypatch.setattr(transfer, "learn", lambda flight: {})
    monkeypatch.setattr(
        transfer, "pair", lambda a, b, learnt: {transfer.FROZEN: {}, transfer.TWENTY: {}}
    )
    group = transfer.Group("s", tmp_path, ())
    first = next(transfer.measure(group, tmp_path, None, []))
    assert [r["predicted"] for r in first] == ["two", "three"]
    rest = [r for new in transfer.measure(group, tmp_path, None, first) for r in new]
    assert len(rest) == 4
    assert all(r["learnt_on"] != "one" for r in rest)


def test_absent_flights_are_said(tmp_path, capsys):
    assert transfer.main(["--data", str(tmp_path / "none"), "--cache", str(tmp_path / "c")]) == 2
    assert "no flights" in capsys.readouterr().err
