"""The page of ``replay diagnose``: verdict first, numbers with intervals, blocks of time, and what to fly next."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from browser import CHROMIUM, DESKTOP, PHONE, Browser
from noise_records import noise_record
from pages import without_script

from models.effects import Context, Effect, catalogue, get
from models.effects.pictures import over_time
from replay.diagnosis.diagnose import Diagnosis, conclude
from replay.diagnosis.html_report import page
from replay.diagnosis.next_step import next_step
from replay.diagnosis.pictures import (
    PIXELS,
    binned,
    effect_picture,
    envelope,
)
from replay.diagnosis.words import channel_words, estimate_text
from replay.residual.faults import LogFault
from replay.residual.record import Record
from replay.search.estimates import IntervalEstimate
from replay.search.results import Found

FEW = [
    e
    for e in catalogue()
    if e.name in ("wind", "thrust_scale", "payload", "ceiling", "thermal_derating")
]


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


@pytest.fixture(scope="module")
def rich(quiet: Record) -> Context:
    """The same flight with every quantity that an effect may be drawn over."""
    ctx, n = quiet.context, len(quiet.time_s)
    fans = len(ctx.vehicle.fans)
    ramp = np.linspace(0.0, 1.0, n)
    near = np.repeat((0.2 + ramp)[:, None], fans, axis=1)
    state = replace(
        ctx.state, h_m=near, d_m=near, ceiling_m=near, second_d_m=near, wall_bearing_rad=3.0 * ramp,
        second_bearing_rad=3.0 * ramp, battery_voltage_v=16.0 - ramp, esc_temperature_c=30.0 + 40.0 * ramp,
        pressure_pa=np.full(n, 9e4), air_temperature_c=np.full(n, 20.0),
    )  # fmt: skip
    return replace(ctx, state=state)


def text(answer: Diagnosis) -> str:
    return page(answer, answer.records[0].context.vehicle)


def plain(html: str) -> str:
    """What a reader sees."""
    return re.sub(
        r"\s+", " ", re.sub(r"<[^>]+>", " ", re.sub(r"<style>.*?</style>", "", html, flags=re.S))
    )


class Balance(HTMLParser):
    """Fails on a tag that is closed but not open."""

    EMPTY = frozenset({"meta", "br", "line", "circle", "polyline", "rect"})

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
        assert "http" not in without_script(html)
        assert "<script" not in without_script(html)
        assert "nan" not in plain(html).lower().replace("nance", "")


def test_the_verdict_comes_first_with_the_one_next_action(weak: Diagnosis, calm: Diagnosis) -> None:
    seen = plain(text(calm))
    head, action = "Nothing is missing", "Next: There is nothing to change"
    assert seen.index(head) < seen.index(action) < seen.index("Error of the model")
    seen = plain(text(weak))
    (named,) = weak.found
    name = named.effect.name.replace("_", " ")
    assert f"The model lacks: {name}." in seen
    assert re.search(r"<h2>The rotors give 5(\.\d)? % less thrust than declared", text(weak)), (
        "what was found"
    )
    assert "<h1>Nothing is missing: " in text(calm)
    assert (
        seen.index("The model lacks: ") < seen.index("Next: ") < seen.index("Numbers and formula")
    )
    assert seen.count("Next: ") == 1


def test_the_next_action_depends_on_how_sure_the_answer_is(weak: Diagnosis) -> None:
    (named,) = weak.found
    alone = replace(named, aliases=(), probability=0.99)
    confirmed = replace(alone, confirmed_by=(0, 1))

    def action(found: Found, **changes: object) -> str:
        return next_step(replace(weak, found=(found,), verdict="explained", **changes)).action

    assert "once more" in action(alone)
    assert "--save-model" in action(confirmed)
    assert "nothing to adopt" in action(replace(confirmed, effect=get("payload")))
    open_ = replace(alone, aliases=("payload",))
    assert action(open_).startswith("Separate ")
    assert "payload" in action(open_)
    for unsure in (
        replace(alone, probability=0.6),
        replace(confirmed, explains=-0.1),
        replace(confirmed, estimates=(replace(alone.estimates[0], at_bound=True),)),
    ):
        assert "--save-model" not in action(unsure)
        assert alone.effect.excite in action(unsure)
    fault = (LogFault("rpm_1", "reads 0"),)
    assert "Check this" in action(confirmed, faults=fault)
    step = next_step(replace(weak, found=(), verdict="unexplained"))
    assert "--save-model" not in step.action
    assert "no effect of the catalogue" in step.verdict


def test_every_effect_has_its_size_in_words_its_numbers_and_how_sure_it_is(weak: Diagnosis) -> None:
    (named,) = weak.found
    seen = plain(text(weak))
    effect = named.effect
    words = effect.shown.in_words(weak.records[0].context, named.numbers)
    part = seen[seen.index(words[1:]) : seen.index("Error of the model")]
    for estimate in named.estimates:
        if estimate.ci95 is not None:
            assert f"{estimate.value:.4g} {estimate.ci95[0]:.4g} to {estimate.ci95[1]:.4g}" in part
    assert f"probability {named.probability:.2f}" in part
    assert f"{named.explains:.0%}" in part
    for other in named.aliases:
        assert other.replace("_", " ") in part
    assert effect.equation in part


def test_the_picture_shows_the_points_and_the_fitted_curve(weak: Diagnosis) -> None:
    (named,) = weak.found
    picture = effect_picture(named, weak.traces)
    assert picture.count("<circle") > 5
    assert picture.count("<polyline") == 1
    # The points scatter about the curve: without the effect the residual is what the effect says.
    t = weak.traces[0]
    own = named.effect.wrench(t.record.context, named.parameters)
    left = (t.after + own)[t.record.valid, 2]
    assert left.mean() == pytest.approx(own[t.record.valid, 2].mean(), rel=0.2)


@pytest.mark.parametrize("effect", catalogue(), ids=lambda e: e.name)
def test_every_effect_of_the_catalogue_has_words_and_a_picture(
    effect: Effect, rich: Context
) -> None:
    middle = {
        c.name: 0.5 * (max(c.least(rich), -0.2) + min(c.most(rich), 0.4))
        for c in effect.coefficients
    }
    shapes = {s.name: 1.0 for s in effect.shapes}
    assert effect.shown.in_words is not None, "a sentence for the pilot: field shown"
    words = effect.shown.in_words(rich, effect.said(rich, middle | shapes))
    assert len(words.split()) > 4
    assert not re.search(r"nan|inf\b|_|[0-9]{6}", words), words
    for axis in effect.axes:
        drawn = (effect.shown.drawn or over_time)(rich, axis)
        assert drawn.values.shape == rich.state.time_s.shape
        assert np.isfinite(drawn.values).all(), drawn.label
        assert "_" not in drawn.label + drawn.force_label
        assert np.broadcast_to(drawn.direction, (len(drawn.values), 6)).shape[1] == 6


def test_the_direction_of_a_picture_is_the_one_that_its_label_says(rich: Context) -> None:
    """A wall on the right draws to the right and tilts the right side down; ahead it draws forward, nose down."""
    right = replace(
        rich, state=replace(rich.state, wall_bearing_rad=np.full(len(rich.state), np.pi / 2))
    )
    ahead = replace(rich, state=replace(rich.state, wall_bearing_rad=np.zeros(len(rich.state))))
    wall = get("wall_effect")
    p = {"pull": 0.1, "tilt": 0.1, "lift": 0.0, "length_radii": 1.0}
    for ctx in (right, ahead):
        wrench = wall.wrench(ctx, p)
        for axis in ("Fx", "Mx"):
            assert ((wrench * wall.shown.drawn(ctx, axis).direction).sum(axis=1) > 0.0).all()
    lift = get("ground_effect")
    up = lift.wrench(rich, {"gain": 0.2, "length_radii": 1.0})
    assert ((up * lift.shown.drawn(rich, "Fz").direction).sum(axis=1) > 0.0).all()


def test_the_error_of_every_judged_axis_stands_there_before_and_after(weak: Diagnosis) -> None:
    seen = plain(text(weak))
    table = seen[seen.index("Error of the model") :]
    before, after = weak.rms(after=False), weak.rms(after=True)
    for axis, word in (("Fx", "force forward"), ("Fz", "force down"), ("My", "pitch moment")):
        i = ("Fx", "Fy", "Fz", "Mx", "My", "Mz").index(axis)
        row = re.search(
            rf"{word} {axis} \[N(?: m)?\] ([0-9.]+) \[([0-9.]+), ([0-9.]+)\] ([0-9.]+)", table
        )
        assert row is not None, axis
        assert float(row[1]) == pytest.approx(before[i], abs=1e-3)
        assert float(row[2]) <= float(row[1]) <= float(row[3])
        assert float(row[4]) == pytest.approx(after[i], abs=1e-3)


def test_what_the_flight_could_not_have_shown_comes_with_the_flight_that_would(
    calm: Diagnosis,
) -> None:
    seen = plain(text(calm))
    idle = [r for r in calm.rejected if not r.excited]
    assert idle
    part = seen[seen.index("and how to find out") : seen.index("By place")]
    for r in idle:
        assert f"{r.name.replace('_', ' ')}: " in part
    shown = [r for r in calm.rejected if r.excited]
    why = seen[seen.index("Other effects, and why") :]
    assert shown
    for r in shown:
        assert r.name.replace("_", " ") in why


def test_names_and_units_are_those_of_people(weak: Diagnosis) -> None:
    seen = plain(text(weak))
    assert not re.search(r"\b[a-z]+_[a-z0-9_]*(m_s2|rad_s|_m|_v|_c)\b", seen)
    assert channel_words("az_m_s2") == "acceleration down [m/s²]"
    assert channel_words("rpm_3") == "speed of ESC 3 [rpm]"
    assert channel_words("range_down_m") == "range down [m]"
    assert (
        estimate_text(IntervalEstimate(name="scale", value=-0.05, ci95=(-0.06, -0.04), unit="1"))
        == "scale = -0.05 [-0.06, -0.04]"
    )


def test_a_long_series_keeps_its_extremes() -> None:
    x = np.arange(20_000.0)
    y = np.sin(x / 50.0)
    y[7777], y[8000:9000] = 9.0, np.nan
    at, shown = envelope(x, y)
    assert len(at) <= 2 * PIXELS
    assert np.nanmax(shown) == 9.0
    assert np.isnan(shown).any(), "a gap stays a gap"
    assert (np.diff(at) >= 0.0).all()


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
def test_a_real_browser_shows_the_page_on_phone_and_desktop_dark_and_light(
    weak: Diagnosis, tmp_path: Path
) -> None:
    path = tmp_path / "report.html"
    path.write_text(text(weak), encoding="utf-8")
    papers = set()
    with Browser() as browser:
        for size in (PHONE, DESKTOP):
            for dark in (False, True):
                seen = browser.open(path.as_uri(), size, dark=dark)
                assert seen.width <= size[0], "nothing is cut"
                assert seen.cut_cells == 0
                assert seen.outside == ()
                assert seen.smallest_text_px > 11.0
                assert seen.console == ()
                assert seen.requests == ()
                assert "Next: " in seen.text
                papers.add((seen.paper, seen.ink))
        assert len(papers) == 2, "dark and light differ"
        assert browser.print().startswith(b"%PDF")
        browser.ask("Emulation.setEmulatedMedia", media="print")
        printed = browser.value(
            "getComputedStyle(document.documentElement).getPropertyValue('--after')"
        )
        assert printed == "#0969da", "on paper the colours for light, whatever the screen had"


def test_samples_that_hang_together_fill_fewer_bins() -> None:
    x = np.linspace(0.0, 1.0, 600)
    middle, mean, error = binned(x, 2.0 * x, 14, 50.0)
    assert len(middle) >= 4, "a flight of a minute whose noise lasts 5 s still shows a slope"
    assert np.allclose(mean, 2.0 * middle)
    assert (error > 0.0).all()
    assert len(binned(x, 2.0 * x, 14, 400.0)[0]) >= 3, (
        "noise as long as the flight: points with wide intervals"
    )
