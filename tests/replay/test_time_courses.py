"""A force that follows time alone is said with its frequency, or with the time from which on it acts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from noise_records import noise_record

from models.common.frames import Array
from models.effects import catalogue
from replay.diagnosis.diagnose import Diagnosis, conclude
from replay.diagnosis.next_step import next_step
from replay.residual.record import Record
from replay.search.time_courses import time_courses

FX = 0
FY = 1
HZ = 0.43
NEWTON = 0.8
"""About 3 % of the weight."""
EFFECTS = [effect for effect in catalogue() if effect.name in ("wind", "imu_bias", "payload")]


@pytest.fixture(scope="module")
def quiet() -> Record:
    """Ninety seconds of noise."""
    return noise_record(21, 90.0, 0.3)


def pushed(record: Record, axis: int, force_n: Array) -> Record:
    """The record with a force (n,) along an axis."""
    residual = record.residual.copy()
    residual[:, axis] += force_n
    return replace(record, residual=residual)


def swing(record: Record) -> Record:
    """A push forward and back at one frequency."""
    return pushed(record, FX, NEWTON * np.sin(2.0 * np.pi * HZ * record.time_s))


def change(record: Record, at_s: float, over_s: float) -> Record:
    """A push to the left that comes within about ``over_s`` and stays."""
    after_s = np.maximum(record.time_s - at_s, 0.0)
    return pushed(record, FY, -1.5 * NEWTON * (1.0 - np.exp(-after_s / over_s)))


def carriers(answer: Diagnosis) -> list[dict[str, object]]:
    """The channels of the JSON, without their scores."""
    channels = answer.as_json(None)["unexplained"]["channels"]
    return [{k: v for k, v in channel.items() if k != "score"} for channel in channels]


def test_the_strongest_swing_has_its_frequency(quiet: Record) -> None:
    hz = [c.swing_hz for c, _ in time_courses(swing(quiet), FX) if c.swing_hz is not None]
    assert hz == [pytest.approx(HZ, abs=1.0 / 90.0)]


def test_a_swing_that_the_vehicle_flies_is_none_of_time_alone(quiet: Record) -> None:
    """On a path that repeats itself drag swings in step with time, and no less with the speed."""
    pushed_by_drag = swing(quiet)
    velocity = quiet.context.state.velocity_ned.copy()
    velocity[:, 0] = 2.0 * np.sin(2.0 * np.pi * HZ * quiet.time_s)
    state = replace(quiet.context.state, velocity_ned=velocity)
    flown = replace(pushed_by_drag, context=replace(quiet.context, state=state))
    assert [c for c, _ in time_courses(flown, FX) if c.swing_hz is not None] == []


@pytest.mark.parametrize("over_s", [0.1, 8.0], ids=["at once", "slowly"])
def test_a_change_has_its_time(quiet: Record, over_s: float) -> None:
    at_s = float(quiet.time_s[0]) + 40.0
    courses = time_courses(change(quiet, at_s, over_s), FY)
    since_s = [c.since_s for c, _ in courses if c.since_s is not None]
    assert since_s == [pytest.approx(at_s + 0.7 * over_s, abs=0.7 * over_s + 1.0)]


def test_a_short_flight_has_no_change(quiet: Record) -> None:
    early = quiet.valid & (quiet.time_s < quiet.time_s[0] + 15.0)
    courses = time_courses(replace(quiet, valid=early), FY)
    assert [c for c, _ in courses if c.since_s is not None] == []


@pytest.mark.filterwarnings("error")
def test_a_flight_that_is_not_judged_has_neither(quiet: Record) -> None:
    assert time_courses(replace(quiet, valid=np.zeros(len(quiet.valid), bool)), FX) == ()


def test_a_swing_is_said_with_its_frequency(quiet: Record) -> None:
    answer = conclude([swing(quiet)], effects=EFFECTS)
    assert answer.verdict == "unexplained"
    (carrier,) = carriers(answer)
    assert carrier == {
        "name": "time_s",
        "axes": ["Fx"],
        "swing_hz": pytest.approx(HZ, abs=1.0 / 90.0),
    }
    assert "time_s, a swing at 0.43 Hz" in answer.as_text()


def test_a_change_that_lasts_is_said_with_its_time(quiet: Record) -> None:
    at_s = float(quiet.time_s[0]) + 40.0
    answer = conclude([change(quiet, at_s, 0.1)], effects=EFFECTS)
    assert answer.verdict == "unexplained"
    (carrier,) = carriers(answer)
    assert carrier == {"name": "time_s", "axes": ["Fy"], "since_s": pytest.approx(at_s, abs=2.0)}
    action = next_step(answer).action
    assert action.startswith(
        "Look on the vehicle, or around it, for what began at 50 s and stayed."
    )


def test_quiet_air_has_neither(quiet: Record) -> None:
    answer = conclude([quiet], effects=EFFECTS)
    assert answer.verdict == "nothing_missing"
    assert carriers(answer) == []
