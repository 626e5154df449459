"""The content of the logs of a folder, known by path, size and time of change: a second run reads no file for it."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from replay.fleet.jobs import content_hash
from replay.fleet.store import Row, Store

SETTLED_NS = 2_000_000_000
"""A file that was changed so recently may change again within the resolution of its time of change."""
NEVER_NS = -1


@dataclass(frozen=True)
class Contents:
    """Every content once."""

    logs: dict[str, Path]
    """By sha256, the first path of each."""
    copies: tuple[tuple[Path, Path], ...]
    """Other paths of a content, with the first."""
    grown: tuple[tuple[Path, str], ...]
    """Logs that were still being written when they were met before, with the sha256 of then."""


def contents(paths: Sequence[Path], store: Store | None) -> Contents:
    """What the files hold. One that vanished meanwhile, or may not be read, is said and left out."""
    logs: dict[str, Path] = {}
    copies = []
    grown = []
    new = []
    try:
        for path in paths:
            log = path.resolve()
            try:
                about = log.stat()
                old = _before(log, store)
                if old is not None and _same(old, about):
                    sha256 = old["sha256"]
                else:
                    sha256 = content_hash(log)
                    new.append((str(log), about.st_size, _settled_ns(about), sha256))
                    if old is not None and _goes_on(log, about, old):
                        grown.append((path, old["sha256"]))
            except OSError as error:
                print(f"replay: {path}: {error.strerror or error}", file=sys.stderr)
                continue
            if sha256 in logs:
                copies.append((path, logs[sha256]))
            else:
                logs[sha256] = log
    finally:
        if store is not None:
            store.put("files", new)
    beginnings = tuple((path, sha256) for path, sha256 in grown if sha256 not in logs)
    return Contents(logs, tuple(copies), beginnings)


def _before(log: Path, store: Store | None) -> Row | None:
    """What the store remembers of a file; asked one by one, as the store may know a million of other folders."""
    if store is None:
        return None
    for row in store.rows("SELECT * FROM files WHERE path = ?", (str(log),)):
        return row
    return None


def _same(old: Row, about: os.stat_result) -> bool:
    """Whether a file was not touched since then."""
    return (old["bytes"], old["changed_ns"]) == (about.st_size, about.st_mtime_ns)


def _settled_ns(about: os.stat_result) -> int:
    """When it was changed; a time that no file has where it may change again at the same one."""
    if time.time_ns() - about.st_mtime_ns > SETTLED_NS:
        return about.st_mtime_ns
    return NEVER_NS


def _goes_on(log: Path, about: os.stat_result, old: Row) -> bool:
    """Whether the file begins with the whole content that it had then. Raises OSError."""
    if not old["bytes"] < about.st_size:
        return False
    return content_hash(log, old["bytes"]) == str(old["sha256"])
