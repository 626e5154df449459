"""Logs of an object store, brought to a folder as docs/logs.md says."""

from __future__ import annotations

import re
from pathlib import Path

import fsspec
from fsspec.implementations.memory import MemoryFileSystem

LOGS = Path(__file__).parents[2] / "docs" / "logs.md"


def documented(store: str, folder: Path) -> str:
    """The lines of the page, for another store and folder."""
    block = re.search(r"```python\n( *from fsspec.*?)```", LOGS.read_text("utf-8"), re.DOTALL)
    assert block is not None
    lines = "\n".join(line.strip() for line in block[1].splitlines())
    assert lines.count("s3://flights/2026") == lines.count("file:///data/logs") == 1
    return lines.replace("s3://flights/2026", store).replace("file:///data/logs", folder.as_uri())


def test_what_is_new_in_an_object_store_comes_to_the_folder_and_nothing_twice(tmp_path):
    store: MemoryFileSystem = fsspec.filesystem("memory")
    store.pipe({"/flights/june/a.tlog": b"first", "/flights/b.tlog": b"second"})
    lines = documented("memory://flights", tmp_path / "logs")
    exec(lines)
    first = tmp_path / "logs" / "june" / "a.tlog"
    assert first.read_bytes() == b"first"
    copied = first.stat().st_mtime_ns

    store.pipe("/flights/c.tlog", b"third")
    exec(lines)
    assert (tmp_path / "logs" / "c.tlog").read_bytes() == b"third"
    assert first.stat().st_mtime_ns == copied
