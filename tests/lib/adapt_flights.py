"""Flights of the built-in vehicle in which something changes that the model does not know: payload, wind, a ceiling, a
sagging battery, and what must teach nothing: lying ranges, dead telemetry, bumps, hands, landings.

A change is a function that is called at every physics step with the flight and the boot time; it may keep its own
state. What is true of a size is computed from the body, never from the model under test alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from lockstep_faults import FaultyLockstep

from companion.adaptation.adaptation import Adaptation
from companion.config import PipelineConfig
from companion.sim.autopilot import Mode
from companion.sim.flight import SimulatedFlight
from companion.sim.pilot import ScriptedPilot
from companion.sim.sensors import OUT_OF_RANGE_M, RangeSensor
from companion.state.decision import Decision
from models.common.frames import GRAVITY
from models.vehicle import Rangefinder, Vehicle

Change = Callable[[SimulatedFlight, float], None]
Force = Callable[[SimulatedFlight, float], tuple[float, float, float]]


class Pilot(ScriptedPilot):
    """The scripted pilot, with changes; ``land_s``: boot time at which it lands, ``end_s``: at which all is over."""

    def __init__(
        self,
        world: FaultyLockstep,
        changes: tuple[Change, ...],
        end_s: float,
        land_s: float = math.inf,
    ) -> None:
        super().__init__(world.flight, world.link, companion=True)
        self._changes = changes
        self._end_s = end_s
        self._land_s = land_s

    @property
    def over(self) -> bool:
        """At its time, or with its script."""
        return self._flight.time_s >= self._end_s or super().over

    def step(self) -> None:
        """Call once per physics step."""
        now = self._flight.time_s
        if now >= self._land_s:
            self._land_s = math.inf
            self.set_mode(Mode.LAND)
        super().step()
        for change in self._changes:
            change(self._flight, now)


@dataclass
class Watch:
    """What the sizes were over the flight; stands where a FaultyLockstep takes an auditor."""

    every_s: float = 0.2
    seen: list[tuple[float, Adaptation]] = field(default_factory=list)
    decisions: list[Decision] = field(default_factory=list)

    def decision(self, decision: Decision) -> None:
        """Keep it where due."""
        if decision.adaptation is None:
            return
        if not self.seen or decision.t_s - self.seen[-1][0] >= self.every_s:
            self.seen.append((decision.t_s, decision.adaptation))
            self.decisions.append(decision)

    def frame(self, arrival_us: int, frame: object) -> None:
        """Not looked at."""

    def size(
        self, name: str, after_s: float = 0.0, before_s: float = math.inf
    ) -> list[tuple[float, float, float]]:
        """(boot time, value, sd) of one size."""
        return [
            (t, known.estimates()[name].value, known.estimates()[name].sd)
            for t, known in self.seen
            if after_s <= t < before_s
        ]


def fly(
    flight: SimulatedFlight,
    config: PipelineConfig,
    end_s: float,
    *changes: Change,
    land_s: float = math.inf,
    record: Path | None = None,
    truth: Path | None = None,
) -> Watch:
    """Fly in lockstep until ``end_s`` of boot time, or the end of the script."""
    watch = Watch()
    world = FaultyLockstep(flight, lambda w: Pilot(w, changes, end_s, land_s), truth)
    world.auditor = watch  # type: ignore[assignment]
    world.fly(config, record)
    return watch


# -- changes ---------------------------------------------------------------------------------------------------------


def push(flight: SimulatedFlight, force: Force) -> None:
    """An outer force at the CG, NED [N], from here on: ``force`` is asked at every physics step."""
    body = flight.body
    inner = flight.body._contact

    def contact(rot: tuple[float, ...]) -> None:
        inner(rot)
        n, e, d = force(flight, body.time_s)
        pushed = [rot[i] * n + rot[3 + i] * e + rot[6 + i] * d for i in range(3)]
        old = body.causes.contact
        body.causes.contact = (old[0] + pushed[0], old[1] + pushed[1], old[2] + pushed[2], *old[3:])

    body._contact = contact  # type: ignore[method-assign]


def bump(at_s: float, newtons: float = 40.0, seconds: float = 0.1) -> Force:
    """A knock from the side."""
    return lambda _, t: (
        (0.0, -newtons, 0.5 * newtons) if at_s <= t < at_s + seconds else (0.0, 0.0, 0.0)
    )


def hand(at_s: float, until_s: float) -> Force:
    """A hand that takes hold of the vehicle, carries a third of it, and draws it to where it is."""
    held: list[list[float]] = []

    def force(flight: SimulatedFlight, t: float) -> tuple[float, float, float]:
        if not at_s <= t < until_s:
            return 0.0, 0.0, 0.0
        b = flight.body
        if not held:
            held.append(list(b.position))
        x = [p - q for p, q in zip(b.position, held[0], strict=True)]
        v = b.velocity
        lift = 0.35 * flight.vehicle.mass_kg * GRAVITY
        return (
            -60.0 * x[0] - 10.0 * v[0],
            -60.0 * x[1] - 10.0 * v[1],
            -60.0 * x[2] - 10.0 * v[2] - lift,
        )

    return force


def payload(at_s: float, kg: float) -> Change:
    """Picked up in flight."""

    def change(flight: SimulatedFlight, t: float) -> None:
        if t >= at_s and flight.body.vehicle.mass_kg == flight.vehicle.mass_kg:
            flight.body.vehicle = replace(flight.vehicle, mass_kg=flight.vehicle.mass_kg + kg)

    return change


def wind(at_s: float, north: float, east: float, rise_s: float = 3.0) -> Change:
    """A wind that rises to its speed [m/s] and stays."""

    def change(flight: SimulatedFlight, t: float) -> None:
        share = min(max((t - at_s) / rise_s, 0.0), 1.0)
        flight.body.wind = (share * north, share * east, 0.0)

    return change


def lying_range(at_s: float, until_s: float, index: int, reads_m: float) -> Change:
    """A rangefinder that says the same plausible distance whatever there is, with noise."""

    def change(flight: SimulatedFlight, t: float) -> None:
        if at_s <= t < until_s:
            flight.ranges[index].reading_m = round(reads_m + 0.01 * math.sin(37.0 * t), 2)

    return change


def dead_rotor(at_s: float, until_s: float, rotor: int, rpm: float | None) -> Change:
    """An ESC whose telemetry reads ``rpm``, or stays where it was (None)."""
    held: list[float] = []

    def change(flight: SimulatedFlight, t: float) -> None:
        if at_s <= t < until_s:
            if not held:
                held.append(flight.esc.rpm[rotor])
            flight.esc.rpm[rotor] = held[0] if rpm is None else rpm

    return change


# -- a ceiling -------------------------------------------------------------------------------------------------------


class CeilingSensor(RangeSensor):
    """A lidar that looks up at a level ceiling."""

    def __init__(self, sensor: Rangefinder, seed: str, ceiling_m: float) -> None:
        super().__init__(sensor, seed)
        self._ceiling_m = ceiling_m

    def step(self, body: Any) -> None:
        """Sample when due, as late and as noisy as the others."""
        if body.time_s < self._next_s:
            return
        self._next_s = body.time_s + 0.02
        if len(self._late) == 2:
            lost = self._rng.random() < 0.01
            self.reading_m = (
                OUT_OF_RANGE_M if lost else round(self._late[0] + self._rng.gauss(0.0, 0.008), 2)
            )
        up = body.rotation()[8]
        self._late.append(
            (self._ceiling_m + body.position[2] + self.sensor.position_m[2] * up) / up
        )


def add_ceiling(flight: SimulatedFlight, ceiling_m: float, gain: float, scale: float = 1.0) -> None:
    """A ceiling over the whole flight, with ``gain`` of Hsiao and Chirarattananon's law (models/effects/ceiling.py)."""
    body = flight.body
    for k, sensor in enumerate(flight.vehicle.rangefinders):
        if sensor.target == "ceiling":
            flight.ranges[k] = CeilingSensor(sensor, f"range {flight.seed} {k}", ceiling_m)
    inner = body.law

    def increments(eta: float, delta: float) -> Any:
        near = inner.increments(eta, delta)
        gap = max(ceiling_m - eta * body.radius, 0.02) / (scale * body.radius)
        gamma = 0.5 + 0.5 * math.sqrt(1.0 + 1.0 / (8.0 * gap * gap))
        return replace(near, z=near.z + gain * (gamma ** (2.0 / 3.0) - 1.0))

    body.law = SimpleNamespace(increments=increments)


def with_ceiling_sensor(vehicle: Vehicle) -> Vehicle:
    """The vehicle with one more lidar, which looks up."""
    return replace(
        vehicle, rangefinders=(*vehicle.rangefinders, Rangefinder(24, "ceiling", (0.0, 0.0, -0.05)))
    )  # fmt: skip
