"""The container file: what it copies is there and is all that the package needs, and it does not run as root."""

from __future__ import annotations

import fnmatch
import json
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LINES = [
    line.split(maxsplit=1)
    for line in (ROOT / "Dockerfile").read_text().replace("\\\n", "").splitlines()
    if line and line[0].isupper()
]
COPIED = [source for kind, rest in LINES if kind == "COPY" for source in rest.split()[:-1]]


@pytest.fixture(scope="module")
def project() -> dict:
    return tomllib.loads((ROOT / "pyproject.toml").read_text())


def test_what_is_copied_is_there_and_not_kept_out() -> None:
    kept_out = (ROOT / ".dockerignore").read_text().split()
    for source in COPIED:
        assert (ROOT / source).exists(), source
        assert not any(fnmatch.fnmatch(source, pattern) for pattern in kept_out), source


def test_all_that_the_package_is_built_from_is_copied(project: dict) -> None:
    about = project["project"]
    packages = [
        pattern.rstrip("*")
        for pattern in project["tool"]["setuptools"]["packages"]["find"]["include"]
    ]
    assert {"pyproject.toml", about["readme"], *about["license-files"], *packages} <= set(COPIED)


def test_python_is_one_that_the_package_is_for(project: dict) -> None:
    image = next(rest for kind, rest in LINES if kind == "FROM")
    version = {"debian:trixie-slim": "3.13"}[image]
    assert f"Programming Language :: Python :: {version}" in project["project"]["classifiers"]


def test_it_starts_the_flight_program_and_not_as_root(project: dict) -> None:
    assert [rest for kind, rest in LINES if kind == "USER"][-1] not in ("0", "root")
    command = json.loads(next(rest for kind, rest in LINES if kind == "ENTRYPOINT"))
    assert command[0] in project["project"]["scripts"]


def test_the_install_is_of_tested_versions_and_leaves_no_cache() -> None:
    (install,) = [rest for kind, rest in LINES if kind == "RUN" and "pip install" in rest]
    assert "-c constraints.txt" in install
    assert "--no-cache-dir" in install
