"""Vertical acceleration of a Crazyflie: what command, battery voltage and lag of the motors say of it.

``python tests/benchmarks tables.nanobench CLONE``: CLONE is a clone of github.com/syediu/nanobench-iros2026, by Ullah
and Baca (arXiv:2603.09908). It keeps errors of four models of the authors for one pair of flights, but neither their
code nor the split; they stand beside ours and are not reproduced. Many trefoil flights are there twice, under two
names, so a split by names would train on what it tests. Here each content counts once. Files in which a command leaves
0 to 1 in the air are left out: they go on beyond their log, with specific forces of up to 173 m/s^2. Flights that are
no trefoil teach, trefoils test. Specific force along the body's z, in the air.

Laws: a constant; least squares in the four commands; ``[throttle]`` of a vehicle file; with ``battery_sag``; with
``fan_imbalance``; with ``motor_lag``, its time from the teaching flights, too.
"""

from __future__ import annotations

import io
import sys
from dataclasses import dataclass
from pathlib import Path

import command_line
import numpy as np
from result_file import add_option, figure, write_result
from scipy.signal import lfilter
from sources.clone import git, read

from models.common.frames import GRAVITY, Array
from tables.crazyflie_stand import rms
from tables.stand import curved, linear, thrust

COMMIT = "0ae7d68"
FOLDER = "datasets/dataset/"
TESTED = "trefoil"
SPARE = ("A1b", "B11", "B12", "C4")
"""Beginnings of names of files too large for every copy of the repository."""
COLUMNS = ("pz", "imu_acc_z", *(f"motor_motor_m{k}" for k in (1, 2, 3, 4)), "pwr_pm_vbat")
KNOWN_FLIGHTS = (80, 29)
"""Contents, and of them trefoils."""
FLYING_M = 0.3
FULL_COMMAND = 65_535.0
FULL_V = 3.7
STEP_S = 0.01
LAGS_S = (0.0, 0.01, 0.02, 0.03, 0.04, 0.06, 0.08, 0.12)
START = (20.0, 0.5, 1.5)
EACH_START = (20.0, 20.0, 20.0, 20.0, 0.5, 1.5)
SAGGED = "with `battery_sag`"
IMBALANCED = "with `fan_imbalance`"
GOAL = 5
"""Columns of rows: four commands from 0 to 1, voltage, and what is told [m/s^2]."""
PUBLISHED = {
    "constant gain": 36.735,
    "time-indexed": 21.981,
    "linear regression": 2.171,
    "voltage-conditioned": 254.547,
}


@dataclass(frozen=True)
class Flight:
    """Rows (n, 6) of a flight, all of it, and which of them (n,) are in the air."""

    rows: Array
    flying: Array

    @property
    def real(self) -> bool:
        """Whether it flies, and its commands in the air are shares: some files go on where the log has ended."""
        commands = self.rows[self.flying, :4]
        return bool(commands.size and commands.min() >= 0.0 and commands.max() <= 1.0)

    def lagged(self, tau_s: float) -> Array:
        """Rows in the air, with the commands through motors of this time constant."""
        keep = np.exp(-STEP_S / tau_s) if tau_s > 0.0 else 0.0
        out = self.rows.copy()
        out[:, :4] = lfilter([1.0 - keep], [1.0, -keep], self.rows[:, :4], axis=0)
        return np.asarray(out[self.flying])


def contents(clone: Path) -> list[str]:
    """Paths of flights, the first of each content."""
    seen: dict[str, str] = {}
    for line in git(clone, "ls-tree", COMMIT, FOLDER).decode().splitlines():
        facts, path = line.split("\t")
        if path.endswith(".csv") and not path.removeprefix(FOLDER).startswith(SPARE):
            seen.setdefault(facts.split()[2], path)
    return list(seen.values())


def flight(clone: Path, path: str) -> Flight:
    """A flight of the clone."""
    text = read(clone, COMMIT, path).decode()
    names = text.splitlines()[0].split(",")
    columns = [names.index(name) for name in COLUMNS]
    table = np.loadtxt(io.StringIO(text), delimiter=",", skiprows=1, usecols=columns, ndmin=2)
    known = np.isfinite(table).all(axis=1)
    table = table[known]
    rows = np.column_stack([table[:, 2:6] / FULL_COMMAND, table[:, 6], GRAVITY * table[:, 1]])
    return Flight(rows, table[:, 0] > FLYING_M)


def split(clone: Path) -> tuple[list[Flight], list[Flight]]:
    """Flights that teach and that test. Raises SystemExit where other files are there than known."""
    paths = contents(clone)
    trefoils = [path for path in paths if TESTED in path]
    if (len(paths), len(trefoils)) != KNOWN_FLIGHTS:
        raise SystemExit(f"refused: {len(paths)} flights are there, known {KNOWN_FLIGHTS[0]}")
    teach: list[Flight] = []
    test: list[Flight] = []
    for path in paths:
        one = flight(clone, path)
        if one.real:
            (test if path in trefoils else teach).append(one)
    return teach, test


def constant(rows: Array) -> Array:
    """One term (n, 1)."""
    return np.ones((len(rows), 1))


def commands(rows: Array) -> Array:
    """Terms (n, 5) of a linear regression."""
    return np.column_stack([np.ones(len(rows)), rows[:, :4]])


def throttle(rows: Array, most: float, expo: float) -> Array:
    """Mean of what the four motors give (n,) [m/s^2]."""
    return law(rows, most, expo, 0.0)


def law(rows: Array, most: float, expo: float, power: float) -> Array:
    """The same (n,), by battery voltage, too."""
    volts = rows[:, 4:GOAL]
    return thrust(rows[:, :4], volts, most, expo, power, FULL_V).mean(axis=1)


def each(rows: Array, *numbers: float) -> Array:
    """The same (n,) with a share of its own for every motor: four of them, and the numbers of ``law`` but the first."""
    *shares, expo, power = numbers
    volts = rows[:, 4:GOAL]
    given = thrust(rows[:, :4], volts, 1.0, expo, power, FULL_V)
    return np.asarray(given @ np.array(shares) / 4.0)


TELLERS = {
    "a constant": linear(constant, GOAL),
    "linear in the commands": linear(commands, GOAL),
    "`[throttle]`": curved(throttle, START[:2], GOAL),
    SAGGED: curved(law, START, GOAL),
    IMBALANCED: curved(each, EACH_START, GOAL),
}


def lag(teach: list[Flight]) -> float:
    """The time constant that tells the teaching flights best."""
    sums = {}
    for tau_s in LAGS_S:
        rows = np.concatenate([one.lagged(tau_s) for one in teach])
        sums[tau_s] = rms(rows[:, GOAL] - TELLERS[SAGGED](rows, rows))
    return min(sums, key=lambda tau_s: sums[tau_s])


def errors(teach: list[Flight], test: list[Flight], name: str, tau_s: float) -> list[Array]:
    """Errors (n,) of a law on each test flight."""
    seen = np.concatenate([one.lagged(tau_s) for one in teach])
    others = [one.lagged(tau_s) for one in test]
    told = TELLERS[name](seen, np.concatenate(others))
    ends = np.cumsum([len(other) for other in others])[:-1]
    wanted = np.concatenate([other[:, GOAL] for other in others])
    return np.split(told - wanted, ends)


def interval(each: list[Array]) -> tuple[float, float]:
    """95 % interval of the RMS over flights drawn anew."""
    squares = np.array([(one**2).sum() for one in each])
    counts = np.array([len(one) for one in each])
    drawn = np.random.default_rng(0).integers(0, len(each), (2000, len(each)))
    means = squares[drawn].sum(axis=1) / counts[drawn].sum(axis=1)
    low, high = np.sqrt(np.quantile(means, [0.025, 0.975]))
    return float(low), float(high)


def main() -> int:
    parser = command_line.of_clone(__doc__)
    add_option(parser)
    a = parser.parse_args()
    teach, test = split(a.clone)
    print(f"{len(teach)} flights teach, {len(test)} test")
    print("| law | RMS on the test flights [m/s^2] |\n|---|---|")
    for name, published in PUBLISHED.items():
        print(f"| {name}, of the authors, on other flights | {published:.2f} |")
    tau_s = lag(teach)
    asked = [(name, name, 0.0) for name in TELLERS]
    asked.append((f"with `motor_lag` of {tau_s:g} s", IMBALANCED, tau_s))
    sizes = []
    for said, name, late in asked:
        each = errors(teach, test, name, late)
        low, high = interval(each)
        sizes.append(f"{rms(np.concatenate(each)):.3f} [{low:.3f}, {high:.3f}]")
        print(f"| {said} | {sizes[-1]} |")
    if a.result:
        detail = f"a constant {sizes[0]}, linear {sizes[1]}, without lag {sizes[-2]}"
        figures = [figure("vertical acceleration by command", f"{sizes[-1]} m/s^2", detail)]
        write_result(a, figures, seeds=f"{len(teach)} and {len(test)} flights", simulated=False)
    return 0


if __name__ == "__main__":
    sys.exit(main())
