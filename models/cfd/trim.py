"""The tip pitch with which the free fan lifts what it should at hover speed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from models.cfd import foam
from models.cfd.case_run import compute
from models.cfd.config import Setup
from models.cfd.polars import Section, stations
from models.cfd.position import Position
from models.errors import ConfigError

FIRST_STEP_DEG = 1.0
TOLERANCE = 0.002
MOST = 6


def trim(
    folder: Path, setup: Setup, section: Section, report: Callable[[float, float], None] = lambda *_: None
) -> tuple[float, float]:
    """Tip pitch [deg] and the lift [N] it gives, within 0.2 % of ``hover_lift_n``, by the secant rule on free air.

    Raises ConfigError where the rule does not get there in six cases: the chord or the section is far from the lift.
    """
    foam.require()
    rotor = setup.rotor
    position = Position(math.inf, math.inf, rotor.hover_rpm)
    known: list[tuple[float, float]] = []
    pitch = rotor.tip_pitch_deg
    neighbour: Path | None = None
    for _ in range(MOST):
        here = replace(setup, rotor=replace(rotor, tip_pitch_deg=pitch))
        case = folder / f"trim_{pitch:.3f}" / position.key
        case.parent.mkdir(parents=True, exist_ok=True)
        result = compute(case, here, position, stations(here, rotor.hover_rpm, section), neighbour, march=False)
        lift = result.wrench[2]
        report(pitch, lift)
        if not math.isfinite(lift):
            raise ConfigError(f"trim: free air at {pitch:g} deg {result.status}; see {case / 'log'}")
        if abs(lift / rotor.hover_lift_n - 1.0) <= TOLERANCE:
            return pitch, lift
        neighbour = case
        known.append((pitch, lift))
        if len(known) == 1:
            pitch += math.copysign(FIRST_STEP_DEG, rotor.hover_lift_n - lift)
        else:
            (a, lift_a), (b, lift_b) = known[-2:]
            pitch = b + (rotor.hover_lift_n - lift_b) * (b - a) / (lift_b - lift_a)
        if not -10.0 < pitch < 60.0:
            break
    raise ConfigError(
        f"trim: no tip pitch lifts {rotor.hover_lift_n:g} N at {rotor.hover_rpm:g} rpm; "
        "check chord_m, blades and section"
    )
