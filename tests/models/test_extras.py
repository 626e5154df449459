"""What to type where an extra is missing: from the folder or wheel that the program was installed from."""

from __future__ import annotations

import json
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from types import SimpleNamespace

import pytest

from models.common.extras import how_to_install

BY_NAME = "pip install 'corner-compensator[replay]'"


def come_from(monkeypatch: pytest.MonkeyPatch, said: str | None) -> None:
    """As if pip had installed the program from there."""
    installed = SimpleNamespace(read_text=lambda name: said)
    monkeypatch.setattr("importlib.metadata.distribution", lambda name: installed)


def test_a_checkout_names_its_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "a b"
    folder.mkdir()
    come_from(monkeypatch, json.dumps({"url": folder.as_uri(), "dir_info": {}}))
    assert how_to_install("replay") == f"pip install '{folder}[replay]'"


@pytest.mark.parametrize(
    "said", [None, "{}", '{"url": "https://example.org/x.whl"}', '{"url": "file:///gone"}']
)
def test_else_the_name_is_given(said: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    come_from(monkeypatch, said)
    assert how_to_install("replay") == BY_NAME


def test_a_program_that_is_not_installed_gives_the_name(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise PackageNotFoundError(name)

    monkeypatch.setattr("importlib.metadata.distribution", missing)
    assert how_to_install("replay") == BY_NAME
