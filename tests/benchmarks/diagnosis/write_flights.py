"""``python tests/benchmarks diagnosis.write_flights --out DIR``: write a round of simulated flights.

It resumes where it stopped. ``docs/lab/diagnose-suite.md`` says what flies.
"""

import sys
from pathlib import Path

import command_line
from flights.make import make_round


def main() -> int:
    parser = command_line.parser(__doc__)
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        help="folder for tlogs, vehicle files, table.csv, truth.json",
    )
    parser.add_argument("--round", type=int, default=1, help="which set of seeds")
    parser.add_argument("--only", nargs="*", default=[], metavar="NAME", help="only these flights")
    args = parser.parse_args()
    make_round(args.out, args.round, args.only, progress=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
