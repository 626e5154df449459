"""``replay info`` as a function: a log in, what it holds and what it can answer out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from companion.config import PipelineConfig
from companion.mavlink.firmware import Stack, mode_name
from companion.mavlink.samples import Heartbeat
from companion.telemetry.summary import Summary
from models.choice import NONE, Choice
from models.errors import LogError
from models.frames import AXES
from models.surrogate.fan_surrogate import FanSurrogate
from models.vehicle import Vehicle
from replay.flightlog import FlightLog
from replay.info.abilities import Ability, Answer, abilities
from replay.info.contents import Stream, streams
from replay.logs.formats import read_flightlogs
from replay.rerun.report import run
from replay.residual.record import build_record

_SHOWN_REASONS = 5
"""The longest ones; all are in the JSON."""


@dataclass(frozen=True)
class Judged:
    """What ``replay diagnose`` would take from a boot: seconds and axes, or the line that refuses it."""

    seconds: float
    axes: tuple[str, ...]
    refusal: str
    left_out_s: tuple[tuple[str, float], ...]

    def as_json(self) -> dict[str, Any]:
        """Plain numbers."""
        return {
            "seconds": round(self.seconds, 3),
            "axes": list(self.axes),
            "refusal": self.refusal or None,
            "left_out_s": {reason: round(s, 3) for reason, s in self.left_out_s},
        }


@dataclass(frozen=True)
class BootInfo:
    """One boot."""

    log: FlightLog
    streams: tuple[Stream, ...]
    abilities: tuple[Ability, ...]
    judged: Judged

    @property
    def modes(self) -> dict[str, float]:
        """Seconds by flight mode."""
        out: dict[str, float] = {}
        for interval in self.log.modes:
            heartbeat = Heartbeat(0.0, 1, 1, True, interval.value, 129, self.log.autopilot or 0, 0, 0)
            name = mode_name(heartbeat)
            out[name] = out.get(name, 0.0) + interval.end_s - interval.start_s
        return out

    @property
    def armed_s(self) -> float:
        """Time armed."""
        return sum(i.end_s - i.start_s for i in self.log.armed)

    def as_json(self) -> dict[str, Any]:
        """Plain numbers."""
        log = self.log
        return {
            "boot": log.boot,
            "system": log.system,
            "autopilot": _autopilot(log),
            "start_s": round(log.start_s, 3),
            "duration_s": round(log.duration_s, 3),
            "armed_s": round(self.armed_s, 3),
            "modes_s": {name: round(s, 3) for name, s in self.modes.items()},
            "parameters": len(log.parameters),
            "streams": [s.as_json() for s in self.streams],
            "judges": [a.as_json() for a in self.abilities],
            "diagnose": self.judged.as_json(),
            "notes": list(log.summary.notes),
        }


@dataclass(frozen=True)
class LogInfo:
    """One file."""

    path: Path
    vehicle: str
    boots: tuple[BootInfo, ...]
    flight: Summary | None
    """What the pipeline of flight decided; None where it could not decide."""
    refusal: str
    """Why it could not."""

    def as_json(self) -> dict[str, Any]:
        """Plain numbers."""
        numbers = None if self.flight is None else self.flight.as_json()
        return {
            "log": str(self.path),
            "bytes": self.boots[0].log.summary.bytes,
            "vehicle": self.vehicle,
            "boots": [b.as_json() for b in self.boots],
            "companion": {
                "engages": numbers is not None and numbers["compensated_s"] > 0.0,
                "compensated_s": 0.0 if numbers is None else numbers["compensated_s"],
                "duration_s": 0.0 if numbers is None else numbers["duration_s"],
                "refusals_s": {} if numbers is None else numbers["refusals_s"],
                "refusal": self.refusal or None,
            },
        }

    def as_text(self) -> str:
        """A page for a person."""
        out = [f"{self.path.name}: {self.boots[0].log.summary.bytes / 1e6:.1f} MB, {len(self.boots)} boot(s)"]
        for boot in self.boots:
            out += _boot_text(boot)
        return "\n".join([*out, *_flight_text(self)])


def inspect(
    path: Path,
    vehicle: Vehicle,
    chosen: Choice,
    target_system: int | None = None,
    assumed: Mapping[str, float] | None = None,
) -> LogInfo:
    """Read one log as ``vehicle`` with a model; ``assumed`` parameters hold where the log lacks them.

    Raises LogError where the log cannot be read; what it lacks is in the answer.
    """
    boots = tuple(
        _boot(log, vehicle, None if chosen.name == NONE else chosen.model)
        for log in read_flightlogs(path, target_system)
    )
    config = PipelineConfig(vehicle=vehicle, model=chosen.model, dry_run=True)
    flight, refusal = None, ""
    try:
        flight = run(path, config, "", target_system, assumed).summary
    except LogError as error:
        refusal = _without_path(error, path)
    return LogInfo(path, vehicle.name, boots, flight, refusal)


def _boot(log: FlightLog, vehicle: Vehicle, model: FanSurrogate | None) -> BootInfo:
    try:
        record = build_record(log, vehicle, model, () if model is None else model.effects)
        left_out = tuple((e.reason, e.seconds) for e in record.excluded)
        judged = Judged(record.seconds, tuple(AXES[i] for i in record.axes), "", left_out)
    except LogError as error:
        judged = Judged(0.0, (), _without_path(error, log.path), ())
    return BootInfo(log, streams(log), abilities(log, vehicle), judged)


def _without_path(error: LogError, path: Path) -> str:
    return str(error).removeprefix(f"{path}: ")


def _autopilot(log: FlightLog) -> str:
    if log.autopilot is None:
        return "unknown"
    try:
        return Stack(log.autopilot).name.lower()
    except ValueError:
        return "other"


def _boot_text(boot: BootInfo) -> list[str]:
    log = boot.log
    modes = ", ".join(f"{name} {s:.0f} s" for name, s in boot.modes.items())
    out = [
        f"boot {log.boot + 1}: system {log.system}, {_autopilot(log)}, {log.duration_s:.1f} s, armed "
        f"{boot.armed_s:.1f} s{f' ({modes})' if modes else ''}, {len(log.parameters)} parameters",
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
    judged = boot.judged
    if judged.refusal:
        out.append(f"  replay diagnose refuses it: {judged.refusal}")
    else:
        out.append(f"  replay diagnose judges {judged.seconds:.0f} s of it in {' '.join(judged.axes)}")
        out += [f"    {s:6.1f} s left out: {reason}" for reason, s in judged.left_out_s]
    return [*out, *(f"  note: {note}" for note in log.summary.notes)]


def _flight_text(info: LogInfo) -> list[str]:
    if info.flight is None:
        return [f"companion would not engage: {info.refusal}"]
    numbers = info.flight.as_json()
    done = numbers["compensated_s"]
    verdict = (
        f"would have compensated {done:.1f} of {numbers['duration_s']:.1f} s" if done else "would not have engaged"
    )
    out = [f"companion with '{info.vehicle}' {verdict}"]
    reasons = info.flight.refusals()[:_SHOWN_REASONS]
    return [*out, *(f"  {s:7.1f} s held back: {reason.value}" for reason, s in reasons)]
