"""The arguments of a command that measures."""

from __future__ import annotations

import argparse


def parser(text: str | None, *, prog: str | None = None) -> argparse.ArgumentParser:
    """A parser whose help is ``text`` as it stands."""
    return argparse.ArgumentParser(
        prog=prog,
        description=text,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
