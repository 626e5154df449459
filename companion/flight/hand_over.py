"""Never leave a tilt behind: where the autopilot is to stay when the companion stops, hangs or dies."""

from __future__ import annotations

import math
from collections.abc import Callable

from companion.config import Base, PipelineConfig
from companion.control.wall_guard import level_wall
from companion.flight.options import FlightOptions
from companion.flight.outbox import Outbox
from companion.flight.timers import Timers
from companion.last_word import PERIOD_S, SILENT, LastWord, Word
from companion.mavlink import AUTOPILOT_COMPONENT
from companion.mavlink.firmware import Stack, mode_name, takes_setpoints
from companion.mavlink.link import Arrivals, Link
from companion.mavlink.message_filter import Intake
from companion.mavlink.message_table import LAYOUTS
from companion.mavlink.samples import Heartbeat
from companion.mavlink.setpoints import Command, PositionCommand, encode
from companion.mavlink.wire_frames import Frame
from companion.pipeline import hand_over_place, level_command
from companion.state.pipeline_state import PipelineState

_LASTS_S = 1.0
"""For so long the autopilot is sent the place to stay at: PX4's controller has settled before the stream ends."""
_LASTS_BESIDE_A_WALL_S = 6.0
"""Until PX4's integral balances the wall's pull: MPC_XY_VEL_P_ACC / MPC_XY_VEL_I_ACC is 4.5 s. Without that it sags
towards the wall, where the pull is larger, as soon as the stream ends. ArduPilot keeps the place that it was sent."""
_PERIOD_S = 0.05
"""As often as attitudes bring setpoints, or a little less."""
_LAST_WORD_PERIOD_S = 0.1
"""Three in the silence after which the second process speaks (last_word.SILENCE_S)."""
_DEAF_S = 0.3
_DEAF_UNTIL_S = 1.5
_DEAF_PERIOD_S = 0.1
"""Without attitudes for so long, and until then, the autopilot is sent a place: it would keep the last tilt."""


def holds(state: PipelineState, config: PipelineConfig) -> bool:
    """Whether our own hold flies the vehicle."""
    return state.held.hold is not None and not config.dry_run and config.base is Base.HOLD


def place_to_stay(state: PipelineState, config: PipelineConfig) -> PositionCommand | None:
    """Where the autopilot should stay without us; None where no hold flies, or where it takes no places."""
    heartbeat = state.heard.heartbeat
    if not holds(state, config) or state.held.hold is None or heartbeat is None:
        return None
    if mode_name(heartbeat) == "GUIDED_NOGPS":
        return None
    return PositionCommand(
        state.t_s, hand_over_place(state, state.held.hold), state.held.hold.target.yaw
    )


def hand_over_lasts_s(state: PipelineState) -> float:
    """How long the autopilot is sent the place to stay at."""
    px4 = state.heard.stack is Stack.PX4
    if px4 and level_wall(state.air.disturbance) is not None:
        return _LASTS_BESIDE_A_WALL_S
    return _LASTS_S


class HandOver:
    """What the autopilot is told while nothing is heard, by the second process, and at the end."""

    def __init__(
        self,
        *,
        config: PipelineConfig,
        link: Link,
        arrivals: Arrivals,
        outbox: Outbox,
        intake: Intake,
        options: FlightOptions,
    ) -> None:
        self._config = config
        self._link = link
        self._arrivals = arrivals
        self._outbox = outbox
        self._intake = intake
        self._options = options
        self._timers = Timers()
        self._last_word: LastWord | None = None
        self._attitude_s = -math.inf
        self._hears_attitudes = False
        """Whether one came since ``_attitude_s`` was last set."""

    def open(self) -> None:
        """Start the second process, where one is wanted and can speak for us."""
        wanted = self._options.last_word and self._config.base is Base.HOLD
        if wanted and self._link.signatures is None and self._link.fileno >= 0:
            self._last_word = LastWord(self._link.fileno, self._link.endpoint)

    def close(self) -> None:
        """End the second process without a word."""
        if self._last_word is not None:
            self._last_word.close()

    def word(self, state: PipelineState) -> Word:
        """What the second process says if this one is killed now; nothing where others fly."""
        place = place_to_stay(state, self._config)
        if place is None:
            return SILENT
        return Word(
            frame=self._link.frame(*encode(place, self._outbox.system)),
            times=round(hand_over_lasts_s(state) / PERIOD_S),
        )

    def renew(self, now_s: float, state: PipelineState) -> None:
        """Keep the second process quiet, and tell it the newest place."""
        if self._last_word is not None and self._timers.due("renew", _LAST_WORD_PERIOD_S, now_s):
            self._last_word.renew(self.word(state), self._link.peers)

    def hear_attitude(self) -> None:
        """An attitude came: it brings a setpoint by itself."""
        self._hears_attitudes = True

    def stay_while_deaf(self, now_s: float, state: PipelineState) -> None:
        """Send a place while attitudes fail to come."""
        if self._hears_attitudes:
            self._hears_attitudes = False
            self._attitude_s = now_s
            return
        place = place_to_stay(state, self._config)
        deaf = _DEAF_S <= now_s - self._attitude_s <= _DEAF_UNTIL_S
        if place is not None and deaf and self._timers.due("place", _DEAF_PERIOD_S, now_s):
            self._outbox.command(place)

    def finish(self, state: PipelineState, alive: Callable[[float], None]) -> None:
        """Send the autopilot the place to stay at, until its own controller has settled.

        Where it takes no places (GUIDED_NOGPS), a level setpoint at hover thrust. ``alive`` is called with the time.
        """
        if not holds(state, self._config):
            return
        command: Command = place_to_stay(state, self._config) or level_command(state, self._config)
        lasts_s = hand_over_lasts_s(state)
        start = self._arrivals.now_s()
        while True:
            now = self._arrivals.now_s()
            alive(now)
            self.renew(now, state)
            self._outbox.command(command)
            if now - start >= lasts_s:
                return
            self._arrivals.clock.wait([], _PERIOD_S)
            for arrival_us, frame in self._link.drain():
                self._outbox.record(arrival_us, frame.raw)
                if self._taken_away(arrival_us, frame):
                    return

    def _taken_away(self, arrival_us: int, frame: Frame) -> bool:
        """Whether this says that the vehicle is disarmed, or in a mode in which it is not ours."""
        if frame.id in LAYOUTS:
            sample = self._intake.sample(frame, arrival_us)
        else:
            sample = None
        if not isinstance(sample, Heartbeat) or sample.component != AUTOPILOT_COMPONENT:
            return False
        return not (sample.armed and takes_setpoints(sample))
