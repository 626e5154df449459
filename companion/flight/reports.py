"""Whom a decision is told to: summary, watchers, live page, ground station and terminal."""

from __future__ import annotations

import math

from companion.config import PipelineConfig
from companion.flight.options import FlightOptions
from companion.flight.pilot import Pilot
from companion.flight.requests import Requests
from companion.mavlink.link import Arrivals
from companion.page.snapshot import snapshot
from companion.state.decision import Decision
from companion.state.pipeline_state import PipelineState
from companion.telemetry.summary import Summary


class Reports:
    """Told of every decision, after its setpoint has left."""

    def __init__(
        self,
        *,
        config: PipelineConfig,
        pilot: Pilot,
        requests: Requests,
        arrivals: Arrivals,
        options: FlightOptions,
    ) -> None:
        self.summary = Summary(config.dry_run)
        self._config = config
        self._pilot = pilot
        self._requests = requests
        self._arrivals = arrivals
        self._options = options
        self._excused_until_s = -math.inf

    def excuse(self, until_s: float) -> None:
        """Until then this computer's own stall explains what came late."""
        self._excused_until_s = until_s

    def tell(self, state: PipelineState, decision: Decision) -> None:
        """A decision, and the state that it left."""
        self.summary.add(decision)
        if self._options.watch is not None:
            self._options.watch(decision)
        now_s = self._arrivals.now_s()
        if self._options.page is not None:
            self._options.page.offer(
                lambda: snapshot(decision, state, self._config, self._requests.streams, now_s)
            )
        excused = now_s < self._excused_until_s
        self._pilot.hear_decision(state, decision, excused=excused)
