"""Test flights of NeuroBEM: force and moment by named effects, beside the authors' own predictions.

``python tests/benchmarks tables.neurobem CLONE``: CLONE is a clone of github.com/RCL-NUS/NeuroMHE, which holds
test flights of NeuroBEM (Bauersfeld et al., RSS 2021, arXiv:2106.08015) with the predictions of its network. Six of
thirteen lie in it as files that can be read. The metric is the RMS of the error vector, as in the paper. NeuroBEM had
learnt from over an hour of other flights. Ours learns from the other five flights of the table, by least squares, and
is told for the one left out. Where NeuroBEM's figures are not reproduced within 2 %, nothing is told.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import command_line
import numpy as np
from result_file import add_option, figure, write_result
from scipy.spatial.transform import Rotation
from sources.neurobem import (
    FLIGHTS,
    FLIP,
    FORWARD_M,
    INERTIA,
    MASS_KG,
    PLACES,
    POSITION,
    QUATERNION,
    RADIUS_M,
    RATES,
    RIGHT_M,
    SPEEDS,
    THRUST_PER_SPEED2,
    TIME,
    VELOCITY,
    rows_of,
)
from sources.neurobem import FORCE as SPECIFIC_FORCE

from models.air_state import blank_state
from models.common.frames import Array
from models.effects import Context, get
from models.vehicle import RHO_SEA_LEVEL, Vehicle
from models.vehicle.vehicle import Fan, Rotor
from models.vehicle_wrench import RPM_TO_RAD_S
from replay.search.trims import off_centre

ANGULAR = slice(1, 4)
THEIR_FORCE = slice(29, 32)
THEIR_MOMENT = slice(32, 35)
"""Columns: angular acceleration, and what NeuroBEM predicts; body forward-left-up."""
FORCE_AXES = slice(0, 3)
MOMENT_AXES = slice(3, 6)
KNOWN = {"force": 0.606, "moment": 0.0147}
"""Pooled RMS [N, N m] of NeuroBEM on these six flights."""
ALLOWED = 0.02
SLOW_M_S = 7.0
FORCES = (
    ("rotor_drag", ("drag", "sinking")),
    ("vertical_inflow", ("slope", "level")),
    ("momentum_thrust", ("slope",)),
)
MOMENTS = (
    ("flapping_moment", ("moment",)),
    ("rate_damping", ("tilting", "yaw")),
    ("gyroscopic", ("inertia",)),
)
Terms = Sequence[tuple[str, tuple[str, ...]]]
"""Effects of the catalogue, with those of their coefficients that are fitted."""


@dataclass(frozen=True, kw_only=True)
class Segment:
    """One flight: what flew (n), force and moment as measured (n, 3), and as NeuroBEM predicts them."""

    name: str
    context: Context
    force: Array
    moment: Array
    their_force: Array
    their_moment: Array

    @property
    def fastest_m_s(self) -> float:
        """Highest speed."""
        return float(np.linalg.norm(self.context.state.velocity_ned, axis=1).max())


def vehicle() -> Vehicle:
    """The vehicle with rough thrust and arms: their shares are fitted."""
    force = RHO_SEA_LEVEL * np.pi * RADIUS_M**4
    fans = []
    for number, (forward, right, spin) in enumerate(PLACES, 1):
        turns = 1 if spin == "cw" else -1
        fan = Fan(
            position_m=(forward * FORWARD_M, right * RIGHT_M, 0.0),
            lip_radius_m=RADIUS_M,
            rotors=(Rotor(turns, esc=number),),
            ct=THRUST_PER_SPEED2 / force,
            cq=0.01,
        )
        fans.append(fan)
    return Vehicle(
        name="racing quadrotor",
        mass_kg=MASS_KG,
        inertia_kgm2=INERTIA,
        hover_thrust=0.45,
        rotor_radius_m=RADIUS_M,
        fans=tuple(fans),
    )


def segments(clone: Path) -> list[Segment]:
    """The six flights at 400 Hz."""
    out = []
    for name in FLIGHTS:
        out.append(_segment(name, rows_of(clone, name)))
    return out


def _segment(name: str, rows: Array) -> Segment:
    pose = Rotation.from_quat(rows[:, QUATERNION])
    over = Rotation.from_euler("x", 180, degrees=True)
    rates = FLIP * rows[:, RATES]
    state = replace(
        blank_state((len(rows),), len(PLACES), len(PLACES)),
        time_s=rows[:, TIME],
        position_ned=FLIP * rows[:, POSITION],
        velocity_ned=FLIP * pose.apply(rows[:, VELOCITY]),
        rotation=(over * pose * over).as_matrix(),
        rates=rates,
        rpm=rows[:, SPEEDS] / RPM_TO_RAD_S,
    )
    inertia = np.array(INERTIA)
    return Segment(
        name=name,
        context=Context(state=state, vehicle=vehicle()),
        force=MASS_KG * FLIP * rows[:, SPECIFIC_FORCE],
        moment=inertia * FLIP * rows[:, ANGULAR] + np.cross(rates, inertia * rates),
        their_force=FLIP * rows[:, THEIR_FORCE],
        their_moment=FLIP * rows[:, THEIR_MOMENT],
    )


def force_columns(context: Context) -> Array:
    """(n, 3, k): thrust as declared, effects, and an accelerometer off the centre of gravity."""
    thrust = context.rotor_wrench[:, :, None]
    place = np.stack(list(off_centre(context)), axis=2)
    return np.concatenate([thrust, _effects(context, FORCES), place], axis=2)[:, FORCE_AXES]


def moment_columns(context: Context) -> Array:
    """(n, 3, k): declared moments about every axis by themselves, and effects."""
    declared = context.rotor_moment[:, :, None] * np.eye(3)
    return np.concatenate([declared, _effects(context, MOMENTS)[:, MOMENT_AXES]], axis=2)


def _effects(context: Context, terms: Terms) -> Array:
    """Wrenches (n, 6, k) of effects with all shapes at zero."""
    parts = []
    for name, wanted in terms:
        effect = get(name)
        x = np.nan_to_num(effect.regressors(context, (0.0,) * len(effect.shapes)))
        names = [c.name for c in effect.coefficients]
        parts.append(x[:, :, [names.index(one) for one in wanted]])
    return np.concatenate(parts, axis=2)


def left_out(columns: Sequence[Array], measured: Sequence[Array]) -> list[Array]:
    """Errors (n, 3) on every flight of coefficients that were fitted to the others."""
    out = []
    for k, (x, y) in enumerate(zip(columns, measured, strict=True)):
        others = np.concatenate([c for j, c in enumerate(columns) if j != k])
        target = np.concatenate([m for j, m in enumerate(measured) if j != k])
        flat = others.reshape(-1, others.shape[2])
        size = np.sqrt((flat**2).mean(axis=0))
        found, *_ = np.linalg.lstsq(flat / size, target.ravel(), rcond=None)
        out.append(x @ (found / size) - y)
    return out


def rms(errors: Array) -> float:
    """RMS of error vectors (n, k)."""
    return float(np.sqrt((errors**2).sum(axis=1).mean()))


def _cells(errors: Array) -> str:
    parts = (errors[:, :2], errors[:, 2:], errors)
    return " | ".join(f"{rms(part):.4f}" for part in parts)


def told(flights: Sequence[Segment], theirs: Sequence[Array], ours: Sequence[Array]) -> str:
    """A table, flight by flight: level, vertical and whole error, theirs and ours."""
    lines = ["| flight | fastest | NeuroBEM xy | z | all | ours xy | z | all |", f"|{'---|' * 8}"]
    for flight, a, b in zip(flights, theirs, ours, strict=True):
        lines.append(f"| {flight.name} | {flight.fastest_m_s:.1f} | {_cells(a)} | {_cells(b)} |")
    pooled = [_cells(np.concatenate(errors)) for errors in (theirs, ours)]
    lines.append(f"| together | | {' | '.join(pooled)} |")
    return "\n".join(lines)


def main() -> int:
    parser = command_line.of_clone(__doc__)
    add_option(parser)
    a = parser.parse_args()
    flights = segments(a.clone)
    theirs = {
        "force": [s.their_force - s.force for s in flights],
        "moment": [s.their_moment - s.moment for s in flights],
    }
    check(theirs)
    ours = {
        "force": left_out([force_columns(s.context) for s in flights], [s.force for s in flights]),
        "moment": left_out(
            [moment_columns(s.context) for s in flights], [s.moment for s in flights]
        ),
    }
    for what, unit in (("force", "N"), ("moment", "N m")):
        print(f"\n{what} [{unit}]\n{told(flights, theirs[what], ours[what])}")
    if a.result:
        write_result(a, _figures(flights, theirs, ours), seeds="six flights", simulated=False)
    return 0


def check(theirs: dict[str, list[Array]]) -> None:
    """Raises SystemExit where NeuroBEM's own figures are not reproduced."""
    for what, known in KNOWN.items():
        found = rms(np.concatenate(theirs[what]))
        if abs(found - known) > ALLOWED * known:
            raise SystemExit(
                f"refused: NeuroBEM's {what} is not reproduced: {found:.4f}, known {known:.4f}"
            )


def _figures(
    flights: Sequence[Segment], theirs: dict[str, list[Array]], ours: dict[str, list[Array]]
) -> list[dict[str, object]]:
    out = []
    for what, unit, goal in (("force", "N", 0.70), ("moment", "N m", 0.018)):
        found = rms(np.concatenate(ours[what]))
        known = rms(np.concatenate(theirs[what]))
        slow = [s.fastest_m_s < SLOW_M_S for s in flights]
        pairs = zip(theirs[what], ours[what], slow, strict=True)
        won = [rms(b) <= 1.01 * rms(a) for a, b, judged in pairs if judged]
        out.append(
            figure(
                f"racing quadrotor, {what}: error of ours",
                f"{found:.3g} {unit}",
                f"NeuroBEM {known:.3g}",
                f"{goal:g} {unit}",
                met=found <= goal,
            )
        )
        out.append(
            figure(
                f"racing quadrotor, {what}: at most 1 % worse than NeuroBEM below {SLOW_M_S:.0f} m/s",
                str(sum(won)),
                f"of {len(won)} flights",
                str(len(won)),
                met=all(won),
            )
        )
    return out


if __name__ == "__main__":
    sys.exit(main())
