"""Is the set of the flow simulation credible? Published statements about ducted fans, with our numbers beside.

python tests/benchmarks surrogates.cfd_statements [--cases CSV] [--fan FILE] [--json FILE]
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import command_line
import numpy as np

from models.cfd.case_run import Row
from models.cfd.cli import SHIPPED_CASES
from models.cfd.config import Setup, load
from models.cfd.statements import Checked, check
from models.cfd.table import read
from models.common.frames import AXES, Array


def summary(c: Checked, rows: Sequence[Row], setup: Setup) -> dict[str, Any]:
    """The figures a program reads."""
    air = setup.air.density_kg_m3
    radius = setup.fan.radius_m
    law = c.made.law
    tip_speed = setup.campaign.rpm * 2 * math.pi / 60 * radius
    return {
        "cases": len(rows),
        "models": dict(Counter(r.position.model for r in rows)),
        "positions": len(c.labels),
        "made": dict(Counter(m.made for m in c.made.marks)),
        "status": dict(Counter(r.result.status for r in rows)),
        "usable": sum(r.result.status in ("steady", "marched", "averaged") for r in rows),
        "cpu_hours": sum(r.result.seconds for r in rows) / 3600,
        "free_lift_N": c.free,
        "C_T": c.free / (air * math.pi * radius**2 * tip_speed**2),
        "mesh_error": _by_axis(c.mesh),
        "half_model_misses": _by_axis(_rms(c.made.correction.change)),
        "corrected_misses": _by_axis(_rms(c.made.correction.missed)),
        "rpm_law": {
            "free_lift_exponent": 2 + law.free,
            "increment_exponent": _by_axis(2 + law.exponent),
            "standard_error": _by_axis(law.error),
            "positions": law.positions,
        },
        "agreement": [asdict(s) for s in c.statements],
        "verdicts": dict(Counter(s.verdict for s in c.statements)),
    }


def _rms(values: Array) -> Array:
    """Root mean square (6,) over the rows of ``values`` (n, 6); not known (nan) without rows."""
    return np.sqrt(np.mean(values**2, axis=0)) if len(values) else np.full(6, np.nan)


def _by_axis(values: Array) -> dict[str, float]:
    return dict(zip(AXES, values.tolist(), strict=True))


def text(s: dict[str, Any]) -> str:
    """The summary in words."""
    law = s["rpm_law"]
    exponents = ", ".join(
        f"{a} {law['increment_exponent'][a]:.2f} +- {law['standard_error'][a]:.2f}"
        for a in ("Fx", "Fz", "My")
    )
    lines = [
        f"{s['cases']} cases ({_counts(s['models'])}), {s['positions']} positions at the campaign's speed, "
        f"{s['usable']} stand still or have a known mean, {s['cpu_hours']:.1f} hours in the solver",
        f"cases: {_counts(s['status'])}; rows: {_counts(s['made'])}",
        f"free lift {s['free_lift_N']:.2f} N, C_T {s['C_T']:.4f} (trimmed, no evidence)",
        f"{'N, N m':28}" + "".join(f"{a:>9}" for a in AXES),
        *(
            f"{key.replace('_', ' '):28}" + "".join(f"{s[key][a]:9.4f}" for a in AXES)
            for key in ("mesh_error", "half_model_misses", "corrected_misses")
        ),
        f"rotor speed, half models: free lift as rpm^{law['free_lift_exponent']:.3f}, increments of {exponents} "
        f"({law['positions']} positions)",
        f"published statements: {_counts(s['verdicts'])}",
        "",
        *(f"[{a['verdict']}] {a['claim']} ({a['source']}): {a['ours']}" for a in s["agreement"]),
    ]
    return "\n".join(lines)


def _counts(found: dict[str, int]) -> str:
    return ", ".join(f"{n} {name}" for name, n in found.items())


def main() -> int:
    """Print the statements and figures of a table of cases."""
    p = command_line.parser(__doc__)
    p.add_argument(
        "--cases", type=Path, default=SHIPPED_CASES, help="case table (default: the shipped one)"
    )
    p.add_argument("--fan", type=Path, help="fan file (default: the built-in fan)")
    p.add_argument("--json", type=Path, help="write the figures here")
    a = p.parse_args()
    setup = load(a.fan)
    rows = read(a.cases)
    found = summary(check(rows, setup), rows, setup)
    if a.json is not None:
        a.json.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    print(text(found))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
