"""Files that users name: an error says what the file is, where it is and what is wrong, in one line."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from models.common.errors import ConfigError, UserError

_PART = 100
"""Characters of a name, so that with what is added to it none is too long."""


def read_text(what: str, path: Path, kind: type[UserError] = ConfigError) -> str:
    """The text of ``path``, without a byte order mark. Raises ``kind`` where it cannot be read."""
    try:
        return path.read_text("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        if isinstance(error, OSError):
            reason = error.strerror
        else:
            reason = "not UTF-8 text"
        raise kind(f"{what} {path}: cannot be read ({reason})") from None


def write_text(what: str, path: Path, text: str, kind: type[UserError] = ConfigError) -> None:
    """Write ``text``. Raises ``kind`` where that fails."""
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise kind(f"{what} {path}: cannot be written ({error.strerror})") from None


@contextmanager
def replaced(what: str, target: Path) -> Iterator[Path]:
    """A path to write to: what is there at the end of the block takes the place of ``target``.

    A full disk, a kill or Ctrl-C leaves the old file whole. Devices and pipes are written directly. Raises ConfigError.
    """
    try:
        if target.exists() and not target.is_file():
            yield target
            return
        whole = target.resolve()
        part = whole.with_name(f".{whole.name[-_PART:]}.{os.getpid()}.part")
        try:
            yield part
            os.replace(part, whole)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise ConfigError(f"{what} {target}: cannot be written ({error.strerror})") from None


def make_folder(what: str, folder: Path) -> None:
    """Make a folder, unless it is there. Raises ConfigError where that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"{what} {folder}: cannot be written ({error.strerror})") from None


def write_json(content: Mapping[str, Any] | Sequence[Any], target: str) -> None:
    """Write the answer of a command for ``--json``: to a file, or to stdout where ``target`` is ``-``."""
    text = json.dumps(content, indent=2, allow_nan=False)
    if target == "-":
        print(text)
        return
    write_text("--json", Path(target), text + "\n")
