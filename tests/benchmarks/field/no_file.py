"""How many logs does ``replay diagnose LOG`` answer without a vehicle file, and how soon? One line a log.

``python tests/benchmarks field.no_file LOG... [--table TABLE] [--result FILE]``. An answer is exit code 0; a log
without the needed messages is refused with 3. The time is of the whole command, on the wall.

TABLE (``field/public_logs.toml``) says what the parameters of a log, by its name, say of the vehicle, and which
reason for a refusal is true. Where a draft or a reason is another one, it is said, and the exit code is 1.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
import time
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import command_line
from result_file import add_option, counted, figure, write_result

GOAL_S = 15.0
MOST_S = 600.0


@dataclass(frozen=True)
class Answer:
    """What the command said of one log."""

    log: Path
    code: int
    seconds: float
    content: dict[str, Any]
    error: str

    def reason(self) -> str:
        """Why it was refused, without the name of the log."""
        return self.error.replace(str(self.log.resolve()), "LOG")

    def line(self) -> str:
        """Log, seconds, drafted frame and hover thrust, and what was found; or why there is no answer."""
        known = {f["key"]: f.get("value") for f in self.content.get("vehicle", {}).get("known", ())}
        names = ", ".join(e["name"] for e in self.content.get("effects", ()))
        said = f"{known.get('frame')}, hover {known.get('hover_thrust')}: {self.content.get('verdict')} {names}"
        return f"{self.log.name:24s} {self.seconds:5.1f} s  exit {self.code}  {self.error or said}"

    def drafted(self) -> tuple[str | None, list[int] | None]:
        """Frame and rotors of the draft."""
        facts = {f["key"]: f.get("value") for f in self.content.get("vehicle", {}).get("known", ())}
        return facts.get("frame"), facts.get("rotors")


@dataclass(frozen=True, kw_only=True)
class Truth:
    """What is known of a log without this program."""

    vehicle: str
    origin: str = ""
    frame: str = ""
    rotors: tuple[int, ...] = ()
    refused: str = ""
    """A pattern of the reason that is true; empty where there is none."""

    def line(self) -> str:
        """Beside the answer."""
        rotors = list(self.rotors) or "rotors not known"
        return f"{self.vehicle}: {self.frame or 'frame not known'}, {rotors}"


def read_table(path: Path | None) -> dict[str, Truth]:
    """The truth by the name of a log; nothing without a table."""
    if path is None:
        return {}
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    out = {}
    for name, keys in tables.items():
        rotors = tuple(keys.pop("rotors", ()))
        out[name] = Truth(**keys, rotors=rotors)
    return out


def answered_truly(answer: Answer, truth: Truth) -> bool:
    """Answered, or refused with a reason that is true. Who has to be refused for what it is, may not be answered."""
    if answer.code == 3:
        return bool(truth.refused) and re.search(truth.refused, answer.reason()) is not None
    return answer.code == 0 and (bool(truth.rotors) or not truth.refused)


def drafted_truly(answer: Answer, truth: Truth) -> bool:
    """Frame and order as the parameters say; what they do not say is not asked."""
    frame, rotors = answer.drafted()
    if truth.frame and frame != truth.frame:
        return False
    return not truth.rotors or rotors == list(truth.rotors)


def ask(log: Path) -> Answer:
    """Diagnose one log with nothing but the log."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "answer.json"
        command = [
            sys.executable,
            "-m",
            "replay",
            "diagnose",
            str(log.resolve()),
            "--json",
            str(out),
            "--quiet",
        ]
        start = time.perf_counter()
        done = subprocess.run(command, capture_output=True, text=True, timeout=MOST_S, check=False)
        seconds = time.perf_counter() - start
        content = json.loads(out.read_text()) if out.exists() else {}
    return Answer(
        log, done.returncode, seconds, content, done.stderr.strip() if done.returncode else ""
    )


def main() -> int:
    """Ask of every log, and count."""
    parser = command_line.parser(__doc__)
    parser.add_argument("logs", nargs="+", type=Path, metavar="LOG")
    parser.add_argument("--table", type=Path, metavar="TABLE", help="what is known of the logs")
    add_option(parser)
    a = parser.parse_args()
    table = read_table(a.table)
    answers: list[Answer] = []
    told: list[tuple[Answer, Truth]] = []
    for log in a.logs:
        answers.append(ask(log))
        print(answers[-1].line(), flush=True)
        if log.name in table:
            told.append((answers[-1], table[log.name]))
            print(_beside(*told[-1]), flush=True)
    answered = [x for x in answers if x.code == 0]
    figures = [
        counted("logs answered without a vehicle file", [x.code == 0 for x in answers]),
        counted("logs refused in one line, exit code 3", [x.code == 3 for x in answers]),
        figure("slowest answer [s]", f"{max((x.seconds for x in answered), default=0.0):.1f}", goal=f"{GOAL_S:.0f}",
               met=all(x.seconds <= GOAL_S for x in answered)),
        counted("answers within 15 s", [x.seconds <= GOAL_S for x in answered]),
    ]  # fmt: skip
    true = [answered_truly(*pair) for pair in told]
    drafts = [drafted_truly(*pair) for pair in told if pair[0].code == 0]
    if told:
        figures.append(counted("answered or refused with a true reason", true, least=1.0))
        figures.append(counted("drafted frame and order right", drafts, least=1.0))
    for f in figures:
        print(f"{f['what']}: {f['value']} {f.get('detail', '')}")
    write_result(a, figures, seeds=f"{len(a.logs)} logs", simulated=False)
    return 0 if all(true) and all(drafts) else 1


def _beside(answer: Answer, truth: Truth) -> str:
    """The truth below an answer, and what of it is wrong."""
    wrong = (
        "" if answered_truly(answer, truth) else "  WRONG: answered, or refused for another reason"
    )
    if answer.code == 0 and not drafted_truly(answer, truth):
        wrong += f"  WRONG: drafted {answer.drafted()}"
    return f"    true: {truth.line()}{wrong}"


if __name__ == "__main__":
    sys.exit(main())
