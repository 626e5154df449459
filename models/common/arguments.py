"""The command line of the three programs: their version; a wrong argument is one line, as every other error."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from typing import NoReturn

from models.common.errors import ConfigError, UserError
from models.common.extras import how_to_install

INTERRUPTED = 130
"""Exit code after Ctrl-C."""


def speaks(args: argparse.Namespace) -> bool:
    """Whether a command prints its text: not with ``--quiet``, nor where stdout is for ``--json``."""
    return not args.quiet and args.json != "-"


def installed_version() -> str:
    """Version of the installed distribution; "unknown" in a checkout that was not installed."""
    # Imported here: it costs a tenth of the start of a program that was not asked for its version.
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("corner-compensator")
    except PackageNotFoundError:
        return "unknown"


class VersionAction(argparse.Action):
    """``--version``: prints program and version; looks the version up only when asked."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object, **__: object) -> None:
        """Print and leave with 0."""
        print(f"{parser.prog} {installed_version()}")
        parser.exit()


class Parser(argparse.ArgumentParser):
    """As argparse's, but an error names the argument and where help is, without the whole usage. Exit code 2."""

    def error(self, message: str) -> NoReturn:
        """Print one line on stderr and leave."""
        self.exit(2, f"{self.prog}: {message}; see: {self.prog} --help\n")


def run_command(program: str, extra: str, run: Callable[[], int]) -> int:
    """The exit code of a command; what a user can mend is one line on stderr.

    ``extra``: of the package, where another package is missing.
    """
    try:
        return run()
    except UserError as error:
        text = str(error)
        code = error.exit_code
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] in ("companion", "models", "replay"):
            raise
        text = f"this needs the package {error.name}: {how_to_install(extra)}"
        code = ConfigError.exit_code
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:  # the reader of our output left
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    print(f"{program}: {text}", file=sys.stderr)
    return code
