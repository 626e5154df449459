"""Vehicle files that are wrong on purpose say what they are meant to say, and what must be found then."""

from __future__ import annotations

from pathlib import Path

import pytest
from measured.changes import CHANGES, LIGHTER, SHIFT, WEAKER, changed
from measured.known import Flight, Range, read

from models.vehicle import load_vehicle

FILE = (
    """name = "four"
mass_kg = 0.04
inertia_kgm2 = [1e-05, 1e-05, 2e-05]
hover_thrust = 0.5
rotor_radius_m = 0.03
"""
    + "".join(
        f"""
[[fan]]
position_m = [{x}, {y}, 0.0]
lip_radius_m = 0.03
{ct}rotors = [{{ esc = {k}, spin = "{spin}" }}]
"""
        for k, (x, y, spin, ct) in enumerate(
            [
                (s * 0.03, t * 0.04, spin, "ct = 0.02\n")
                for s, t, spin in ((1, 1, "ccw"), (-1, 1, "cw"), (-1, -1, "ccw"), (1, -1, "cw"))
            ],
            1,
        )
    )
    + """
[limits]
thrust = 0.10
tilt_deg = 8.0
slew_thrust_per_s = 0.5
slew_tilt_deg_per_s = 60.0
"""
)
FLIGHT = Flight(
    "source", "measured", "a.tlog", "v.toml", ("Fx", "Fy", "Fz"), must=(frozenset({"rotor_drag"}),),
    unknown=frozenset({"cg_offset", "wind"}), never=frozenset({"payload"}),
    limits=(Range("cg_offset", "x", -1.0, 1.0),),
)  # fmt: skip


def vehicles(name: str, folder: Path):
    (folder / "v.toml").write_text(FILE)
    flight = changed(FLIGHT, name, folder, folder)
    assert flight is not None
    return load_vehicle(folder / "v.toml"), load_vehicle(folder / flight.vehicle), flight


def test_lighter_hides_a_load(tmp_path):
    right, wrong, flight = vehicles("lighter", tmp_path)
    assert wrong.mass_kg == pytest.approx(LIGHTER * right.mass_kg)
    assert flight.must[1] == {"payload", "thrust_scale"}
    assert "payload" in flight.true
    assert not flight.never
    (load, _) = flight.sizes
    assert load.holds(right.mass_kg - wrong.mass_kg)
    assert flight.limits == FLIGHT.limits


def test_a_weak_fan_is_the_third(tmp_path):
    right, wrong, flight = vehicles("weak_fan", tmp_path)
    assert [b.ct / a.ct for a, b in zip(right.fans, wrong.fans, strict=True)] == pytest.approx(
        [1, 1, 1 / WEAKER, 1], rel=1e-4
    )
    assert Range("fan_imbalance", "fan", 3, 3) in flight.limits


def test_shifted_fans_are_a_shifted_centre_of_gravity(tmp_path):
    right, wrong, flight = vehicles("shifted", tmp_path)
    ahead = [b.position_m[0] - a.position_m[0] for a, b in zip(right.fans, wrong.fans, strict=True)]
    assert ahead == pytest.approx([SHIFT * 0.05] * 4)
    assert flight.sizes[0].holds(SHIFT * 0.05)
    assert "cg_offset" in flight.true
    assert "cg_offset" not in flight.unknown
    assert flight.limits == ()


def test_exchanged_rotors_are_a_fault_of_the_file(tmp_path):
    right, wrong, flight = vehicles("exchanged", tmp_path)
    assert [r.esc for fan in wrong.fans for r in fan.rotors] == [2, 1, 3, 4]
    assert [r.spin for fan in wrong.fans for r in fan.rotors] == [
        r.spin for fan in right.fans for r in fan.rotors
    ]
    assert frozenset({"fault:vehicle file"}) in flight.must


def test_a_load_is_hidden_only_where_rotor_speeds_are_telemetered(tmp_path):
    (tmp_path / "v.toml").write_text(FILE + "\n[throttle]\nmax_thrust_n = 0.2\n")
    assert changed(FLIGHT, "lighter", tmp_path, tmp_path) is None
    assert changed(FLIGHT, "shifted", tmp_path, tmp_path) is not None


def test_the_table_of_the_nano_drone_is_whole():
    table = read(Path(__file__).parents[1] / "benchmarks" / "measured" / "nanodrone.toml")
    assert len(table.flights) == 21
    assert all(not f.never & f.true and not f.unknown & f.true for f in table.flights)
    assert set(CHANGES) == {"lighter", "weak_fan", "shifted", "exchanged"}
