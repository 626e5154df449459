"""A model knows its fan: another one is refused in flight, none flies by default, and the diagnosis says so."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import models
from companion.vehicles import QUAD, default_vehicle
from models.choice import choose, choose_to_fly
from models.cli import main
from models.common.errors import ConfigError
from models.surrogate.empty import empty_model, is_empty
from models.surrogate.fan_identity import contradictions, identity_of, lift_over_weight
from models.vehicle import load_vehicle
from replay.diagnosis.amended_model import amended


@pytest.mark.parametrize("name", ["default", "corner_cfd", "corner_cfd_half"])
def test_shipped_models_name_their_fan_and_fit_the_shipped_vehicle(name):
    model, vehicle = models.load(name), default_vehicle()
    fan = identity_of(model.info)
    assert (fan.radius_m, fan.lip_radius_m) == (
        vehicle.rotor_radius_m,
        vehicle.fans[0].lip_radius_m,
    )
    assert fan.ct == pytest.approx(0.045, rel=0.02)
    assert contradictions(vehicle, model) == ()
    assert lift_over_weight(vehicle, model) == pytest.approx(1.0, abs=0.03)


def test_another_fan_is_refused_in_flight_by_size_and_lift():
    quad = load_vehicle(QUAD)
    said = "; ".join(contradictions(quad, models.load()))
    for word in ("rotor radius", "lip radius", "times the weight"):
        assert word in said
    with pytest.raises(ConfigError, match="--model default: is of another fan") as refused:
        choose_to_fly(quad, "default")
    assert refused.value.exit_code == 2


def test_without_a_name_another_vehicle_gets_no_model_and_hears_why():
    chosen = choose_to_fly(load_vehicle(QUAD), None)
    assert chosen.name == "none"
    assert is_empty(chosen.model)
    assert "another fan" in chosen.note
    own = choose_to_fly(default_vehicle(), None)
    assert (own.name, own.note) == ("shipped", None)


def test_none_is_rotors_in_free_air():
    vehicle = default_vehicle()
    model = choose(vehicle, "none").model
    near, far = model.wrench(0.1, 0.1, 4000.0), model.wrench(np.inf, np.inf, 4000.0)
    np.testing.assert_array_equal(near, far)
    assert 2.0 * far[2] == pytest.approx(4.6 * 9.80665, rel=0.01)


def test_a_vehicle_without_ct_hears_which_key_is_missing():
    quad = load_vehicle(QUAD)
    bare = replace(quad, fans=tuple(replace(fan, ct=None) for fan in quad.fans))
    with pytest.raises(ConfigError, match=r"fan\.ct"):
        choose(bare, None)
    with pytest.raises(ConfigError, match=r"fan\.ct"):
        choose(bare, "none")


def test_an_amended_model_keeps_the_fan_and_fits_its_vehicle_only(tmp_path):
    quad = load_vehicle(QUAD)
    models.save_model(tmp_path / "own", amended(None, quad, ()))
    assert choose_to_fly(quad, str(tmp_path / "own")).contradictions == ()
    with pytest.raises(ConfigError, match="another fan"):
        choose_to_fly(default_vehicle(), str(tmp_path / "own"))
    manifest = json.loads((tmp_path / "own" / "model.json").read_text())
    assert manifest["fan"] == {"radius_m": 0.14, "lip_radius_m": 0.14, "ct": pytest.approx(0.014)}


def test_a_wrong_coefficient_alone_is_noticed_by_the_lift():
    vehicle = default_vehicle()
    weak = replace(vehicle, fans=tuple(replace(fan, ct=0.02) for fan in vehicle.fans))
    assert any("times the weight" in line for line in contradictions(weak, models.load()))
    slightly = replace(vehicle, fans=tuple(replace(fan, ct=0.040) for fan in vehicle.fans))
    assert contradictions(slightly, models.load()) == ()


def test_a_trained_model_is_told_its_fan(tmp_path, capsys):
    out = tmp_path / "m"
    assert (
        main(
            [
                "train",
                "--data",
                "closed-form",
                "--method",
                "polynomial",
                "--out",
                str(out),
                "--quiet",
            ]
        )
        == 0
    )
    assert identity_of(models.load(out).info).radius_m == 0.165
    data = str(models.__path__[0]) + "/data/corner_cfd.csv"
    arguments = ["train", "--data", data, "--method", "polynomial", "--out", str(out), "--quiet"]
    assert main([*arguments, "--fan", "0.14", "0.15"]) == 0
    assert identity_of(models.load(out).info).lip_radius_m == 0.15
    assert main(arguments) == 0
    assert identity_of(models.load(out).info) is None
    assert main([*arguments, "--fan", "0.2", "0.1"]) == 2
    assert "--fan" in capsys.readouterr().err


def test_query_of_no_model(tmp_path, capsys):
    place = ["--h", "0.2", "--d", "inf", "--rpm", "4000", "--json", "-"]
    assert main(["query", "none", "--vehicle", str(QUAD), *place]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["wrench"] == said["free_air"]
    assert main(["query", "none", *place]) == 2


def test_empty_model_of_unequal_fans_lifts_their_sum():
    quad = load_vehicle(QUAD)
    uneven = replace(quad, fans=(replace(quad.fans[0], ct=0.016), *quad.fans[1:]))
    law = empty_model(uneven).free_air_law
    assert 4.0 * float(law.lift(4000.0)) == pytest.approx(
        (0.016 + 3 * 0.014) / (4 * 0.014) * 4.0 * float(empty_model(quad).free_air_law.lift(4000.0))
    )
