"""All cases of a data set: which, in what order, from which start; resumable, one solver a core."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

from models.cfd import foam, polars, table
from models.cfd.case_run import Result, Row, compute, iteration_limit
from models.cfd.config import Setup
from models.cfd.polars import Section
from models.cfd.position import Position, check, near
from models.common.errors import ConfigError

RESULT = "result.csv"
FAN = "fan.json"


def plan(setup: Setup, model: str) -> list[Position]:
    """Every case of ``half`` or ``full`` models, most useful first; refuses positions that cannot be meshed."""
    if model == "half":
        cases = _plan_half(setup)
    else:
        cases = _plan_full(setup)
    order = list(dict.fromkeys(cases))
    for position in order:
        check(setup, position)
    return order


def _plan_half(setup: Setup) -> Iterator[Position]:
    """Half models: free air; wall without ground; ground without wall; corners coarse to fine; other speeds; other
    meshes; second starts where the flow may have two states.

    Heights go up: near the ground the jet opens to a hollow cone around air that rises to the hub, a state that starts
    from above reach only after very many iterations.
    """
    c = setup.campaign
    inf = math.inf
    case = partial(Position, rpm=c.rpm)
    yield case(h=inf, d=inf)
    for d in sorted(c.d, reverse=True):
        yield case(h=inf, d=d)
    for h in sorted(c.h):
        yield case(h=h, d=inf)
    for step_h, step_d in ((4, 4), (2, 2), (2, 1), (1, 1)):
        # From far to near, so that a start is at hand.
        distances = sorted(c.d[::step_d], reverse=True)
        for h, d in itertools.product(sorted(c.h[::step_h]), distances):
            yield case(h=h, d=d)
        if (step_h, step_d) == (2, 2):
            for rpm, (h, d) in itertools.product(c.other_rpm, c.rpm_at):
                yield Position(h=h, d=d, rpm=rpm)
            for level, (h, d) in itertools.product(sorted(c.grid_levels), c.grid_at):
                yield case(h=h, d=d, level=level)
    for h, d in (*c.rpm_at, *c.grid_at, *c.full_at):
        yield case(h=h, d=d)
    for h, d in c.again_from_far:
        yield case(h=h, d=d, approach="far")
    for h, d in c.again_from_wall:
        yield case(h=h, d=d, approach="wall")


def _plan_full(setup: Setup) -> Iterator[Position]:
    """Full models: half of a spread of positions, other speeds, the other half, other meshes, every position."""
    c = setup.campaign
    on_mesh = partial(Position, swirl=True, level=c.full_level)
    case = partial(on_mesh, rpm=c.rpm)
    spread = [case(h=h, d=d) for h, d in c.full_at]
    first = len(spread) // 2
    yield from spread[:first]
    for rpm, (h, d) in itertools.product(c.other_rpm, c.full_other_rpm_at):
        yield on_mesh(h=h, d=d, rpm=rpm)
    yield from spread[first:]
    for level, (h, d) in itertools.product(c.full_grid_levels, c.full_grid_at):
        yield case(h=h, d=d, level=level)
    for half in _plan_half(setup):
        yield case(h=half.h, d=half.d)
    for h, d in c.full_again_from_far:
        yield case(h=h, d=d, approach="far")


def rows(folder: Path, positions: Sequence[Position]) -> list[Row]:
    """All finished cases, in the order of the plan. Raises ModelError for a result of another version."""
    out = []
    for position in positions:
        path = folder / position.key / RESULT
        if path.exists():
            for row in table.read(path):
                out.append(Row(position, row.result))
    return out


def start_for(position: Position, finished: Sequence[Row]) -> Position | None:
    """The finished case whose state is nearest: the same mesh at another speed, else the nearest position."""
    able = []
    for row in finished:
        if row.result.status != "diverged" and row.position.model == position.model:
            able.append(row.position)
    same = [p for p in able if replace(p, rpm=position.rpm) == position]
    if same:
        return min(same, key=lambda p: abs(p.rpm - position.rpm))
    able = [p for p in able if p.rpm == position.rpm and p.approach == "near"]
    if position.approach == "wall":
        able = [p for p in able if p.h == position.h and p.d < position.d]
    elif position.approach == "far":
        able = [p for p in able if p.place == (math.inf, position.d)]
    here = near(position.place)

    def apart(p: Position) -> float:
        return math.dist(near(p.place), here) + 0.01 * abs(p.level - position.level)

    return min(able, key=apart, default=None)


def run(
    folder: Path,
    setup: Setup,
    section: Section,
    positions: Sequence[Position],
    jobs: int = 1,
    progress: Callable[[str, int, int], None] = lambda *_: None,
) -> None:
    """Compute what is not there yet: first every case in steady iterations, then in time those that still move.

    ``jobs`` threads of this process, each with one solver. A case that is stopped from outside, by Ctrl-C or by
    somebody who kills its solver, keeps what it has reached; the next run goes on from there.
    """
    foam.require()
    _claim(folder, setup)
    done = {row.position: row for row in rows(folder, positions)}
    pool = ThreadPoolExecutor(jobs)

    def submit(position: Position, marching: bool) -> Future[Result]:
        start = start_for(position, list(done.values()))
        blades = polars.blades(setup, position.rpm, section, swirl=position.swirl)
        neighbour = None if start is None else folder / start.key
        case = folder / position.key
        return pool.submit(compute, case, setup, position, blades, neighbour, march=marching)

    try:
        for marching in (False, True):
            what = "cases in time" if marching else "cases"
            waiting = iter([p for p in positions if _wanted(done.get(p), setup, marching)])
            running: dict[Future[Result], Position] = {}
            while True:
                for position in itertools.islice(waiting, jobs - len(running)):
                    running[submit(position, marching)] = position
                if not running:
                    break
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    position = running.pop(future)
                    if not isinstance(future.exception(), foam.StoppedError):
                        done[position] = Row(position, future.result())
                        _store(folder, done[position])
                        progress(what, len(done), len(positions))
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _claim(folder: Path, setup: Setup) -> None:
    """Make the folder this fan's own; refuse one that holds cases of another."""
    parts = {name: asdict(getattr(setup, name)) for name in ("fan", "rotor", "air", "mesh")}
    mine = json.dumps(parts, indent=1)
    path = folder / FAN
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not path.exists():
            path.write_text(mine, encoding="utf-8")
        known = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"work folder {folder}: {path} cannot be written or read ({error})"
        ) from None
    if known != mine:
        raise ConfigError(
            f"work folder {folder}: holds cases of another fan or mesh ({path}); use another folder"
        )


def _wanted(row: Row | None, setup: Setup, marching: bool) -> bool:
    """Steady round: what has no result, or drifted when a lower limit stopped it. Marching round: what swung then."""
    if row is None:
        return not marching
    result = row.result
    if marching:
        return result.status == "cycling" and result.steps < setup.solver.march_limit
    cut_short = result.steps == 0 and result.iterations < iteration_limit(setup, result.start)
    return result.status == "drifting" and cut_short


def _store(folder: Path, row: Row) -> None:
    target = folder / row.position.key / RESULT
    target.parent.mkdir(exist_ok=True)
    scratch = target.with_suffix(".tmp")
    table.write(scratch, [row])
    scratch.replace(target)
