"""Numbers by name that the command line gives, such as parameters of the autopilot where a log lacks them."""

from __future__ import annotations

import math
from collections.abc import Sequence

from models.errors import ConfigError


def assumed_parameters(pairs: Sequence[str]) -> dict[str, float]:
    """``NAME=VALUE`` of the command line; ConfigError where one is no number."""
    out = {}
    for pair in pairs:
        name, _, value = pair.partition("=")
        try:
            out[name] = float(value)
        except ValueError:
            out[name] = math.nan
        if not name or not math.isfinite(out[name]):
            raise ConfigError(f"--param {pair}: must be NAME=NUMBER, such as GUID_OPTIONS=8")
    return out
