"""Files of others' repositories, at one commit of a clone."""

from __future__ import annotations

import subprocess
from pathlib import Path


def git(clone: Path, *arguments: str) -> bytes:
    """What git prints about ``clone``. Raises SystemExit with git's own line where it fails."""
    done = subprocess.run(
        ["git", "-C", str(clone), *arguments],
        capture_output=True,
        check=False,
    )
    if done.returncode:
        raise SystemExit(f"{clone}: {done.stderr.decode().strip()}")
    return done.stdout


def read(clone: Path, commit: str, path: str) -> bytes:
    """The file ``path`` as it was at ``commit``."""
    return git(clone, "show", f"{commit}:{path}")
