"""A motor that fails in flight: is it named, with its time, and is no other motor ever named?

    python tests/benchmarks diagnosis.failing_fan OUT --seed N [--each M] [--kind KIND ...]

Makes flights (tests/simulators/failing) in OUT, unless they are there, reads each as ``replay diagnose`` does, and
prints by kind and signal how many answers are right, with Wilson's interval. The table of what is right is the
generator's own (cases.py, ``truth.json``). A failure is right where its motor alone is named within ``WITHIN_S`` of the
truth; unsure where two are named, and one is right; wrong where others are. Anything else is right where none is named.
The search is not run: what is said of a failing motor is said before it.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import command_line
import numpy as np
from shares import share_of

from companion.vehicles import chosen_vehicle
from models.common.errors import UserError
from replay.flightlog import LogFault, MotorLoss
from replay.logs.formats import load
from replay.residual.record import build_record
from tests.simulators.failing import cases
from tests.simulators.failing.make import make

WITHIN_S = 1.0
UNREAD = MotorLoss(motors=(0,), share=1.0, interval=(0.0, 1.0), probability=1.0)
"""Of a flight that is too short to be judged, whose line names a motor."""
ANSWERS = ("right", "unsure", "missed", "wrong")


def named(log: Path, vehicle: Path) -> Sequence[LogFault]:
    """Faults of one flight that name motors."""
    flown = next(iter(load(log, None, {})))
    try:
        faults = build_record(flown, chosen_vehicle(vehicle), None).faults
    except UserError as error:
        # A flight that is too short still says which motor failed.
        return [LogFault("", str(error), np.nan, UNREAD)] if "motor" in str(error) else []
    return [fault for fault in faults if fault.motors]


def judged(truth: Mapping[str, Any], faults: Sequence[LogFault]) -> str:
    """One of ``ANSWERS``."""
    if not truth["fails"]:
        return "wrong" if faults else "right"
    if not faults:
        return "missed"
    first = faults[0]
    (motor,) = truth["motors"]
    if motor not in first.motors:
        return "wrong"
    late = abs((first.since_s or np.inf) - truth["since_s"])
    if late > WITHIN_S:
        return "wrong"
    return "right" if first.motors == (motor,) else "unsure"


def main() -> int:
    """As the docstring says."""
    parser = command_line.parser(__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--each", type=int, default=6)
    parser.add_argument("--kind", nargs="*", default=[*cases.FAILURES, *cases.OTHERS])
    a = parser.parse_args()
    if not (a.folder / "truth.json").exists():
        make(a.folder, a.seed, a.each, tuple(a.kind))
    truth = json.loads((a.folder / "truth.json").read_text(encoding="utf-8"))
    counts: dict[tuple[str, str], Counter[str]] = {}
    for name, happened in truth.items():
        faults = named(a.folder / f"{name}.tlog", a.folder / f"{name}.toml")
        answer = judged(happened, faults)
        signal = "speeds" if name.endswith("speeds") else "outputs"
        counts.setdefault((happened["kind"], signal), Counter())[answer] += 1
        if answer != "right":
            said = "; ".join(fault.what for fault in faults) or "nothing"
            print(
                f"{answer}: {name} ({happened['frame']}, motors {happened['motors']}): {said}",
                file=sys.stderr,
            )
    print(f"{'kind':12s} {'signal':8s} " + " ".join(f"{answer:>7s}" for answer in ANSWERS))
    for (kind, signal), each in sorted(counts.items()):
        print(f"{kind:12s} {signal:8s} " + " ".join(f"{each[answer]:7d}" for answer in ANSWERS))
    for what, kinds in (("a motor fails", cases.FAILURES), ("none fails", cases.OTHERS)):
        for signal in ("outputs", "speeds"):
            total = sum(
                (each for (k, s), each in counts.items() if k in kinds and s == signal), Counter()
            )
            count = sum(total.values())
            if count:
                right = share_of(total["right"], count)
                print(f"{what}, {signal}: right {right}, wrong {total['wrong']}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
