"""The site of the manual: what is public is in its reference, and no page asks another computer for anything."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import companion
import models
import replay

pytest.importorskip("mkdocs", reason="mkdocs is not installed (extra: docs)")
pytest.importorskip("material", reason="mkdocs-material is not installed (extra: docs)")

ROOT = Path(__file__).resolve().parents[1]
LOADED = re.compile(r"<(?:script|link|img|iframe)[^>]*(?:src|href)=\"(?:https?:)?//[^\"]+\"")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet"]
    done = subprocess.run(
        [*command, "--site-dir", str(folder)],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT), "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert "WARNING" not in done.stderr
    return folder


@pytest.mark.slow
def test_no_page_needs_another_computer(site: Path) -> None:
    pages = list(site.rglob("*.html"))
    assert len(pages) > 30
    for page in pages:
        assert LOADED.findall(page.read_text()) == [], page.name


@pytest.mark.slow
def test_every_public_name_is_in_the_reference(site: Path) -> None:
    page = (site / "reference.html").read_text()
    for package in (models, companion, replay):
        for name in package.__all__:
            thing = getattr(package, name)
            if not name.startswith("__"):
                assert f'id="{thing.__module__}.{thing.__qualname__}"' in page, name
                assert re.search(rf">\s*{package.__name__}\.{name}\s*<", page), "as it is imported"


@pytest.mark.slow
def test_sections_of_docstrings_are_shown_as_such(site: Path) -> None:
    page = (site / "reference.html").read_text()
    entry = page.split('id="companion.pipeline.step"')[1].split('class="doc doc-object ')[0]
    for section in ("Parameters", "Returns", "Examples"):
        assert f'doc-section-title">{section}:<' in entry
    assert 'id="replay.logs.plugins.LogReader.__call__"' in page
    assert "-----" not in page


@pytest.mark.slow
def test_the_readme_is_the_first_page(site: Path) -> None:
    text = (site / "index.html").read_text()
    assert "Try it in a minute" in text
    assert 'href="install.html' in text
    assert "models/data" not in re.findall(r'href="([^"]*)"', text)
