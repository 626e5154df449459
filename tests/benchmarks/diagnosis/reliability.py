"""Of the effects that are stated with probability p, how many are right?

``python tests/benchmarks diagnosis.reliability JUDGED.json... [--plot FILE.png]`` reads what ``measured_flights.py
--json`` and ``diagnose_suite.py --json`` wrote. Where answers state no probability, 1 - q_value is shown in its place
and said so: q_value controls the share of false discoveries, and is no probability of the single effect. Names of which
nothing is known are left out.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import command_line
from shares import share, wilson

PROBABILITY = "probability"
Q_VALUE = "1 - q_value"
EDGES = {
    PROBABILITY: (0.0, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0),
    Q_VALUE: (0.0, 0.95, 0.98, 0.99, 0.995, 0.998, 0.999, 1.0),
}


@dataclass(frozen=True)
class Stated:
    """One effect, how surely it was stated, and whether it is right."""

    kind: str
    effect: str
    basis: str
    sure: float
    status: str
    right: bool


@dataclass(frozen=True)
class Bin:
    """Statements between two probabilities."""

    low: float
    high: float
    mean: float
    right: int
    trials: int


def statements(row: Mapping[str, Any]) -> list[Stated]:
    """What one judged flight states: a row of either command."""
    judgement = row.get("judgement", row)
    out = []
    for s in judgement.get("statements", []):
        basis = Q_VALUE if s["probability"] is None else PROBABILITY
        sure = (
            s["probability"]
            if s["probability"] is not None
            else None
            if s["q_value"] is None
            else 1.0 - s["q_value"]
        )
        if s["right"] is not None and sure is not None:
            out.append(
                Stated(
                    row.get("kind", "simulated"), s["effect"], basis, sure, s["status"], s["right"]
                )
            )
    return out


def read(path: Path) -> list[Stated]:
    """All statements of a file of judgements."""
    raw = json.loads(path.read_text(encoding="utf-8"))
    rows = raw if isinstance(raw, list) else raw["flights"]
    return [s for row in rows if not row.get("again") for s in statements(row)]


def bins(said: Sequence[Stated], basis: str) -> list[Bin]:
    """Non-empty bins of one basis, in order; a bin holds its lower edge, the last one both."""
    out = []
    edges = EDGES[basis]
    for low, high in pairwise(edges):
        inside = [
            s
            for s in said
            if s.basis == basis and (low <= s.sure < high or s.sure == high == edges[-1])
        ]
        if inside:
            mean = sum(s.sure for s in inside) / len(inside)
            out.append(Bin(low, high, mean, sum(s.right for s in inside), len(inside)))
    return out


def table(said: Sequence[Stated]) -> str:
    """Stated against right, by kind of flight."""
    lines = ["reliability: of what was stated so surely, right"]
    for basis in (PROBABILITY, Q_VALUE):
        for kind in dict.fromkeys(s.kind for s in said):
            mine = [s for s in said if s.kind == kind and s.basis == basis]
            for b in bins(mine, basis):
                lines.append(
                    f"  {kind:10s} {basis:12s} {b.low:g} to {b.high:g} (mean {b.mean:.3f})  "
                    + share([True] * b.right + [False] * (b.trials - b.right))
                )
    for status in dict.fromkeys(s.status for s in said if s.status):
        lines.append(f"  status {status:10s} {share(s.right for s in said if s.status == status)}")
    return "\n".join(lines) if len(lines) > 1 else "reliability: nothing was stated"


def plot(path: Path, groups: Mapping[str, Sequence[Stated]]) -> None:
    """Draw the share right over what was stated, with 95 % intervals; one panel a basis."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    shown = [
        b
        for b in (PROBABILITY, Q_VALUE)
        if any(s.basis == b for said in groups.values() for s in said)
    ]
    figure, panels = plt.subplots(
        1, max(len(shown), 1), figsize=(5.2 * max(len(shown), 1), 4.6), squeeze=False
    )
    for panel, basis in zip(panels[0], shown, strict=False):
        for k, (kind, said) in enumerate(groups.items()):
            points = bins(said, basis)
            if not points:
                continue
            share_right = [b.right / b.trials for b in points]
            # Rounding must not make the length of an error bar negative.
            ends = [
                (max(y - low, 0.0), max(high - y, 0.0))
                for y, (low, high) in zip(share_right, intervals(points), strict=True)
            ]
            label = f"{kind} (n = {sum(b.trials for b in points)})"
            beside = 0.003 * k * (1.0 - EDGES[basis][1] if basis == Q_VALUE else 1.0)
            panel.errorbar(
                [b.mean + beside for b in points],
                share_right,
                list(zip(*ends, strict=True)),
                fmt="o-",
                capsize=3,
                label=label,
            )
        if basis == PROBABILITY:
            panel.plot([0, 1], [0, 1], "k:", linewidth=1)
        panel.set_xlim(EDGES[basis][1] - 0.05 if basis == Q_VALUE else 0.0, 1.01)
        panel.set_ylim(0, 1.03)
        panel.set_xlabel(f"stated {basis}")
        panel.set_ylabel("share right")
        panel.legend(loc="lower left", frameon=False)
    figure.tight_layout()
    figure.savefig(path, dpi=130)
    plt.close(figure)


def intervals(points: Sequence[Bin]) -> list[tuple[float, float]]:
    """95 % interval of each bin's share (Wilson)."""
    return [wilson(b.right, b.trials) for b in points]


def main(argv: Sequence[str] | None = None) -> int:
    p = command_line.parser(__doc__)
    p.add_argument("judged", nargs="+", type=Path, metavar="JUDGED.json")
    p.add_argument("--plot", type=Path, metavar="FILE.png")
    args = p.parse_args(argv)
    said = [s for path in args.judged for s in read(path)]
    print(table(said))
    if args.plot:
        plot(
            args.plot,
            {
                kind: [s for s in said if s.kind == kind]
                for kind in dict.fromkeys(s.kind for s in said)
            },
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
