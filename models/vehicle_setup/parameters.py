"""Parameter files as ground stations save them."""

from __future__ import annotations

import re
from pathlib import Path

from models.errors import ConfigError
from models.text_file import read_text

_NAME = re.compile(r"^[A-Z][A-Z0-9_]{1,15}$")


def read_parameters(path: Path) -> dict[str, float]:
    """Names and values of a parameter file.

    Mission Planner and MAVProxy write ``NAME,VALUE`` or ``NAME VALUE``, QGroundControl five columns, the name third.
    Lines that begin with # are comments. Raises ConfigError naming the file, and the line where one makes no sense.
    """
    out: dict[str, float] = {}
    for number, line in enumerate(read_text("parameter file", path).splitlines(), 1):
        words = re.split(r"[,\s]+", line.split("#", 1)[0].strip())
        if words == [""]:
            continue
        name, value = (words[2], words[3]) if len(words) >= 4 and words[0].isdigit() else (words[0], words[-1])
        try:
            out[name] = float(value)
        except ValueError:
            out[name] = float("nan")
        if not _NAME.match(name) or out[name] != out[name] or len(words) < 2:
            raise ConfigError(f"parameter file {path}: line {number} is no parameter: {line.strip()[:60]!r}")
    if not out:
        raise ConfigError(f"parameter file {path}: holds no parameter")
    return out
