"""The command line parser of the three programs: a wrong argument is one line, as every other error."""

from __future__ import annotations

import argparse
from typing import NoReturn


def speaks(args: argparse.Namespace) -> bool:
    """Whether a command prints its text: not with ``--quiet``, nor where stdout is for ``--json``."""
    return not args.quiet and args.json != "-"


class Parser(argparse.ArgumentParser):
    """As argparse's, but an error names the argument and where help is, without the whole usage. Exit code 2."""

    def error(self, message: str) -> NoReturn:
        """Print one line on stderr and leave."""
        self.exit(2, f"{self.prog}: {message}; see: {self.prog} --help\n")
