"""Text files of users: an error names what the file is, where it is and what is wrong, in one line."""

from __future__ import annotations

from pathlib import Path

from models.errors import ConfigError, UserError


def read_text(what: str, path: Path, kind: type[UserError] = ConfigError) -> str:
    """The text of ``path``, without a byte order mark. Raises ``kind`` where it cannot be read."""
    try:
        return path.read_text("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise kind(f"{what} {path}: cannot be read ({reason})") from None


def write_text(what: str, path: Path, text: str, kind: type[UserError] = ConfigError) -> None:
    """Write ``text``. Raises ``kind`` where that fails."""
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise kind(f"{what} {path}: cannot be written ({error.strerror})") from None
