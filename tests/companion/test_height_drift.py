"""The autopilot's height against the ground range: what is a drift, what is none, and what is flown then."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass, field

import pytest
from flying import bench

from companion.control.hand_over import place_of
from companion.control.position_hold import Motion, engage
from companion.control.reasons import Reason
from companion.estimation.height_drift import NO_DRIFT, HeightDrift, compare, hear
from companion.estimation.surfaces import Seen, Surface
from companion.mavlink.firmware import ThrustMap
from companion.mavlink.samples import LocalPosition
from companion.telemetry.status import said_of

DT = 0.02
HEIGHT_M = 0.45
SLOPE = 0.15


@dataclass
class Held:
    """A vehicle that is held at ``HEIGHT_M`` by what the detector says its position is."""

    estimate: Callable[[float], float] = lambda t: 0.0
    """What the estimated down coordinate is off by, over time [s]."""
    velocity_too: bool = False
    ground: Callable[[float], float] = lambda t: 0.0
    """The ground's height over time, or what the range is off by, with the other sign."""
    stepped_s: float = -math.inf
    east_m_s: float = 0.0
    noise: Callable[[], tuple[float, float]] = lambda: (0.0, 0.0)
    """Of range and estimate [m]."""
    flies: bool = True
    """False: it stays where it truly is, whatever is estimated."""
    down: float = -HEIGHT_M
    sinks: float = 0.0
    t: float = 0.0
    drift: HeightDrift = NO_DRIFT
    heights: list[float] = field(default_factory=list)
    flown: list[float] = field(default_factory=list)
    noticed_s: float | None = None

    def run(self, seconds: float) -> Held:
        for _ in range(round(seconds / DT)):
            self.tick()
        return self

    def tick(self) -> None:
        self.t += DT
        of_range, of_estimate = self.noise()
        off, before = self.estimate(self.t), self.estimate(self.t - DT)
        rate = (off - before) / DT if self.velocity_too and abs(off - before) < 0.05 else 0.0
        place = (0.0, self.east_m_s * self.t, self.down + off + of_estimate)
        raw = LocalPosition(self.t, 1, 1, place, (0.0, self.east_m_s, self.sinks + rate))
        self.drift, flown = hear(self.drift, raw)
        surface = Surface(
            Seen.SURFACE, -self.down - self.ground(self.t) + of_range, stepped_s=self.stepped_s
        )
        self.drift = compare(self.drift, surface, flown)
        if self.flies:
            wanted = 3.0 * (-HEIGHT_M - flown.position_ned[2])
            self.sinks = min(max(wanted, -0.5), 0.5)
            self.down += self.sinks * DT
        self.heights.append(-self.down)
        self.flown.append(flown.position_ned[2])
        if self.drift.drifts and self.noticed_s is None:
            self.noticed_s = self.t


def ramp(rate: float, start_s: float = 2.0, end_s: float = math.inf) -> Callable[[float], float]:
    return lambda t: rate * (min(max(t, start_s), end_s) - start_s)


@pytest.mark.parametrize("velocity_too", [False, True])
@pytest.mark.parametrize("rate", [-0.05, -0.1, -0.25])
def test_an_estimate_that_climbs_alone_is_noticed_and_the_vehicle_is_held_up_by_the_range(
    rate, velocity_too
):
    held = Held(ramp(rate), velocity_too).run(15.0)
    assert held.noticed_s is not None
    assert held.noticed_s - 2.0 < max(0.3 / abs(rate), 1.3)
    assert min(held.heights) > HEIGHT_M - 0.28
    assert held.heights[-1] == pytest.approx(HEIGHT_M, abs=0.06)
    assert held.drift.rate_m_s == pytest.approx(-rate, abs=0.02)


def test_a_drift_of_a_centimetre_a_second_is_followed_too():
    held = Held(ramp(-0.015)).run(60.0)
    assert held.noticed_s is not None
    assert min(held.heights) > HEIGHT_M - 0.25
    assert max(held.heights) < HEIGHT_M + 0.05


def test_an_estimate_that_sinks_against_its_own_velocity_and_the_range_leads_nobody_up():
    held = Held(ramp(0.1)).run(12.0)
    assert held.drift.drifts
    assert held.drift.led_down
    assert max(held.heights) < HEIGHT_M + 0.2
    assert held.heights[-1] == pytest.approx(HEIGHT_M, abs=0.05)


def test_a_range_that_grows_alone_leads_nobody_down():
    """The estimate and its velocity stand still, the range says that the vehicle climbs."""
    held = Held(ground=ramp(-0.1)).run(10.0)
    assert held.drift.drifts
    assert held.drift.correction_m == 0.0
    assert held.heights[-1] == pytest.approx(HEIGHT_M, abs=0.01)


def test_a_range_that_shrinks_alone_makes_it_climb_and_never_sink():
    held = Held(ground=ramp(0.1, end_s=6.0)).run(10.0)
    assert held.drift.correction_m > 0.0
    assert min(held.heights) > HEIGHT_M - 0.01


def test_a_step_of_the_ground_is_no_drift():
    """A table's edge: the track of the range starts anew."""
    held = Held(ground=lambda t: 0.0 if t < 4.0 else -0.3)
    held.run(4.0)
    held.stepped_s = 4.0
    held.run(16.0)
    assert held.noticed_s is None
    assert held.drift.correction_m == 0.0


def test_a_mat_on_the_floor_is_no_drift():
    assert Held(ground=lambda t: 0.04 if 4.0 < t < 9.0 else 0.0).run(15.0).noticed_s is None


@pytest.mark.parametrize("speed", [0.1, 0.25, 0.6])
def test_a_slope_that_is_flown_over_level_is_no_drift(speed):
    held = Held(ground=lambda t: SLOPE * speed * t, east_m_s=speed).run(20.0)
    assert held.noticed_s is None


def test_climbing_and_sinking_with_a_range_that_is_five_per_cent_long_is_no_drift():
    held = Held(flies=False)
    for k in range(1000):
        held.down = -HEIGHT_M - 0.8 * (1.0 - math.cos(0.4 * k * DT)) / 2.0
        held.ground = lambda t, d=held.down: 0.05 * d
        held.tick()
    assert held.noticed_s is None


def test_the_wander_and_noise_of_good_sensors_is_no_drift():
    rng, wander = random.Random(3), [0.0]

    def noise() -> tuple[float, float]:
        wander[0] += -wander[0] * DT / 10.0 + 0.02 * math.sqrt(2.0 * DT / 10.0) * rng.gauss(
            0.0, 1.0
        )
        return rng.gauss(0.0, 0.01), wander[0]

    assert Held(noise=noise).run(300.0).noticed_s is None


def test_when_the_estimate_is_set_right_again_the_correction_goes_and_nothing_leaps():
    held = Held(lambda t: ramp(-0.1)(t) if t < 6.0 else 0.0).run(6.0)
    assert held.drift.correction_m == pytest.approx(0.4, abs=0.06)
    last = held.flown[-1]
    held.run(1.0)
    assert held.drift.correction_m == pytest.approx(0.0, abs=0.05)
    assert (
        max(abs(b - a) for a, b in zip([last, *held.flown[300:]], held.flown[300:], strict=False))
        < 0.03
    )
    held.run(10.0)
    assert not held.drift.drifts
    assert held.heights[-1] == pytest.approx(HEIGHT_M, abs=0.05)


def test_a_range_that_is_lost_while_it_drifts_leaves_the_correction_as_it_is():
    held = Held(ramp(-0.1)).run(6.0)
    before = held.drift.correction_m
    position = LocalPosition(held.t + DT, 1, 1, (0.0, 0.0, held.flown[-1]), (0.0, 0.0, 0.0))
    drift = compare(held.drift, Surface(Seen.STALE), position)
    assert drift.correction_m == before
    assert drift.drifts


def test_the_autopilot_is_given_its_place_as_it_counts_itself():
    here = Motion((1.0, 2.0, -0.45), (0.0,) * 3, (0.0, 0.0, 1.0), 0.0)
    hold = engage(0.0, here, (0.0, 0.0), 0.5, ThrustMap(0.5, 1.0))
    assert place_of(hold, 0.4) == (1.0, 2.0, pytest.approx(-0.85))


def test_the_pilot_is_told_how_fast_it_drifts_and_offsets_go():
    b = bench()
    assert b.run(4.0).reasons == ()
    for k in range(100):
        b.estimate_above, b.height = 0.1 * DT * k, 0.3 + 0.001 * (k % 2)
        decision = b.tick()
    assert decision.reasons == (Reason.HEIGHT_DRIFTS,)
    assert (
        "height estimate drifts 0.1 m/s against the ground range" in said_of(b.state, decision)[0]
    )
    for k in range(100, 130):
        b.estimate_above, b.height = 0.1 * DT * k, 0.3 + 0.001 * (k % 2)
        decision = b.tick()
    assert decision.authority == 0.0
    assert decision.command is not None


@pytest.mark.parametrize("climb_m_s", [0.1, 0.25, -0.1])
def test_a_range_that_froze_leaves_no_correction_behind(climb_m_s: float):
    """The reading repeats itself while the vehicle moves 0.13 m, then it is known as frozen; later it is right."""
    drift, height, frozen_at = NO_DRIFT, HEIGHT_M, None
    for k in range(round(14.0 / DT)):
        t = k * DT
        speed = climb_m_s if 2.0 <= t < 4.0 else 0.0
        height += speed * DT
        drift, flown = hear(drift, LocalPosition(t, 1, 1, (0.0, 0.0, -height), (0.0, 0.0, -speed)))
        if not 2.0 <= t < 6.0:
            ground = Surface(Seen.SURFACE, height, slant_m=round(height, 2))
        elif abs(height - HEIGHT_M) <= 0.13 and frozen_at is None:
            ground = Surface(Seen.SURFACE, HEIGHT_M, slant_m=round(HEIGHT_M, 2))
        else:
            frozen_at = t
            ground = Surface(Seen.FROZEN)
        drift = compare(drift, ground, flown)
    assert frozen_at is not None
    assert drift.correction_m == pytest.approx(0.0, abs=0.005)
    assert not drift.drifts
