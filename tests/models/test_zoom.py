"""Plots of pages are zoomed and read by the one script that a page allows; without it the page is whole."""

from __future__ import annotations

import base64
import hashlib

import numpy as np
import pytest
from browser import CHROMIUM, DESKTOP, PHONE, Browser

from models.common.pages.document import PAGE_END, PLOT_SCRIPT, SCRIPT_HASH, document
from models.common.pages.svg import Band, Line, figure

TIME_S = np.linspace(0.0, 10.0, 201)
SCRIPT_OF_A_LOG = "<script>document.title = 'taken over'</script>"


def page(extra: str = "") -> str:
    sine = np.sin(TIME_S)
    sine[100:110] = np.nan
    lines = (
        Line(TIME_S, sine, "before", "measured"),
        Line(TIME_S, 0.5 * sine, "after", "modelled"),
    )
    bands = (Band(2.0, 4.0, "fit", "in the corner"),)
    force = figure("Force", lines, "time [s]", "force [N]", bands)
    height = figure("Height", (Line(TIME_S, 2.0 + sine, "a"),), "time [s]", "height [m]")
    loop = figure("Loop", (Line(np.cos(TIME_S), sine, "b"),), "x", "y")
    return document("Plots", (force, height, loop, extra))


def test_the_page_allows_its_own_script_by_its_hash():
    digest = hashlib.sha256(PLOT_SCRIPT.encode()).digest()
    assert f"'sha256-{base64.b64encode(digest).decode()}'" == SCRIPT_HASH
    html = page()
    assert html.index("Content-Security-Policy") < html.index(PAGE_END)
    assert "</script" not in PLOT_SCRIPT


def test_a_plot_says_its_axes_and_its_curves():
    html = page()
    assert 'data-x="0,10,56,390"' in html
    assert 'data-x-label="time [s]" data-y-label="force [N]"' in html
    assert 'data-label="measured"' in html


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
@pytest.mark.parametrize("size", [DESKTOP, PHONE])
def test_a_browser_zooms_and_resets_all_plots_over_one_axis(tmp_path, size):
    file = tmp_path / "page.html"
    file.write_text(page(SCRIPT_OF_A_LOG), encoding="utf-8")

    def shown() -> list[float]:
        answer = browser.value(
            "[...groups.get('time [s]')].flatMap(p => [p.scales.x.min, p.scales.x.max]).join()"
        )
        return [float(v) for v in answer.split(",")]

    def press(key: str) -> None:
        browser.value(
            "document.querySelector('.zoom').dispatchEvent("
            f"new KeyboardEvent('keydown', {{key: '{key}', bubbles: true}}))"
        )

    with Browser() as browser:
        seen = browser.open(file.as_uri(), size)
        assert seen.width <= size[0]
        assert browser.value("document.querySelectorAll('figure.live').length") == 2
        assert browser.value("document.title") == "Plots", "a script of a log does not run"
        above = browser.value("document.querySelector('.zoom .u-title').textContent")
        assert above == "force [N]", "beside the axis a long name would be cut"
        whole = [0.0, 10.0, 0.0, 10.0]
        assert shown() == pytest.approx(whole, abs=0.02)
        press("+")
        assert shown() == pytest.approx([2.5, 7.5, 2.5, 7.5], abs=0.02)
        press("ArrowRight")
        assert shown() == pytest.approx([3.75, 8.75, 3.75, 8.75], abs=0.02)
        press("0")
        assert shown() == pytest.approx(whole, abs=0.02)
        value = browser.value("groups.get('time [s]')[0].data[1][20]")
        assert value == pytest.approx(np.sin(TIME_S[20]), abs=0.02)
        assert browser.value("groups.get('time [s]')[0].data[1].includes(null)")
