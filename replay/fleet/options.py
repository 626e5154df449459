"""Options of the commands that take a folder. Light, so that ``--help`` answers at once."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_options(p: argparse.ArgumentParser) -> None:
    """The options that only a folder has."""
    g = p.add_argument_group("of a folder of logs")
    g.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="answers, table and, without --report, the page (default: NAME-COMMAND, here)",
    )
    g.add_argument("--workers", type=int, metavar="N", help="local processes (default: one a core)")
    g.add_argument("--scheduler", metavar="tcp://HOST:PORT", help="a Dask cluster that sees the same files")
