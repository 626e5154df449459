"""``models vehicle``: frames, parameters, estimates, and a file that is checked before it is written."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.vehicles import QUAD, TANDEM
from models.cli import main
from models.frames import GRAVITY
from models.vehicle import load_vehicle, parse_vehicle
from models.vehicle_setup.estimate import ct_of_hover, inertia, max_thrust, throttle_output
from models.vehicle_setup.frames import FRAMES, ardupilot_frame
from models.vehicle_setup.parameters import read_parameters
from models.vehicle_setup.toml_text import vehicle_text

QUAD_X = ["--mass", "3", "--frame", "quad-x", "--span", "0.6364", "--propeller", "11.02"]


@pytest.mark.parametrize("shipped", [QUAD, TANDEM])
def test_the_text_of_a_vehicle_reads_back_as_the_vehicle(shipped):
    vehicle = load_vehicle(shipped)
    assert parse_vehicle(vehicle_text(vehicle, {"ct": "a note"}, "a\nhead"), "text") == vehicle


def test_the_shipped_quadrotor_comes_out_of_its_frame(tmp_path):
    out = tmp_path / "q.toml"
    assert main(["vehicle", "--out", str(out), "--rotor-height", "0.06", "--quiet", *QUAD_X]) == 0
    made, shipped = load_vehicle(out), load_vehicle(QUAD)
    for a, b in zip(made.fans, shipped.fans, strict=True):
        assert a.position_m == pytest.approx(b.position_m, abs=0.001)
        assert a.rotors == b.rotors
    assert made.inertia_kgm2 == pytest.approx(shipped.inertia_kgm2, rel=0.3)


def test_every_frame_makes_a_file_that_passes(tmp_path, capsys):
    for frame in FRAMES:
        out = tmp_path / f"{frame}.toml"
        arguments = ["--mass", "6", "--frame", frame, "--span", "1.2", "--propeller", "13"]
        assert main(["vehicle", "--out", str(out), *arguments]) == 0, capsys.readouterr().err
        vehicle = load_vehicle(out)
        spins = [r.spin for r in vehicle.rotors]
        assert sum(spins) == 0
        # Yaw torque is balanced about the centre too: no roll or pitch comes of it.
        assert sum(f.position_m[0] for f in vehicle.fans) == pytest.approx(0.0, abs=1e-3)
    assert len(load_vehicle(tmp_path / "octaquad-x.toml").fans) == 4


def test_ardupilot_parameters_give_frame_outputs_ranges_and_curve(tmp_path):
    params = tmp_path / "a.param"
    params.write_text(
        "# saved\nFRAME_CLASS,1\nFRAME_TYPE,1\nSERVO9_FUNCTION,33\nSERVO10_FUNCTION,34\nSERVO11_FUNCTION,35\n"
        "SERVO12_FUNCTION,36\nMOT_THST_HOVER,0.31\nMOT_THST_EXPO,0.6\nMOT_SPIN_MIN,0.1\nMOT_SPIN_MAX,0.9\n"
        "RNGFND1_TYPE,20\nRNGFND1_ORIENT,25\nRNGFND1_POS_Z,0.04\nRNGFND2_TYPE,20\nRNGFND2_ORIENT,0\nRNGFND3_TYPE,0\n"
    )
    out = tmp_path / "v.toml"
    arguments = ["--params", str(params), "--mass", "3", "--span", "0.64", "--propeller", "11", "--quiet"]
    assert main(["vehicle", "--out", str(out), *arguments]) == 0
    vehicle = load_vehicle(out)
    assert [r.esc for r in vehicle.rotors] == [9, 10, 11, 12]
    assert vehicle.hover_thrust == 0.31
    assert [(r.orientation, r.target) for r in vehicle.rangefinders] == [(25, "ground"), (0, "wall")]
    assert vehicle.rangefinders[0].position_m == (0.0, 0.0, 0.04)
    assert main(["vehicle", "--out", str(out), "--force", "--no-rpm", "--voltage", "15.5", *arguments]) == 0
    vehicle = load_vehicle(out)
    assert [r.servo for r in vehicle.rotors] == [9, 10, 11, 12]
    t = vehicle.throttle
    x = ((0.6 - 1.0) + math.sqrt(0.16 + 4 * 0.6 * 0.31)) / 1.2
    u = 0.1 + 0.8 * x
    assert 4 * t.max_thrust_n * ((1 - t.expo) * u + t.expo * u * u) == pytest.approx(3 * GRAVITY, rel=1e-3)


def test_px4_parameters_give_places_and_spins(tmp_path):
    params = tmp_path / "px4.params"
    rows = ["# Onboard parameters", "# Vehicle-Id Component-Id Name Value Type"]
    places = [(0.2, 0.25, 0.05), (-0.2, -0.2, 0.05), (0.2, -0.25, -0.05), (-0.2, 0.2, -0.05)]
    given = {"CA_ROTOR_COUNT": 4.0, "MPC_THR_HOVER": 0.45}
    for k, (x, y, km) in enumerate(places):
        given |= {f"CA_ROTOR{k}_PX": x, f"CA_ROTOR{k}_PY": y, f"CA_ROTOR{k}_KM": km}
    rows += [f"1\t1\t{name}\t{value:g}\t9" for name, value in given.items()]
    params.write_text("\n".join(rows))
    out = tmp_path / "v.toml"
    arguments = ["--params", str(params), "--mass", "2", "--propeller", "10", "--hover-rpm", "5000", "--quiet"]
    assert main(["vehicle", "--out", str(out), *arguments]) == 0
    vehicle = load_vehicle(out)
    assert [f.position_m[:2] for f in vehicle.fans] == [pytest.approx(p[:2], abs=1e-4) for p in places]
    assert [r.spin for r in vehicle.rotors] == [-1, -1, 1, 1]
    assert [r.esc for r in vehicle.rotors] == [1, 2, 3, 4]
    assert vehicle.hover_thrust == 0.45
    assert vehicle.fans[0].ct == pytest.approx(ct_of_hover(2.0, 4, 0.127, 5000.0))


def test_what_is_missing_is_named_and_nothing_is_written(tmp_path, capsys):
    out = tmp_path / "v.toml"
    bad = tmp_path / "bad.param"
    bad.write_text("FRAME_CLASS,1\nnot a parameter\n")
    for arguments, words in (
        (["--mass", "3"], "--frame, --span, --propeller"),
        ([*QUAD_X, "--range", "down"], "--range down"),
        ([*QUAD_X, "--no-rpm"], "--voltage"),
        ([*QUAD_X, "--params", str(bad)], "line 2"),
        ([*QUAD_X, "--params", str(tmp_path / "none")], "cannot be read"),
        ([*QUAD_X[:2], "--frame", "quad-x", "--span", "0.1", "--propeller", "11"], "overlap"),
        (["--mass", "-3", *QUAD_X[2:]], "--mass -3"),
    ):
        assert main(["vehicle", "--out", str(out), *arguments]) == 2
        err = capsys.readouterr().err
        assert words in err
        assert len(err.strip().splitlines()) == 1
        assert not out.exists()
    out.write_text("mine")
    assert main(["vehicle", "--out", str(out), *QUAD_X]) == 2
    assert "--force" in capsys.readouterr().err
    assert out.read_text() == "mine"


@given(st.floats(0.2, 50.0), st.floats(0.1, 2.0), st.sampled_from(sorted(FRAMES)))
def test_inertia_is_that_of_a_possible_body(mass, arm, frame):
    xx, yy, zz = inertia(mass, arm, FRAMES[frame])
    assert 0.0 < max(xx, yy) < zz < xx + yy
    assert math.sqrt(zz / mass) < arm


def test_hover_carries_the_weight():
    parameters = {"THR_MDL_FAC": 0.3}
    expo, output = throttle_output(parameters, 0.4)
    assert expo * output**2 + (1 - expo) * output == pytest.approx(0.4)
    assert 4 * max_thrust(2.0, 4, expo, output) * 0.4 == pytest.approx(2.0 * GRAVITY, rel=1e-3)
    assert ardupilot_frame({"FRAME_CLASS": 7, "FRAME_TYPE": 1}) is None


def test_a_file_with_a_byte_order_mark_and_spaces(tmp_path):
    path = tmp_path / "p.parm"
    path.write_text("\ufeffMOT_THST_HOVER  0.3\nFRAME_CLASS 2 # hexa\n", encoding="utf-8")
    assert read_parameters(path) == {"MOT_THST_HOVER": 0.3, "FRAME_CLASS": 2.0}
