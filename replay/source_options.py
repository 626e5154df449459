"""``--set``: which instance of a quantity is read (``replay/sources``)."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from models.common.errors import ConfigError


def add_source_option(p: argparse.ArgumentParser) -> None:
    """Which instance of a quantity is read."""
    p.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="QUANTITY=NAME",
        help="read this instance, such as battery=2 or imu=IMU:1; replay info names them "
        "(default: the one in use)",
    )


def source_settings(pairs: Sequence[str]) -> dict[str, str]:
    """``QUANTITY=NAME`` of the command line; ConfigError where one is not of that form."""
    out = {}
    for pair in pairs:
        quantity, _, name = pair.partition("=")
        if not quantity or not name:
            raise ConfigError(f"--set {pair}: must be QUANTITY=NAME, such as battery=2")
        out[quantity] = name
    return out
