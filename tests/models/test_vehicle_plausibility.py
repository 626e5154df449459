"""Vehicle files that cannot be are refused by key, odd ones are said, real ones pass."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from companion.vehicles import QUAD, TANDEM
from models.common.errors import ConfigError
from models.vehicle import Vehicle, load_vehicle
from models.vehicle.plausibility import warnings


def changed(tmp_path: Path, source: Path, *pairs: tuple[str, str]) -> Path:
    text = source.read_text()
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new)
    path = tmp_path / "vehicle.toml"
    path.write_text(text)
    return path


def load(tmp_path: Path, source: Path, *pairs: tuple[str, str]) -> Vehicle:
    return load_vehicle(changed(tmp_path, source, *pairs))


@pytest.mark.parametrize(
    ("source", "pairs", "said"),
    [
        (TANDEM, [("mass_kg = 4.6", "mass_kg = 2000")], ("mass_kg", "rotor_radius_m")),
        (TANDEM, [("[0.092, 0.283, 0.245]", "[20.0, 25.0, 25.0]")], ("inertia_kgm2", "25 kg m^2")),
        (
            QUAD,
            [("[-0.225, -0.225, -0.06]", "[0.225, 0.225, -0.06]")],
            ("fan[2].position_m", "one place"),
        ),
        (QUAD, [('spin = "cw"', 'spin = "ccw"')], ("spin", "same way")),
        (QUAD, [("rotor_radius_m = 0.14", "rotor_radius_m = 0.28")], ("lip_radius_m", "diameter")),
        (
            QUAD,
            [
                ("rotor_radius_m = 0.14", "rotor_radius_m = 0.28"),
                ("lip_radius_m = 0.14", "lip_radius_m = 0.28"),
            ],
            ("lip_radius_m", "diameter"),
        ),
        (
            QUAD,
            [("orientation = 25 # down", "orientation = 24")],
            ("rangefinder[1].orientation", "24 looks up"),
        ),
        (
            QUAD,
            [("orientation = 0 # forward", "orientation = 25")],
            ("rangefinder[2].orientation", "wall"),
        ),
        (TANDEM, [("0.0, 0.15]", "0.0, -0.15]")], ("vane[1].position_m", "positive down")),
        (QUAD, [("ct = 0.0140", "ct = 0.00014")], ("fan[1].ct", "m/s")),
        (QUAD, [("mass_kg = 3.0", "mass = 3.0")], ("'mass_kg' is missing", "'mass' is not known")),
        (
            QUAD,
            [("hover_thrust = 0.42", "hover_trust = 0.42")],
            ("'hover_thrust'", "'hover_trust'"),
        ),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(tmp_path, source, pairs, said):
    with pytest.raises(ConfigError) as refused:
        load(tmp_path, source, *pairs)
    text = str(refused.value)
    assert "\n" not in text
    assert str(tmp_path / "vehicle.toml") in text
    for word in said:
        assert word in text


def test_an_unknown_key_names_the_one_that_is_meant(tmp_path):
    with pytest.raises(
        ConfigError, match="'rotor_radius' is not known; did you mean 'rotor_radius_m'"
    ):
        load(
            tmp_path, QUAD, ("rotor_radius_m = 0.14", "rotor_radius_m = 0.14\nrotor_radius = 0.14")
        )


@pytest.mark.parametrize(
    ("source", "pairs", "said"),
    [
        (QUAD, [("-0.06]", "0.06]"), ("[0.0, 0.0, 0.05]", "[0.0, 0.0, -0.05]")], "positive down"),
        (QUAD, [("-0.06]", "0.06]")], "positive down"),
        (
            QUAD,
            [("[0.225, 0.225,", "[0.725, 0.225,"), ("[0.225, -0.225,", "[0.725, -0.225,")],
            "CG",
        ),
        (QUAD, [("[0.060, 0.064, 0.105]", "[6e-6, 6.4e-6, 1.05e-5]")], "inertia_kgm2"),
    ],
)
def test_what_is_odd_is_said(tmp_path, source, pairs, said):
    warned = warnings(load(tmp_path, source, *pairs))
    assert any(said in line for line in warned), warned


def test_no_rangefinder_at_all_is_said(tmp_path):
    text = QUAD.read_text()
    path = tmp_path / "vehicle.toml"
    path.write_text(text[: text.index("[[rangefinder]]")] + text[text.index("[limits]") :])
    assert any("rangefinder" in line for line in warnings(load_vehicle(path)))


@pytest.mark.parametrize(("newtons", "refused"), [(3.0, True), (9.0, False), (20.0, False)])
def test_thrust_to_weight(tmp_path, newtons, refused):
    text = QUAD.read_text().replace("esc =", "servo =")
    throttle = (
        f"[throttle]\nmax_thrust_n = {newtons}\nexpo = 0.65\npwm_min_us = 1000\npwm_max_us = 2000\n"
    )
    path = tmp_path / "vehicle.toml"
    path.write_text(f"{text}{throttle}voltage_v = 16.0\n")
    if refused:
        with pytest.raises(ConfigError, match="max_thrust_n"):
            load_vehicle(path)
    else:
        assert any("max_thrust_n" in line for line in warnings(load_vehicle(path))) is (
            newtons < 10.0
        )


@pytest.mark.parametrize("path", [QUAD, TANDEM])
def test_the_shipped_vehicles_are_sound(path):
    assert warnings(load_vehicle(path)) == []


def test_vehicles_of_real_flights_are_sound(shared_data: Path):
    files = sorted(shared_data.rglob("*.toml"))
    assert files
    for path in files:
        assert all("rangefinder" in line for line in warnings(load_vehicle(path))), path


def test_slew_rates_that_cannot_take_an_offset_back_in_time_are_said():
    quick = load_vehicle(TANDEM)
    assert not [w for w in warnings(quick) if "slew" in w]
    slow = replace(quick, limits=replace(quick.limits, slew_thrust_per_s=0.1))
    assert "takes 1 s" in next(w for w in warnings(slow) if "limits.slew_thrust_per_s" in w)
