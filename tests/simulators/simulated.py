"""Simulated flights with all that the built-in vehicle lacks: either autopilot, its link and pilot, GPS or vision."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from arducopter import ArduCopter
from arducopter_link import ArduCopterLink
from gps import GpsEstimator
from px4 import Px4
from px4_link import Px4Link
from vision import VisionEstimator

from companion.sim.autopilot import Mode
from companion.sim.flight import SimulatedFlight
from companion.sim.pilot import ScriptedPilot
from companion.sim.scenario import Scenario
from models.common.errors import ConfigError
from models.vehicle import Vehicle


def simulated(
    vehicle: Vehicle, scenario: Scenario, seed: int, *, px4: bool = False, vision: bool = False,
    parameters: Mapping[str, float] | None = None, **more: Any,
) -> SimulatedFlight:  # fmt: skip
    """A flight. ``parameters`` are the pilot's own settings of the autopilot, over its defaults; ``vision``: no GPS."""
    flight = SimulatedFlight(
        vehicle, scenario, seed, autopilot=Px4 if px4 else ArduCopter,
        estimator=VisionEstimator if vision else GpsEstimator, **more,
    )  # fmt: skip
    for name, value in (parameters or {}).items():
        if not flight.autopilot.set_parameter(name, value):
            raise ConfigError(f"simulated autopilot: no parameter '{name}'")
    return flight


def is_px4(flight: SimulatedFlight) -> bool:
    """Which of both flies."""
    return isinstance(flight.autopilot, Px4)


def link_of(flight: SimulatedFlight, send: Callable[[bytes], None]) -> ArduCopterLink:
    """The link of its autopilot."""
    return (Px4Link if is_px4(flight) else ArduCopterLink)(flight, send)


class Nobody(ScriptedPilot):
    """No pilot: somebody on the link commands the vehicle."""

    link = ArduCopterLink

    def step(self) -> None:
        """Nothing."""


class Px4Pilot(ScriptedPilot):
    """PX4 takes off in a mode of its own; OFFBOARD once somebody's stream has been running for a second."""

    link = Px4Link
    take_off_mode = Mode.LOITER

    def _wait(self) -> None:
        super()._wait()
        pilot = self._flight.autopilot
        if pilot.mode is Mode.LOITER and pilot.stream_runs:
            self.set_mode(Mode.GUIDED)
