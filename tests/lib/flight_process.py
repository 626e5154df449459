"""The flight program as a process of its own, as a user starts it."""

from __future__ import annotations

import sys


def flight_command(port: int, *options: str, scheme: str = "udpin") -> list[str]:
    """The paper's tandem, listening on a loopback port."""
    return [
        sys.executable,
        "-m",
        "companion",
        "--vehicle",
        "tandem",
        "--connect",
        f"{scheme}:127.0.0.1:{port}",
        *options,
    ]
