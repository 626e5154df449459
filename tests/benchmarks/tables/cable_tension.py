"""Force of a cable on a quadrotor, beside a load cell: the thrust it commands, and the thrust it has.

``python tests/benchmarks tables.cable_tension CLONE``: CLONE is a clone of github.com/RCL-NUS/NeuroMHE (Wang, Ma, Lai
& Zhao 2023, IEEE Transactions on Robotics, arXiv:2206.10397). A quadrotor of 1.0 kg draws on an elastic cable to a load
cell on the ground. Three flights, each with the force that one of the authors' estimators told in flight. They score it
by a truth of their own, m a + f: mass times measured acceleration, and the thrust f that was commanded. These figures
are reproduced first, or nothing is told.

The load cell knows neither m nor f. Its tension, along the straight line to the cell, is the truth here. Ours is the
authors' formula with one named number, ``thrust_scale``: m a + (1 + s) f. It is fitted to the two other flights, and
never to the load cell: a cable does not push sideways, so the force across it is to be zero.
"""

from __future__ import annotations

import csv
import io
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import command_line
import numpy as np
from result_file import add_option, figure, write_result
from scipy.signal import firwin, kaiserord, lfilter
from scipy.spatial.transform import Rotation
from sources.clone import read

from models.common.frames import Array
from tables.neurobem import rms

COMMIT = "64e184c"
FOLDER = "SecVII-C (source code)/Evaluation in real-world experiment/Experiment Raw Data"
CELL = "22_Feb_2023_Tension_data/22-Feb-2023-Exp1-controller_{}.csv"
MASS_KG = 1.0
CELL_HEIGHT_M = 0.17
RATE_HZ = 50.0
FLYING_M = 0.3
"""Height from which on a flight is scored: the vehicle stands on its legs at 0.1 m."""
ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
BLOCK = 100
"""Samples that are drawn together for an interval: two seconds, in which errors look alike."""
DRAWS = 2000
ALLOWED = 0.02


@dataclass(frozen=True)
class Log:
    """Files of a flight; from which row on the authors judge it, and the row of the cell at that time."""

    name: str
    path: str
    cell: str
    first: int
    of_cell: int
    known: float
    """RMS of the difference of the forces' sizes, theirs and that of their truth, as published [N]."""


LOGS = (
    Log("NeuroMHE", "NeuroMHE/log_10_2023-2-22-11-32-38", "a", 121, 1696, 0.5742),
    Log("DMHE", "DMHE/log_11_2023-2-22-11-44-46", "b", 135, 860, 2.3194),
    Log("L1-AC", "L1-AC/log_17_2023-2-22-18-14-06", "c_correct", 143, 3500, 0.6997),
)
LENGTH_OF = LOGS[1]
"""The authors cut all flights where the log of this one ends."""


@dataclass(frozen=True)
class Flight:
    """Samples of a flight (n, 3), east-north-up [N]: forces, and the direction from the vehicle to the cell."""

    inertial: Array
    """Mass times specific force, through the authors' low-pass."""
    thrust: Array
    """As commanded, through the same."""
    told: Array
    """By the authors' estimator, in flight."""
    to_cell: Array
    tension: Array
    """(n,), by the load cell."""
    flying: Array
    """(n,): off the ground."""

    def outside(self, scale: float) -> Array:
        """The force from outside (n, 3), with a thrust that is (1 + scale) of the commanded one."""
        return self.inertial - (1.0 + scale) * self.thrust

    @property
    def cable(self) -> Array:
        """What the cell says (n, 3)."""
        return self.tension[:, None] * self.to_cell

    def across(self, force: Array) -> Array:
        """The part of a force (n, 3) that no cable can make."""
        along = (force * self.to_cell).sum(axis=1, keepdims=True)
        return np.asarray(force - along * self.to_cell)


def low_pass(signal: Array) -> Array:
    """The authors' filter: below 2 Hz, causal, 30 dB down within 5 Hz."""
    nyquist = RATE_HZ / 2.0
    taps, beta = kaiserord(30.0, 5.0 / nyquist)
    weights = firwin(taps, 2.0 / nyquist, window=("kaiser", beta))
    return np.asarray(lfilter(weights, 1.0, signal, axis=0))


def flight(clone: Path, log: Log) -> Flight:
    """A flight of the clone, row by row as the authors take it."""
    rows = slice(
        log.first, len(_columns(clone, LENGTH_OF, "position_setpoint_triplet", ["timestamp"]))
    )
    # The authors put the commanded thrust and what their estimator tells into spare fields of the setpoint.
    names = ["current.vx", "current.a_x", "current.a_y", "current.a_z"]
    command = _columns(clone, log, "position_setpoint_triplet", names)[rows]
    felt = _columns(clone, log, "sensor_combined", [f"accelerometer_m_s2[{i}]" for i in range(3)])
    quaternion = _columns(clone, log, "vehicle_attitude", [f"q[{i}]" for i in (1, 2, 3, 0)])
    place = _columns(clone, log, "vehicle_local_position", ["x", "y", "z"])[rows] @ ENU.T
    attitude = Rotation.from_quat(quaternion[rows]).as_matrix()
    up = -attitude[:, :, 2] @ ENU.T
    specific = np.einsum("nij,nj->ni", attitude, felt[rows]) @ ENU.T
    line = np.array([0.0, 0.0, CELL_HEIGHT_M]) - place
    text = read(clone, COMMIT, f"{FOLDER}/{CELL.format(log.cell)}").decode()
    tension = np.array([float(row[2]) for row in csv.reader(io.StringIO(text))])
    return Flight(
        inertial=low_pass(MASS_KG * specific),
        thrust=low_pass(command[:, :1] * up),
        told=command[:, 1:] @ ENU.T,
        to_cell=line / np.linalg.norm(line, axis=1, keepdims=True),
        tension=tension[log.of_cell : log.of_cell + len(line)],
        flying=place[:, 2] > FLYING_M,
    )


def _columns(clone: Path, log: Log, topic: str, names: Sequence[str]) -> Array:
    """Columns (n, names) of a topic."""
    text = read(clone, COMMIT, f"{FOLDER}/{log.path}_{topic}_0.csv").decode()
    rows = []
    for row in csv.DictReader(io.StringIO(text)):
        rows.append([float(row[name]) for name in names])
    return np.array(rows)


def check(flights: Sequence[Flight]) -> None:
    """Raises SystemExit where the published figures do not come out."""
    for log, one in zip(LOGS, flights, strict=True):
        sizes = [np.linalg.norm(force, axis=1) for force in (one.outside(0.0), one.told)]
        found = rms((sizes[0] - sizes[1])[:, None])
        if abs(found - log.known) > ALLOWED * log.known:
            raise SystemExit(f"refused: {log.name}: {found:.4f} N, published {log.known} N")


def thrust_scale(flights: Sequence[Flight]) -> float:
    """The scale s that leaves the least force across the cable: least squares over flights."""
    over = total = 0.0
    for one in flights:
        thrust = one.across(one.thrust)[one.flying]
        missing = one.across(one.outside(0.0))[one.flying]
        over += (thrust * missing).sum()
        total += (thrust**2).sum()
    return over / total


def interval(errors: Array) -> tuple[float, float]:
    """95 % interval of the RMS of error vectors (n, 3), by drawing blocks of them anew."""
    squares = (errors**2).sum(axis=1)
    count = len(squares) // BLOCK
    blocks = squares[: count * BLOCK].reshape(count, BLOCK).mean(axis=1)
    drawn = np.random.default_rng(0).choice(blocks, (DRAWS, count)).mean(axis=1)
    low, high = np.sqrt(np.quantile(drawn, [0.025, 0.975]))
    return float(low), float(high)


def errors(one: Flight, scale: float) -> list[Array]:
    """Errors (m, 3) in the air: no force, the authors' estimator, their truth, ours."""
    forces = (np.zeros_like(one.told), one.told, one.outside(0.0), one.outside(scale))
    return [(force - one.cable)[one.flying] for force in forces]


def main() -> int:
    parser = command_line.of_clone(__doc__)
    add_option(parser)
    a = parser.parse_args()
    flights = [flight(a.clone, log) for log in LOGS]
    check(flights)
    print("| flight, estimator | no force [N] | estimator | m a + f | m a + (1 + s) f | s |")
    print("|---|---|---|---|---|---|")
    every = []
    for log, one in zip(LOGS, flights, strict=True):
        scale = thrust_scale([other for other in flights if other is not one])
        missed = errors(one, scale)
        every.append(missed)
        print(f"| {log.name} | {' | '.join(map(_said, missed))} | {scale:.3f} |")
    together = [np.concatenate(kind) for kind in zip(*every, strict=True)]
    print(f"| together | {' | '.join(map(_said, together))} | |")
    if a.result:
        nothing, told, truth, _ = map(rms, together)
        detail = f"no force {nothing:.2f} N, estimators {told:.2f} N, their truth {truth:.2f} N"
        value = f"{_said(together[3])} N"
        figures = [figure("force of a cable beside a load cell", value, detail)]
        write_result(a, figures, seeds="three flights", simulated=False)
    return 0


def _said(missed: Array) -> str:
    low, high = interval(missed)
    return f"{rms(missed):.2f} [{low:.2f}, {high:.2f}]"


if __name__ == "__main__":
    sys.exit(main())
