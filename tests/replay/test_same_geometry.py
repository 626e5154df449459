"""Flight and replay give effects the same distances: mounts, tilts, bearings, ages, silent and undeclared beams."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import models
from companion.config import PipelineConfig
from companion.disturbance.air_state import air_state
from companion.disturbance.fan_query import fan_query
from companion.estimation.estimates import Estimates, blank_estimates
from companion.estimation.estimator import take_attitude
from companion.estimation.readings import take_range
from companion.estimation.surfaces import Seen, surface
from companion.mavlink.range_beams import orientation_direction
from companion.mavlink.samples import Attitude, Range, RangeVerdict
from companion.vehicles import default_vehicle
from models.air_state import AirState
from models.common.frames import quaternion_from_euler, rotation_from_quaternion, rotation_rows
from models.effects import AdoptedEffect, Context, adopted_wrench
from models.vehicle import Rangefinder, Vehicle
from replay.flightlog import Beam, FlightLog, Series
from replay.residual.distances import distances

DOWN, UP, FORWARD, RIGHT = 25, 24, 0, 2
END_S = 12.0
STEP_S = 0.04
FIELDS = ("h_m", "d_m", "wall_bearing_rad", "second_d_m", "second_bearing_rad", "ceiling_m")
LEVEL = (1.0, 0.0, 0.0, 0.0)
MODEL = models.load()


@dataclass(frozen=True)
class Sensor:
    """One rangefinder, what it reads all the time, and how long before the end it last spoke."""

    orientation: int
    target: str
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0)
    slant_m: float = 1.0
    silent_s: float = 0.0
    declared: bool = True

    @property
    def stamps(self) -> list[float]:
        return np.arange(11.0, END_S - self.silent_s + 1e-9, STEP_S).tolist()

    @property
    def reading(self) -> tuple[float, RangeVerdict]:
        return (
            (60.0, RangeVerdict.ABOVE_MAX)
            if math.isinf(self.slant_m)
            else (self.slant_m, RangeVerdict.OK)
        )


def vehicle_with(sensors: list[Sensor]) -> Vehicle:
    declared = tuple(Rangefinder(s.orientation, s.target, s.mount) for s in sensors if s.declared)
    return replace(default_vehicle(), rangefinders=declared)


def flown(
    sensors: list[Sensor], q: tuple[float, float, float, float]
) -> tuple[AirState, Estimates, PipelineConfig]:
    """The air of the last instant as flight has it."""
    config = PipelineConfig(vehicle=vehicle_with(sensors), model=MODEL)
    estimates = take_attitude(
        blank_estimates(config.vehicle), Attitude(5.0, 1, 1, q, (0.0, 0.0, 0.0), "ATTITUDE")
    )
    for t, k in sorted((t, k) for k, s in enumerate(sensors) for t in s.stamps):
        sensor, direction = sensors[k], orientation_direction(sensors[k].orientation)
        distance, verdict = sensor.reading
        sample = Range(
            t,
            1,
            1,
            direction_frd=direction,
            orientation=sensor.orientation,
            sensor_id=k,
            distance_m=distance,
            min_m=0.05,
            max_m=40.0,
            sigma_m=None,
            quality=None,
            verdict=verdict,
            source="x",
        )
        estimates = take_range(estimates, sample, config)
    ground, wall, ceiling = (
        surface(estimates, config, kind, END_S) for kind in ("ground", "wall", "ceiling")
    )
    rotation, rotors = rotation_rows(*q), np.full(4, 4000.0)
    query = fan_query(config.vehicle, ground, wall, rotation, (4000.0, 4000.0), 0.0)
    return air_state(estimates, config, query, ceiling, rotors, END_S), estimates, config


def replayed(sensors: list[Sensor], q: tuple[float, float, float, float]) -> dict[str, np.ndarray]:
    """The same instant out of a log of the same readings."""
    beams = []
    for k, sensor in enumerate(sensors):
        # A log goes on after the instant that is looked at, unless the sensor fell silent.
        t = np.array(sensor.stamps + ([END_S + STEP_S] if sensor.silent_s == 0.0 else []))
        distance, verdict = sensor.reading
        series = Series(t, np.full((len(t), 1), distance))
        direction, verdicts = orientation_direction(sensor.orientation), (verdict,) * len(t)
        beams.append(
            Beam(
                direction,
                1,
                k,
                sensor.orientation,
                "x",
                series,
                verdicts,
                0.05,
                40.0,
                math.nan,
                0.01,
            )
        )
    log = FlightLog(
        path=Path("x"), system=1, boot=0, start_s=10.0, end_s=END_S + 1.0, beams=tuple(beams)
    )
    rotation = rotation_from_quaternion(q)[None]
    return distances(log, vehicle_with(sensors), np.array([END_S]), rotation, np.zeros((1, 3)), 0.0)


mounts = st.tuples(*(st.floats(-0.5, 0.5),) * 3)
slants = st.floats(0.3, 8.0) | st.just(math.inf)
walls = st.lists(
    st.builds(
        Sensor, st.sampled_from((0, 2, 4, 6)), st.just("wall"), mounts, slants, st.sampled_from((0.0, 0.0, 0.0, 0.7)),
    ),
    max_size=3, unique_by=lambda s: s.orientation,
)  # fmt: skip
downs = st.builds(
    Sensor, st.just(DOWN), st.just("ground"), mounts, slants, st.sampled_from((0.0, 0.0, 0.7))
)
ups = st.builds(
    Sensor, st.just(UP), st.just("ceiling"), mounts, slants, st.sampled_from((0.0, 0.0, 0.9))
) | st.builds(Sensor, st.just(UP), st.just("ceiling"), slant_m=slants, declared=st.just(False))
tilts = st.floats(-0.6, 0.6)


@settings(max_examples=200, deadline=None)
@given(downs, walls, st.lists(ups, max_size=1), tilts, tilts, st.floats(-3.1, 3.1))
def test_flight_and_replay_see_the_same_surroundings(down, sides, up, roll, pitch, yaw):
    sensors, q = [down, *sides, *up], quaternion_from_euler(roll, pitch, yaw)
    live, estimates, config = flown(sensors, q)
    recorded = replayed(sensors, q)
    ground, wall = (surface(estimates, config, kind, END_S).known for kind in ("ground", "wall"))
    known = {"h_m": ground, "d_m": wall, "second_d_m": wall}
    for name in FIELDS:
        told = recorded[name][0]
        if not known.get(name, True):
            # Flight refuses offsets by name then, and the surrogate is asked as if nothing were there.
            assert np.isnan(told).all(), name
        else:
            np.testing.assert_allclose(getattr(live, name), told, atol=1e-6, err_msg=name)


def test_what_a_second_wall_pushes_is_the_same_and_the_mount_counts_once():
    sensors = [
        Sensor(DOWN, "ground", slant_m=1.0), Sensor(RIGHT, "wall", (0.0, 0.21, 0.0), 0.3),
        Sensor(FORWARD, "wall", (0.49, 0.0, 0.0), 0.5),
    ]  # fmt: skip
    live, _, config = flown(sensors, LEVEL)
    # Front fan: 0.32 m ahead of the CG, lip 0.21 m; the sensor is 0.49 m ahead.
    assert live.second_d_m[0] == pytest.approx(0.5 + 0.49 - 0.32 - 0.21, abs=1e-3)
    effect = AdoptedEffect(
        "second_wall", {"pull": 0.1, "tilt": 0.0, "lift": 0.0, "loss": 0.0, "length_radii": 0.9}
    )
    recorded = {name: value[0] for name, value in replayed(sensors, LEVEL).items()}
    pushes = [
        adopted_wrench(
            [effect], Context(state=state, vehicle=config.vehicle, model=MODEL), in_flight=True
        )
        for state in (live, replace(live, **recorded))
    ]
    np.testing.assert_allclose(pushes[0], pushes[1], rtol=1e-4)
    assert pushes[0][0] > 0.05


def test_a_wall_that_vanished_is_not_reported():
    sensors = [Sensor(DOWN, "ground"), Sensor(RIGHT, "wall", slant_m=0.4, silent_s=0.9)]
    _, estimates, config = flown(sensors, LEVEL)
    assert surface(estimates, config, "wall", END_S).seen is Seen.STALE


def test_the_nearest_wall_counts_whatever_the_order_of_the_file():
    near, far = Sensor(FORWARD, "wall", slant_m=0.6), Sensor(RIGHT, "wall", slant_m=1.5)
    for sensors in ([near, far], [far, near]):
        told = replayed([Sensor(DOWN, "ground"), *sensors], LEVEL)
        assert told["wall_bearing_rad"][0] == 0.0
        assert told["second_bearing_rad"][0] == pytest.approx(math.pi / 2)


def test_an_undeclared_ceiling_beam_counts_in_flight_as_in_the_diagnosis():
    sensors = [Sensor(DOWN, "ground"), Sensor(UP, "ceiling", slant_m=0.4, declared=False)]
    live, _, _ = flown(sensors, LEVEL)
    np.testing.assert_allclose(live.ceiling_m, [0.4, 0.4], atol=1e-3)
    np.testing.assert_allclose(replayed(sensors, LEVEL)["ceiling_m"][0], [0.4, 0.4], atol=1e-9)
