"""The page of ``replay run --report``: what would have been done, why not, and the plots of it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from browser import CHROMIUM, DESKTOP, PHONE, Browser
from log_writers import EPOCH_US, flight, write_tlog
from pages import without_script

from companion.control.reasons import Reason
from companion.mavlink.wire_frames import cut
from replay.cli import main
from replay.rerun import history
from replay.rerun.history import History


@pytest.fixture(scope="module")
def near(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A hover of the default vehicle near ground and wall, whose log holds every parameter."""
    path = tmp_path_factory.mktemp("near") / "near.tlog"
    write_tlog(path, flight(20.0))
    return path


@pytest.fixture(scope="module")
def written(near: Path) -> Path:
    assert main(["run", str(near), "--report", str(near.parent / "report"), "--quiet"]) == 0
    return near.parent / "report" / "report.html"


def test_the_page_says_first_what_would_have_been_done_and_what_is_next(written: Path) -> None:
    html = written.read_text()
    assert (
        html.index("would") < html.index("Next: ") < html.index("Over time") < html.index("Numbers")
    )
    assert "near.tlog" in html
    assert html.count("<polyline") >= 6
    assert "http" not in without_script(html)
    assert "<script" not in without_script(html)
    assert "_m_s" not in html


@pytest.mark.slow
def test_reasons_are_those_of_the_text_report(
    near: Path, written: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", str(near)]) == 0
    text, html = capsys.readouterr().out, written.read_text()
    shown = [reason for reason in Reason if reason.value in html]
    assert shown
    for reason in shown:
        assert reason.value in text or reason.value in html


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
@pytest.mark.parametrize("size", [PHONE, DESKTOP])
def test_a_real_browser_shows_it(written: Path, size: tuple[int, int]) -> None:
    with Browser() as browser:
        for dark in (False, True):
            seen = browser.open(written.as_uri(), size, dark=dark)
            assert seen.width <= size[0]
            assert (seen.cut_cells, seen.outside, seen.console, seen.requests) == (0, (), (), ())
            assert seen.smallest_text_px > 11.0


@pytest.mark.slow
def test_what_is_to_be_mended_is_no_take_off(tmp_path: Path) -> None:
    """Half a minute on the ground, disarmed; in the air it lacks both rangefinders."""
    standing = flight(30.0, armed=False)
    flying = flight(20.0, start_ms=70_000, arrival_us=EPOCH_US + 30_000_000)
    write_tlog(tmp_path / "a.tlog", [m for m in [*standing, *flying] if cut(m[1], 0).id != 132])
    log = str(tmp_path / "a.tlog")
    assert main(["run", log, "--vehicle", "tandem", "--report", str(tmp_path), "--quiet"]) == 0
    html = (tmp_path / "report.html").read_text()
    assert f"Next: correct the main reason for no offset ({Reason.RANGE_MISSING.value}" in html
    assert f"longest ({Reason.NOT_ARMED.value}" not in html


def test_attitudes_that_come_too_slowly_are_what_is_to_be_mended(tmp_path: Path) -> None:
    seen: set[tuple[int, int]] = set()
    slow = []
    for arrival_us, raw in flight(20.0):
        key = ((arrival_us - EPOCH_US) // 1_000_000, cut(raw, 0).id)
        if key not in seen:
            seen.add(key)
            slow.append((arrival_us, raw))
    write_tlog(tmp_path / "a.tlog", slow)
    assert main(["run", str(tmp_path / "a.tlog"), "--report", str(tmp_path), "--quiet"]) == 0
    assert "Next: attitudes come 1.0 s apart" in (tmp_path / "report.html").read_text()


def test_a_place_that_cannot_be_written_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_tlog(tmp_path / "a.tlog", flight(4.0))
    (tmp_path / "file").write_text("x")
    assert (
        main(["run", str(tmp_path / "a.tlog"), "--report", str(tmp_path / "file"), "--quiet"]) == 2
    )
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_nothing_seen_is_an_empty_history() -> None:
    history = History()
    assert history.column("h_m").shape == (0,)
    assert np.array_equal(history.column("t_s"), np.empty(0))


def test_a_flight_of_many_hours_is_plotted_from_fewer_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(history, "_MOST_ROWS", 100)
    kept = History()
    offset = SimpleNamespace(thrust=0.0, roll=0.0, pitch=0.0)
    decided = [
        SimpleNamespace(
            t_s=0.1 * k, offset=offset, disturbance=None, authority=1.0, reasons=frozenset()
        )
        for k in range(10_000)
    ]
    assert list(kept.watch(decided)) == decided
    t_s = kept.column("t_s")
    assert 40 < len(t_s) <= 101
    assert t_s[0] == 0.0
    assert t_s[-1] > 970.0
    assert np.diff(t_s).max() < 2.0 * np.diff(t_s).min(), "one period, but where it was doubled"
    assert kept.column("compensating").all()
