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
MOST = 6
"""Cases of a secant search for one pitch before it is refused."""
MOST_PAIR = 8
"""The same for two pitches, whose first three cases only give the slopes."""

Report = Callable[[tuple[float, ...], Result], None]


def trim(
    folder: Path, setup: Setup, section: Section, model: str, report: Report = lambda *_: None
) -> tuple[tuple[float, ...], Result]:
    """Tip pitch [deg] of both discs as one (``half``) or of upper and lower disc (``full``), and the case.

    Half model: the lift is ``hover_lift_n`` within 0.2 %, by the secant rule. With swirl also the net torque is zero
    within 0.2 % of lift times R, by Broyden's rule. Raises ConfigError where the rule does not get there.
    """
    foam.require()
    cases = _Cases(folder, setup, section, model, report)
    return cases.secant() if model == "half" else cases.broyden()


class _Cases:
    """Free air at the pitches that the rules ask for; each case starts from the one before."""

    def __init__(self, folder: Path, setup: Setup, section: Section, model: str, report: Report) -> None:
        self.folder, self.setup, self.section, self.report = folder, setup, section, report
        level = setup.campaign.full_level if model == "full" else 1.0
        rpm = setup.rotor.hover_rpm
        self.position = Position(math.inf, math.inf, rpm, model == "full", level)
        self.neighbour: Path | None = None

    def compute(self, pitch: tuple[float, ...]) -> Result:
        rotor = _pitched(self.setup.rotor, pitch)
        here = replace(self.setup, rotor=rotor)
        case = self.folder / ("trim_" + "_".join(f"{p:.3f}" for p in pitch)) / self.position.key
        case.parent.mkdir(parents=True, exist_ok=True)
        tables = blades(here, rotor.hover_rpm, self.section, swirl=self.position.swirl)
        result = compute(case, here, self.position, tables, self.neighbour, march=False)
        self.report(pitch, result)
        if not math.isfinite(result.wrench[2]):
            raise ConfigError(f"trim: free air at {_degrees(pitch)} {result.status}; see {case / 'log'}")
        self.neighbour = case
        return result

    def secant(self) -> tuple[tuple[float, ...], Result]:
        rotor = self.setup.rotor
        known: list[tuple[float, float]] = []
        pitch = rotor.tip_pitch_deg
        for _ in range(MOST):
            result = self.compute((pitch,))
            lift = result.wrench[2]
            if abs(lift / rotor.hover_lift_n - 1.0) <= TOLERANCE:
                return (pitch,), result
            known.append((pitch, lift))
            if len(known) == 1:
                pitch += math.copysign(FIRST_STEP_DEG, rotor.hover_lift_n - lift)
            else:
                (a, lift_a), (b, lift_b) = known[-2:]
                if lift_a == lift_b:
                    break
                pitch = b + (rotor.hover_lift_n - lift_b) * (b - a) / (lift_b - lift_a)
            if not _possible(pitch):
                break
        raise ConfigError(
            f"trim: no tip pitch lifts {rotor.hover_lift_n:g} N at {rotor.hover_rpm:g} rpm; "
            "check chord_m, blades and section"
        )

    def broyden(self) -> tuple[tuple[float, ...], Result]:
        pitch = np.array(self.setup.rotor.swirl_tip_pitch_deg)
        result = self.compute(_pair(pitch))
        miss = self._miss(result)
        if _small(miss):
            return _pair(pitch), result
        columns = [self._miss(self.compute(_pair(pitch + step))) - miss for step in FIRST_STEP_DEG * np.eye(2)]
        slope = np.column_stack(columns) / FIRST_STEP_DEG
        for _ in range(MOST_PAIR - 3):
            if abs(np.linalg.det(slope)) < 1e-9:
                break
            step = -np.linalg.solve(slope, miss)
            pitch = pitch + step
            if not all(_possible(p) for p in pitch):
                break
            result = self.compute(_pair(pitch))
            before, miss = miss, self._miss(result)
            if _small(miss):
                return _pair(pitch), result
            slope += np.outer(miss - before - slope @ step, step) / (step @ step)
        raise ConfigError(
            f"trim: does not converge: {_degrees(_pair(pitch))} leave {miss[0]:+.2%} of the lift and a net torque of "
            f"{miss[1]:+.2%} of lift x R; check blades, chord_m, section and the pitches to start from"
        )

    def _miss(self, result: Result) -> Array:
        """Lift and net torque (2,) beyond what they should be, over the lift and over lift times R."""
        rotor = self.setup.rotor
        lift, torque = result.wrench[2], result.wrench[5]
        radius = self.setup.fan.radius_m
        return np.array([lift / rotor.hover_lift_n - 1.0, torque / (rotor.hover_lift_n * radius)])


def _pitched(rotor: Rotor, pitch: tuple[float, ...]) -> Rotor:
    return replace(rotor, tip_pitch_deg=pitch[0]) if len(pitch) == 1 else replace(rotor, swirl_tip_pitch_deg=pitch)


def _pair(pitch: Array) -> tuple[float, ...]:
    return float(pitch[0]), float(pitch[1])


def _small(miss: Array) -> bool:
    return bool(np.all(np.abs(miss) <= TOLERANCE))


def _possible(pitch: float) -> bool:
    return -10.0 < pitch < 60.0


def _degrees(pitch: tuple[float, ...]) -> str:
    return " and ".join(f"{p:.2f}" for p in pitch) + " deg"
