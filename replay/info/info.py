"""``replay info`` as a function: a log in, what it holds and what it can answer out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from companion.config import PipelineConfig
from companion.mavlink.firmware import Stack, mode_name
from companion.mavlink.samples import Heartbeat
from models.common.errors import LogError
from models.vehicle import Vehicle
from replay.flightlog import FlightLog, Interval, SourceChoice
from replay.info.abilities import Ability, Extent, abilities
from replay.info.contents import Stream, streams
from replay.numbers import rounded
from replay.rerun.report import run
from replay.sources.choose import source_notes, sources_json
from replay.vehicle.airframe import airframe, what_it_is
from replay.vehicle.identity import identity

_BEST = (Extent.YES, Extent.PARTLY, Extent.NO)
_STACKS: dict[int | None, str] = {
    None: "unknown",
    **{stack.value: stack.name.lower() for stack in Stack},
}
_ON_GROUND = 1
"""MAV_LANDED_STATE_ON_GROUND."""


@dataclass(frozen=True, kw_only=True)
class BootInfo:
    """One boot."""

    boot: int
    system: int
    autopilot: str
    start_s: float
    duration_s: float
    armed_s: float
    air_s: float
    """Armed, and not on the ground by the autopilot."""
    modes_s: Mapping[str, float]
    """Seconds by flight mode."""
    parameters: int
    streams: Sequence[Stream]
    judges: Sequence[Ability]
    source: Mapping[str, Mapping[str, Any]]
    """Which instance each quantity was read from, and why, by quantity."""
    read_from: Sequence[str]
    """The same in words, of what came several times."""
    identity: Mapping[str, str]
    """Which vehicle it was, as far as the log says."""
    notes: Sequence[str]


@dataclass(frozen=True, kw_only=True)
class LogInfo:
    """One file."""

    log: str
    bytes: int
    vehicle: str
    boots: Sequence[BootInfo]
    refusal: str = ""
    """Why no diagnosis would take it, where that is known."""
    companion: Mapping[str, Any] | None = None
    """What the pipeline of flight decided; None where it was not asked."""

    def as_json(self) -> Any:
        """Plain numbers, by the names of the fields; ``source`` of the longest boot beside them."""
        longest = max(self.boots, key=lambda boot: boot.duration_s)
        of_longest = {"source": longest.source, "identity": longest.identity}
        return rounded(asdict(self) | of_longest)

    def as_line(self, name: str = "") -> str:
        """One line of a list of logs; ``name`` in the place of the file's own."""
        duration_s = sum(b.duration_s for b in self.boots)
        air_s = sum(b.air_s for b in self.boots)
        of_boots = zip(*(b.judges for b in self.boots), strict=True)
        best = [min(same, key=lambda a: _BEST.index(a.answer)) for same in of_boots]
        can = []
        for a in best:
            if a.answer != Extent.NO:
                can.append(f"{a.question}{' in part' if a.answer is Extent.PARTLY else ''}")
        frame = self.vehicle.partition(", drafted")[0]
        said = (
            f"{name or Path(self.log).name}: {frame}, {duration_s:.0f} s, {air_s:.0f} s in the air"
        )
        if self.refusal:
            return f"{said}; cannot be judged: {self.refusal}"
        return f"{said}; can be judged: {', '.join(can) or 'nothing'}"

    def as_text(self) -> str:
        """A page for a person."""
        out = [f"{Path(self.log).name}: {self.bytes / 1e6:.1f} MB, {len(self.boots)} boot(s)"]
        for boot in self.boots:
            out += _boot_text(boot)
        out += [f"replay diagnose refuses it: {self.refusal}" if self.refusal else self.as_line()]
        out += (
            []
            if self.companion is None
            else [f"companion with '{self.vehicle}' {self.companion['text']}"]
        )
        return "\n".join(out)


def inspect(
    path: Path, logs: Sequence[FlightLog], vehicle: Vehicle | None, refusal: str = ""
) -> LogInfo:
    """What the ``logs`` of one file hold, read as ``vehicle``; what they lack is in the answer.

    ``vehicle``: None where none can be drafted. ``refusal``: why no diagnosis would take it, where that is known.
    """
    boots = [_boot(_with_frame(log), vehicle) for log in logs]
    flown = next((log for log in logs if log.armed), logs[0])
    if vehicle is None:
        name = what_it_is(flown)
    else:
        name = vehicle.name
    return LogInfo(
        log=str(path), bytes=path.stat().st_size, vehicle=name, boots=boots, refusal=refusal
    )


def _with_frame(log: FlightLog) -> FlightLog:
    """The log with its frame among what was chosen."""
    try:
        frame = airframe(log)
    except LogError as error:
        why = str(error).removeprefix(f"{log.path}: ")
        said = SourceChoice(quantity="frame", chosen=what_it_is(log), why=why)
    else:
        said = SourceChoice(quantity="frame", chosen=frame.name, why=frame.source)
    return replace(log, sources=(*log.sources, said))


def unasked(refusal: str) -> dict[str, Any]:
    """The answer of the pipeline of flight where the log shows no vehicle that it could fly."""
    return {"engages": False, "refusal": refusal, "text": f"would not engage: {refusal}"}


def decided(
    path: Path,
    config: PipelineConfig,
    target_system: int | None,
    assumed: Mapping[str, float],
    *,
    quiet: bool,
) -> dict[str, Any]:
    """What the pipeline of flight decides on a log, in seconds and in words."""
    try:
        summary = run(path, config, "", target_system, assumed, quiet=quiet).summary
    except LogError as error:
        why = str(error).removeprefix(f"{path}: ")
        return unasked(why)
    numbers = {key: summary.as_json()[key] for key in ("compensated_s", "duration_s", "refusals_s")}
    engages = numbers["compensated_s"] > 0.0
    if engages:
        verdict = "would have engaged"
    else:
        verdict = "would not have engaged"
    return {
        "engages": engages,
        **numbers,
        "refusal": None,
        "text": f"{verdict}: {summary.as_text()}",
    }


def _boot(log: FlightLog, vehicle: Vehicle | None) -> BootInfo:
    flown = log.between(log.start_s, log.end_s)  # events may be older than the first sample
    armed_s = sum(map(_length, flown.armed))
    ground = [i for i in flown.landed if i.value == _ON_GROUND]
    modes_s: dict[str, float] = {}
    for interval in flown.modes:
        said = Heartbeat(
            t_s=0.0,
            system=1,
            component=1,
            armed=True,
            custom_mode=interval.value,
            autopilot=log.autopilot or 0,
            vehicle_type=0,
        )
        name = mode_name(said)
        modes_s[name] = modes_s.get(name, 0.0) + _length(interval)
    return BootInfo(
        boot=log.boot,
        system=log.system,
        autopilot=_STACKS.get(log.autopilot, "other"),
        start_s=log.start_s,
        duration_s=log.duration_s,
        armed_s=armed_s,
        air_s=armed_s - sum(_overlap_s(i, g) for i in flown.armed for g in ground),
        modes_s=modes_s,
        parameters=len(log.parameters),
        streams=streams(log),
        judges=abilities(log, vehicle),
        source=sources_json(log.sources),
        identity=identity(log).as_json(),
        read_from=source_notes(log.sources),
        notes=log.summary.notes,
    )


def _length(interval: Interval) -> float:
    return interval.end_s - interval.start_s


def _overlap_s(interval: Interval, other: Interval) -> float:
    return max(min(interval.end_s, other.end_s) - max(interval.start_s, other.start_s), 0.0)


def _boot_text(boot: BootInfo) -> list[str]:
    modes = ", ".join(f"{name} {s:.0f} s" for name, s in boot.modes_s.items())
    out = [
        f"boot {boot.boot + 1}: system {boot.system}, {boot.autopilot}, {boot.duration_s:.1f} s, "
        f"armed {boot.armed_s:.1f} s{f' ({modes})' if modes else ''}, {boot.parameters} "
        "parameters",
        f"  {'holds':<26} {'samples':>8} {'rate':>9} {'gaps':>5} {'longest':>8}  from",
    ]
    for s in boot.streams:
        if s.rate_hz is None:
            rate = "once"
        else:
            rate = f"{s.rate_hz:.1f} Hz"
        if s.share_good is None:
            good = ""
        else:
            good = f", {s.share_good:.0%} good"
        out.append(
            f"  {s.name:<26} {s.count:>8} {rate:>9} {s.gaps:>5} {s.longest_gap_s:>6.2f} s  "
            f"{s.source}{good}"
        )
    out += [f"  read from {note}" for note in boot.read_from]
    out.append("  can be judged")
    for a in boot.judges:
        out.append(f"  {a.answer.value:<6} {a.question}: {a.why}")
        if a.answer is not Extent.YES:
            out.append(f"         to change it: {a.change}")
    return [*out, *(f"  note: {note}" for note in boot.notes)]
