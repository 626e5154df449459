"""The answer of a command as JSON, for ``--json``."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from models.text_file import write_text


def write_json(content: Mapping[str, Any] | Sequence[Any], target: str) -> None:
    """Write ``content`` to a file, or to stdout where ``target`` is ``-``. Raises ConfigError where that fails."""
    text = json.dumps(content, indent=2, allow_nan=False)
    if target == "-":
        print(text)
        return
    write_text("--json", Path(target), text + "\n")
