"""Samples of a hovering vehicle and a transparent fan model, for the tests of the pipeline."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from companion.config import Base, PipelineConfig
from companion.mavlink.samples import (
    Attitude,
    Heartbeat,
    LandedState,
    LocalPosition,
    Parameter,
    Range,
    RangeVerdict,
    RotorSpeeds,
    Sample,
    SetAttitudeTarget,
)
from companion.pipeline import initial_state, step
from companion.state.decision import Decision
from companion.state.pipeline_state import PipelineState
from companion.vehicles import default_vehicle
from models.common.frames import quaternion_from_euler
from models.surrogate.fan_surrogate import Answer

HOVER_N = 4.6 * 9.80665 / 2.0
DOWN, RIGHT = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)


@dataclass(frozen=True)
class PlainModel:
    """Lift + 10 % at h = 0, pull 5 % and tilt at d = 0, all linear to nothing at 0.6 m: to be checked by hand."""

    effects: tuple = ()
    believed: float = 1.0
    info: ClassVar[dict] = {}

    def wrench(self, h, d, rpm):
        h, d, rpm = np.broadcast_arrays(*(np.asarray(a, dtype=float) for a in (h, d, rpm)))
        free = HOVER_N * (rpm / 4000.0) ** 2
        ground, wall = np.clip(1.0 - h / 0.6, 0.0, 1.0), np.clip(1.0 - d / 0.6, 0.0, 1.0)
        out = np.zeros((*free.shape, 6))
        out[..., 0] = 0.05 * free * wall
        out[..., 2] = free * (1.0 + 0.10 * ground)
        out[..., 4] = 0.02 * free * wall
        return out

    def query(self, h, d, rpm):
        wrench = self.wrench(h, d, rpm)
        return Answer(wrench, 0.01 * np.abs(wrench), np.full(wrench.shape[:-1], self.believed))

    def free_air_now(self, rpm):
        return self.wrench(np.inf, np.inf, rpm).tolist()


CONFIG = PipelineConfig(vehicle=default_vehicle(), model=PlainModel())


@dataclass
class Bench:
    """Feeds ``step`` with a vehicle at rest; every knob can be turned between ticks."""

    config: PipelineConfig = CONFIG
    t: float = 10.0
    height: float = 0.3
    wall: float = 0.5
    rpm: float = 4000.0
    roll: float = 0.0
    pitch: float = 0.0
    armed: bool = True
    mode: int = 4
    autopilot: int = 3
    vehicle_type: int = 2
    landed: int = 2
    guid_options: float | None = 8.0
    send_range: bool = True
    send_rpm: bool = True
    send_position: bool = True
    range_verdict: RangeVerdict = RangeVerdict.OK
    late: float = 0.0
    position: tuple[float, float] = (0.0, 0.0)
    estimate_above: float = 0.0
    """The autopilot believes that it is this much higher than it is."""
    state: PipelineState = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        self.state = self.state or initial_state(self.config)

    def feed(self, sample: Sample) -> Decision | None:
        self.state, decision = step(self.state, sample, self.config)
        return decision

    def range(self, direction, distance, sensor=0) -> Range:
        return Range(
            self.t,
            1,
            1,
            direction_frd=direction,
            orientation=0,
            sensor_id=sensor,
            distance_m=distance,
            min_m=0.05,
            max_m=8.0,
            sigma_m=None,
            quality=None,
            verdict=self.range_verdict,
            source="DISTANCE_SENSOR",
        )

    def tick(self, dt: float = 0.02) -> Decision:
        """One 50 Hz cycle; returns the decision that the attitude calls for."""
        self.t += dt
        if self.guid_options is not None and "GUID_OPTIONS" not in self.state.heard.parameters:
            self.feed(Parameter(self.t, 1, 1, "GUID_OPTIONS", self.guid_options))
        self.feed(Heartbeat(self.t, 1, 1, self.armed, self.mode, self.autopilot, self.vehicle_type))
        self.feed(LandedState(self.t, 1, 1, self.landed))
        if self.send_position:
            place = (*self.position, -self.height - self.estimate_above)
            self.feed(LocalPosition(self.t, 1, 1, place, (0.0, 0.0, 0.0), late_s=self.late))
        if self.send_range:
            # The shipped vehicle's sensors sit 0.05 m below and 0.21 m right of the CG.
            tilt = math.cos(self.roll) * math.cos(self.pitch)
            self.feed(self.range(DOWN, self.height / tilt - 0.05))
            self.feed(self.range(RIGHT, self.wall, sensor=1))
        if self.send_rpm:
            self.feed(RotorSpeeds(self.t, 1, 1, 1, (self.rpm,) * 4, "ESC_TELEMETRY_1_TO_4"))
        q = quaternion_from_euler(self.roll, self.pitch, 0.0)
        decision = self.feed(
            Attitude(self.t, 1, 1, q, (0.0, 0.0, 0.0), "ATTITUDE_QUATERNION", late_s=self.late)
        )
        if self.config.base is Base.UPSTREAM:
            assert decision is None or decision.command is None, "upstream decides on setpoints"
            target = SetAttitudeTarget(
                self.t, 255, 1, 7, (1.0, 0.0, 0.0, 0.0), (0.1, 0.2, 0.3), 0.5, 1, 1
            )
            decision = self.feed(target)
        assert decision is not None
        return decision

    def run(self, seconds: float) -> Decision:
        for _ in range(round(seconds / 0.02)):
            decision = self.tick()
        return decision


def with_plant(state: PipelineState, **changes) -> PipelineState:
    """The state with another plant."""
    return replace(state, plant=replace(state.plant, **changes))


def bench(**changes) -> Bench:
    config_changes = {
        k: changes.pop(k)
        for k in ("base", "carrier", "dry_run", "offsets", "model")
        if k in changes
    }
    return Bench(config=replace(CONFIG, **config_changes), **changes)
