"""Feeds recorded frames through the pipeline of flight: same intake, same step, same decisions, bit for bit.

Takes any iterable of (arrival stamp [us], frame bytes), so that a live loop can be checked against its own recording.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from companion.config import PipelineConfig
from companion.mavlink.message_filter import UNREAD, Intake
from companion.mavlink.message_table import LAYOUTS
from companion.mavlink.samples import Heartbeat, Parameter, Sample
from companion.mavlink.wire_frames import cut
from companion.pipeline import initial_state, step
from companion.state.decision import Decision
from companion.state.pipeline_state import PipelineState


@dataclass
class Replay:
    """A run of the pipeline over recorded input. Iterate ``decisions`` once; the rest fills as it goes."""

    config: PipelineConfig
    system: int | None = None
    """None: the first autopilot heard, as in flight."""
    assumed: Mapping[str, float] = field(default_factory=dict)
    """Parameters taken as given until the recording gives them: a log cannot be asked."""
    samples: Counter[str] = field(default_factory=Counter)
    """How many samples of each kind reached the pipeline."""

    def __post_init__(self) -> None:
        self.intake = Intake(self.system, UNREAD)

    def decisions(self, frames: Iterable[tuple[int, bytes]]) -> Iterator[Decision]:
        """The decisions on a recorded link."""
        yield from self.decisions_on(self._sampled(frames))

    def decisions_on(self, samples: Iterable[Sample]) -> Iterator[Decision]:
        """The decisions on samples that are on the boot axis already."""
        state: PipelineState = initial_state(self.config)
        for sample in self._with_assumed(samples):
            self.samples[type(sample).__name__] += 1
            state, decision = step(state, sample, self.config)
            if decision is not None:
                yield decision

    def _with_assumed(self, samples: Iterable[Sample]) -> Iterator[Sample]:
        heard: set[str] = set()
        for sample in samples:
            yield sample
            if isinstance(sample, Parameter):
                heard.add(sample.name)
            elif isinstance(sample, Heartbeat):
                # At every heartbeat, because a reboot forgets.
                for name, value in self.assumed.items():
                    if name not in heard:
                        yield Parameter(sample.t_s, sample.system, sample.component, name, value)

    def _sampled(self, frames: Iterable[tuple[int, bytes]]) -> Iterator[Sample]:
        for arrival_us, raw in frames:
            frame = cut(raw, 0)
            if frame.id in LAYOUTS:
                sample = self.intake.sample(frame, arrival_us)
                if sample is not None:
                    yield sample
