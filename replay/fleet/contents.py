"""The content of the logs of a folder, known by path, size and time of change: a second run reads no file for it."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from replay.fleet.jobs import content_hash
from replay.fleet.store import Store

SETTLED_NS = 2_000_000_000
"""A file that was changed so recently may change again within the resolution of its time of change."""


@dataclass(frozen=True)
class Contents:
    """Every content once."""

    logs: dict[str, Path]
    """By sha256, the first path of each."""
    copies: tuple[tuple[Path, Path], ...]
    """Other paths of a content, with the first."""


def contents(paths: Sequence[Path], store: Store | None) -> Contents:
    """What the files hold. One that vanished meanwhile is said and left out."""
    remembered = {}
    if store is not None:
        for row in store.rows("SELECT * FROM files"):
            remembered[row["path"], row["bytes"], row["changed_ns"]] = row["sha256"]
    logs: dict[str, Path] = {}
    copies = []
    new = []
    try:
        for path in paths:
            log = path.resolve()
            try:
                about = log.stat()
                key = (str(log), about.st_size, about.st_mtime_ns)
                sha256 = remembered.get(key)
                if sha256 is None:
                    sha256 = content_hash(log)
                    if time.time_ns() - about.st_mtime_ns > SETTLED_NS:
                        new.append((*key, sha256))
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
    return Contents(logs, tuple(copies))
