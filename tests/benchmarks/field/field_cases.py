"""Are logs as the field records them read right? Case, expectation and result, one line each.

``python tests/benchmarks field.field_cases [--data DIR] [--only NAME] [--result FILE]`` runs ``replay info`` and
``replay diagnose`` on the cases of DIR (``NAME/input.*``, expected in ``field/cases.toml``), and on the ones that
``field_case_logs.py`` writes. Exit code 1 where an answer is wrong. Where DIR is absent, its cases are left out.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import command_line
import numpy as np
from field_case_logs import CASES, Expected
from result_file import ROOT, add_option, counted, write_result

from models.common.errors import LogError
from models.common.frames import Array
from replay import load

DATA = ROOT.parent / "shared" / "data" / "cases"
TABLE = Path(__file__).with_name("cases.toml")
MOST_S = 300.0


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What the two commands said of a log."""

    code: int
    """Exit code of ``replay diagnose``."""
    content: dict[str, Any]
    """Its JSON."""
    text: str
    """All that was said, of both commands."""
    volts: tuple[float, float] | None = None
    """Least and most of the battery."""
    speed_m_s: float = 0.0
    """The fastest velocity in the log."""

    @property
    def known(self) -> dict[str, Any]:
        """What the drafted vehicle knows."""
        facts = self.content.get("vehicle", {}).get("known", ())
        return {fact["key"]: fact["value"] for fact in facts}

    @property
    def names(self) -> list[str]:
        """Effects."""
        return [effect["name"] for effect in self.content.get("effects", ())]

    def line(self) -> str:
        """In one line: what was found, or why not."""
        if self.code:
            return self.text.splitlines()[-1] if self.text else f"exit code {self.code}"
        judged = self.content["duration_s"]
        found = ", ".join(self.names) or "nothing"
        return (
            f"{self.known.get('frame')} {self.known.get('rotors')}, {judged:.1f} s judged: {found}"
        )


def ask(log: Path) -> Answer:
    """Both commands, and the battery and velocity that the reader gives."""
    info = replay("info", str(log))
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "answer.json"
        done = replay("diagnose", str(log), "--json", str(out), "--quiet")
        content = json.loads(out.read_text()) if out.exists() else {}
    said = [info.stdout, info.stderr, json.dumps(content), done.stderr]
    volts, speed = readings(log)
    return Answer(
        code=done.returncode,
        content=content,
        # Names of files are no answer.
        text="\n".join(part.strip() for part in said)
        .replace(str(log), "LOG")
        .replace(log.name, "LOG"),
        volts=volts,
        speed_m_s=speed,
    )


def replay(*arguments: str) -> subprocess.CompletedProcess[str]:
    """One command of ``replay``."""
    command = [sys.executable, "-m", "replay", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=MOST_S, check=False)


def readings(path: Path) -> tuple[tuple[float, float] | None, float]:
    """Least and most voltage, and the fastest velocity; None and 0 where there is none."""
    try:
        logs = load(path)
    except LogError:
        return None, 0.0
    volts = [log.battery.values[:, 0] for log in logs if log.battery is not None]
    speeds = [
        np.linalg.norm(log.velocity.values, axis=1) for log in logs if log.velocity is not None
    ]
    span = _span(speeds)
    return _span(volts), 0.0 if span is None else span[1]


def _span(parts: list[Array]) -> tuple[float, float] | None:
    """Least and most of what is known."""
    if not parts:
        return None
    together = np.concatenate(parts)
    known = together[np.isfinite(together)]
    return (float(known.min()), float(known.max())) if len(known) else None


def wrong(expected: Expected, answer: Answer) -> list[str]:
    """What of an answer is not as expected."""
    out = [f"says {p!r}" for p in expected.never if re.search(p, answer.text)]
    if answer.code not in (0, 3):
        return [*out, f"exit code {answer.code}"]
    if answer.code == 3:
        reason = answer.text.splitlines()[-1]
        if not expected.refused or not re.search(expected.refused, reason):
            out.append("refused")
        return out
    if expected.says and not re.search(expected.says, answer.text):
        out.append(f"does not say {expected.says!r}")
    return [*out, *_wrong_vehicle(expected, answer), *_wrong_numbers(expected, answer)]


def _wrong_vehicle(expected: Expected, answer: Answer) -> list[str]:
    out: list[str] = []
    frame = answer.known.get("frame")
    rotors = answer.known.get("rotors")
    if expected.frame and frame != expected.frame:
        out.append(f"frame {frame}, not {expected.frame}")
    if expected.rotors and rotors != list(expected.rotors):
        out.append(f"rotors {rotors}, not {list(expected.rotors)}")
    if expected.names is not None:
        out += [f"names {name}" for name in answer.names if name not in expected.names]
    return out


def _wrong_numbers(expected: Expected, answer: Answer) -> list[str]:
    out: list[str] = []
    judged = answer.content["duration_s"]
    if not expected.judged_s <= judged <= expected.judged_most_s:
        out.append(f"{judged:.1f} s judged")
    if expected.volts is not None and not _within(expected.volts, answer.volts):
        out.append(f"battery {answer.volts}")
    if expected.speed_m_s is not None and answer.speed_m_s > expected.speed_m_s:
        out.append(f"{answer.speed_m_s:.1f} m/s")
    return out


def _within(bounds: tuple[float, float], found: tuple[float, float] | None) -> bool:
    return found is not None and bounds[0] <= found[0] and found[1] <= bounds[1]


def shared_cases(data: Path) -> list[tuple[str, Path, Expected]]:
    """Name, log and expectation of every case of the table that lies in ``data``."""
    out = []
    for name, keys in tomllib.loads(TABLE.read_text(encoding="utf-8")).items():
        values = {key: tuple(v) if isinstance(v, list) else v for key, v in keys.items()}
        for log in sorted((data / name).glob("input.*")):
            out.append((name, log, Expected(**values)))
    return out


def written_cases(folder: Path, only: str) -> list[tuple[str, Path, Expected]]:
    """The same of those that are written here, and have ``only`` in their names."""
    out = []
    for case in CASES:
        if only not in case.name:
            continue
        path = folder / f"{case.name}{case.suffix}"
        case.write(path)
        out.append((case.name, path, case.expected))
    return out


def main() -> int:
    """Ask of every case, and count."""
    parser = command_line.parser(__doc__)
    parser.add_argument(
        "--data",
        type=Path,
        default=DATA,
        metavar="DIR",
        help="folder of cases (default %(default)s)",
    )
    parser.add_argument(
        "--only", default="", metavar="NAME", help="only cases with NAME in their name"
    )
    add_option(parser)
    a = parser.parse_args()
    if not a.data.is_dir():
        print(f"no cases in {a.data}: only the written ones")
    right = {"given": [], "written": []}
    with tempfile.TemporaryDirectory() as folder:
        kinds = {"given": shared_cases(a.data), "written": written_cases(Path(folder), a.only)}
        for kind, cases in kinds.items():
            for name, log, expected in cases:
                if a.only not in name:
                    continue
                answer = ask(log)
                reasons = wrong(expected, answer)
                right[kind].append(not reasons)
                verdict = f"WRONG: {'; '.join(reasons)}" if reasons else "right"
                print(
                    f"{name}\n  expected  {expected.text}\n  result    {answer.line()}\n  {verdict}",
                    flush=True,
                )
    figures = [
        counted(f"{kind} cases right", flags, least=1.0) for kind, flags in right.items() if flags
    ]
    for f in figures:
        print(f"{f['what']}: {f.get('detail', '')}")
    write_result(a, figures, seeds=f"{sum(map(len, right.values()))} logs", simulated=True)
    return 0 if all(all(flags) for flags in right.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
