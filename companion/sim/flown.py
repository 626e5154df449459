"""One simulated flight judged against its truth: errors of height, place and tilt, by approach and by phase."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.config import PipelineConfig
from companion.sim.body import DT
from companion.sim.flight import SimulatedFlight
from companion.sim.lockstep import Lockstep
from companion.sim.pilot import ScriptedPilot
from models.common.errors import LinkError
from models.common.frames import Array, Mask

SETTLE_S = (2.0, 5.5)
"""Script time over which each flight's own position error is taken out: the EKF's offset is nobody's merit."""
STEP_S = 0.02
"""Grid on which the flights of one seed are compared: the period of the truth file."""
AXES = ("height", "lateral", "tilt")
UNITS = {"height": "mm", "lateral": "mm", "tilt": "deg"}
PHASES = ("low", "wall", "corner", "between")
"""Where the vehicle stays over the ground, at the wall, in the corner; and the ways between."""
_STAYS = {"ground": 0, "wall": 1, "corner": 2}
"""Phases of a script and their places in ``PHASES``."""
TRUTH = (
    "script_s",
    "ref_n",
    "ref_e",
    "ref_d",
    "n",
    "e",
    "d",
    "roll",
    "pitch",
    "need_roll",
    "need_pitch",
    "streamed",
    "contact",
    "phase",
)
"""Columns of what truly happened."""


class Leg(Enum):
    """Who flies, and in which air."""

    AUTOPILOT = "autopilot's own hold"
    OFF = "our hold, offsets off"
    ON = "our hold, offsets on"
    ADAPTED = "our hold, offsets adapted"
    FREE = "our hold, in free air"


@dataclass(frozen=True, kw_only=True)
class Flown:
    """One leg: errors on a grid of script time, height [m], lateral (north, east) [m], tilt (roll, pitch) [rad].

    Tilt error is the true tilt minus the tilt that balances the true air at that instant, vanes included.
    """

    leg: Leg
    seed: int
    time_s: Array
    height: Array
    lateral: Array
    tilt: Array
    touched_s: float
    phase: NDArray[np.intp]
    """(n,) places in ``PHASES``."""
    approach_s: float = math.inf
    """Length of one of several approaches."""
    adapted: Mapping[str, Any] = field(default_factory=dict)
    """Sizes measured in flight."""

    @property
    def approaches(self) -> int:
        """How many there are in this flight."""
        if math.isinf(self.approach_s):
            return 1
        return round(float(self.time_s[-1]) / self.approach_s)

    def during(self, approach: int | None = None, phase: str | None = None) -> Mask:
        """(n,): whether an instant belongs to an approach, counted from 1, and to one of ``PHASES``; None: to any."""
        out = np.ones(len(self.time_s), bool)
        if approach is not None and math.isfinite(self.approach_s):
            start = (approach - 1) * self.approach_s
            out &= (self.time_s >= start) & (self.time_s < start + self.approach_s)
        if phase is not None:
            out &= self.phase == PHASES.index(phase)
        return out

    def size(self, axis: str) -> Array:
        """Magnitude of the error of ``axis`` in its printed unit, shape (n,)."""
        if axis == "height":
            return np.asarray(1e3 * np.abs(self.height))
        if axis == "lateral":
            return np.asarray(1e3 * np.hypot(self.lateral[:, 0], self.lateral[:, 1]))
        return np.asarray(np.degrees(np.hypot(self.tilt[:, 0], self.tilt[:, 1])))

    def rms(self, axis: str, rows: Mask | None = None) -> float:
        """Root mean square of ``axis`` over all or some instants; NaN over none."""
        if rows is None:
            size = self.size(axis)
        else:
            size = self.size(axis)[rows]
        if size.size:
            return float(np.sqrt(np.mean(size**2)))
        return math.nan

    def peak(self, axis: str) -> float:
        """Largest error of ``axis``."""
        return float(np.max(self.size(axis)))


class Witness:
    """What truly happened, row by row, from the moment the script begins."""

    def __init__(self, flight: SimulatedFlight) -> None:
        self._flight = flight
        self._next_s = 0.0
        self._rows: list[tuple[float, ...]] = []

    def step(self) -> None:
        """Take down a row when due. Call once per physics step."""
        f = self._flight
        now_s = self._flight.time_s
        if now_s + 0.5 * DT < self._next_s:
            return
        self._next_s = round(now_s + STEP_S, 4)
        if f.script_s < 0.0:
            return
        reference = f.reference
        body = f.body
        self._rows.append(
            (
                f.script_s,
                *reference.position,
                *body.position,
                *body.euler()[:2],
                *f.needed_tilt(),
                f.autopilot.hand == "stream",
                body.contact,
                _STAYS.get(reference.phase, PHASES.index("between")),
            )
        )

    def columns(self) -> dict[str, Array]:
        """The numbers by name: SI, radians, world NED.

        ``need_*``: the tilt that balances the true air; ``streamed``: 1 where a companion flew; ``phase``: place in
        ``PHASES``.
        """
        table = np.array(self._rows, float).reshape(-1, len(TRUTH))
        return dict(zip(TRUTH, table.T, strict=True))


def fly_judged(
    flight: SimulatedFlight,
    config: PipelineConfig | None,
    leg: Leg,
    *,
    approach_s: float = math.inf,
    record: Path | None = None,
    pilot: type[ScriptedPilot] = ScriptedPilot,
) -> Flown:
    """Fly in lockstep and judge; ``config`` None: the autopilot flies. The same numbers on every machine."""
    witness = Witness(flight)
    companion = config is not None
    world = Lockstep(
        flight, pilot.link, lambda w: pilot(w.flight, w.link, companion=companion), witness.step
    )
    world.fly(config, record)
    found = flown(leg, flight.seed, witness.columns(), approach_s)
    if world.companion is None:
        known = None
    else:
        known = world.companion.summary.adaptation
    if known is None:
        return found
    return replace(found, adapted=known.as_json())


def flown(leg: Leg, seed: int, truth: Mapping[str, Array], approach_s: float = math.inf) -> Flown:
    """Errors of one flight from its truth."""
    script = truth["script_s"]
    if len(script) < 10 or script[-1] < SETTLE_S[1]:
        raise LinkError(f"simulated flight '{leg.value}', seed {seed}: the script did not run")
    if leg is not Leg.AUTOPILOT and (share := float(np.mean(truth["streamed"]))) < 0.98:
        raise LinkError(
            f"simulated flight '{leg.value}', seed {seed}: the companion flew only "
            f"{100 * share:.0f} % of it"
        )
    grid = np.arange(0.0, script[-1], STEP_S)

    def on_grid(values: Array) -> Array:
        return np.interp(grid, script, values)

    settled = (grid >= SETTLE_S[0]) & (grid <= SETTLE_S[1])

    def position(axis: str) -> Array:
        error = on_grid(truth[axis] - truth[f"ref_{axis}"])
        return np.asarray(error - np.mean(error[settled]))

    return Flown(
        leg=leg,
        seed=seed,
        time_s=grid,
        height=-position("d"),
        lateral=np.column_stack([position("n"), position("e")]),
        tilt=np.column_stack([on_grid(truth[a] - truth[f"need_{a}"]) for a in ("roll", "pitch")]),
        touched_s=float(np.sum(truth["contact"]) * STEP_S),
        phase=truth["phase"][np.maximum(np.searchsorted(script, grid, side="right") - 1, 0)].astype(
            np.intp
        ),
        approach_s=approach_s,
    )
