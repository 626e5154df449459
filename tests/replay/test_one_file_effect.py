"""An effect that is written as one file is known to all that asks the catalogue: prediction, changes, flight, page."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from documents import effects_page
from noise_records import noise_record

import models.effects
from models.effects import adopted, adopted_wrench, catalogue, get
from models.surrogate.empty import empty_model
from replay.changes.spread import usual
from replay.predict.day import learn_day

NAME = "taut_cable"
FILE = '''"""A steady pull to the north, of another strength every day.

Valid: everywhere.
Source: made for a test.
"""

import numpy as np

from models.effects.coefficient import BelongsTo, Coefficient
from models.effects.effect import Effect


def _wrenches(ctx, _):
    out = np.zeros((*ctx.state.time_s.shape, 6))
    out[..., :3] = ctx.weight * ctx.state.rotation[..., 0, :]
    return (out,)


EFFECT = Effect(
    name="taut_cable",
    belongs_to=BelongsTo.WEATHER,
    law=True,
    every_flight=True,
    equation="dF_north = a W",
    sign="a > 0: to the north",
    axes=("Fx", "Fy"),
    channels=("yaw_rad",),
    excite="turn on the spot",
    coefficients=(Coefficient(name="share", unit="1", low=-1.0, high=1.0, typical=0.1),),
    wrenches=_wrenches,
)
'''


@pytest.fixture
def written(tmp_path: Path) -> Iterator[None]:
    """The catalogue with one file more."""
    (tmp_path / f"{NAME}.py").write_text(FILE, encoding="utf-8")
    models.effects.__path__.append(str(tmp_path))
    catalogue.cache_clear()
    yield
    models.effects.__path__.pop()
    catalogue.cache_clear()


@pytest.mark.usefixtures("written")
def test_the_day_of_a_flight_has_an_effect_that_is_there_on_every_flight() -> None:
    record = noise_record(3, 60.0, 0.3)
    pull = adopted_wrench((adopted(NAME, {"share": 0.08}),), record.context)
    quiet = learn_day(record, record.residual, (), {})
    pulled = learn_day(record, record.residual + pull, (), {})
    place = pulled.names.index((NAME, "share"))
    more = pulled.values[place] - quiet.values[place]
    assert more > 0.02, "wind pulls to the north too: the two share what is seen by their priors"


@pytest.mark.usefixtures("written")
def test_flights_differ_by_as_much_of_a_law_as_is_typical_of_it() -> None:
    record = noise_record(3, 20.0, 0.3)
    (size,) = usual([get(NAME)], [], record)
    assert size.sd == 0.1


@pytest.mark.usefixtures("written")
def test_a_model_takes_it_and_the_page_of_effects_shows_it() -> None:
    record = noise_record(3, 20.0, 0.3)
    effect = adopted(NAME, {"share": 0.5})
    model = empty_model(record.context.vehicle).with_effects((effect,))
    wrench = adopted_wrench(model.effects, record.context)
    np.testing.assert_allclose(
        np.linalg.norm(wrench[:, :3], axis=1), 0.5 * record.context.weight, rtol=1e-6
    )
    assert f"## {NAME}\n" in effects_page.page(list(catalogue()))


def test_without_its_file_nothing_knows_it() -> None:
    assert NAME not in [effect.name for effect in catalogue()]
    assert NAME not in [effect.name for effect in catalogue() if effect.every_flight]
