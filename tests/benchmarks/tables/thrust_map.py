"""Command of a motor for a thrust at a voltage, on a thrust stand: our law beside the authors' polynomial.

``python tests/benchmarks tables.thrust_map CLONE``: CLONE is a clone of github.com/aerostack2/thrust_map_estimation,
with three runs of one motor and two of four motors together (Anguita et al., *A Comparative Study on Thrust Map
Estimation for Multirotor Aerial Vehicles*). Their polynomial of degree 2 in thrust and voltage, their filter of rows
and their metric, the mean error of the command, are taken over; each run is told by the others of its stand. The law
is ``[throttle]`` of a vehicle file with ``battery_sag``, solved for the command: three numbers beside six.
"""

from __future__ import annotations

import sys

import command_line
import numpy as np
from result_file import add_option, figure, write_result

from models.common.frames import Array
from models.vehicle.estimate import thrust_to_output
from tables.stand import curved, left_out, linear, rows_of, sagged, surface

COMMIT = "cd178f6"
FOLDER = "thrust_stand/data"
STANDS = {
    "one motor": (
        "single_rotor/xNova-SR-ramp",
        "single_rotor/xNova-SR-steps",
        "single_rotor/xNova-SR-steps-up",
    ),
    "four motors": ("multirotor/xNova-MR-ramp", "multirotor/xNova-MR-steps"),
}
COLUMNS = ("ESC signal (µs)", "Thrust (N)", "Voltage (V)")
COMMAND = 0
"""The column that is told."""
COMMANDS_US = (1300.0, 1500.0)
THRUSTS_N = (0.0, 11.0)
VOLTS = (20.4, 25.2)
"""The rows that the authors keep, by the configuration beside their scripts."""
LEAST_US = 1000.0
SPAN_US = 1000.0
FULL_V = 22.2
"""Six cells at 3.7 V."""
START = (12.0, 0.5, 1.5)
KNOWN_ROWS = 562
"""Rows of all five runs that their filter keeps."""


def kept(rows: Array) -> Array:
    """Rows within the authors' limits, thrust upward."""
    rows = rows * (1.0, -1.0, 1.0)
    inside = np.ones(len(rows), dtype=bool)
    for values, (low, high) in zip(rows.T, (COMMANDS_US, THRUSTS_N, VOLTS), strict=True):
        inside &= (values > low) & (values < high)
    return np.asarray(rows[inside])


def polynomial(rows: Array) -> Array:
    """Terms (n, 6) of the authors' surface."""
    return surface(rows[:, 1], rows[:, 2])


def command(rows: Array, most: float, expo: float, power: float) -> Array:
    """The command (n,) [us] at which the law gives the measured thrust."""
    share = rows[:, 1] / (most * sagged(rows[:, 2], power, FULL_V))
    return np.asarray(LEAST_US + SPAN_US * thrust_to_output(np.maximum(share, 0.0), expo))


def main() -> int:
    parser = command_line.of_clone(__doc__)
    add_option(parser)
    a = parser.parse_args()
    stands = {}
    for name, files in STANDS.items():
        paths = {file: f"{FOLDER}/{file}.csv" for file in files}
        runs = {key: rows_of(a.clone, COMMIT, path, COLUMNS) for key, path in paths.items()}
        stands[name] = {key: kept(rows) for key, rows in runs.items()}
    count = sum(len(rows) for runs in stands.values() for rows in runs.values())
    if count != KNOWN_ROWS:
        raise SystemExit(f"refused: {count} rows pass the authors' filter, known {KNOWN_ROWS}")
    print("| stand | run | polynomial [us] | throttle and battery_sag [us] |\n|---|---|---|---|")
    theirs = []
    ours = []
    for name, runs in stands.items():
        by_surface = left_out(runs, linear(polynomial, COMMAND), COMMAND)
        by_law = left_out(runs, curved(command, START, COMMAND), COMMAND)
        for key in runs:
            theirs.append(np.abs(by_surface[key]))
            ours.append(np.abs(by_law[key]))
            run = key.rpartition("/")[2]
            print(f"| {name} | {run} | {theirs[-1].mean():.1f} | {ours[-1].mean():.1f} |")
    together = [float(np.concatenate(errors).mean()) for errors in (theirs, ours)]
    print(f"| together | | {together[0]:.1f} | {together[1]:.1f} |")
    ahead = sum(float(x.mean()) < float(y.mean()) for x, y in zip(ours, theirs, strict=True))
    if a.result:
        figures = [
            figure(
                "thrust map: mean error of the command",
                f"{together[1]:.1f} us",
                f"polynomial of the authors {together[0]:.1f} us",
            ),
            figure("thrust map: runs told better than by the polynomial", f"{ahead}", "of 5"),
        ]
        write_result(a, figures, seeds=f"five runs, {count} rows", repeatable=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
