"""The browser of the page tests leaves no folder behind, however long its helpers go on writing to it."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import pytest
from browser import CHROMIUM, Browser, remove


def _write(folder: Path, until: float) -> None:
    number = 0
    while time.monotonic() < until:
        number += 1
        inner = folder / "Default" / str(number % 7)
        try:
            inner.mkdir(parents=True, exist_ok=True)
            (inner / str(number)).write_text("x")
        except OSError:
            continue


@pytest.mark.slow
def test_a_folder_that_is_still_written_to_is_removed_once_the_writer_ends(tmp_path):
    folder = tmp_path / "home"
    writers = [
        threading.Thread(target=_write, args=(folder, time.monotonic() + 0.5)) for _ in range(2)
    ]
    for writer in writers:
        writer.start()
    time.sleep(0.1)
    remove(folder)
    for writer in writers:
        writer.join()
    remove(folder)
    assert not folder.exists()


def test_a_folder_that_cannot_be_removed_is_said(tmp_path, monkeypatch):
    def refuse(path: Path) -> None:
        raise OSError("not empty")

    monkeypatch.setattr("browser.shutil.rmtree", refuse)
    with pytest.raises(OSError, match="not empty"):
        remove(tmp_path, patience_s=0.0)


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
def test_a_browser_leaves_nothing_behind():
    with Browser() as browser:
        home = browser._home
        assert home.exists()
    assert not home.exists()
