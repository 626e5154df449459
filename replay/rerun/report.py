"""``replay run``: a recorded log through the pipeline, and what it would have done, in words and as JSON."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from companion.config import PipelineConfig
from companion.pipeline import Decision
from companion.telemetry.summary import Summary
from models.errors import LogError
from replay.logs.formats import read_flightlogs, suffix_of
from replay.logs.tlog_blocks import TlogFile
from replay.rerun.harness import Replay

_NEEDED = {
    "Heartbeat": "HEARTBEAT of the autopilot (component 1)",
    "Attitude": "ATTITUDE or ATTITUDE_QUATERNION",
}
_WANTED = {
    "LocalPosition": "LOCAL_POSITION_NED",
    "Range": "DISTANCE_SENSOR (or RANGEFINDER)",
    "Parameter": "PARAM_VALUE",
}


@dataclass
class RunReport:
    """What ``replay run`` found."""

    log: Path
    vehicle: str
    model: str
    system: int
    summary: Summary
    replay: Replay
    boots: int
    notes: list[str] = field(default_factory=list)

    def as_json(self) -> dict[str, Any]:
        """Plain numbers. ``share_compensated`` is of the time with decisions."""
        numbers = self.summary.as_json()
        duration = numbers["duration_s"]
        return {
            "log": str(self.log),
            "vehicle": self.vehicle,
            "model": self.model,
            "system": self.system,
            "boots": self.boots,
            "samples": sum(self.replay.samples.values()),
            "samples_by_kind": dict(sorted(self.replay.samples.items())),
            "share_compensated": numbers["compensated_s"] / duration if duration > 0.0 else 0.0,
            **numbers,
            "notes": self.notes,
        }

    def as_text(self) -> str:
        """A few lines for a person."""
        numbers = self.as_json()
        head = [
            f"{self.log.name}: {numbers['samples']} samples of system {self.system}, {self.boots} boot(s), "
            f"{100.0 * numbers['share_compensated']:.1f} % of the time compensated",
        ]
        head += [f"  note: {note}" for note in self.notes]
        body = self.summary.as_text().splitlines()
        numbered = next((i for i, line in enumerate(body) if line.startswith("  thrust ")), len(body))
        body.insert(numbered, f"  {'':<10} {'min':>8} {'mean':>8} {'max':>8}")
        return "\n".join([*head, *body])


def run(
    path: Path,
    config: PipelineConfig,
    model: str,
    target_system: int | None = None,
    assumed: Mapping[str, float] | None = None,
    *,
    quiet: bool = True,
    watch: Callable[[Iterable[Decision]], Iterable[Decision]] = iter,
) -> RunReport:
    """Replay one log; ``assumed`` parameters hold where the log gives none. ``watch`` may look at every decision.

    Raises LogError in one line where it cannot be read or lacks what every decision needs.
    """
    assumed = assumed or {}
    if suffix_of(path) == ".tlog":
        log = TlogFile(path)
        choice = log.census.choose(path, target_system)
        replay = Replay(config, choice.system, assumed)
        notes = [*log.report.notes(), *choice.notes()]
        decisions = replay.decisions(_with_progress(log, quiet))
        summary = _summarised(watch(decisions))
        boots = replay.intake.clock.boot + 1
        system = choice.system
    else:
        # These hold no MAVLink: their columns are turned into the samples that a link would have given.
        from replay.rerun.log_samples import samples_of

        logs = read_flightlogs(path, target_system)
        replay = Replay(config, logs[0].system, assumed)
        notes = [note for one in logs for note in one.summary.notes]
        summary = _summarised(watch(replay.decisions_on(sample for one in logs for sample in samples_of(one))))
        boots, system = len(logs), logs[0].system
    _check(path, replay, summary)
    notes += _missing(config, replay)
    return RunReport(path, config.vehicle.name, model, system, summary, replay, boots, notes)


def _summarised(decisions: Iterable[Decision]) -> Summary:
    summary = Summary(dry_run=True)
    for decision in decisions:
        summary.add(decision)
    return summary


def _with_progress(log: TlogFile, quiet: bool) -> Iterator[tuple[int, bytes]]:
    from tqdm import tqdm

    # disable=None: only to a terminal.
    yield from tqdm(log.frames(), total=len(log), unit="frame", disable=True if quiet else None, leave=False)


def _check(path: Path, replay: Replay, summary: Summary) -> None:
    lacking = [what for kind, what in _NEEDED.items() if not replay.samples[kind]]
    if lacking:
        raise LogError(f"{path}: cannot be replayed without {' and '.join(lacking)}: record them and try again")
    if not summary.decisions:
        raise LogError(f"{path}: no decision came of it: its attitudes carry no usable boot time")


def _missing(config: PipelineConfig, replay: Replay) -> list[str]:
    """What the log lacks for offsets, by message."""
    out = [what for kind, what in _WANTED.items() if not replay.samples[kind]]
    if config.vehicle.telemetered and not replay.samples["RotorSpeeds"]:
        out.append("ESC_TELEMETRY_x_TO_y, ESC_STATUS or RPM (rotor speeds)")
    elif not config.vehicle.telemetered and not replay.samples["ServoOutput"]:
        out.append("SERVO_OUTPUT_RAW (the rotors of this vehicle file are named by servo)")
    return [f"not in the log: {', '.join(out)}"] if out else []
