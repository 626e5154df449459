"""The arguments of a command that measures."""

from __future__ import annotations

import argparse
from pathlib import Path


def parser(text: str | None, *, prog: str | None = None) -> argparse.ArgumentParser:
    """A parser whose help is ``text`` as it stands."""
    return argparse.ArgumentParser(
        prog=prog,
        description=text,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )


def of_clone(text: str | None) -> argparse.ArgumentParser:
    """The same, of a command that reads a clone of others' repository."""
    p = parser(text)
    p.add_argument("clone", type=_present, metavar="CLONE")
    return p


def _present(name: str) -> Path:
    if not Path(name).is_dir():
        raise SystemExit(f"skipped: {name}: no clone of the authors' repository is there")
    return Path(name)
