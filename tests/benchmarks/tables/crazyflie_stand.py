"""Thrust of a Crazyflie 2.1+ on a scale, over command and voltage: our law beside the authors' polynomial.

``python tests/benchmarks tables.crazyflie_stand CLONE``: CLONE is a clone of
github.com/IMRCLab/crazyflie-data-collection, with one run for each of three batteries. The authors fit a polynomial of
degree 3 in voltage times command, which the firmware uses, and thrust as a square of the rotor speed
(``system-id/estimate_kw_from_thruststand.py``). Each battery is told by the two others. The law is ``[throttle]`` of a
vehicle file with ``battery_sag``.
"""

from __future__ import annotations

import sys

import command_line
import numpy as np
from result_file import add_option, figure, write_result

from models.common.frames import Array
from tables.stand import curved, left_out, linear, rows_of, surface, thrust

COMMIT = "4d777a5"
FOLDER = "system-id/data/cf21plus"
RUNS = {
    "250 mAh": "data_feb_24_2026_250mah_battery0.csv",
    "350 mAh, first": "data_feb_24_2026_350mah_battery0.csv",
    "350 mAh, second": "data_feb_24_2026_350mah_battery1.csv",
}
COLUMNS = ("pwm", "vbat[V]", "rpm1", "rpm2", "rpm3", "rpm4", "thrust[g]")
THRUST = 6
"""The column that is told."""
FULL_COMMAND = 65_535.0
FULL_V = 3.7
START = (70.0, 0.5, 1.5)
KNOWN_ROWS = 353
"""Of all three files."""


def cubic(rows: Array) -> Array:
    """Terms (n, 4) of the authors' polynomial in voltage times command."""
    volts = rows[:, 1] * rows[:, 0] / FULL_COMMAND
    return np.stack([volts**power for power in range(4)], axis=1)


def squares(rows: Array) -> Array:
    """Sum of squared rotor speeds (n, 1) [1e6 rpm^2]."""
    speeds = rows[:, 2:THRUST] / 1e3
    return np.asarray((speeds**2).sum(axis=1, keepdims=True))


def plain(rows: Array) -> Array:
    """Terms (n, 6) of a polynomial in command and voltage."""
    return surface(rows[:, 0] / FULL_COMMAND, rows[:, 1])


def law(rows: Array, most: float, expo: float, power: float) -> Array:
    """Thrust (n,) [g] of command and voltage."""
    return thrust(rows[:, 0] / FULL_COMMAND, rows[:, 1], most, expo, power, FULL_V)


TELLERS = {
    "cubic in voltage times command (authors)": linear(cubic, THRUST),
    "polynomial of degree 2": linear(plain, THRUST),
    "throttle and battery_sag": curved(law, START, THRUST),
    "rotor speeds squared": linear(squares, THRUST),
}


def rms(errors: Array) -> float:
    """Root of the mean square (n,)."""
    return float(np.sqrt((errors**2).mean()))


def main() -> int:
    parser = command_line.of_clone(__doc__)
    add_option(parser)
    a = parser.parse_args()
    paths = {name: f"{FOLDER}/{file}" for name, file in RUNS.items()}
    runs = {name: rows_of(a.clone, COMMIT, path, COLUMNS) for name, path in paths.items()}
    count = sum(map(len, runs.values()))
    if count != KNOWN_ROWS:
        raise SystemExit(f"refused: {count} rows are there, known {KNOWN_ROWS}")
    print(f"| law, RMS in grams | {' | '.join(runs)} | together |\n|{'---|' * (len(runs) + 2)}")
    together = {}
    for name, teller in TELLERS.items():
        errors = left_out(runs, teller, THRUST)
        together[name] = rms(np.concatenate(list(errors.values())))
        cells = " | ".join(f"{rms(errors[run]):.2f}" for run in runs)
        print(f"| {name} | {cells} | {together[name]:.2f} |")
    if a.result:
        authors, polynomial, ours, speeds = together.values()
        detail = f"authors {authors:.2f} g, polynomial {polynomial:.2f} g"
        figures = [
            figure("Crazyflie stand: thrust by command and voltage", f"{ours:.2f} g", detail),
            figure("Crazyflie stand: thrust by rotor speeds", f"{speeds:.2f} g"),
        ]
        write_result(a, figures, seeds=f"three batteries, {count} rows", repeatable=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
