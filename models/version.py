"""Version of the installed program, and the ``--version`` option of the three commands."""

from __future__ import annotations

import argparse

DISTRIBUTION = "corner-compensator"


class VersionAction(argparse.Action):
    """``--version``: prints program and version; looks the version up only when asked."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object, **__: object) -> None:
        """Print and leave with 0."""
        print(f"{parser.prog} {installed_version()}")
        parser.exit()


def installed_version() -> str:
    """Version of the installed distribution; "unknown" in a checkout that was not installed."""
    # Imported here: it costs a tenth of the start of a program that was not asked for its version.
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(DISTRIBUTION)
    except PackageNotFoundError:
        return "unknown"
