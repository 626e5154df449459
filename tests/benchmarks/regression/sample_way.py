"""The way of one sample through the code: how many calls of ``step`` enter another file, and how many go up a layer.

    python tests/benchmarks regression.sample_way LOG.tlog [--vehicle FILE.toml] [--edges]

A reader who follows one sample looks into another file at every such call. ``jumps``: pairs of files, each counted
once. A call goes up a layer where the file that it enters imports, by way of others too, the file that it comes from.
By kind of sample: medians over a recorded flight, and the longest way. ``--edges`` lists the calls of the longest one.
"""

from __future__ import annotations

import ast
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from statistics import median
from types import FrameType
from typing import Any

import command_line

import models
from companion.config import PipelineConfig
from companion.mavlink.message_filter import UNREAD, Intake
from companion.mavlink.message_table import LAYOUTS
from companion.mavlink.samples import Parameter, Sample
from companion.mavlink.wire_frames import cut
from companion.pipeline import initial_state, step
from companion.vehicles import default_vehicle
from models.vehicle import load_vehicle
from replay.logs.tlog import read_tlog

ROOT = Path(models.__file__).resolve().parents[1]
PACKAGES = ("companion", "models")
Edge = tuple[str, str]
"""The file that calls, and the one that is entered."""


@cache
def imported(file: str) -> frozenset[str]:
    """Files of the packages that a file imports when it is loaded."""
    out = set()
    for node in ast.parse((ROOT / file).read_text("utf-8")).body:
        if isinstance(node, ast.ImportFrom) and node.module:
            for name in ("", *(alias.name for alias in node.names)):
                module = Path(*node.module.split("."), name)
                for path in (module.with_suffix(".py"), module / "__init__.py"):
                    if (ROOT / path).is_file():
                        out.add(path.as_posix())
    return frozenset(out)


@cache
def below(file: str) -> frozenset[str]:
    """Files that a file imports, by way of others too."""
    found: set[str] = set()
    open_ = [file]
    while open_:
        new = imported(open_.pop()) - found
        found |= new
        open_ += new
    return frozenset(found)


class Way:
    """Calls between files of the packages, by ``sys.setprofile``; generated code and libraries are passed through."""

    def __init__(self) -> None:
        self.edges: list[Edge] = []

    def __call__(self, frame: FrameType, event: str, _: Any) -> None:
        """Take note of a call."""
        if event != "call":
            return
        entered = _file_of(frame)
        back = frame.f_back
        while back is not None and _file_of(back) is None:
            back = back.f_back
        caller = None if back is None else _file_of(back)
        if entered and caller and entered != caller:
            self.edges.append((caller, entered))

    @property
    def up(self) -> int:
        """Calls that go up a layer."""
        return sum(caller in below(entered) for caller, entered in self.edges)


@cache
def _inside(name: str) -> str | None:
    path = Path(name)
    if not path.is_relative_to(ROOT):
        return None
    inside = path.relative_to(ROOT)
    if inside.parts[0] not in PACKAGES:
        return None
    return inside.as_posix()


def _file_of(frame: FrameType) -> str | None:
    """The file of the packages that a frame runs in."""
    return _inside(frame.f_code.co_filename)


def samples(log: Path) -> Iterator[Sample]:
    """What a flight heard, with the parameter without which nothing is sent."""
    intake = Intake(None, UNREAD)
    allowed = False
    for arrival, raw in read_tlog(log).frames():
        frame = cut(raw, 0)
        sample = intake.sample(frame, arrival) if frame.id in LAYOUTS else None
        if sample is None:
            continue
        yield sample
        if not allowed:
            allowed = True
            yield Parameter(sample.t_s, sample.system, sample.component, "GUID_OPTIONS", 8.0)


def ways(log: Path, config: PipelineConfig) -> dict[str, list[Way]]:
    """The way of every sample of a flight, by kind."""
    state = initial_state(config)
    out: dict[str, list[Way]] = defaultdict(list)
    for sample in samples(log):
        way = Way()
        sys.setprofile(way)
        state, decision = step(state, sample, config)
        sys.setprofile(None)
        kind = type(sample).__name__
        if decision is not None and decision.command is not None:
            kind += ", with a setpoint"
        out[kind].append(way)
    return out


def main() -> int:
    """A row for every kind of sample."""
    p = command_line.parser(__doc__)
    p.add_argument("log", type=Path)
    p.add_argument("--vehicle", type=Path)
    p.add_argument("--edges", action="store_true")
    a = p.parse_args()
    vehicle = load_vehicle(a.vehicle) if a.vehicle else default_vehicle()
    found = ways(a.log, PipelineConfig(vehicle=vehicle, model=models.load()))
    print(f"{'sample':32s}{'number':>8s}{'calls':>8s}{'jumps':>8s}{'up':>6s}{'longest':>9s}")
    for kind, own in sorted(found.items()):
        calls = median(len(way.edges) for way in own)
        jumps = median(len(set(way.edges)) for way in own)
        up = median(way.up for way in own)
        longest = max(len(way.edges) for way in own)
        print(f"{kind:32s}{len(own):8d}{calls:8.0f}{jumps:8.0f}{up:6.0f}{longest:9d}")
    if a.edges:
        every = [way for own in found.values() for way in own]
        longest = max(every, key=lambda way: len(way.edges))
        for (caller, entered), count in Counter(longest.edges).most_common():
            direction = "up" if caller in below(entered) else ""
            print(f"{count:4d} {direction:3s}{caller} -> {entered}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
