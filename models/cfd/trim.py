"""The tip pitch with which the free fan lifts what it should at hover speed; with swirl, without net torque."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from models.cfd import foam
from models.cfd.case_run import Result, compute
from models.cfd.config import Setup
from models.cfd.polars import Section, blades
from models.cfd.position import Position
from models.errors import ConfigError
from models.frames import Array

FIRST_STEP_DEG = 1.0
"""First change of a pitch."""
TOLERANCE = 0.002
"""Of the lift, and of lift times R for the net torque."""
MOST = 5
"""Steps before it is refused, beyond the cases that give the first slopes."""


def trim(folder: Path, setup: Setup, section: Section, model: str) -> tuple[tuple[float, ...], Result]:
    """Tip pitch [deg] of both discs as one (``half``) or of upper and lower disc (``full``), and the case.

    Half model: the lift is ``hover_lift_n`` within 0.2 %. With swirl also the net torque is zero within 0.2 % of lift
    times R. Broyden's rule, which for one pitch is the secant rule. Raises ConfigError where it does not get there.
    """
    foam.require()
    rotor, swirl = setup.rotor, model == "full"
    position = Position(math.inf, math.inf, rotor.hover_rpm, swirl, setup.campaign.full_level if swirl else 1.0)
    found: list[tuple[tuple[float, ...], Result, Path]] = []

    def miss(pitch: Array) -> Array:
        """Lift beyond what it should be, over the lift; with swirl also the net torque over lift times R."""
        tips = tuple(pitch.tolist())
        change = {"swirl_tip_pitch_deg": tips} if swirl else {"tip_pitch_deg": tips[0]}
        here = replace(setup, rotor=replace(rotor, **change))
        case = folder / ("trim_" + "_".join(f"{p:.3f}" for p in tips)) / position.key
        case.parent.mkdir(parents=True, exist_ok=True)
        tables = blades(here, rotor.hover_rpm, section, swirl=swirl)
        result = compute(case, here, position, tables, found[-1][2] if found else None, march=False)
        if not math.isfinite(result.wrench[2]):
            raise ConfigError(f"trim: free air at {_degrees(pitch)} {result.status}; see {case / 'log'}")
        found.append((tips, result, case))
        off = [result.wrench[2], result.wrench[5] / setup.fan.radius_m] if swirl else [result.wrench[2]]
        return np.array(off) / rotor.hover_lift_n - [1.0, 0.0][: len(off)]

    pitch = np.array(rotor.swirl_tip_pitch_deg if swirl else [rotor.tip_pitch_deg])
    off, slope = miss(pitch), None
    while np.any(np.abs(off) > TOLERANCE):
        if slope is None:
            columns = [miss(pitch + step) - off for step in FIRST_STEP_DEG * np.eye(len(pitch))]
            slope = np.column_stack(columns) / FIRST_STEP_DEG
        if abs(np.linalg.det(slope)) < 1e-9 or len(found) > MOST + len(pitch):
            raise ConfigError(
                f"trim: does not converge: {_degrees(pitch)} leave {off[0]:+.2%} of the lift"
                + (f" and a net torque of {off[1]:+.2%} of lift x R" if swirl else "")
                + "; check blades, chord_m, section and the pitches to start from"
            )
        step = -np.linalg.solve(slope, off)
        pitch = pitch + step
        before, off = off, miss(pitch)
        slope += np.outer(off - before - slope @ step, step) / (step @ step)
    return found[-1][:2]


def _degrees(pitch: Array) -> str:
    return " and ".join(f"{p:.2f}" for p in pitch) + " deg"
