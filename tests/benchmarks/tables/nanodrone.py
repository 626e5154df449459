"""The nano-drone benchmark of IDSIA: our model beside the authors' learners, on their test flights, by their metric.

``python tests/benchmarks tables.nanodrone CLONE``: CLONE is a clone of
github.com/idsia-robotics/nanodrone-sysid-benchmark (Busetto et al. 2026, arXiv:2512.14450). Needs pyarrow. Their rows
*Naive* and *Physics* are computed first; where they differ by more than 2 % from what was published, nothing is told.
The model is a vehicle with effects of the catalogue, rolled out by ``replay.rollout``. Forces are fitted first, with
the measured attitude, then moments, both on training flights alone; the test flights are used once, for the score.
``--validate`` scores run 4 of the training flights and the unpublished trajectory random1, and not the test flights.
``--model DIR --vehicle FILE`` scores what ``replay diagnose --save-model`` wrote of the training flights in place of
the fit, beside the vehicle file alone.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import command_line
import numpy as np
from result_file import add_option, figure, write_result

from models.common.frames import Array, rotation_from_quaternion
from models.effects import AdoptedEffect, get
from models.surrogate.fan_surrogate import FanSurrogate
from models.surrogate.store import load
from models.vehicle import RHO_SEA_LEVEL, Vehicle, load_vehicle
from models.vehicle.vehicle import Fan, Rotor
from models.vehicle_wrench import RPM_TO_RAD_S
from replay import FlightModel, rollout
from replay.predict.rollout import POSITION, QUATERNION, RATES, VELOCITY, turned_by
from tables.multistep import Parameter, fit
from tables.nanodrone_data import STEP_S, TRAINING, Run, raw_runs, test_runs
from tables.nanodrone_score import (
    QUANTITIES,
    STEPS,
    Predictor,
    Score,
    error,
    inputs_of,
    naive,
    score,
    starts,
)

MASS_KG = 0.045
ARM_M = 0.0353
RADIUS_M = 0.0225
THRUST_N_S2 = 3.72e-8
TORQUE_NM_S2 = 7.74e-12
INERTIA_KGM2 = (2.3951e-5, 2.3951e-5, 3.2347e-6)
PLACES = ((1, 1), (-1, 1), (-1, -1), (1, -1))
"""Forward and right, of motors 1 to 4."""
SPINS = (-1, 1, -1, 1)
ROUND = (1e3, 1e3, 1e3)
"""An inertia [kg m^2] that no moment of a nano-drone turns: the rates stay as they are, as in the authors' Physics."""
HORIZONS = (1, 2, 4, 7, 10, 15, 20, 27, 35, 43, 50)
"""Steps at which the fit looks."""
STRIDE = 20
"""Steps from one window of the fit to the next."""
PLACE = {"position": POSITION, "velocity": VELOCITY, "rates": RATES}
"""Of a quantity in a state."""
HEAD = ("h1", "h10", "h50", "sum")
ALLOWED = 0.02
ROUNDED = 5e-5
PUBLISHED: dict[str, Score] = {
    "Naive": {
        "position": [0.0143, 0.1430, 0.6797, 17.7878],
        "velocity": [0.0329, 0.3182, 1.4749, 38.9241],
        "attitude": [0.0071, 0.0692, 0.3041, 8.2138],
        "rates": [0.0796, 0.3596, 0.8837, 29.0866],
    },
    "Physics": {
        "position": [0.0013, 0.0126, 0.1269, 2.3223],
        "velocity": [0.0080, 0.0570, 0.5781, 10.6232],
        "attitude": [0.0011, 0.0205, 0.2544, 5.1013],
        "rates": [0.0796, 0.3596, 0.8837, 29.0866],
    },
    "MLP": {
        "position": [0.0032, 0.0305, 0.1712, 4.0519],
        "velocity": [0.0116, 0.0890, 0.5720, 12.5809],
        "attitude": [0.0022, 0.0331, 0.2268, 6.0591],
        "rates": [0.1138, 0.5949, 0.9005, 35.5735],
    },
    "Hybrid": {
        "position": [0.0016, 0.0166, 0.1119, 2.3625],
        "velocity": [0.0092, 0.0613, 0.5556, 10.4033],
        "attitude": [0.0027, 0.0376, 0.2306, 6.1534],
        "rates": [0.0912, 0.4880, 0.5979, 28.9873],
    },
    "LSTM": {
        "position": [0.0079, 0.0390, 0.2572, 5.9711],
        "velocity": [0.0247, 0.1175, 0.7407, 16.7207],
        "attitude": [0.0066, 0.0372, 0.2325, 5.6525],
        "rates": [0.1021, 0.4292, 1.2407, 35.8353],
    },
}
DEAD_S = "dead_s"
"""Of the rotors: the air takes time to follow their speed."""
LEARNERS = ("MLP", "Hybrid", "LSTM")
FORCES = [
    Parameter("thrust", 1.0, 0.05, 0.5, 1.5),
    Parameter(DEAD_S, 0.01, 0.01, 0.0, 0.1),
    Parameter("rotor_drag.drag", 0.5, 0.3, 0.0),
    Parameter("vertical_inflow.slope", 2.0, 2.0, 0.0),
    Parameter("momentum_thrust.slope", 2.0, 2.0, 0.0),
]
MOMENTS = [
    Parameter("roll_arm", 0.5, 0.3, 0.0),
    Parameter("pitch_arm", 0.5, 0.3, 0.0),
    Parameter("yaw", 0.1, 0.3, 0.0),
    Parameter("rate_damping.tilting", 1.0, 1.0, 0.0),
    Parameter("rate_damping.yaw", 0.2, 0.2, 0.0),
    Parameter("flapping_moment.moment", 0.0, 0.1),
    Parameter("rotor_inertia.inertia", 1e-8, 1e-7, 0.0),
    Parameter("trim_moment.roll", 0.0, 1e-5),
    Parameter("trim_moment.pitch", 0.0, 1e-5),
    Parameter("trim_moment.yaw", 0.0, 1e-6),
]


def vehicle(
    thrust: float = 1.0,
    roll_arm: float = 1.0,
    pitch_arm: float = 1.0,
    yaw: float = 1.0,
    inertia: tuple[float, float, float] = INERTIA_KGM2,
) -> Vehicle:
    """The authors' vehicle, with shares of their thrust, arms and rotor torque."""
    area = np.pi * RADIUS_M**2
    force = RHO_SEA_LEVEL * area * RADIUS_M**2
    fans = []
    for number, ((forward, right), spin) in enumerate(zip(PLACES, SPINS, strict=True), 1):
        fan = Fan(
            position_m=(forward * pitch_arm * ARM_M, right * roll_arm * ARM_M, 0.0),
            lip_radius_m=RADIUS_M,
            rotors=(Rotor(spin, esc=number),),
            ct=thrust * THRUST_N_S2 / force,
            cq=yaw * TORQUE_NM_S2 / (force * RADIUS_M),
        )
        fans.append(fan)
    return Vehicle(
        name="nano-drone",
        mass_kg=MASS_KG,
        inertia_kgm2=inertia,
        hover_thrust=0.5,
        rotor_radius_m=RADIUS_M,
        fans=tuple(fans),
    )


@dataclass(frozen=True)
class Fitted:
    """Parameters by name: shares of the vehicle's numbers, and coefficients of effects."""

    values: Mapping[str, float]

    @property
    def model(self) -> FlightModel:
        """What is rolled out."""
        own = {k: v for k, v in self.values.items() if "." not in k and k != DEAD_S}
        named: dict[str, dict[str, float]] = {}
        for key, value in self.values.items():
            if "." in key:
                effect, coefficient = key.split(".")
                named.setdefault(effect, {})[coefficient] = value
        effects = []
        for name, found in named.items():
            effect = get(name)
            parameters = dict.fromkeys((c.name for c in effect.coefficients), 0.0)
            parameters |= dict.fromkeys((s.name for s in effect.shapes), 0.0)
            effects.append(AdoptedEffect(name, parameters | found))
        return FlightModel(vehicle(**own), None, tuple(effects))

    def predict(self, states: Array, inputs: Array, rotations: Array | None = None) -> Array:
        """States (n, steps, 13) that follow; ``rotations`` as in ``rollout``."""
        return rollout(
            self.model,
            states,
            self._late(inputs),
            step_s=STEP_S,
            beside=self._spun_up(inputs),
            rotations=rotations,
        )

    def _late(self, inputs: Array) -> Array:
        """Rotor speeds (n, steps, 4) that the thrust belongs to; the first one held before it."""
        late = self.values.get(DEAD_S, 0.0) / STEP_S
        whole = int(late)
        part = late - whole
        steps = np.arange(inputs.shape[1])
        after = inputs[:, np.maximum(steps - whole, 0)]
        before = inputs[:, np.maximum(steps - whole - 1, 0)]
        return np.asarray((1.0 - part) * after + part * before)

    def _spun_up(self, inputs: Array) -> Array:
        """Reaction (n, steps, 6) of rotors that speed up; at the first step the change is not known."""
        out = np.zeros((*inputs.shape[:2], 6))
        spin = (inputs * SPINS).sum(axis=2) * RPM_TO_RAD_S
        change = np.diff(spin, axis=1) / STEP_S
        out[:, 1:, 5] = -self.values.get("rotor_inertia.inertia", 0.0) * change
        return out


def physics(states: Array, inputs: Array) -> Array:
    """The authors' row of that name: their thrust, and rates that stay as they are."""
    return rollout(FlightModel(vehicle(inertia=ROUND)), states, inputs, step_s=STEP_S)


@dataclass(frozen=True)
class Cut:
    """Windows of all training flights: states (n, 13), rotor speeds (n, steps, 4), and what followed."""

    states: Array
    inputs: Array
    measured: Array
    halfway: Array
    """(n, steps, 3, 3) measured attitude in the middle of every step."""

    @classmethod
    def of(cls, runs: Sequence[Run], stride: int = STRIDE) -> Cut:
        """All windows at this stride."""
        states = []
        inputs = []
        measured = []
        halfway = []
        for run in runs:
            rows = starts(run, stride)
            later = rows[:, None] + np.arange(STEPS)
            turned = turned_by(run.states[:, QUATERNION], 0.5 * STEP_S * run.states[:, RATES])
            states.append(run.states[rows])
            inputs.append(inputs_of(run, rows))
            measured.append(run.states[later + 1])
            halfway.append(rotation_from_quaternion(turned)[later])
        return cls(*(np.concatenate(part) for part in (states, inputs, measured, halfway)))

    def usual(self, quantity: str) -> float:
        """Mean error norm over ``HORIZONS`` where nothing changes."""
        path = naive(self.states, self.inputs)
        return float(error(quantity, path, self.measured)[:, np.array(HORIZONS) - 1].mean())


def rolled(vehicle_file: Path, model: FanSurrogate | None) -> Predictor:
    """A vehicle file with a model directory, or alone."""
    flies = FlightModel(load_vehicle(vehicle_file), model)
    return lambda states, inputs: rollout(flies, states, inputs, step_s=STEP_S)


def fitted(runs: Sequence[Run]) -> Fitted:
    """Forces with the measured attitude, then moments with the forces as they are.

    What is made least is what is scored: error norms, with the same weight at every step.
    """
    cut = Cut.of(runs)
    at = np.array(HORIZONS) - 1
    measured = cut.measured[:, at]
    usual = {quantity: cut.usual(quantity) for quantity in QUANTITIES}

    def missed(path: Array, quantity: str) -> Array:
        """Error vectors (n, 3) of states (windows, horizons, 13), over their usual size."""
        if quantity == "attitude":
            off = _turned(path[..., QUATERNION], measured[..., QUATERNION])
        else:
            off = path[..., PLACE[quantity]] - measured[..., PLACE[quantity]]
        return np.asarray(off / usual[quantity]).reshape(-1, 3)

    def forces(x: Array) -> Array:
        model = Fitted(dict(zip([p.name for p in FORCES], x.tolist(), strict=True)))
        path = model.predict(cut.states, cut.inputs, cut.halfway)[:, at]
        return np.concatenate([missed(path, quantity) for quantity in ("position", "velocity")])

    force = fit(forces, FORCES)

    def moments(x: Array) -> Array:
        model = Fitted(force | dict(zip([p.name for p in MOMENTS], x.tolist(), strict=True)))
        path = model.predict(cut.states, cut.inputs)[:, at]
        return np.concatenate([missed(path, quantity) for quantity in QUANTITIES])

    return Fitted(force | fit(moments, MOMENTS))


def _turned(a: Array, b: Array) -> Array:
    """Rotation vectors (..., 3) from quaternions b to a, for angles well below a half turn."""
    w = b[..., :1]
    v = b[..., 1:]
    x = a[..., :1]
    u = a[..., 1:]
    scalar = w * x + (v * u).sum(axis=-1, keepdims=True)
    return np.asarray(2.0 * np.sign(scalar) * (w * u - x * v - np.cross(v, u)))


def differing(computed: Score, published: Score) -> list[str]:
    """Columns that differ by more than is allowed, in words; published numbers are rounded to four places."""
    out = []
    for quantity in QUANTITIES:
        columns = zip(HEAD, computed[quantity], published[quantity], strict=True)
        for name, ours, theirs in columns:
            if abs(ours - theirs) > ALLOWED * theirs + ROUNDED:
                out.append(f"{quantity} {name}: {ours:.4f}, published {theirs:.4f}")
    return out


def better(ours: Score, theirs: Sequence[Score]) -> int:
    """Columns of 16 in which ours, rounded as theirs are, is below every one of theirs."""
    count = 0
    for quantity in QUANTITIES:
        for column, value in enumerate(ours[quantity]):
            count += all(round(value, 4) < other[quantity][column] for other in theirs)
    return count


def worse(ours: Score, theirs: Sequence[Score]) -> int:
    """Columns of 16 in which ours is above the best of theirs by more than a hundredth."""
    count = 0
    for quantity in QUANTITIES:
        for column, value in enumerate(ours[quantity]):
            count += value > 1.01 * min(other[quantity][column] for other in theirs)
    return count


def row(name: str, scored: Score) -> str:
    """One line of the table."""
    cells = []
    for quantity in QUANTITIES:
        cells += [f"{value:.4f}" for value in scored[quantity]]
    return f"| {name} | {' | '.join(cells)} |"


def head() -> str:
    """Two lines of the table."""
    names = [f"{quantity} {name}" for quantity in QUANTITIES for name in HEAD]
    return f"| model | {' | '.join(names)} |\n|{'---|' * (len(names) + 1)}"


def reproduced(runs: Sequence[Run]) -> dict[str, Score]:
    """The authors' rows that need no learning. Raises SystemExit where they are not the published ones."""
    rows = {
        "Naive": score(runs, naive, seam=True),
        "Physics": score(runs, physics, seam=True),
    }
    wrong = []
    for name, computed in rows.items():
        wrong += [f"{name} {column}" for column in differing(computed, PUBLISHED[name])]
    if wrong:
        raise SystemExit(f"refused: the published rows are not reproduced: {'; '.join(wrong)}")
    return rows


def main() -> int:
    parser = command_line.of_clone(__doc__)
    parser.add_argument("--validate", action="store_true", help="score flights for validation")
    parser.add_argument("--model", type=Path, metavar="DIR", help="score this model directory")
    parser.add_argument("--vehicle", type=Path, metavar="FILE", help="the vehicle file of --model")
    add_option(parser)
    a = parser.parse_args()
    if (a.model is None) != (a.vehicle is None):
        parser.error("--model and --vehicle go together")
    rows = _rows(a)
    if a.validate:
        _validate(a.clone, rows)
    elif a.model:
        _beside(a.clone, rows)
    else:
        _judge(a, rows["ours"])
    return 0


def _rows(a: argparse.Namespace) -> dict[str, Predictor]:
    """What is scored, by the name of its row."""
    if a.model:
        return {
            "vehicle file": rolled(a.vehicle, None),
            "replay diagnose": rolled(a.vehicle, load(a.model)),
        }
    ours = fitted(raw_runs(a.clone, TRAINING, (1, 2, 3)))
    for name, value in ours.values.items():
        print(f"{name:24s} {value:.4g}")
    return {"ours": ours.predict}


def _beside(clone: Path, rows: Mapping[str, Predictor]) -> None:
    runs = test_runs(clone)
    reproduced(runs)
    print(f"\nas published\n{head()}")
    for name, predict in rows.items():
        print(row(name, score(runs, predict, seam=True)))


def _validate(clone: Path, rows: Mapping[str, Predictor]) -> None:
    flights = {
        "run 4": raw_runs(clone, TRAINING, (4,)),
        "random1": raw_runs(clone, ("random1",), (1, 2, 3, 4)),
    }
    for name, runs in flights.items():
        print(f"\n{name}\n{head()}")
        print(row("Physics", score(runs, physics, seam=False)))
        for title, predict in rows.items():
            print(row(title, score(runs, predict, seam=False)))


def _judge(a: argparse.Namespace, ours: Predictor) -> None:
    runs = test_runs(a.clone)
    rows = reproduced(runs)
    print(f"\nas published (the truth runs on from one flight into the next)\n{head()}")
    for name, published in PUBLISHED.items():
        print(row(name, published))
    for name, computed in rows.items():
        print(row(f"{name}, computed here", computed))
    official = score(runs, ours, seam=True)
    print(row("ours", official))
    print(f"\nwithout the seam\n{head()}")
    clean = score(runs, ours, seam=False)
    print(row("Physics, computed here", score(runs, physics, seam=False)))
    print(row("ours", clean))
    against = {name: better(official, [PUBLISHED[name]]) for name in LEARNERS}
    best = better(official, list(PUBLISHED.values()))
    behind = worse(official, list(PUBLISHED.values()))
    print()
    for name, count in against.items():
        print(f"better than {name}: {count} of 16 columns")
    print(f"better than every row: {best} of 16; worse than the best by more than 1 %: {behind}")
    sums = ", ".join(f"{official[quantity][-1]:.3g}" for quantity in QUANTITIES)
    figures = [
        figure(
            "nano-drone: columns better than MLP, Hybrid, LSTM",
            ", ".join(str(count) for count in against.values()),
            "of 16 each",
            "16",
            met=all(count == 16 for count in against.values()),
        ),
        figure("nano-drone: columns better than every published row", str(best), "of 16"),
        figure(
            "nano-drone: columns more than 1 % worse than the best row",
            str(behind),
            "of 16",
            "0",
            met=behind == 0,
        ),
        figure(
            "nano-drone: sums over 50 steps of position, velocity, attitude, rates",
            sums,
            "best published 2.32, 10.4, 5.10, 29.0",
            "1.95, 8.1, 3.8, 20.7",
            met=_within(official, (1.95, 8.1, 3.8, 20.7)),
        ),
    ]
    if a.result:
        write_result(a, figures, seeds="three test flights, nine for training", simulated=False)


def _within(scored: Score, goals: Sequence[float]) -> bool:
    pairs = zip(QUANTITIES, goals, strict=True)
    return all(scored[quantity][-1] <= goal for quantity, goal in pairs)


if __name__ == "__main__":
    sys.exit(main())
