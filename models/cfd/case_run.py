"""One case from its files to its wrench: mesh, iterate in chunks, judge, march in time where it still moves."""

from __future__ import annotations

import math
import shutil
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from models.cfd import case, foam
from models.cfd.config import Setup
from models.cfd.polars import Blades
from models.cfd.position import FREE, Position, check
from models.common.frames import Array

STATE = "state.npz"
# What the state holds beside the samples.
KEPT = ("iterations", "steps", "cells", "seconds", "start")
# A start from rest may take this many times the iterations: the jet has to grow to the ground first.
FROM_REST = 2
# A swing that has kept this much of its size over two chunks does not die out before the limit.
STILL_SWINGING = 0.7
# A flow that swings is marched this many chunks at least, before its mean is taken: the first is left out, and four
# blocks are needed.
LEAST_CHUNKS = 5
# Powers of the rotor speed with which a state scales to another speed.
SPEED_POWER = {"U": 1, "phi": 1, "p": 2, "k": 2, "omega": 1, "nut": 1}
# With fewer blocks the error of the error is above 40 % (1 / sqrt(2 (n - 1))).
LEAST_BLOCKS = 4
BLOCK_SIZES = 3
UNKNOWN = (math.nan,) * 6


@dataclass(frozen=True, kw_only=True)
class Result:
    """What a case gave. N, N m, corner frame, one fan.

    ``wrench`` (6,) mean over the last two chunks, of a flow that swings on over everything marched but the first chunk;
    ``swing`` (6,) half of its peak-to-peak there; ``drift`` (6,) change of the mean between the halves; ``error`` (6,)
    standard error of the mean by block averages, nan where it is not known. ``parts``: Fz of upper disc, lower disc,
    duct with hub [N]. ``iterated`` (6,), of a flow that was marched in time: mean over the last two chunks of
    iterations before; ``iterated_error`` its swing there or twice its drift, the larger; nan of all others.
    """

    wrench: tuple[float, ...]
    swing: tuple[float, ...]
    drift: tuple[float, ...]
    parts: tuple[float, ...]
    status: str
    """``steady``; ``marched`` (steady in time); ``averaged`` (swings on in time, mean known); ``cycling`` (to and fro,
    mean not known); ``drifting`` (slowly on); ``diverged``."""
    cells: int
    iterations: int
    steps: int
    seconds: float
    start: str
    note: str = ""
    error: tuple[float, ...] = UNKNOWN
    iterated: tuple[float, ...] = UNKNOWN
    iterated_error: tuple[float, ...] = UNKNOWN


@dataclass(frozen=True)
class Row:
    """One finished case."""

    position: Position
    result: Result


def iteration_limit(setup: Setup, start: str) -> int:
    """Most steady iterations of a case that started from there."""
    return setup.solver.limit * (FROM_REST if start == "rest" else 1)


def compute(
    folder: Path,
    setup: Setup,
    position: Position,
    blades: Blades,
    neighbour: Path | None = None,
    *,
    march: bool = True,
) -> Result:
    """Compute one case in ``folder``, going on from what an earlier, interrupted run left there.

    ``neighbour``: folder of a finished case to start from (its state mapped onto this mesh). ``march`` False: leave a
    case that still swings after the steady limit as ``cycling``; a later call with True goes on in time from there.
    """
    check(setup, position)
    run = _Case(folder, setup, position)
    try:
        run.prepare(blades, neighbour)
        run.iterate()
        if march and run.status() == "cycling":
            run.march()
        return run.result(run.status())
    except foam.SolverError as error:
        return run.result("diverged", str(error))


class _Case:
    """State of one case: its samples and how far it came; kept in the folder after every chunk.

    ``samples`` (n, 10): time, wrench (6) and lift by part (3) of every state that was written.
    """

    def __init__(self, folder: Path, setup: Setup, position: Position) -> None:
        self.folder = folder
        self.setup = setup
        self.position = position
        self.samples = np.empty((0, 10))
        self.iterations = self.steps = self.cells = 0
        self.seconds = 0.0
        self.start = "rest"
        if (folder / STATE).exists():
            with np.load(folder / STATE) as kept:
                self.samples = kept["samples"]
                for name in KEPT:
                    setattr(self, name, kept[name].item())

    def prepare(self, blades: Blades, neighbour: Path | None) -> None:
        """Mesh and start fields, unless they are there."""
        if self.cells:
            # A run that was stopped within a chunk leaves states that may be cut short.
            reached = self.iterations + self.steps * self.setup.solver.time_step_s
            states = foam.times(self.folder)
            later = [state for state in states if float(state) > reached + 1e-6]
            foam.forget(self.folder, later)
            return
        shutil.rmtree(self.folder, ignore_errors=True)
        case.write(self.folder, self.setup, self.position, blades)
        foam.run(self.folder, "blockMesh")
        foam.run(self.folder, "topoSet")
        for what in ("writeCellVolumes", "writeCellCentres"):
            foam.run(self.folder, "postProcess", "-func", what, "-time", "0")
        self.cells = len(foam.read_field(self.folder / "0/V"))
        if neighbour is not None and neighbour.is_dir():
            states = foam.times(neighbour)
            if states:
                self._start_from(neighbour, states[-1])
        self._keep()

    def _start_from(self, neighbour: Path, state: str) -> None:
        """Map a state of another case onto this mesh; copy and scale it where only the speed differs."""
        self.start = neighbour.name
        mesh, _, rpm = neighbour.name.rpartition("_n")
        own_mesh, _, _ = self.folder.name.rpartition("_n")
        if mesh == own_mesh:
            faster = self.position.rpm / float(rpm)
            for name, power in SPEED_POWER.items():
                field = self.folder / "0" / name
                shutil.copy(neighbour / state / name, field)
                foam.scale_field(field, faster**power)
            return
        case.put(self.folder / "system/mapFieldsDict", "patchMap ();\ncuttingPatches ();\n")
        foam.run(self.folder, "mapFields", str(neighbour.resolve()), "-sourceTime", state)

    def iterate(self) -> None:
        """Steady iterations until the wrench stands still, or the limit."""
        solver = self.setup.solver
        limit = iteration_limit(self.setup, self.start)
        while self.steps == 0 and not self._enough() and self.iterations < limit and self.finite():
            chunk = solver.chunk if self.iterations else solver.start
            end = self.iterations + chunk
            self._advance(end, steady=True)
            self.iterations = end
            self._keep()

    def march(self) -> None:
        """Go on in time from the newest state, until the wrench stands still or its mean is known."""
        solver = self.setup.solver
        while self.steps < solver.march_limit and self.finite():
            if self.steps and (self.settled() or self.averaged()):
                break
            end = self.iterations + (self.steps + solver.march_chunk) * solver.time_step_s
            self._advance(end, steady=False)
            self.steps += solver.march_chunk
            self._keep()

    def _advance(self, end: float, *, steady: bool) -> None:
        began = time.monotonic()
        case.control(self.folder, self.setup, end, steady=steady)
        foam.run(self.folder, "simpleFoam" if steady else "pimpleFoam")
        self._collect()
        self.seconds += time.monotonic() - began

    def _collect(self) -> None:
        """Turn the states written since the last chunk into samples; keep only the newest on disk."""
        surfaces = foam.surface_loads(self.folder)
        states = foam.times(self.folder)
        volume = foam.read_field(self.folder / "0/V")
        centre = foam.read_field(self.folder / "0/C")
        newest = self.samples[:, 0].max(initial=0.0)
        for state in states:
            at = float(state)
            if at <= newest:
                continue
            surface = surfaces[min(surfaces, key=lambda other: abs(other - at))]
            # The air's force and moment on each disc: the solver's source per volume and density, summed.
            discs = np.zeros((2, 6))
            for name, zone, _, _ in case.sources(self.position):
                source = foam.read_field(self.folder / state / f"{name}:rotorForce")
                force = self.setup.air.density_kg_m3 * source * volume[:, None]
                moment = np.cross(centre, force)
                disc = case.DISCS.index(zone[:-1])
                discs[disc] += [*force.sum(axis=0), *moment.sum(axis=0)]
            total = surface + discs.sum(axis=0)
            parts = np.array([*discs[:, 2], surface[2]])
            if not self.position.swirl:  # only one half is meshed
                total = 2 * total * [1, 0, 1, 0, 1, 0]
                parts = 2 * parts
            self.samples = np.vstack([self.samples, [at, *total, *parts]])
        foam.forget(self.folder, states[:-1])

    # Judging

    def _last(self, chunks: int) -> Array:
        """Samples (n, 6) of the last ``chunks`` chunks."""
        solver = self.setup.solver
        per_chunk = 8 if self.steps else solver.chunk // solver.sample_every
        return self.samples[-chunks * per_chunk :, 1:7]

    def _window(self) -> Array:
        """Samples (n, 6) of a flow that swings on, for its mean: all chunks but the first, two at least."""
        return self._last(max(2, self.steps // self.setup.solver.march_chunk - 1))

    def _scale(self) -> Array:
        rotor = self.setup.rotor
        lift = rotor.hover_lift_n * (self.position.rpm / rotor.hover_rpm) ** 2
        return lift * np.array([1.0] * 3 + [self.setup.fan.radius_m] * 3)

    def _allowed(self, of_hover: float, of_effect: float) -> Array:
        """The larger (6,) of these shares of hover lift and of what the case adds to it, nothing in free air."""
        out = of_hover * self._scale()
        last = self._last(2)
        if len(last) and self.position.place != FREE:
            effect = np.abs(last.mean(axis=0) - self._scale() * [0, 0, 1, 0, 0, 0])
            out = np.maximum(out, of_effect * effect)
        return out

    def _allowed_swing(self) -> Array:
        return self._allowed(self.setup.converged.swing, self.setup.converged.swing_of_effect)

    def settled(self) -> bool:
        """True where the wrench stands still over the last two chunks."""
        if self.steps and self.steps < 2 * self.setup.solver.march_chunk:
            return False
        drift, swing = _moves(self._last(2))
        limit = self.setup.converged
        most = limit.drift_free if self.position.place == FREE else limit.drift
        still = drift <= self._allowed(most, limit.drift_of_effect)
        calm = swing <= self._allowed_swing()
        return bool(np.all(still & calm))

    def averaged(self) -> bool:
        """True where a flow that swings on in time has a mean that is known: blocks enough and a small error."""
        if self.steps < LEAST_CHUNKS * self.setup.solver.march_chunk:
            return False
        allowed = self._allowed(self.setup.converged.mean, self.setup.converged.drift_of_effect)
        return bool(np.all(error_of_mean(self._window()) <= allowed))

    def _enough(self) -> bool:
        """True where more steady iterations would change nothing: settled, or going round in circles."""
        if self.settled():
            return True
        last = self._last(4)
        half = len(last) // 2
        if half < 2 or self.iterations < 2 * self.setup.solver.start:
            return False
        before = np.ptp(last[:half], axis=0) / 2
        now = np.ptp(last[half:], axis=0) / 2
        lasts = now > STILL_SWINGING * before
        return bool(np.any(lasts & (now > self._allowed_swing())))

    def finite(self) -> bool:
        """True while the wrench is of a size a fan can have."""
        return bool(np.all(np.abs(self.samples[-1:, 1:7]) < 10 * self._scale()))

    def status(self) -> str:
        if not self.finite():
            return "diverged"
        if self.settled():
            return "marched" if self.steps else "steady"
        _, swing = _moves(self._last(2))
        if np.all(swing <= self._allowed_swing()):
            return "drifting"
        if self.averaged():
            return "averaged"
        return "cycling"

    def result(self, status: str, note: str = "") -> Result:
        """What the case gave; NaN without a sample."""
        if len(self.samples) == 0:
            self.samples = np.full((2, 10), math.nan)
        moving = status in ("averaged", "cycling")
        if moving:
            last = self._window()
        else:
            last = self._last(2)
        drift, swing = _moves(last)
        more: dict[str, tuple[float, ...]] = {}
        if moving and self.steps:
            more["error"] = _floats(error_of_mean(last))
        if self.steps:
            before = self.samples[self.samples[:, 0] <= self.iterations, 1:7]
            before = before[-2 * self.setup.solver.chunk // self.setup.solver.sample_every :]
            drift_before, swing_before = _moves(before)
            more["iterated"] = _floats(before.mean(axis=0))
            more["iterated_error"] = _floats(np.maximum(swing_before, 2 * drift_before))
        return Result(
            wrench=_floats(last.mean(axis=0)),
            swing=_floats(swing),
            drift=_floats(drift),
            parts=_floats(self.samples[-len(last) :, 7:].mean(axis=0)),
            status=status,
            cells=self.cells,
            iterations=self.iterations,
            steps=self.steps,
            seconds=self.seconds,
            start=self.start,
            note=note,
            **more,
        )

    def _keep(self) -> None:
        target = self.folder / STATE
        scratch = target.with_suffix(".tmp.npz")
        kept = {name: getattr(self, name) for name in KEPT}
        np.savez(scratch, samples=self.samples, **kept)
        scratch.replace(target)


def _moves(samples: Array) -> tuple[Array, Array]:
    """Change of the mean from the first half to the second, and half of the peak-to-peak, (6,) each."""
    if len(samples) < 2:
        return np.full(6, np.inf), np.full(6, np.inf)
    half = len(samples) // 2
    drift = np.abs(samples[half:].mean(axis=0) - samples[:half].mean(axis=0))
    return drift, np.ptp(samples, axis=0) / 2


def _floats(values: Array) -> tuple[float, ...]:
    return tuple(float(v) for v in values)


def error_of_mean(samples: Array) -> Array:
    """Standard error (k,) of the mean of correlated samples (n, k), in time order; nan for fewer than four.

    Means of blocks, whose size doubles as long as ``LEAST_BLOCKS`` of them are left (Flyvbjerg and Petersen 1989).
    Short blocks know nothing of the swing, long ones are few: the largest estimate of the ``BLOCK_SIZES`` longest
    counts.
    """
    if len(samples) < LEAST_BLOCKS:
        return np.full(samples.shape[1:], np.nan)
    found = []
    size = 1
    while len(samples) // size >= LEAST_BLOCKS:
        blocks = len(samples) // size
        # What does not fill a block is left out at the start, where the run is least settled.
        kept = samples[len(samples) - blocks * size :]
        means = kept.reshape(blocks, size, -1).mean(axis=1)
        found.append(means.std(axis=0, ddof=1) / np.sqrt(blocks))
        size *= 2
    out: Array = np.max(found[-BLOCK_SIZES:], axis=0)
    return out
