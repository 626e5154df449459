"""``replay run``: a recorded log through the pipeline, and what it would have done, in words and as JSON."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tqdm import tqdm

from companion.config import PipelineConfig
from companion.mavlink.samples import Sample
from companion.state.decision import Decision
from companion.telemetry.summary import Summary
from models.common.errors import LogError
from replay.logs.formats import load, suffix_of
from replay.logs.names import called
from replay.logs.timeline import steady
from replay.logs.tlog import read_tlog
from replay.logs.tlog_vehicle import choose
from replay.rerun.harness import Replay
from replay.rerun.log_samples import samples

_NEEDED = {"Heartbeat": "heartbeat", "Attitude": "attitude"}
_WANTED = {"LocalPosition": "position", "Range": "range", "Parameter": "parameters"}
"""Kinds of samples, and the quantities that a log names in its own way."""


@dataclass
class RunReport:
    """What ``replay run`` found."""

    log: Path
    model: str
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
            "vehicle": self.replay.config.vehicle.name,
            "model": self.model,
            "system": self.replay.system,
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
            f"{self.log.name}: {numbers['samples']} samples of system {self.replay.system}, "
            f"{self.boots} boot(s), {100.0 * numbers['share_compensated']:.1f} % of the time "
            "compensated",
        ]
        head += [f"  note: {note}" for note in self.notes]
        return "\n".join([*head, self.summary.as_text()])


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
    played = play(path, config, target_system, assumed or {}, quiet=quiet)
    replay = played.replay
    summary = Summary(dry_run=True)
    for decision in watch(played.decisions):
        summary.add(decision)
    _check(path, replay, summary)
    return RunReport(
        path, model, summary, replay, played.boots(), [*played.notes, *_missing(path, replay)]
    )


@dataclass
class OngoingReplay:
    """A log on its way through the pipeline; ``notes`` and ``boots`` are whole when ``decisions`` has ended."""

    replay: Replay
    decisions: Iterator[Decision]
    notes: list[str]
    boots: Callable[[], int]
    """How many there were up to the newest decision."""


def play(
    path: Path,
    config: PipelineConfig,
    target: int | None,
    assumed: Mapping[str, float],
    *,
    quiet: bool,
) -> OngoingReplay:
    """Begin to replay a log."""
    bar = True if quiet else None  # None: only to a terminal
    if suffix_of(path) == ".tlog":
        log = read_tlog(path)
        choice = choose(log, target)
        replay = Replay(config, choice.system, assumed)
        heard = steady(log, choice.system)
        frames = tqdm(heard.frames(), total=len(log), unit="frame", disable=bar, leave=False)
        notes = [*log.report.notes(), *choice.notes()]
        return OngoingReplay(
            replay, replay.decisions(frames), notes, lambda: replay.intake.clock.boot + 1
        )
    # The others hold no MAVLink: their columns are turned into the samples that a link would have given.
    logs = load(path, target)
    begun: list[int] = []

    def moments() -> Iterator[Sample]:
        for log in logs:
            begun.append(log.boot)
            yield from samples(log)

    replay = Replay(config, logs[0].system, assumed)
    decisions = replay.decisions_on(tqdm(moments(), unit="sample", disable=bar, leave=False))
    notes = list(dict.fromkeys(note for log in logs for note in log.summary.notes))
    return OngoingReplay(replay, decisions, notes, lambda: len(begun))


def _check(path: Path, replay: Replay, summary: Summary) -> None:
    lacking = [called(path, what) for kind, what in _NEEDED.items() if not replay.samples[kind]]
    if lacking:
        raise LogError(
            f"{path}: cannot be replayed without {' and '.join(lacking)}: record them and try again"
        )
    if not summary.decisions:
        raise LogError(f"{path}: no decision came of it: its attitudes carry no usable boot time")


def _missing(path: Path, replay: Replay) -> list[str]:
    """What the log lacks for offsets, by message."""
    out = [called(path, what) for kind, what in _WANTED.items() if not replay.samples[kind]]
    if replay.config.vehicle.telemetered:
        kind = "RotorSpeeds"
        rotors = f"{called(path, 'rotor speeds')} (rotor speeds)"
    else:
        kind = "ServoOutput"
        rotors = f"{called(path, 'outputs')} (this vehicle's rotors are named by servo)"
    out += [] if replay.samples[kind] else [rotors]
    if out:
        return [f"not in the log: {', '.join(out)}"]
    return []
