"""The page of ``replay diagnose``: verdict first, numbers with intervals, blocks of time, and what to fly next."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from diagnose_noise import noise_record

from models.effects import catalogue, get
from replay.diagnosis.diagnose import Diagnosis, conclude
from replay.diagnosis.html_report import blocks, page
from replay.residual.record import Record

FEW = [e for e in catalogue() if e.name in ("wind", "thrust_scale", "payload", "ceiling", "thermal_derating")]


@pytest.fixture(scope="module")
def quiet() -> Record:
    """Seventy seconds of noise."""
    return noise_record(3, 70.0, 0.3)


@pytest.fixture(scope="module")
def calm(quiet: Record) -> Diagnosis:
    return conclude([quiet], effects=FEW)


@pytest.fixture(scope="module")
def weak(quiet: Record) -> Diagnosis:
    """Five percent less thrust than declared, put in as the catalogue's own term: this tests the page."""
    effect = get("thrust_scale")
    push = effect.regressors(quiet.context, ())[:, :, 0] * -0.05
    return conclude([replace(quiet, residual=quiet.residual + push)], effects=FEW)


def text(answer: Diagnosis) -> str:
    return page(answer, answer.records[0].context.vehicle)


def plain(html: str) -> str:
    """What a reader sees."""
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", re.sub(r"<style>.*?</style>", "", html, flags=re.S)))


class Balance(HTMLParser):
    """Fails on a tag that is closed but not open."""

    EMPTY = frozenset({"meta", "br", "line", "circle", "polyline"})

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in self.EMPTY:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in self.EMPTY:
            assert self.open.pop() == tag


def test_the_page_is_well_formed_and_needs_nothing_else(weak: Diagnosis, calm: Diagnosis) -> None:
    for answer in (weak, calm):
        html = text(answer)
        reader = Balance()
        reader.feed(html)
        assert reader.open == []
        assert "http" not in html
        assert "<script" not in html
        assert "nan" not in plain(html).lower().replace("nance", "")


def test_the_verdict_comes_first_in_plain_words_with_what_to_do(weak: Diagnosis, calm: Diagnosis) -> None:
    seen = plain(text(calm))
    assert (
        seen.index("Nothing is missing.") < seen.index("There is nothing to change") < seen.index("Error of the model")
    )
    assert "In short" not in seen
    seen = plain(text(weak))
    name = weak.named[0].found.effect.name
    told = f"What is missing has a name: {name.replace('_', ' ')}"
    assert seen.index(told) < seen.index("--save-model") < seen.index("In short") < seen.index("Error of the model")


def test_every_effect_has_its_size_interval_and_how_sure_it_is(weak: Diagnosis) -> None:
    (named,) = weak.named
    seen = plain(text(weak))
    short = seen[seen.index("In short") : seen.index("Error of the model")]
    for estimate in named.found.estimates:
        if estimate.ci95[1] > estimate.ci95[0]:
            assert f"{estimate.value:.3g}" in short
            assert f"({estimate.ci95[0]:.3g} to {estimate.ci95[1]:.3g})" in short
    assert "candidate" in short
    assert f"{named.explains:.0%}" in short
    for other in named.found.aliases:
        assert other.replace("_", " ") in short


def test_the_error_of_every_judged_axis_stands_there_before_and_after(weak: Diagnosis) -> None:
    seen = plain(text(weak))
    table = seen[seen.index("Error of the model") :]
    before, after = weak.rms(after=False), weak.rms(after=True)
    for axis, word in (("Fx", "forward"), ("Fz", "down"), ("My", "pitch")):
        i = ("Fx", "Fy", "Fz", "Mx", "My", "Mz").index(axis)
        row = re.search(rf"{axis} {word} ([0-9.]+) \[([0-9.]+), ([0-9.]+)\] ([0-9.]+)", table)
        assert row is not None, axis
        assert float(row[1]) == pytest.approx(before[i], abs=1e-3)
        assert float(row[2]) <= float(row[1]) <= float(row[3])
        assert float(row[4]) == pytest.approx(after[i], abs=1e-3)


def test_blocks_of_held_out_time_are_counted(weak: Diagnosis) -> None:
    middle, before, after = blocks(weak.traces[0])
    assert len(middle) == 7
    assert np.all(np.diff(middle) > 5.0)
    # In units of the noise: what is left is noise.
    assert after.mean() == pytest.approx(1.0, abs=0.2)
    better = int((after < before).sum())
    assert better >= 6
    assert f"Lower in {better} of 7 blocks" in plain(text(weak))


def test_what_the_flight_could_not_have_shown_comes_with_the_flight_that_would(calm: Diagnosis) -> None:
    seen = plain(text(calm))
    idle = [r for r in calm.rejected if not r.excited]
    assert idle
    part = seen[seen.index("Not excited") : seen.index("By place")]
    for r in idle:
        assert f"{r.name.replace('_', ' ')} " in part
    shown = [r for r in calm.rejected if r.excited]
    why = seen[seen.index("Every other effect") :]
    assert shown
    for r in shown:
        assert r.name.replace("_", " ") in why
