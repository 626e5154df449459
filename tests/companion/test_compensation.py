"""From a modelled disturbance to an offset, where a model asks for more than any thrust can give."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from flying import CONFIG, HOVER_N, PlainModel, bench

from companion.control.compensation import Offset, wanted_offset
from companion.disturbance.records import Disturbance
from companion.disturbance.stable_gain import GAIN
from companion.estimation.surfaces import Seen, Surface
from companion.mavlink.firmware import ThrustMap

LEVEL = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
FREE_N = 2.0 * HOVER_N
THRUST = ThrustMap(hover=0.5, slope=2.0)
NOWHERE = Surface(Seen.UNDECLARED)


def wanted(lost: float, base_thrust: float = 0.5) -> Offset:
    """With a model that says that the surroundings take this share of the lift in free air."""
    push = Disturbance(
        wrench=(0.0, 0.0, lost * FREE_N, 0.0, 0.0, 0.0),
        free_lift_n=FREE_N,
        trust=1.0,
        gain=1.0,
        h_m=(),
        d_m=(),
        ground=NOWHERE,
        wall=NOWHERE,
        ceiling=NOWHERE,
    )
    return wanted_offset(push, None, CONFIG, THRUST, base_thrust, LEVEL, 0.02)[0]


@pytest.mark.parametrize("base_thrust", [0.0, 0.3, 0.5, 0.9, 1.0])
def test_more_suction_never_asks_for_less_thrust_and_never_for_more_than_there_is(base_thrust):
    asked = [
        wanted(lost, base_thrust).thrust
        for lost in (-0.2, 0.0, 0.2, 0.5, 0.9, 0.999, 1.0, 1.01, 1.5, 10.0)
    ]
    assert asked == sorted(asked)
    assert asked[1] == 0.0
    assert asked[-1] <= 1.0 - base_thrust


def test_a_part_of_the_lift_is_made_up_for_multiplicatively():
    assert wanted(0.2).thrust == pytest.approx((1.0 / 0.8 - 1.0) / THRUST.slope)
    assert wanted(-0.2).thrust == pytest.approx((1.0 / 1.2 - 1.0) / THRUST.slope)


@dataclass(frozen=True)
class Suction(PlainModel):
    """The ground takes ``lost`` of the lift."""

    lost: float = 0.0

    def wrench(self, h, d, rpm):
        out = super().wrench(h, d, rpm)
        return np.where(np.isfinite(h)[..., None], out * (1.0 - self.lost), out)


@pytest.mark.parametrize("lost", [0.999, 1.0, 1.01, 1.0 / GAIN, 2.0])
def test_no_setpoint_fails_or_reverses_with_a_model_that_takes_all_the_lift(lost):
    decision = bench(model=Suction(lost=lost), height=0.5).run(4.0)
    assert decision.command is not None
    assert decision.offset.thrust == pytest.approx(CONFIG.vehicle.limits.thrust)
