"""docs/safety.md: every requirement names tests that exist, with the cases that it names."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from faults.catalog import FAULTS

from companion.invariants.requirements import Requirement

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "safety.md").read_text(encoding="utf-8")
REQUIREMENTS = PAGE.split("## Requirements")[1].split("## Limits")[0]
ROWS = [
    line
    for line in REQUIREMENTS.splitlines()
    if line.startswith("| ") and not line.startswith("| requirement")
]
LINK = re.compile(r"\[[^]]+\]\(\.\./(tests/[\w/]+\.py)#(\w+)\)")


@pytest.mark.parametrize("row", ROWS, ids=[row[2:50] for row in ROWS])
def test_every_requirement_names_tests_that_exist(row):
    tests = row.split("|")[3]
    links = LINK.findall(tests)
    assert links
    assert len(links) == tests.count("]("), "a link that is none of a test"
    for path, name in links:
        assert re.search(rf"^def {name}\(", (ROOT / path).read_text(encoding="utf-8"), re.M), (
            f"{path} lacks {name}"
        )
    for case in re.findall(r"\*([^*]+)\*", tests):
        assert any(f'"{case}"' in (ROOT / path).read_text(encoding="utf-8") for path, _ in links), (
            case
        )


def test_the_page_is_complete():
    assert len(ROWS) >= len(Requirement) - 3, (
        "armed, mode and landed share a row, as do form and quaternion"
    )
    assert f"{len(FAULTS)} things that go wrong" in PAGE
