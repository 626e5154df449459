"""First numbers of a vehicle: frames, estimates, and the text of a vehicle file."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.vehicles import QUAD, TANDEM
from models.common.frames import GRAVITY
from models.vehicle import load_vehicle, parse_vehicle
from models.vehicle.ardupilot_frames import ardupilot_frame
from models.vehicle.estimate import inertia, max_thrust, throttle_output
from models.vehicle.motor_layouts import FRAMES
from models.vehicle.motor_outputs import declared_motors
from models.vehicle.px4_frames import px4_motors
from models.vehicle.setup import Answers, build, parameter_ranges
from models.vehicle.toml_text import vehicle_text

ARDUPILOT = {
    "SERVO9_FUNCTION": 33.0, "SERVO10_FUNCTION": 34.0, "SERVO11_FUNCTION": 35.0, "SERVO12_FUNCTION": 36.0,
    "MOT_THST_HOVER": 0.31, "MOT_THST_EXPO": 0.6, "MOT_SPIN_MIN": 0.1, "MOT_SPIN_MAX": 0.9, "RNGFND1_TYPE": 20.0,
    "RNGFND1_ORIENT": 25.0, "RNGFND1_POS_Z": 0.04, "RNGFND2_TYPE": 20.0, "RNGFND2_ORIENT": 0.0, "RNGFND3_TYPE": 0.0,
}  # fmt: skip


def built(motors, arm_m, **known):
    """A vehicle of 3 kg, through the text of its file."""
    declared = declared_motors(known.get("parameters", {}))
    own = declared[0].numbers if declared else {}
    numbers = {motor: own.get(motor, motor) for motor in range(1, len(motors) + 1)}
    answers = {
        "name": "v",
        "mass_kg": 3.0,
        "propeller_m": 0.28,
        "motors": motors,
        "arm_m": arm_m,
        "numbers": numbers,
    }
    answers |= known
    vehicle, origin = build(Answers(**answers))
    return parse_vehicle(vehicle_text(vehicle, origin), "v.toml")


@pytest.mark.parametrize("shipped", [QUAD, TANDEM])
def test_the_text_of_a_vehicle_reads_back_as_the_vehicle(shipped):
    vehicle = load_vehicle(shipped)
    assert parse_vehicle(vehicle_text(vehicle, {"ct": "a note"}, "a\nhead"), "text") == vehicle


def test_the_shipped_quadrotor_comes_out_of_its_frame():
    made, shipped = built(FRAMES["quad-x"], 0.3182), load_vehicle(QUAD)
    for a, b in zip(made.fans, shipped.fans, strict=True):
        assert a.position_m[:2] == pytest.approx(b.position_m[:2], abs=0.001)
        assert a.rotors == b.rotors
    assert made.inertia_kgm2 == pytest.approx(shipped.inertia_kgm2, rel=0.3)


LOPSIDED = {
    "quad-vtail",
    "quad-atail",
    "quad-y4",
    "quad-deadcat",
    "octo-v",
    "tri",
    "tri-reversed",
    "px4-tri",
}
"""By the firmware's own tables."""


@pytest.mark.parametrize("frame", FRAMES)
def test_every_frame_makes_a_file_that_passes(frame):
    vehicle = built(FRAMES[frame], 0.6, numbers={m.number: m.number for m in FRAMES[frame]})
    if frame not in LOPSIDED:
        assert sum(r.spin for r in vehicle.rotors) == 0
        # Yaw torque is balanced about the centre too: no roll or pitch comes of it.
        assert sum(f.position_m[0] for f in vehicle.fans) == pytest.approx(0.0, abs=1e-3)
    assert len(vehicle.fans) == len({(m.forward, m.right) for m in FRAMES[frame]})


def test_ardupilot_parameters_give_outputs_ranges_and_curve():
    vehicle = built(
        FRAMES["quad-x"], 0.32, parameters=ARDUPILOT, ranges=parameter_ranges(ARDUPILOT)
    )
    assert [r.esc for r in vehicle.rotors] == [9, 10, 11, 12]
    assert vehicle.hover_thrust == 0.31
    assert [(r.orientation, r.target) for r in vehicle.rangefinders] == [
        (25, "ground"),
        (0, "wall"),
    ]
    assert vehicle.rangefinders[0].position_m == (0.0, 0.0, 0.04)
    vehicle = built(FRAMES["quad-x"], 0.32, parameters=ARDUPILOT, telemetered=False, voltage_v=15.5)
    assert [r.servo for r in vehicle.rotors] == [9, 10, 11, 12]
    t = vehicle.throttle
    x = ((0.6 - 1.0) + math.sqrt(0.16 + 4 * 0.6 * 0.31)) / 1.2
    u = 0.1 + 0.8 * x
    assert 4 * t.max_thrust_n * ((1 - t.expo) * u + t.expo * u * u) == pytest.approx(
        3 * GRAVITY, rel=1e-3
    )


def test_px4_parameters_give_places_and_spins():
    places = [(0.2, 0.25, 0.05), (-0.2, -0.2, 0.05), (0.2, -0.25, -0.05), (-0.2, 0.2, -0.05)]
    given = {"CA_ROTOR_COUNT": 4.0, "MPC_THR_HOVER": 0.45}
    for k, (x, y, km) in enumerate(places):
        given |= {f"CA_ROTOR{k}_PX": x, f"CA_ROTOR{k}_PY": y, f"CA_ROTOR{k}_KM": km}
    vehicle = built(*px4_motors(given), propeller_m=0.25, parameters=given)
    assert [f.position_m[:2] for f in vehicle.fans] == [
        pytest.approx(p[:2], abs=1e-4) for p in places
    ]
    assert [r.spin for r in vehicle.rotors] == [-1, -1, 1, 1]
    assert [r.esc for r in vehicle.rotors] == [1, 2, 3, 4]
    assert vehicle.hover_thrust == 0.45


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
    assert ardupilot_frame({"FRAME_CLASS": 15, "FRAME_TYPE": 1}) is None
