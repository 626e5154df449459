"""How many logs does ``replay diagnose LOG`` answer without a vehicle file, and how soon? One line a log.

``python tests/benchmarks/no_file.py LOG... [--result FILE]``. An answer is exit code 0; a log without the needed
messages is refused with 3. The time is of the whole command, on the wall.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from result_file import add_option, counted, figure, write_result

GOAL_S, MOST_S = 15.0, 600.0


@dataclass(frozen=True)
class Answer:
    """What the command said of one log."""

    log: Path
    code: int
    seconds: float
    content: dict[str, Any]
    error: str

    def line(self) -> str:
        """Log, seconds, drafted frame and hover thrust, and what was found; or why there is no answer."""
        known = {f["key"]: f.get("value") for f in self.content.get("vehicle", {}).get("known", ())}
        names = ", ".join(e["name"] for e in self.content.get("effects", ()))
        said = f"{known.get('frame')}, hover {known.get('hover_thrust')}: {self.content.get('verdict')} {names}"
        return f"{self.log.name:24s} {self.seconds:5.1f} s  exit {self.code}  {self.error or said}"


def ask(log: Path) -> Answer:
    """Diagnose one log with nothing but the log."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "answer.json"
        command = [sys.executable, "-m", "replay", "diagnose", str(log.resolve()), "--json", str(out), "--quiet"]
        start = time.perf_counter()
        done = subprocess.run(command, capture_output=True, text=True, timeout=MOST_S, check=False)
        seconds = time.perf_counter() - start
        content = json.loads(out.read_text()) if out.exists() else {}
    return Answer(log, done.returncode, seconds, content, done.stderr.strip() if done.returncode else "")


def main() -> int:
    """Ask of every log, and count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+", type=Path, metavar="LOG")
    add_option(parser)
    a = parser.parse_args()
    answers = []
    for log in a.logs:
        answers.append(ask(log))
        print(answers[-1].line(), flush=True)
    answered = [x for x in answers if x.code == 0]
    figures = [
        counted("logs answered without a vehicle file", [x.code == 0 for x in answers]),
        counted("logs refused in one line, exit code 3", [x.code == 3 for x in answers]),
        figure("slowest answer [s]", f"{max((x.seconds for x in answered), default=0.0):.1f}", goal=f"{GOAL_S:.0f}",
               met=all(x.seconds <= GOAL_S for x in answered)),
        counted("answers within 15 s", [x.seconds <= GOAL_S for x in answered]),
    ]  # fmt: skip
    for f in figures:
        print(f"{f['what']}: {f['value']} {f.get('detail', '')}")
    write_result(a, figures, seeds=f"{len(a.logs)} logs", simulated=False)
    return 0


if __name__ == "__main__":
    sys.exit(main())
