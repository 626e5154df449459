"""All cases of a data set: which, in what order, from which start; resumable, one solver a core."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from models.cfd import foam, polars
from models.cfd.case_run import Result, compute, iteration_limit
from models.cfd.config import Setup
from models.cfd.polars import Blades, Section
from models.cfd.position import Position, check, near
from models.errors import ConfigError

RESULT = "result.json"
FAN = "fan.json"
# Stops from outside after which a case is marked and the campaign goes on without it.
KILLED_LIMIT = 2


@dataclass(frozen=True)
class Row:
    """One finished case."""

    position: Position
    result: Result

    @property
    def usable(self) -> bool:
        """True where the numbers stand still, or their mean is known."""
        return self.result.status in ("steady", "marched", "averaged")


CAMPAIGNS = ("half", "full")
"""What a work folder can hold: half models or full models."""


def plan(setup: Setup, model: str) -> list[Position]:
    """Every case of one campaign, most useful first; refuses positions that cannot be meshed before any work."""
    order = dict.fromkeys((_plan_half if model == "half" else _plan_full)(setup))
    for position in order:
        check(setup, position)
    return list(order)


def _plan_half(setup: Setup) -> Iterator[Position]:
    """Half models: free air; wall without ground; ground without wall; corners coarse to fine; other speeds; other
    meshes; second starts where the flow may have two states.

    Heights go up: near the ground the jet opens to a hollow cone around air that rises to the hub, a state that starts
    from above reach only after very many iterations.
    """
    c, inf = setup.campaign, math.inf
    yield Position(inf, inf, c.rpm)
    yield from (Position(inf, d, c.rpm) for d in sorted(c.d, reverse=True))
    yield from (Position(h, inf, c.rpm) for h in sorted(c.h))
    for step_h, step_d in ((4, 4), (2, 2), (2, 1), (1, 1)):
        for h in sorted(c.h[::step_h]):
            # From far to near, so that a start is at hand.
            yield from (Position(h, d, c.rpm) for d in sorted(c.d[::step_d], reverse=True))
        if (step_h, step_d) == (2, 2):
            yield from (Position(h, d, rpm) for rpm in c.other_rpm for h, d in c.rpm_at)
            yield from (Position(h, d, c.rpm, level=level) for level in sorted(c.grid_levels) for h, d in c.grid_at)
    yield from (Position(h, d, c.rpm) for h, d in (*c.rpm_at, *c.grid_at, *c.full_at))
    yield from (Position(h, d, c.rpm, approach="far") for h, d in c.again_from_far)
    yield from (Position(h, d, c.rpm, approach="wall") for h, d in c.again_from_wall)


def _plan_full(setup: Setup) -> Iterator[Position]:
    """Full models: half of a spread of positions, other speeds, the other half, other meshes, every position."""
    c = setup.campaign
    positions = [Position(h, d, c.rpm, swirl=True, level=c.full_level) for h, d in c.full_at]
    first = len(positions) // 2
    yield from positions[:first]
    for rpm in c.other_rpm:
        yield from (Position(h, d, rpm, swirl=True, level=c.full_level) for h, d in c.full_other_rpm_at)
    yield from positions[first:]
    for level in c.full_grid_levels:
        yield from (Position(h, d, c.rpm, swirl=True, level=level) for h, d in c.full_grid_at)
    yield from (Position(p.h, p.d, c.rpm, swirl=True, level=c.full_level) for p in _plan_half(setup))
    again = c.full_again_from_far
    yield from (Position(h, d, c.rpm, swirl=True, level=c.full_level, approach="far") for h, d in again)


def load(folder: Path, position: Position) -> Row | None:
    """The finished case, or None."""
    path = folder / position.key / RESULT
    if not path.exists():
        return None
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        for name in ("wrench", "swing", "drift", "parts", "error", "iterated", "iterated_error"):
            if name in content:
                content[name] = tuple(float("nan") if v is None else float(v) for v in content[name])
        return Row(position, Result(**content))
    except (ValueError, TypeError, KeyError) as error:
        raise ConfigError(
            f"{path}: is not a result of this version ({error}); delete it to compute the case again"
        ) from None


def rows(folder: Path, positions: Sequence[Position]) -> list[Row]:
    """All finished cases, in the order of the plan."""
    return [row for p in positions if (row := load(folder, p)) is not None]


def start_for(position: Position, finished: Sequence[Row]) -> Position | None:
    """The finished case whose state is nearest: the same mesh at another speed, else the nearest position."""
    able = [
        r.position
        for r in finished
        if r.result.status not in ("diverged", "killed") and r.position.model == position.model
    ]
    same = [p for p in able if (p.place, p.level, p.approach) == (position.place, position.level, position.approach)]
    if same:
        return min(same, key=lambda p: abs(p.rpm - position.rpm))
    able = [p for p in able if p.rpm == position.rpm and p.approach == "near"]
    if position.approach == "wall":
        able = [p for p in able if p.h == position.h and p.d < position.d]
    elif position.approach == "far":
        able = [p for p in able if p.place == (math.inf, position.d)]
    elif position.approach == "rest":
        able = []
    return min(able, key=lambda p: _apart(p, position), default=None)


def _apart(a: Position, b: Position) -> float:
    return math.dist(near(a.place), near(b.place)) + 0.01 * abs(a.level - b.level)


def run(
    folder: Path,
    setup: Setup,
    section: Section,
    positions: Sequence[Position],
    jobs: int = 1,
    *,
    march: bool = True,
    progress: Callable[[str, int, int], None] = lambda *_: None,
    finished: Callable[[Row], None] = lambda _: None,
) -> None:
    """Compute what is not there yet: first every case in steady iterations, then in time those that still move.

    ``jobs`` threads of this process, each with one solver. A case that is stopped from outside goes on from its last
    chunk; after that it is marked ``killed``. Ctrl-C keeps what every case has reached.
    """
    foam.require()
    _claim(folder, setup, positions)
    pool = ThreadPoolExecutor(jobs)
    done = {row.position: row for row in rows(folder, positions)}

    def keep(row: Row, what: str) -> None:
        done[row.position] = row
        _store(folder, row.position, row.result)
        progress(what, len(done), len(positions))
        finished(row)

    try:
        for marching in (False, True) if march else (False,):
            what = "cases in time" if marching else "cases"
            todo = [p for p in positions if _wanted(done.get(p), setup, marching)]
            work = _Work(pool, folder, setup, section, marching)
            for row in work.through(todo, done, jobs):
                keep(row, what)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


_Job = tuple[Position, Position | None]
"""A case and the finished one that it starts from."""


@dataclass
class _Work:
    """One round of a campaign: hands cases to the workers and takes them up again where a solver was stopped."""

    pool: ThreadPoolExecutor
    folder: Path
    setup: Setup
    section: Section
    marching: bool
    tables: dict[tuple[float, bool], Blades] = field(default_factory=dict)
    killed: dict[Position, int] = field(default_factory=dict)

    def through(self, todo: Sequence[Position], done: Mapping[Position, Row], jobs: int) -> Iterator[Row]:
        """Compute ``todo``, ``jobs`` at a time, each from the nearest case in ``done``; yields as they finish."""
        waiting = iter(todo)
        running: dict[Future[Result], _Job] = {}
        while True:
            for position in itertools.islice(waiting, jobs - len(running)):
                job = position, start_for(position, list(done.values()))
                running[self._submit(job)] = job
            if not running:
                return
            ready, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in ready:
                job = running.pop(future)
                try:
                    result = future.result()
                except foam.StoppedError as error:
                    again = self._again(job)
                    if again is not None:
                        running[again] = job
                        continue
                    result = _marked(str(error))
                yield Row(job[0], result)

    def _again(self, job: _Job) -> Future[Result] | None:
        """The case taken up again, or None where it was stopped too often."""
        position, _ = job
        self.killed[position] = self.killed.get(position, 0) + 1
        return self._submit(job) if self.killed[position] < KILLED_LIMIT else None

    def _submit(self, job: _Job) -> Future[Result]:
        position, start = job
        kind = position.rpm, position.swirl
        if kind not in self.tables:
            self.tables[kind] = polars.blades(self.setup, position.rpm, self.section, swirl=position.swirl)
        neighbour = self.folder / start.key if start is not None else None
        target = self.folder / position.key
        return self.pool.submit(
            compute, target, self.setup, position, self.tables[kind], neighbour, march=self.marching
        )


def _claim(folder: Path, setup: Setup, positions: Sequence[Position]) -> None:
    """Make the folder this fan's and this model's own; refuse one that holds cases of another."""
    model = next((name for name in CAMPAIGNS for p in positions if p.model.startswith(name)), CAMPAIGNS[0])
    mine = _content(setup, model)
    path = folder / FAN
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not path.exists():
            path.write_text(json.dumps(mine, indent=1), encoding="utf-8")
        known = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"work folder {folder}: cannot be written ({error.strerror})") from None
    except ValueError as error:
        raise ConfigError(f"work folder {folder}: {path} is not JSON ({error})") from None
    there = model_of(folder)
    if there != model:
        raise ConfigError(
            f"work folder {folder}: holds {there} models, not {model} models ({path}); use another folder"
        )
    if known != mine:
        raise ConfigError(f"work folder {folder}: holds cases of another fan or mesh ({path}); use another folder")


def model_of(folder: Path) -> str:
    """What a work folder holds, one of ``CAMPAIGNS``; ``half`` where there is nothing yet."""
    path = folder / FAN
    try:
        known = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {"model": CAMPAIGNS[0]}
    except (OSError, ValueError) as error:
        raise ConfigError(f"work folder {folder}: {path} cannot be read ({error})") from None
    model = known.get("model") if isinstance(known, dict) else None
    if model not in CAMPAIGNS:
        raise ConfigError(f"work folder {folder}: {path} names no model of {', '.join(CAMPAIGNS)}")
    return str(model)


def _content(setup: Setup, model: str) -> dict[str, Any]:
    """What the cases of a folder have in common, as it comes back from JSON."""
    sections = ("fan", "rotor", "air", "mesh")
    mine: dict[str, Any] = {"model": model} | {name: asdict(getattr(setup, name)) for name in sections}
    content: dict[str, Any] = json.loads(json.dumps(mine))
    return content


def _wanted(row: Row | None, setup: Setup, marching: bool) -> bool:
    """Steady round: what has no result, or drifted when a lower limit stopped it. Marching round: what swung then."""
    if row is None:
        return not marching
    result = row.result
    if marching:
        return result.status == "cycling" and result.steps < setup.solver.march_limit
    cut_short = result.steps == 0 and result.iterations < iteration_limit(setup, result.start)
    return result.status == "killed" or (result.status == "drifting" and cut_short)


def _marked(note: str) -> Result:
    nothing = (float("nan"),) * 6
    return Result(nothing, nothing, nothing, nothing[:3], "killed", 0, 0, 0, 0.0, "", note)


def _store(folder: Path, position: Position, result: Result) -> None:
    target = folder / position.key / RESULT
    target.parent.mkdir(exist_ok=True)
    scratch = target.with_suffix(".tmp")
    content = {k: [_number(x) for x in v] if isinstance(v, tuple) else v for k, v in asdict(result).items()}
    scratch.write_text(json.dumps(content, indent=1), encoding="utf-8")
    scratch.replace(target)


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
