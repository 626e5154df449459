"""``replay diagnose --since``: arguments, files and text; the work is in since.py."""

from __future__ import annotations

import argparse
from pathlib import Path

from models.common.errors import ConfigError


def run(a: argparse.Namespace) -> int:
    """Run the command; UserErrors are reported by the caller."""
    from replay.changes.since import page, since
    from replay.command import fault_lines, given, of_logs, progress_bar, refuse, write_answer
    from replay.diagnosis.model_faults import model_faults

    why = "amends a model, and --since asks what changed; give one of them"
    refuse(a, ("save_model", "save_vehicle", "test"), why)
    logs, good = _flights(a)
    vehicle, chosen, draft = of_logs(a.vehicle, a.model, [*good, *logs], given(a), a.target_system)
    answer = since(
        logs, good, vehicle, chosen.judged, target_system=a.target_system, progress=progress_bar(a)
    )
    faults = model_faults(answer.records, chosen)
    content = (
        answer.as_json()
        | {"log_faults": faults}
        | ({} if draft is None else {"vehicle": draft.as_json()})
    )
    write_answer(
        a, content, [*fault_lines(faults), answer.as_text()], lambda: page(answer, vehicle, faults)
    )
    return 0


def _flights(a: argparse.Namespace) -> tuple[list[Path], list[Path]]:
    """The logs that are asked about, and the good ones: named, or the first N of a folder in order of date."""
    from replay.changes.since import by_date
    from replay.fleet.results import logs_in

    if not any(log.is_dir() for log in a.logs):
        good = [Path(name) for name in a.since]
        for log in good:
            if log.is_dir():
                raise ConfigError(f"--since {log}: is a folder; name the good logs")
            if log in a.logs:
                raise ConfigError(f"{log}: is one of the good flights of --since; name another log")
        return list(a.logs), good
    if len(a.logs) > 1:
        raise ConfigError(
            f"--since: give one folder alone, or name the logs, instead of {a.logs[0]} and others"
        )
    if len(a.since) != 1 or not a.since[0].isdecimal() or int(a.since[0]) < 1:
        raise ConfigError(
            f"--since {' '.join(a.since)}: with a folder, give the number of its first logs that "
            "are good"
        )
    ordered = by_date(logs_in(a.logs[0])[0])
    first = int(a.since[0])
    if len(ordered) <= first:
        raise ConfigError(
            f"--since {first}: {a.logs[0]} holds {len(ordered)} logs; at least one more is needed"
        )
    return ordered[first:], ordered[:first]
