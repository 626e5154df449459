"""The companion on real firmwares: skipped unless ARDUCOPTER_BIN or PX4_BIN names a SITL binary (docs/firmware.md)."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from rig import ARDUCOPTER, GUIDED, LOITER, OFFBOARD, POSITION, PX4, Moment, Rig

pytestmark = [pytest.mark.firmware, pytest.mark.timeout(1200)]
Fly = Callable[..., "contextmanager[Rig]"]


@pytest.fixture(params=[ARDUCOPTER, PX4])
def fly(request: pytest.FixtureRequest, tmp_path: Path):
    """Boots a firmware with parameters, takes off, engages."""
    binary = os.environ.get(request.param)
    if not binary:
        pytest.skip(f"{request.param} names no SITL binary: see docs/firmware.md")
    if not Path(binary).is_file():
        pytest.fail(f"{request.param}={binary}: no such file")

    @contextmanager
    def flown(parameters: dict[str, float] | None = None, *, engaged: bool = True) -> Iterator[Rig]:
        with Rig(request.param, binary, tmp_path, parameters) as rig:
            rig.take_off()
            if engaged:
                rig.engage()
            yield rig

    return flown


def after(rig: Rig, since: int) -> list[Moment]:
    """The truth from row ``since`` on; there must be some."""
    moments = rig.truth()[since:]
    assert len(moments) > 20
    return moments


def loss(moments: list[Moment]) -> float:
    """Furthest below the height at the beginning."""
    return moments[0].height - min(m.height for m in moments)


def drift(moments: list[Moment]) -> float:
    """Furthest from the place at the beginning, level."""
    a = moments[0]
    return max(((m.north - a.north) ** 2 + (m.east - a.east) ** 2) ** 0.5 for m in moments)


def test_take_off_and_engage_without_a_jump(fly):
    with fly(engaged=False) as rig:
        since = len(rig.truth())
        rig.engage()
        rig.sleep(6.0)
        moments = after(rig, since)
    assert not any(m.contact for m in moments)
    assert loss(moments) < 0.2
    assert drift(moments) < 0.4
    assert max(m.tilt_deg for m in moments) < 5.0


def test_approach_to_the_wall_touches_nothing(fly):
    with fly() as rig:
        since = len(rig.truth())
        for k in range(1, 61):
            rig.go(1.35 * k / 60, 0.0, 1.5 - 0.5 * k / 60)
            rig.sleep(0.2)
        rig.sleep(6.0)
        moments = after(rig, since)
    assert not any(m.contact for m in moments)
    assert moments[-1].north > moments[0].north + 1.0
    assert max(m.tilt_deg for m in moments) < 12.0


def test_a_mode_of_the_pilot_takes_over_and_gives_back(fly):
    with fly() as rig:
        since = len(rig.truth())
        ours, theirs = (OFFBOARD, POSITION) if rig.px4 else (GUIDED, LOITER)
        for mode in (theirs, ours, theirs, ours):
            rig.mode(mode)
            rig.until(lambda mode=mode: rig.in_mode == mode[0], 5.0, "the mode")
            rig.sleep(3.0)
        moments = after(rig, since)
    assert not any(m.contact for m in moments)
    assert loss(moments) < 0.3
    assert drift(moments) < 0.5


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT], ids=["kill", "interrupt"])
def test_a_companion_that_ends_leaves_the_vehicle_in_the_air(fly, how):
    with fly() as rig:
        since = len(rig.truth())
        rig.signal_companion(how)
        rig.sleep(8.0)
        moments = after(rig, since)
    assert not any(m.contact for m in moments)
    assert loss(moments) < 0.3
    assert max(m.tilt_deg for m in moments) < 12.0


def test_a_companion_that_stands_still_for_three_seconds(fly):
    with fly() as rig:
        since = len(rig.truth())
        rig.signal_companion(signal.SIGSTOP)
        rig.sleep(3.0)
        rig.signal_companion(signal.SIGCONT)
        rig.sleep(8.0)
        moments = after(rig, since)
    assert not any(m.contact for m in moments)
    assert loss(moments) < 0.5


def test_without_gps_the_companion_does_not_fly_on_for_long(fly):
    with fly() as rig:
        since = len(rig.truth())
        rig.lose_gps()
        rig.sleep(12.0)
        moments = after(rig, since)
        words = rig.texts
    assert any("position" in text for text in words), words
    assert drift(moments) < 3.0  # dead reckoning is the firmware's own
    assert max(m.tilt_deg for m in moments) < 15.0


def test_a_slow_attitude_loop_does_not_swing_up(fly):
    slow = {
        "ATC_ANG_RLL_P": 2.25,
        "ATC_ANG_PIT_P": 2.25,
        "ATC_INPUT_TC": 0.3,
        "MC_ROLL_P": 3.0,
        "MC_PITCH_P": 3.0,
    }
    with fly(slow) as rig:
        since = len(rig.truth())
        for place in ((0.6, 0.0), (0.0, 0.6), (0.0, 0.0)):
            rig.go(*place, 1.5)
            rig.sleep(5.0)
        rig.sleep(8.0)
        moments = after(rig, since)
    assert not any(m.contact for m in moments)
    assert max(m.tilt_deg for m in moments) < 20.0
    assert max(m.tilt_deg for m in moments[-200:]) < 3.0  # four seconds, nine after the last step
