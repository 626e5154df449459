"""``replay audit``: did a recorded flight keep the requirements of docs/safety.md? By companion/invariants/."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from companion.vehicles import vehicle_path
from models.common.errors import LogError

if TYPE_CHECKING:
    from companion.invariants.requirements import Audit
    from models.vehicle import Vehicle
from replay.pipeline_options import add_answer_options

_EPILOG = """exit codes: 0 every requirement was kept; 1 one was broken; 2 bad arguments or vehicle file; 3 log
unreadable, or without the companion's own messages; 130 interrupted. What the requirements mean: docs/safety.md."""
_BROKEN = 1


def add_parser(commands: Any) -> None:
    """Register ``audit`` with the subparsers of ``replay``."""
    p: argparse.ArgumentParser = commands.add_parser(
        "audit",
        help="say whether a recorded flight kept the safety requirements",
        epilog=_EPILOG,
        description="Check everything that the companion sent in a recorded flight against what "
        "it heard. The recording must hold both directions, as companion --record and ground "
        "stations write them.",
    )
    p.add_argument("logs", nargs="+", type=Path, metavar="FLIGHT.tlog")
    p.add_argument(
        "--vehicle",
        type=vehicle_path,
        metavar="FILE.toml",
        help="vehicle file flown: its limits, and which sensors are needed (default: the default "
        "limits; any sensor)",
    )
    p.add_argument(
        "--dry-run",
        action="store_true",
        help="it was flown with --dry-run: no setpoint may be there",
    )
    p.add_argument(
        "--setpoint",
        choices=("hold", "upstream"),
        help="what was flown (default: upstream where another station's SET_ATTITUDE_TARGET is "
        "in the log)",
    )
    add_answer_options(p, flies="the first heard")
    p.set_defaults(run=run)


def run(a: argparse.Namespace) -> int:
    """Run the command; UserErrors are reported by the caller."""
    # Imported here so that --help answers at once.
    from models.common.text_file import write_json
    from models.vehicle import load_vehicle

    if a.vehicle is None:
        vehicle = None
    else:
        vehicle = load_vehicle(a.vehicle)
    quiet = a.quiet or a.json == "-"
    audits = [_audit(log, vehicle, a, quiet=quiet) for log in a.logs]
    kept = all(one.kept for one in audits)
    if a.json is not None:
        answers = [
            {"log": str(log), **one.as_json()} for log, one in zip(a.logs, audits, strict=True)
        ]
        write_json({"kept": kept, "logs": answers}, a.json)
    if not quiet:
        print(as_text(a.logs, audits))
    if kept:
        return 0
    return _BROKEN


def _audit(path: Path, vehicle: Vehicle | None, a: argparse.Namespace, *, quiet: bool) -> Audit:
    """Check one recording.

    Raises LogError where it cannot be read, or holds nothing that the companion sent.
    """
    from tqdm import tqdm

    from companion.invariants.auditor import Auditor
    from companion.mavlink import OWN_COMPONENT
    from companion.mavlink.setpoints import SET_ATTITUDE_TARGET
    from companion.mavlink.wire_frames import cut
    from replay.logs.formats import suffix_of
    from replay.logs.tlog import read_tlog

    if suffix_of(path) != ".tlog" and path.exists():
        raise LogError(
            f"{path}: only a .tlog holds both directions of the link; record one with companion "
            "--record"
        )
    log = read_tlog(path)
    counts = log.counts()
    ours = {s for s in counts if s[1] == OWN_COMPONENT and a.target_system in (None, s[0])}
    if not ours:
        raise LogError(
            f"{path}: holds no message of the companion (component {OWN_COMPONENT}): nothing to "
            "audit"
        )
    others = {number for *_, number in counts.keys() - ours}
    if a.setpoint is None:
        hold = SET_ATTITUDE_TARGET not in others
    else:
        hold = a.setpoint == "hold"
    auditor = Auditor(vehicle, hold=hold, dry_run=a.dry_run, system=a.target_system)
    bar = True if quiet else None  # None: only to a terminal
    for arrival_us, raw in tqdm(
        log.frames(), path.name, len(log), unit="frame", leave=False, disable=bar
    ):
        auditor.frame(arrival_us, cut(raw, 0))
    return auditor.audit


def as_text(logs: Sequence[Path], audits: Sequence[Audit]) -> str:
    """A table for a person."""
    out = []
    for log, one in zip(logs, audits, strict=True):
        out.append(
            f"{log.name}: {'kept' if one.kept else 'NOT KEPT'}; {one.sent} sent, {one.setpoints} "
            "setpoints"
        )
        for requirement, kept in one.requirements.items():
            if kept.broken:
                state = f"{kept.broken:7} broken"
            else:
                state = "     ok"
            if kept.checked:
                seen = f"{kept.checked:8}"
            else:
                seen = "       -"
            out.append(f"  {seen} {state:14}  {requirement.value}")
            if kept.broken:
                out.append(f"  {'':24} at {kept.first_s:.2f} s: {kept.first}")
    return "\n".join(out)
