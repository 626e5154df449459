"""Files of others' repositories, at one commit of a clone."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path


def git(clone: Path, *arguments: str) -> bytes:
    """What git prints about ``clone``. Raises SystemExit with git's own line where it fails."""
    done = subprocess.run(["git", "-C", str(clone), *arguments], capture_output=True, check=False)
    if done.returncode:
        raise SystemExit(f"{clone}: {done.stderr.decode().strip()}")
    return done.stdout


def clone_and_out(usage: str | None) -> tuple[Path, Path]:
    """The two arguments of a converter: a clone, and the folder to write to, made. Else ``usage`` and exit 2."""
    if len(sys.argv) != 3:
        print(usage, file=sys.stderr)
        raise SystemExit(2)
    clone, out = Path(sys.argv[1]), Path(sys.argv[2])
    out.mkdir(parents=True, exist_ok=True)
    return clone, out
