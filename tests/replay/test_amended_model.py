"""What of an answer an amended model takes to the next flight, and what it says of the logs it was made from."""

from __future__ import annotations

from pathlib import Path

import pytest

from companion.vehicles import default_vehicle
from models.air_state import blank_state
from models.common.errors import ModelError
from models.effects import AdoptedEffect, BelongsTo, Context, catalogue, get
from models.surrogate.store import load, save_model
from replay.diagnosis.amended_model import amended, known_day, learnt_from, to_adopt
from replay.diagnosis.words import kept_words
from replay.search.estimates import IntervalEstimate

WIND = {
    "north": 3.0,
    "east": -1.0,
    "own_motion": 0.4,
    "turning": 0.0,
    "sinking": 0.1,
    "lift": 0.0,
    "above_radii": 0.5,
}
INFLOW = {"slope": 4.0, "turning": 0.0, "north": -30.0, "east": 2.0, "level": 0.1}


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "flight.tlog"
    path.write_bytes(b"of a flight")
    return path


def saved(tmp_path: Path, log: Path, *effects: AdoptedEffect):
    save_model(tmp_path / "m", amended(load(), default_vehicle(), effects, [log]))
    return load(tmp_path / "m")


def test_weather_and_load_start_the_next_flight_at_zero(tmp_path: Path, log: Path) -> None:
    payload = AdoptedEffect("payload", {"mass": 0.4, "from_s": 12.0, "until_s": 40.0})
    model = saved(
        tmp_path,
        log,
        AdoptedEffect("wind", WIND),
        payload,
        AdoptedEffect("vertical_inflow", INFLOW),
    )
    effects = {e.name: e.parameters for e in model.effects}
    assert effects == {
        "rotor_drag": {"drag": 0.4, "turning": 0.0, "sinking": 0.1, "above_radii": 0.5},
        "vertical_inflow": INFLOW | {"north": 0.0, "east": 0.0},
    }
    of_day = model.info["of_day"]
    spread = {"north": 4.0, "east": 4.0, "lift": 0.03}
    assert of_day["wind"] == {"spread": spread, "shape": {"above_radii": 0.5}}
    assert of_day["payload"]["spread"]["mass"] == pytest.approx(0.15 * default_vehicle().mass_kg)
    assert known_day(model)["payload"] == {}


def test_the_model_knows_the_logs_that_it_was_made_from(tmp_path: Path, log: Path) -> None:
    model = saved(tmp_path, log, AdoptedEffect("thrust_scale", {"scale": 0.05}))
    assert [entry["name"] for entry in model.info["learnt_from"]] == ["flight.tlog"]
    copy = tmp_path / "renamed.tlog"
    copy.write_bytes(log.read_bytes())
    assert learnt_from(model, copy)
    copy.write_bytes(b"of another flight")
    assert not learnt_from(model, copy)
    assert not learnt_from(load(), log)


def test_every_effect_says_what_is_kept_of_it() -> None:
    kept = {e.name: e.kept for e in catalogue()}
    assert [name for name, k in kept.items() if not k] == [
        "air_density",
        "payload",
        "slung_load",
        "trim_moment",
        "wind",
    ]
    for e in catalogue():
        assert kept_words(e).startswith("kept" if e.kept else "not kept")
        assert e.kept == (not e.belongs_to.of_day)
    assert "keeps what of it is the vehicle's, as rotor drag" in kept_words(get("wind"))
    assert "north and east" in kept_words(get("vertical_inflow"))
    assert get("imu_bias").belongs_to is BelongsTo.INSTRUMENT


def test_a_size_that_its_flight_hardly_knows_is_taken_towards_what_was_known_before() -> None:
    vehicle = default_vehicle()
    context = Context(
        state=blank_state((), len(vehicle.fans), len(vehicle.rotors)), vehicle=vehicle
    )
    known = (
        IntervalEstimate(name="scale", value=0.1, ci95=(0.1 - half, 0.1 + half), unit="1")
        for half in (0.004, 0.2)
    )
    well, badly = (to_adopt(get("thrust_scale"), [scale], context).parameters for scale in known)
    assert well["scale"] == pytest.approx(0.1, rel=0.01)
    assert 0.0 < badly["scale"] < 0.06
    bias = [
        IntervalEstimate(name=n, value=0.2, ci95=(-0.3, 0.7), unit="1")
        for n in ("x", "y", "z", "pitch", "roll")
    ]
    assert to_adopt(get("imu_bias"), bias, context).parameters["x"] == 0.2


def test_drag_that_was_found_in_a_strong_wind_is_adopted_by_half() -> None:
    vehicle = default_vehicle()
    context = Context(
        state=blank_state((), len(vehicle.fans), len(vehicle.rotors)), vehicle=vehicle
    )
    found = [
        IntervalEstimate(name=name, value=value, ci95=(value, value), unit="1")
        for name, value in WIND.items()
    ]
    one, two = (
        to_adopt(get("wind"), found, context, doubt=doubt).parameters for doubt in (0.5, 0.0)
    )
    assert two["own_motion"] == pytest.approx(0.4)
    assert one["own_motion"] == pytest.approx(0.2)
    scale = [IntervalEstimate(name="scale", value=0.1, ci95=(0.1, 0.1), unit="1")]
    assert to_adopt(get("thrust_scale"), scale, context, doubt=0.5).parameters[
        "scale"
    ] == pytest.approx(0.1)


def test_axes_on_which_an_effect_does_not_act_are_kept(tmp_path: Path, log: Path) -> None:
    model = saved(tmp_path, log, AdoptedEffect("thrust_scale", {"scale": 0.05}, ("Fx", "My")))
    assert model.effects[0].without == ("Fx", "My")
    path = tmp_path / "m" / "model.json"
    path.write_text(path.read_text().replace('"My"', '"Mq"'))
    with pytest.raises(ModelError, match="'thrust_scale': axis 'Mq' is not one of Fx, Fy, Fz"):
        load(tmp_path / "m")


def test_the_map_of_ground_and_wall_is_in_the_radii_of_the_vehicle_where_a_model_names_no_fan() -> (
    None
):
    law = get("surface_law")
    size = dict.fromkeys([c.name for c in law.coefficients], 0.02) | dict.fromkeys(
        [s.name for s in law.shapes], 1.0
    )
    found, bare = AdoptedEffect(law.name, size), load()
    nameless = bare.with_effects(
        (), {key: value for key, value in bare.info.items() if key != "fan"}
    )
    model = amended(nameless, default_vehicle(), [found])
    assert model.wrench(0.2, 0.1, 4000.0) == pytest.approx(
        bare.with_effects((found,)).wrench(0.2, 0.1, 4000.0)
    )
