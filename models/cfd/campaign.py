"""All cases of a data set: which, in what order, from which start; resumable, one solver a core."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from dataclasses import asdict, dataclass
from pathlib import Path

from models.cfd import foam
from models.cfd.case_run import Result, compute, iteration_limit
from models.cfd.config import Setup
from models.cfd.polars import Section, Station, stations
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
        """True where the numbers stand still."""
        return self.result.status in ("steady", "marched")


def plan(setup: Setup) -> list[Position]:
    """Every case of the campaign, most useful first; refuses positions that cannot be meshed before any work.

    Free air; wall without ground; ground without wall; corners coarse to fine; other speeds; other meshes; swirl;
    second starts where the flow may have two states. Heights go up: near the ground the jet opens to a hollow cone
    around air that rises to the hub, a state that starts from above reach only after very many iterations.
    """
    c = setup.campaign
    inf = math.inf
    order: dict[Position, None] = {}

    def add(*positions: Position) -> None:
        order.update(dict.fromkeys(positions))

    add(Position(inf, inf, c.rpm))
    add(*(Position(inf, d, c.rpm) for d in sorted(c.d, reverse=True)))
    add(*(Position(h, inf, c.rpm) for h in sorted(c.h)))
    for step_h, step_d in ((4, 4), (2, 2), (2, 1), (1, 1)):
        for h in sorted(c.h[::step_h]):
            # From far to near, so that a start is at hand.
            add(*(Position(h, d, c.rpm) for d in sorted(c.d[::step_d], reverse=True)))
        if (step_h, step_d) == (2, 2):
            add(*(Position(h, d, rpm) for rpm in c.other_rpm for h, d in c.rpm_at))
            add(*(Position(h, d, c.rpm, level=level) for level in sorted(c.grid_levels) for h, d in c.grid_at))
            add(*(Position(h, d, c.rpm, swirl=True) for h, d in c.swirl_at))
    add(*(Position(h, d, c.rpm) for h, d in (*c.rpm_at, *c.grid_at, *c.swirl_at)))
    add(*(Position(h, d, c.rpm, approach="far") for h, d in c.again_from_far))
    add(*(Position(h, d, c.rpm, approach="wall") for h, d in c.again_from_wall))
    for position in order:
        check(setup, position)
    return list(order)


def load(folder: Path, position: Position) -> Row | None:
    """The finished case, or None."""
    path = folder / position.key / RESULT
    if not path.exists():
        return None
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        for name in ("wrench", "swing", "drift", "parts"):
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
    able = [r.position for r in finished if r.result.status != "diverged" and r.position.swirl == position.swirl]
    same = [
        p for p in able if p.place == position.place and p.level == position.level and p.approach == position.approach
    ]
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
    executor: Executor | None = None,
    jobs: int = 1,
    *,
    march: bool = True,
    progress: Callable[[str, int, int], None] = lambda *_: None,
    finished: Callable[[Row], None] = lambda _: None,
) -> None:
    """Compute what is not there yet: first every case in steady iterations, then in time those that still move.

    ``executor`` None: ``jobs`` threads of this process, each with one solver. A case that is stopped from outside goes
    on from its last chunk; after that it is marked ``killed``. Ctrl-C keeps what every case has reached.
    """
    foam.require()
    _claim(folder, setup)
    tables: dict[float, tuple[Station, ...]] = {}
    own = executor is None
    pool = executor or ThreadPoolExecutor(jobs)
    done = {row.position: row for row in rows(folder, positions)}
    try:
        for marching in (False, True) if march else (False,):
            todo = iter([p for p in positions if _wanted(done.get(p), setup, marching)])
            running: dict[Future[Result], tuple[Position, Position | None]] = {}
            killed: dict[Position, int] = {}
            while True:
                for position in _fill(todo, jobs - len(running)):
                    if position.rpm not in tables:
                        tables[position.rpm] = stations(setup, position.rpm, section)
                    start = start_for(position, list(done.values()))
                    future = _submit(pool, folder, setup, position, tables[position.rpm], start, marching)
                    running[future] = position, start
                if not running:
                    break
                ready, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in ready:
                    position, start = running.pop(future)
                    try:
                        result = future.result()
                    except foam.StoppedError as error:
                        killed[position] = killed.get(position, 0) + 1
                        if killed[position] < KILLED_LIMIT:
                            again = _submit(pool, folder, setup, position, tables[position.rpm], start, marching)
                            running[again] = position, start
                            continue
                        result = _marked(str(error))
                    done[position] = Row(position, result)
                    _store(folder, position, result)
                    progress("cases in time" if marching else "cases", len(done), len(positions))
                    finished(done[position])
    finally:
        if own:
            pool.shutdown(wait=False, cancel_futures=True)


def _claim(folder: Path, setup: Setup) -> None:
    """Make the folder this fan's own; refuse one that holds cases of another fan or mesh."""
    mine = {name: asdict(getattr(setup, name)) for name in ("fan", "rotor", "air", "mesh")}
    text = json.dumps(mine, indent=1)
    path = folder / FAN
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not path.exists():
            path.write_text(text, encoding="utf-8")
        elif path.read_text(encoding="utf-8") != text:
            raise ConfigError(f"work folder {folder}: holds cases of another fan or mesh ({path}); use another folder")
    except OSError as error:
        raise ConfigError(f"work folder {folder}: cannot be written ({error.strerror})") from None


def _wanted(row: Row | None, setup: Setup, marching: bool) -> bool:
    """Steady round: what has no result, or drifted when a lower limit stopped it. Marching round: what swung then."""
    if row is None:
        return not marching
    result = row.result
    if marching:
        return result.status == "cycling" and result.steps == 0
    cut_short = result.steps == 0 and result.iterations < iteration_limit(setup, result.start)
    return result.status == "killed" or (result.status == "drifting" and cut_short)


def _fill(todo: Iterator[Position], free: int) -> list[Position]:
    return [p for _, p in zip(range(free), todo, strict=False)]


def _submit(
    pool: Executor,
    folder: Path,
    setup: Setup,
    position: Position,
    table: tuple[Station, ...],
    start: Position | None,
    march: bool,
) -> Future[Result]:
    neighbour = folder / start.key if start is not None else None
    return pool.submit(compute, folder / position.key, setup, position, table, neighbour, march=march)


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
