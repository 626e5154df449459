"""The answer of a command as JSON, for ``--json``."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from models.errors import ConfigError


def write_json(content: Mapping[str, Any] | Sequence[Any], target: str) -> None:
    """Write ``content`` to a file, or to stdout where ``target`` is ``-``. Raises ConfigError where that fails."""
    text = json.dumps(content, indent=2, allow_nan=False)
    if target == "-":
        print(text)
        return
    try:
        Path(target).write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"--json {target}: cannot be written ({error.strerror})") from None
