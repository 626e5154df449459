"""The declared model of simulated flights, and how their commands run."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from zlib import crc32

REPO = Path(__file__).resolve().parents[3]
ENVIRONMENT = {**os.environ, "OMP_NUM_THREADS": "1"}


def train(table: Path, method: str, folder: Path) -> Path:
    """A surrogate of a table of the air, trained once and kept in ``folder``."""
    out = folder / f"model-{method}-{crc32(table.read_bytes()):08x}"
    if (out / "model.json").exists():
        return out
    command = [
        sys.executable,
        "-m",
        "models",
        "train",
        "--quiet",
        f"--data={table}",
        f"--method={method}",
        f"--out={out}",
    ]
    subprocess.run(command, check=True, cwd=REPO, env=ENVIRONMENT)
    return out


def be_nice() -> None:
    """Of a process that is to start: last in turn."""
    os.nice(19)
