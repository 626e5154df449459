"""Puts tests/simulators on the path; to be imported before what lies there."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "simulators"))
