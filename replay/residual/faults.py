"""Faults of a log, or of the vehicle file it is read with: reported, left out, and never named as an effect.

Every kind is one function of ``rotor_faults``, ``motion_faults`` or ``vehicle_faults``; here stands what each costs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from models.effects import Context
from replay.flightlog import Beam, FlightLog, LogFault
from replay.residual import motion_faults, rotor_faults, vehicle_faults
from replay.residual.grid import Mask
from replay.residual.motion import ENOUGH_S, Trajectory

FOLLOWS_AGAIN_S = 0.3
"""So long after full command [s] thrust follows the outputs again: the slowest motor lag of small vehicles."""
STUCK_BEAM_M = 0.002
MOVED_M = 0.4
"""A range that spans less than the first while the vehicle rises by more than the second [m] is stuck."""
STUCK_BEAM_SAMPLES = 20
"""Fewest readings for that."""
LIFT_AND_MOMENTS = frozenset({2, 3, 4, 5})
MOMENTS = frozenset({3, 4, 5})


@dataclass(frozen=True)
class Doubts:
    """What was found wrong, the axes that can still be judged, and samples that are left out, (n,) by their reason."""

    faults: tuple[LogFault, ...]
    axes: tuple[int, ...]
    left_out: tuple[tuple[str, Mask], ...]
    blind: tuple[int, ...] = ()
    """Axes that are not judged, but on which something acts all the same."""


def doubted(
    log: FlightLog, ctx: Context, motion: Trajectory, flying: Mask, axes: list[int]
) -> Doubts:
    """Doubt the log before anything is fitted. ``flying`` (n,): airborne samples of the grid."""
    faults: list[LogFault] = []
    usable = set(axes)
    blind = set[int]()

    def doubt(found: list[LogFault], lost: frozenset[int]) -> None:
        faults.extend(found)
        if found:
            usable.difference_update(lost)

    for axis, fault in motion_faults.accelerometer_faults(motion, flying):
        doubt([fault], frozenset({axis}))
    rotors = [*rotor_faults.wrong_speeds(ctx, flying), *rotor_faults.undeclared_rotors(log, ctx)]
    impossible = rotor_faults.impossible_speeds(log, ctx, motion, flying)
    if ctx.vehicle.telemetered:
        rotors = [*impossible, *rotors]
    else:
        faults += impossible
    stopped, full = rotor_faults.full_command(ctx, flying)
    if rotors or full.sum() > rotor_faults.FULL_MOST * flying.sum():
        blind |= usable & {2}
        usable -= LIFT_AND_MOMENTS
    faults += [*rotors, *stopped]
    if not rotors and 2 in usable:
        lift = vehicle_faults.wrong_lift(ctx, flying)
    else:
        lift = []
    doubt(lift, LIFT_AND_MOMENTS)
    faults.sort(key=lambda fault: fault not in lift)  # the vehicle file comes first
    doubt(rotor_faults.copies(log, ctx, motion, flying), MOMENTS)
    shifted = rotor_faults.shifted_speeds(log, ctx, motion, flying)
    if usable & MOMENTS:
        moments = [
            *rotor_faults.slow_rotors(log, ctx.vehicle),
            *motion_faults.gyro_faults(motion, flying),
        ]
        doubt(
            moments
            or vehicle_faults.exchanged_fans(ctx, motion, flying)
            or vehicle_faults.exchanged_spins(ctx, motion, flying),
            MOMENTS,
        )
    doubt(shifted, MOMENTS)
    left_out = []
    at_stop = (
        np.convolve(full, np.ones(round(FOLLOWS_AGAIN_S * motion.grid.rate) + 1))[: len(full)] > 0.5
    )
    if usable & LIFT_AND_MOMENTS and (flying & ~at_stop).sum() >= ENOUGH_S * motion.grid.rate:
        left_out.append(("at full command", at_stop))
    crash = motion_faults.first_upside_down(motion)
    if crash is not None:
        when = f"upside down from {motion.grid.t[crash]:.0f} s on: what follows is no flight"
        faults.append(LogFault("roll_rad", when))
        after = np.arange(len(flying)) >= crash - int(motion.grid.rate)
        left_out.append(("after a crash", after))
    return Doubts(tuple(faults), tuple(sorted(usable)), tuple(left_out), tuple(sorted(blind)))


def without_stuck_beams(log: FlightLog) -> tuple[FlightLog, list[LogFault]]:
    """The log without rangefinders that never move while the vehicle does."""
    if log.position is None:
        return log, []
    moved = float(np.ptp(log.position.values[:, 2]))
    stuck = [b for b in log.beams if moved > MOVED_M and _stuck(b)]
    faults = [
        LogFault(
            f"range_{b.name}_m",
            f"stays at {float(np.median(b.good.values)):.2f} m while the vehicle moves",
        )
        for b in stuck
    ]
    return replace(log, beams=tuple(b for b in log.beams if b not in stuck)), faults


def _stuck(beam: Beam) -> bool:
    good = beam.good
    vertical = beam.name in ("down", "up")
    return vertical and len(good) > STUCK_BEAM_SAMPLES and float(np.ptp(good.values)) < STUCK_BEAM_M
