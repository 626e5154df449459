"""How often 1.96 sigma of the flying ensemble holds the truth where it has not learnt, and how wide it is.

    python tests/benchmarks surrogates.surrogate_coverage [--data CSV] [--every N] [--seed N] [--json FILE]

The (h, d) plane is cut into sixteenths; each (or every N-th) is left out whole, a model is trained and calibrated on
the rest, and judged on that block and on the scattered places that its training held out. Neither was calibrated on.
Without --data: a simulated campaign of about a hundred noisy places (closed form plus noise).
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import command_line
import numpy as np
from noisy_campaign import noisy_campaign

from models import dataset
from models.common.frames import AXES, Array
from models.dataset import DataSet
from models.surrogate import free_air
from models.training import train
from models.training.problem import frame

CUTS = 4


def sixteenths(data: DataSet) -> list[Array]:
    """Masks of the blocks, free air in none of them."""
    index = []
    for distance in (data.h, data.d):
        rank = np.unique(distance, return_inverse=True)[1]
        index.append(np.minimum(CUTS * rank // (rank.max() + 1), CUTS - 1))
    cell = CUTS * index[0] + index[1]
    blocks = [(cell == k) & ~data.free_air for k in range(CUTS * CUTS)]
    return [block for block in blocks if block.any()]


def campaign() -> DataSet:
    """The tests' simulated campaign."""
    return noisy_campaign()


def main() -> None:
    """Train once a block and print one table."""
    parser = command_line.parser(__doc__)
    parser.add_argument("--data")
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json")
    args = parser.parse_args()
    data = free_air.level(dataset.read(args.data) if args.data else campaign())
    live = frame(data).live
    inside: dict[str, list[Array]] = {"scattered places": [], "whole blocks": []}
    ratio: dict[str, list[Array]] = {name: [] for name in inside}
    trusts: list[Array] = []
    for k, block in enumerate(sixteenths(data)[:: args.every]):
        rest = data.take(~block)
        model = train.train(rest, "ensemble", args.seed + k).model
        scattered = dataset.held_out(free_air.level(rest), np.random.default_rng(args.seed + k))
        for name, rows in (
            ("scattered places", rest.take(scattered)),
            ("whole blocks", data.take(block)),
        ):
            answer = model.query(rows.h, rows.d, rows.rpm)
            error = np.abs(answer.wrench - rows.wrench)
            inside[name].append(error <= 1.96 * answer.sigma + 1e-12)
            ratio[name].append(answer.sigma / model.free_air_law.lift(rows.rpm)[:, None])
            if name == "whole blocks":
                trusts.append(answer.trust)
        print(f"{k + 1} blocks", file=sys.stderr, flush=True)
    result = {}
    for name in inside:
        covered = np.concatenate(inside[name])
        sigma = np.concatenate(ratio[name])
        result[name] = {
            axis: {
                "covered": float(covered[:, c].mean()),
                "median_sigma_over_lift": float(np.median(sigma[:, c])),
            }
            for c, axis in enumerate(AXES)
            if live[c]
        }
        columns = "  ".join(
            f"{a} {r['covered']:.1%} ({r['median_sigma_over_lift']:.2e})"
            for a, r in result[name].items()
        )
        print(
            f"{name}: {len(covered)} rows; covered by 1.96 sigma (median sigma over lift): {columns}"
        )
    trusted = np.concatenate(trusts) > 0.5
    where = np.concatenate(inside["whole blocks"])[trusted][:, live].mean(axis=0)
    print(
        f"whole blocks where trust > 0.5 ({trusted.mean():.0%}): "
        + "  ".join(f"{v:.1%}" for v in where)
    )
    if args.json:
        Path(args.json).write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
