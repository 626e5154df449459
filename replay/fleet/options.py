"""Options of the commands that take a folder. Light, so that ``--help`` answers at once."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

from models.errors import ConfigError


@dataclass(frozen=True)
class FolderOptions:
    """Where the answers about a folder go, and what works on them."""

    out: Path | None
    workers: int | None
    scheduler: str | None
    report: Path | None
    json: str | None
    quiet: bool

    @classmethod
    def of(cls, a: argparse.Namespace) -> FolderOptions:
        """As the command line gives them. ConfigError where one makes no sense."""
        if a.workers is not None and not 1 <= a.workers <= 1024:
            raise ConfigError(f"--workers {a.workers}: must be 1 to 1024")
        if a.scheduler is not None and "://" not in a.scheduler:
            raise ConfigError(f"--scheduler {a.scheduler}: must be an address such as tcp://10.0.0.5:8786")
        return cls(a.out, a.workers, a.scheduler, a.report, a.json, a.quiet)


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
