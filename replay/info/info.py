"""``replay info`` as a function: a log in, what it holds and what it can answer out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from companion.config import PipelineConfig
from companion.mavlink.firmware import Stack, mode_name
from companion.mavlink.samples import Heartbeat
from models.choice import Choice
from models.errors import LogError
from models.vehicle import Vehicle
from replay.flightlog import FlightLog, Interval
from replay.info.abilities import Ability, Answer, abilities
from replay.info.contents import Stream, joined, streams
from replay.info.engagement import Engagement, engagement, refused
from replay.info.judged import Judge, Judged
from replay.logs.formats import read_pieces
from replay.logs.progress import with_progress

_BEST = (Answer.YES, Answer.PARTLY, Answer.NO)
_ON_GROUND = 1
"""MAV_LANDED_STATE_ON_GROUND."""


@dataclass(frozen=True)
class BootInfo:
    """One boot, or a piece of a long one."""

    boot: int
    system: int
    autopilot: str
    start_s: float
    duration_s: float
    armed_s: float
    air_s: float
    """Armed, and not on the ground by the autopilot."""
    modes: Mapping[str, float]
    """Seconds by flight mode."""
    parameters: int
    streams: tuple[Stream, ...]
    abilities: tuple[Ability, ...]
    judged: Judged | None
    """What a diagnosis takes of it; None of a piece, and where it was not asked."""
    notes: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """Plain numbers."""
        return {
            "boot": self.boot,
            "system": self.system,
            "autopilot": self.autopilot,
            "start_s": round(self.start_s, 3),
            "duration_s": round(self.duration_s, 3),
            "armed_s": round(self.armed_s, 3),
            "air_s": round(self.air_s, 3),
            "modes_s": {name: round(s, 3) for name, s in self.modes.items()},
            "parameters": self.parameters,
            "streams": [s.as_json() for s in self.streams],
            "judges": [a.as_json() for a in self.abilities],
            "diagnose": None if self.judged is None else self.judged.as_json(),
            "notes": list(self.notes),
        }


@dataclass(frozen=True)
class LogInfo:
    """One file."""

    path: Path
    bytes: int
    vehicle: str
    boots: tuple[BootInfo, ...]
    flight: Engagement | None
    """What the pipeline of flight decided; None where it could not decide or was not asked."""
    refusal: str
    """Why it could not; empty where it was not asked."""

    def as_json(self) -> dict[str, Any]:
        """Plain numbers."""
        return {
            "log": str(self.path),
            "bytes": self.bytes,
            "vehicle": self.vehicle,
            "boots": [b.as_json() for b in self.boots],
            "companion": self._companion(),
        }

    def _companion(self) -> dict[str, Any] | None:
        if self.flight is not None:
            return self.flight.as_json()
        return refused(self.refusal) if self.refusal else None

    def as_line(self) -> str:
        """One line of a list of logs."""
        duration_s, air_s = sum(b.duration_s for b in self.boots), sum(b.air_s for b in self.boots)
        of_boots = zip(*(b.abilities for b in self.boots), strict=True)
        best = [min(same, key=lambda a: _BEST.index(a.answer)) for same in of_boots]
        can = [f"{a.question}{' in part' if a.answer is Answer.PARTLY else ''}" for a in best if a.answer != Answer.NO]
        frame = self.vehicle.partition(", drafted")[0]
        said = f"{self.path.name}: {frame}, {duration_s:.0f} s, {air_s:.0f} s in the air"
        return f"{said}; can be judged: {', '.join(can) or 'nothing'}"

    def as_text(self) -> str:
        """A page for a person."""
        out = [f"{self.path.name}: {self.bytes / 1e6:.1f} MB, {len(self.boots)} boot(s)"]
        for boot in self.boots:
            out += _boot_text(boot)
        if self.flight is None and not self.refusal:
            return "\n".join(out)
        if self.flight is None:
            return "\n".join([*out, f"companion would not engage: {self.refusal}"])
        verdict, *reasons = self.flight.as_text()
        return "\n".join([*out, f"companion with '{self.vehicle}' {verdict}", *reasons])


def inspect(
    path: Path,
    vehicle: Vehicle,
    chosen: Choice,
    target_system: int | None = None,
    assumed: Mapping[str, float] | None = None,
    *,
    refusal: str = "",
    judge: bool = True,
    decide: bool = True,
    quiet: bool = True,
) -> LogInfo:
    """Read one log as ``vehicle`` with a model; ``assumed`` parameters hold where the log lacks them.

    ``refusal``: why no diagnosis would take it, where that is known already. ``judge``: ask what a diagnosis takes.
    ``decide``: run the pipeline of flight.
    Raises LogError where the log cannot be read; what it lacks is in the answer.
    """
    boots: list[BootInfo] = []
    judged = Judge(vehicle, chosen.judged, refusal) if judge or refusal else None
    for piece in with_progress(path, read_pieces(path, target_system), "reading", quiet=quiet):
        log = piece.own()
        if judged is not None:
            judged.add(log)
        one = _boot(log, vehicle)
        if boots and boots[-1].boot == one.boot:
            boots[-1] = _joined(boots[-1], one)
        else:
            boots.append(one)
    if judged is not None:
        boots = [replace(boot, judged=judged.of(boot.boot)) for boot in boots]
    config = PipelineConfig(vehicle=vehicle, model=chosen.model, dry_run=True)
    size = path.stat().st_size
    if not decide:
        return LogInfo(path, size, vehicle.name, tuple(boots), None, "")
    flight, why = None, ""
    try:
        length_s, armed = sum(b.duration_s for b in boots), any(b.armed_s > 0.0 for b in boots)
        flight = engagement(path, config, length_s, target_system, assumed, armed=armed, quiet=quiet)
    except LogError as error:
        why = str(error).removeprefix(f"{path}: ")
    return LogInfo(path, size, vehicle.name, tuple(boots), flight, why)


def _boot(log: FlightLog, vehicle: Vehicle) -> BootInfo:
    armed = [replace(i, start_s=max(i.start_s, log.start_s), end_s=min(i.end_s, log.end_s)) for i in log.armed]
    armed_s = sum(_overlap_s(i, log) for i in log.armed)
    ground = [i for i in log.landed if i.value == _ON_GROUND]
    return BootInfo(
        boot=log.boot,
        system=log.system,
        autopilot=_autopilot(log),
        start_s=log.start_s,
        duration_s=log.duration_s,
        armed_s=armed_s,
        air_s=armed_s - sum(_overlap_s(i, g) for i in armed for g in ground),
        modes=_modes(log),
        parameters=len(log.parameters),
        streams=streams(log),
        abilities=abilities(log, vehicle),
        judged=None,
        notes=log.summary.notes,
    )


def _modes(log: FlightLog) -> dict[str, float]:
    out: dict[str, float] = {}
    for interval in log.modes:
        name = mode_name(Heartbeat(0.0, 1, 1, True, interval.value, 129, log.autopilot or 0, 0, 0))
        out[name] = out.get(name, 0.0) + _overlap_s(interval, log)
    return out


def _overlap_s(interval: Interval, other: Interval | FlightLog) -> float:
    """Time of an interval that is in another, or in the log: events may be older than the first sample."""
    return max(min(interval.end_s, other.end_s) - max(interval.start_s, other.start_s), 0.0)


def _joined(first: BootInfo, then: BootInfo) -> BootInfo:
    """Two pieces of a boot as one; every question is answered as by the piece that answers it better."""
    answers = [
        min(pair, key=lambda a: _BEST.index(a.answer)) for pair in zip(first.abilities, then.abilities, strict=True)
    ]
    later = {(s.name, s.source): s for s in then.streams}
    both = [joined(s, later.pop(key)) if (key := (s.name, s.source)) in later else s for s in first.streams]
    return replace(
        first,
        start_s=first.start_s,
        duration_s=then.start_s + then.duration_s - first.start_s,
        armed_s=first.armed_s + then.armed_s,
        air_s=first.air_s + then.air_s,
        modes={m: first.modes.get(m, 0.0) + then.modes.get(m, 0.0) for m in {**first.modes, **then.modes}},
        streams=(*both, *later.values()),
        abilities=tuple(answers),
        notes=tuple(dict.fromkeys((*first.notes, *then.notes))),
    )


def _autopilot(log: FlightLog) -> str:
    if log.autopilot is None:
        return "unknown"
    try:
        return Stack(log.autopilot).name.lower()
    except ValueError:
        return "other"


def _boot_text(boot: BootInfo) -> list[str]:
    modes = ", ".join(f"{name} {s:.0f} s" for name, s in boot.modes.items())
    out = [
        f"boot {boot.boot + 1}: system {boot.system}, {boot.autopilot}, {boot.duration_s:.1f} s, armed "
        f"{boot.armed_s:.1f} s{f' ({modes})' if modes else ''}, {boot.parameters} parameters",
        f"  {'holds':<26} {'samples':>8} {'rate':>9} {'gaps':>5} {'longest':>8}  from",
    ]
    for s in boot.streams:
        rate = "once" if s.rate_hz is None else f"{s.rate_hz:.1f} Hz"
        good = "" if s.share_good is None else f", {s.share_good:.0%} good"
        out.append(f"  {s.name:<26} {s.count:>8} {rate:>9} {s.gaps:>5} {s.longest_gap_s:>6.2f} s  {s.source}{good}")
    out.append("  can be judged")
    for a in boot.abilities:
        out.append(f"  {a.answer.value:<6} {a.question}: {a.why}")
        if a.answer is not Answer.YES:
            out.append(f"         to change it: {a.change}")
    out += [] if boot.judged is None else boot.judged.as_text()
    return [*out, *(f"  note: {note}" for note in boot.notes)]
