"""The tip pitch with which the free fan lifts what it should at hover speed; with swirl, without net torque."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from models.cfd import foam
from models.cfd.case_run import Result, compute
from models.cfd.config import Rotor, Setup
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
LEAST_DEG, MOST_DEG = -10.0, 60.0
"""Pitches that a blade can have."""

Report = Callable[[tuple[float, ...], Result], None]


def trim(
    folder: Path, setup: Setup, section: Section, model: str, report: Report = lambda *_: None
) -> tuple[tuple[float, ...], Result]:
    """Tip pitch [deg] of both discs as one (``half``) or of upper and lower disc (``full``), and the case.

    Half model: the lift is ``hover_lift_n`` within 0.2 %. With swirl also the net torque is zero within 0.2 % of lift
    times R. Raises ConfigError where Broyden's rule does not get there.
    """
    foam.require()
    return _Cases(folder, setup, section, model, report).broyden()


class _Cases:
    """Free air at the pitches that the rules ask for; each case starts from the one before."""

    def __init__(self, folder: Path, setup: Setup, section: Section, model: str, report: Report) -> None:
        self.folder, self.setup, self.section, self.report = folder, setup, section, report
        level = setup.campaign.full_level if model == "full" else 1.0
        rpm = setup.rotor.hover_rpm
        self.position = Position(math.inf, math.inf, rpm, model == "full", level)
        self.neighbour: Path | None = None

    def compute(self, pitch: Array) -> Result:
        rotor = _pitched(self.setup.rotor, pitch)
        here = replace(self.setup, rotor=rotor)
        case = self.folder / ("trim_" + "_".join(f"{p:.3f}" for p in pitch)) / self.position.key
        case.parent.mkdir(parents=True, exist_ok=True)
        tables = blades(here, rotor.hover_rpm, self.section, swirl=self.position.swirl)
        result = compute(case, here, self.position, tables, self.neighbour, march=False)
        self.report(_floats(pitch), result)
        if not math.isfinite(result.wrench[2]):
            raise ConfigError(f"trim: free air at {_degrees(pitch)} {result.status}; see {case / 'log'}")
        self.neighbour = case
        return result

    def broyden(self) -> tuple[tuple[float, ...], Result]:
        """Pitches and their case, by Broyden's rule: of one pitch it is the secant rule."""
        rotor = self.setup.rotor
        pitch = np.array(rotor.swirl_tip_pitch_deg if self.position.swirl else [rotor.tip_pitch_deg])
        result = self.compute(pitch)
        miss = self._miss(result)
        if np.all(np.abs(miss) <= TOLERANCE):
            return _floats(pitch), result
        columns = [self._miss(self.compute(pitch + step)) - miss for step in FIRST_STEP_DEG * np.eye(len(pitch))]
        slope = np.column_stack(columns) / FIRST_STEP_DEG
        for _ in range(MOST):
            if abs(np.linalg.det(slope)) < 1e-9:
                break
            step = -np.linalg.solve(slope, miss)
            pitch = pitch + step
            if not np.all((pitch > LEAST_DEG) & (pitch < MOST_DEG)):
                break
            result = self.compute(pitch)
            before, miss = miss, self._miss(result)
            if np.all(np.abs(miss) <= TOLERANCE):
                return _floats(pitch), result
            slope += np.outer(miss - before - slope @ step, step) / (step @ step)
        off = f"{miss[0]:+.2%} of the lift"
        if self.position.swirl:
            off += f" and a net torque of {miss[1]:+.2%} of lift x R"
        raise ConfigError(
            f"trim: does not converge: {_degrees(pitch)} leave {off}; check blades, chord_m, section and the "
            "pitches to start from"
        )

    def _miss(self, result: Result) -> Array:
        """Lift beyond what it should be, over the lift; with swirl also the net torque over lift times R."""
        rotor = self.setup.rotor
        lift, torque = result.wrench[2], result.wrench[5]
        off = [lift / rotor.hover_lift_n - 1.0, torque / (rotor.hover_lift_n * self.setup.fan.radius_m)]
        return np.array(off if self.position.swirl else off[:1])


def _pitched(rotor: Rotor, pitch: Array) -> Rotor:
    if len(pitch) == 1:
        return replace(rotor, tip_pitch_deg=float(pitch[0]))
    return replace(rotor, swirl_tip_pitch_deg=_floats(pitch))


def _floats(pitch: Array) -> tuple[float, ...]:
    return tuple(pitch.tolist())


def _degrees(pitch: Array) -> str:
    return " and ".join(f"{p:.2f}" for p in pitch) + " deg"
