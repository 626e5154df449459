"""``python tests/benchmarks/flights --out DIR``: write a round of simulated flights (resumes where it stopped)."""

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from flights.make import make_round


def main() -> int:
    parser = argparse.ArgumentParser(prog="flights", description=__doc__)
    parser.add_argument(
        "--out", type=Path, required=True, help="folder for tlogs, vehicle files, table.csv, truth.json"
    )
    parser.add_argument("--round", type=int, default=1, help="which set of seeds")
    parser.add_argument("--only", nargs="*", default=[], metavar="NAME", help="only these flights")
    args = parser.parse_args()
    make_round(args.out, args.round, args.only, progress=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
