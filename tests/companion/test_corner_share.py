"""A law of a wall in the open is sent near the ground as far as it was measured there."""

from __future__ import annotations

import numpy as np
import pytest

from companion.adapt_options import Adapt
from companion.adaptation import judge
from companion.adaptation.apply import Applied, towards
from companion.adaptation.begin import initial
from companion.adaptation.beliefs import corner_share
from companion.adaptation.corner_share import EVERYWHERE
from companion.adaptation.sizes import PULL
from companion.config import PipelineConfig
from companion.disturbance.adopted_effects import of_walls_alone
from companion.disturbance.records import FanPlaces
from companion.vehicles import QUAD
from models.choice import NONE, choose
from models.effects.adopted_effect import AdoptedEffect
from models.vehicle import load_vehicle

VEHICLE = load_vehicle(QUAD)
WALL = np.array([[1.0, 0.5, 0.0, 0.1, 0.2, 0.0]])
PARAMETERS = {"pull": 0.1, "tilt": 0.1, "length_radii": 1.0}
LOW = (1.2, 0.5)
OPEN = (8.0, 0.5)
AWAY = (1.2, 6.0)


def places(height: float, gap: float) -> FanPlaces:
    return FanPlaces((height,) * 4, (gap,) * 4, (7.0,) * 4)


def sent(applied: Applied, place: tuple[float, float]) -> np.ndarray:
    """Of the wall, which is counted as modelled elsewhere."""
    nothing = [[0.0] * 6] * 4
    return WALL[0] + applied.compensated(VEHICLE, nothing, places(*place), WALL)


def amended(*names: str):
    model = choose(VEHICLE, NONE).model
    return model.with_effects(tuple(AdoptedEffect(name, PARAMETERS) for name in names))


def begun(*names: str):
    known = initial(PipelineConfig(vehicle=VEHICLE, model=amended(*names), adapt=Adapt.FULL))
    assert known is not None
    return known


def seen_at(known, height: float, gap: float, blocks: int):
    """The belief of the pull after so many blocks there."""
    channel = known.channels[PULL]
    belief = known.judged[PULL]
    place = judge.MAP.cells(height, gap)
    row = np.zeros(channel.mean.shape[1])
    for k, weight in place:
        row[channel.gain + 2 + k] = 28.0 * weight
    for _ in range(blocks):
        belief = judge.learn(channel, belief, 0.2, [(0.0, row, 0.05), (0.0, 0.0 * row, 0.05)])
    judged = (known.judged[0], belief, known.judged[2])
    return corner_share(known.channels, judged)


def test_a_wall_alone_is_what_the_catalogue_says_unless_the_corner_was_named_too():
    assert of_walls_alone(amended("wall_effect")) == (True,)
    assert of_walls_alone(amended("ground_effect", "wall_effect")) == (False, True)
    assert of_walls_alone(amended("wall_effect", "corner_effect")) == (False, False)


def test_before_anything_is_measured_nothing_of_a_wall_is_sent_low():
    wanted = begun("wall_effect").wanted
    assert sent(wanted, LOW) == pytest.approx(np.zeros(6))
    assert sent(wanted, OPEN) == pytest.approx(WALL[0])
    assert sent(wanted, AWAY) == pytest.approx(WALL[0])


def test_a_model_that_knows_the_corner_is_sent_everywhere():
    wanted = begun("wall_effect", "corner_effect").wanted
    assert wanted.corner is EVERYWHERE


def test_what_is_measured_low_is_sent_low():
    known = begun("wall_effect")
    shares = [seen_at(known, *LOW, blocks).of_wrench(places(*LOW))[0] for blocks in (0, 5, 20)]
    assert shares[0] == pytest.approx(0.0, abs=1e-9)
    assert shares == sorted(shares)
    assert shares[-1] > 0.5


def test_a_wall_measured_in_the_open_says_nothing_of_the_corner():
    known = begun("wall_effect")
    shares = seen_at(known, *OPEN, 100)
    assert shares.of_wrench(places(*LOW))[0] == pytest.approx(0.0, abs=0.01)
    halfway = 0.5 * (np.log(3.2) + np.log(4.5))
    assert 0.3 < shares.of_wrench(places(np.exp(halfway), 0.5))[0] < 0.7


def test_the_share_grows_slowly():
    known = begun("wall_effect")
    measured = Applied((1.0,) * 4, known.wanted.near, EVERYWHERE, (True,))
    grown = towards(known.wanted, measured, 0.2)
    assert 0.0 < sent(grown, LOW)[0] < 0.06
