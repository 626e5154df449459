"""Frames, vehicle file and the modelled wrench of a whole vehicle: signs, lever arms, and refusals by key."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import models
from models import vehicle_wrench as air
from models.air_state import AirState, blank_state
from models.common import frames as wrench
from models.common.errors import ConfigError
from models.vehicle import Vehicle, load_vehicle

INF = np.inf
G = 9.80665

TANDEM = """
name = "tandem"
mass_kg = 4.6
inertia_kgm2 = [0.092, 0.283, 0.245]
hover_thrust = 0.50
rotor_radius_m = 0.165

[[fan]]
position_m = [0.32, 0.0, 0.0]
lip_radius_m = 0.21
rotors = [{ esc = 1, spin = "cw" }, { esc = 2, spin = "ccw" }]
ct = 0.0451
cq = 0.0080

[[fan]]
position_m = [-0.32, 0.0, 0.0]
lip_radius_m = 0.21
rotors = [{ esc = 3, spin = "cw" }, { esc = 4, spin = "ccw" }]
ct = 0.0451
cq = 0.0080

[[vane]]
servo = 5
fan = 1
position_m = [0.32, 0.0, 0.15]
axis = [0.0, 1.0, 0.0]
force_per_thrust_rad = 0.5
neutral_us = 1500
rad_per_us = 0.001

[[rangefinder]]
orientation = 25
target = "ground"
position_m = [0.0, 0.0, 0.05]
"""
THROTTLE = "[throttle]\nmax_thrust_n = 18.0\nexpo = 0.65\npwm_min_us = 1000\npwm_max_us = 2000\nvoltage_v = 16.0\n"


def _load(tmp_path: Path, text: str = TANDEM) -> Vehicle:
    path = tmp_path / "vehicle.toml"
    path.write_text(text, encoding="utf-8")
    return load_vehicle(path)


@pytest.fixture
def tandem(tmp_path: Path) -> Vehicle:
    return _load(tmp_path)


def _hover(**changes: object) -> AirState:
    state = replace(blank_state((), 2, 4), rpm=np.full(4, 4000.0), servo_us=np.full(16, 1500.0))
    return replace(state, **changes)  # type: ignore[arg-type]


# Frames


@pytest.mark.parametrize(
    ("bearing", "expected"),
    [
        (0.0, [1, -2, -3, 4, -5, -6]),
        (np.pi / 2, [2, 1, -3, 5, 4, -6]),
        (-np.pi / 2, [-2, -1, -3, -5, -4, -6]),
        (np.pi, [-1, 2, -3, -4, 5, -6]),
    ],
)
def test_a_corner_wrench_turns_to_the_walls_bearing(bearing: float, expected: list[float]) -> None:
    np.testing.assert_allclose(
        wrench.corner_to_body([1, 2, 3, 4, 5, 6], bearing), expected, atol=1e-12
    )


@settings(deadline=None)
@given(bearing=st.floats(-7, 7), seed=st.integers(0, 100))
def test_the_turn_is_a_rotation(bearing: float, seed: int) -> None:
    w = np.random.default_rng(seed).normal(size=(2, 6))
    body = wrench.corner_to_body(w, bearing)
    np.testing.assert_allclose(
        np.linalg.norm(body[:, :3], axis=1), np.linalg.norm(w[:, :3], axis=1)
    )
    cross = np.cross(w[0, :3], w[1, :3])
    turned = wrench.corner_to_body(np.concatenate([cross, cross]), bearing)[:3]
    np.testing.assert_allclose(np.cross(body[0, :3], body[1, :3]), turned, atol=1e-9)


def test_bearings_and_wrenches_broadcast() -> None:
    out = wrench.corner_to_body(np.ones((5, 1, 6)), np.zeros((5, 3)))
    assert out.shape == (5, 3, 6)


def test_a_lift_ahead_of_the_cg_pitches_up() -> None:
    moved = wrench.at_cg([0, 0, -10, 0, 0, 0], (0.5, 0, 0))
    np.testing.assert_allclose(moved, [0, 0, -10, 0, 5, 0])


@settings(deadline=None)
@given(roll=st.floats(-3, 3), pitch=st.floats(-1.5, 1.5), yaw=st.floats(-3, 3))
def test_the_quaternion_of_euler_angles_is_their_rotation(
    roll: float, pitch: float, yaw: float
) -> None:
    q = wrench.quaternion_from_euler(roll, pitch, yaw)
    rotation = wrench.rotation_from_quaternion(q)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    np.testing.assert_allclose(np.arctan2(rotation[2, 1], rotation[2, 2]), roll, atol=1e-6)
    np.testing.assert_allclose(-np.arcsin(rotation[2, 0]), pitch, atol=1e-6)
    np.testing.assert_allclose(np.arctan2(rotation[1, 0], rotation[0, 0]), yaw, atol=1e-6)


def test_yaw_turns_forward_to_east() -> None:
    rotation = wrench.rotation_from_quaternion(wrench.quaternion_from_euler(0, 0, np.pi / 2))
    np.testing.assert_allclose(rotation @ [1, 0, 0], [0, 1, 0], atol=1e-12)


def test_the_measured_wrench_of_a_hover_is_the_weight_and_a_spin_needs_a_moment() -> None:
    inertia = [0.1, 0.2, 0.3]
    still = wrench.measured_wrench([0, 0, -G], [0, 0, 0], [0, 0, 0], 4.6, inertia)
    np.testing.assert_allclose(still, [0, 0, -4.6 * G, 0, 0, 0])
    spin = wrench.measured_wrench([0, 0, 0], [1, 2, 0], [0, 0, 3], 4.6, inertia)
    np.testing.assert_allclose(spin[3:], [0, 0, 0.3 * 3 + (0.2 - 0.1) * 1 * 2])


# Vehicle file


def test_the_contracts_vehicle_loads(tandem: Vehicle) -> None:
    assert len(tandem.fans) == 2
    assert tandem.rotor_fan == (0, 0, 1, 1)
    assert [r.spin for r in tandem.rotors] == [1, -1, 1, -1]
    assert tandem.telemetered
    assert tandem.disc_area_m2 == pytest.approx(0.08553, abs=1e-5)
    assert tandem.limits.tilt_deg == 8.0


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("mass_kg = 4.6", "mass_kg = -1", "mass_kg"),
        ("mass_kg = 4.6", "", "mass_kg"),
        ("mass_kg = 4.6", "mass_kg = nan", "mass_kg"),
        ("mass_kg = 4.6", 'mass_kg = "heavy"', "mass_kg"),
        ("mass_kg = 4.6", "mass_kg = 4.6\nmass = 3", "mass"),
        ("hover_thrust = 0.50", "hover_thrust = 1.5", "hover_thrust"),
        ("[0.092, 0.283, 0.245]", "[0.092, 0.283]", "inertia_kgm2"),
        ("[0.092, 0.283, 0.245]", "[0.092, 0.583, 0.245]", "inertia_kgm2"),
        ("lip_radius_m = 0.21", "lip_radius_m = 0.1", "lip_radius_m"),
        ("esc = 2", "esc = 1", "esc"),
        ("esc = 2", "esc = 33", "esc"),
        ("esc = 2", "servo = 2", "fan"),
        ('spin = "cw"', 'spin = "left"', "spin"),
        ("fan = 1", "fan = 3", "fan"),
        ("axis = [0.0, 1.0, 0.0]", "axis = [0.0, 0.5, 0.0]", "axis"),
        ('target = "ground"', 'target = "floor"', "target"),
        ("orientation = 25", "orientation = 25\nport = 3", "port"),
        ("[[vane]]", THROTTLE + "[[vane]]", "throttle"),
        ("[[vane]]", "[limits]\nthrust = 0.1\n[[vane]]", "limits.tilt_deg"),
        ("[[vane]]", "[limits]\nthrust = true\n[[vane]]", "limits.thrust"),
        ("[[vane]]", "limits = 3\n[[vane]]", "limits"),
    ],
)
def test_a_wrong_vehicle_file_is_refused_by_file_and_key(
    tmp_path: Path, old: str, new: str, key: str
) -> None:
    with pytest.raises(ConfigError) as error:
        _load(tmp_path, TANDEM.replace(old, new))
    message = str(error.value)
    assert "vehicle.toml" in message
    assert key in message
    assert "\n" not in message


def test_files_that_are_no_vehicle_are_refused(tmp_path: Path) -> None:
    for path, content in ((tmp_path / "a.toml", b"name = "), (tmp_path / "b.toml", b"\xff\xfe")):
        path.write_bytes(content)
        with pytest.raises(ConfigError, match=path.name):
            load_vehicle(path)
    with pytest.raises(ConfigError, match="cannot be read"):
        load_vehicle(tmp_path / "none.toml")


# Modelled wrench


def test_a_fans_one_speed_is_the_root_of_the_mean_square(tandem: Vehicle) -> None:
    np.testing.assert_allclose(
        air.fan_rpm(tandem, [3000.0, 4000.0, 5000.0, 5000.0]), [np.sqrt(12.5e6), 5000.0]
    )


def test_the_tandem_hovers_in_free_air(tandem: Vehicle) -> None:
    w = air.modelled_wrench(tandem, models.load(), _hover())
    np.testing.assert_allclose(w, [0, 0, -4.6 * G, 0, 0, 0], atol=1e-6)
    np.testing.assert_array_equal(
        air.disturbance_wrench(tandem, models.load(), _hover()), np.zeros(6)
    )


@pytest.mark.parametrize("side", [1, -1])
def test_a_wall_draws_and_rolls_the_vehicle_towards_itself(tandem: Vehicle, side: int) -> None:
    state = _hover(d_m=np.full(2, 0.1), wall_bearing_rad=np.asarray(side * np.pi / 2))
    w = air.disturbance_wrench(tandem, models.load(), state)
    assert side * w[1] > 0.1
    assert side * w[3] > 0.1
    assert abs(w[4]) < 0.1 * abs(w[3]), "both fans see the same wall: what is left is swirl"


def test_ground_lifts_and_the_lower_fan_more(tandem: Vehicle) -> None:
    state = _hover(h_m=np.array([0.15, 0.3]))
    w = air.disturbance_wrench(tandem, models.load(), state)
    assert w[2] < -1.0
    assert w[4] > 0.1, "more lift in front pitches up"
    assert w[3] == pytest.approx(0.0, abs=1e-12)


def test_disturbance_is_the_difference_of_modelled_wrenches(tandem: Vehicle) -> None:
    near = _hover(
        h_m=np.array([0.15, 0.2]), d_m=np.array([0.1, 0.2]), wall_bearing_rad=np.asarray(1.0)
    )
    model = models.load()
    difference = air.modelled_wrench(tandem, model, near) - air.modelled_wrench(
        tandem, model, _hover()
    )
    np.testing.assert_allclose(air.disturbance_wrench(tandem, model, near), difference, atol=1e-9)


def test_a_record_is_its_instants(tandem: Vehicle) -> None:
    rng = np.random.default_rng(0)
    record = replace(
        blank_state((5,), 2, 4),
        rpm=rng.uniform(3000, 5000, (5, 4)),
        servo_us=rng.uniform(1400, 1600, (5, 16)),
        h_m=rng.uniform(0.1, 0.5, (5, 2)),
        d_m=rng.uniform(0.1, 0.5, (5, 2)),
        wall_bearing_rad=rng.uniform(-3, 3, 5),
    )
    whole = air.modelled_wrench(tandem, models.load(), record)
    for i in range(5):
        np.testing.assert_allclose(
            air.modelled_wrench(tandem, models.load(), record.take(i)), whole[i], atol=1e-9
        )


def test_a_deflected_vane_pushes_sideways_and_rolls(tandem: Vehicle) -> None:
    servo = np.full(16, 1500.0)
    servo[4] = 1600.0
    w = air.modelled_wrench(tandem, models.load(), _hover(servo_us=servo))
    side = 0.5 * 0.1 * 0.5 * 4.6 * G
    np.testing.assert_allclose(w[[1, 3, 5]], [side, -0.15 * side, 0.32 * side], atol=1e-6)


def test_a_faster_clockwise_rotor_turns_the_body_the_other_way(tandem: Vehicle) -> None:
    assert air.fan_torques(tandem, [4000.0] * 4) == pytest.approx(0.0, abs=1e-12)
    unequal = air.fan_torques(tandem, [4200.0, 3800.0, 4000.0, 4000.0])
    assert unequal[0] < 0.0
    assert unequal[1] == pytest.approx(0.0, abs=1e-12)
    silent = replace(tandem, fans=tuple(replace(f, cq=None) for f in tandem.fans))
    assert not air.fan_torques(silent, [4200.0, 3800.0, 4000.0, 4000.0]).any()


def test_the_empty_model_is_rotors_in_free_air(tandem: Vehicle) -> None:
    w = air.modelled_wrench(tandem, None, _hover(h_m=np.full(2, 0.1)))
    thrust = 0.0451 * 1.225 * tandem.disc_area_m2 * (4000 * 2 * np.pi / 60 * 0.165) ** 2
    np.testing.assert_allclose(w, [0, 0, -2 * thrust, 0, 0, 0], atol=1e-9)


def test_the_empty_model_without_ct_is_refused_by_key(tandem: Vehicle) -> None:
    bare = replace(tandem, fans=tuple(replace(f, ct=None) for f in tandem.fans))
    with pytest.raises(ConfigError, match=r"fan\.ct"):
        air.modelled_wrench(bare, None, _hover())


def test_rotor_speed_follows_from_servo_outputs_where_none_is_telemetered(tmp_path: Path) -> None:
    text = TANDEM.split("[[vane]]")[0].replace("esc =", "servo =") + THROTTLE
    vehicle = _load(tmp_path, text)
    assert not vehicle.telemetered
    servo = np.full(16, 1500.0)
    thrust = air.servo_thrust(vehicle, servo)
    np.testing.assert_allclose(thrust, 18.0 * (0.35 * 0.5 + 0.65 * 0.25))
    rpm = air.rpm_from_servos(vehicle, None, servo)
    state = _hover(rpm=rpm, servo_us=servo)
    np.testing.assert_allclose(air.modelled_wrench(vehicle, None, state)[2], -thrust.sum())
    with pytest.raises(ConfigError, match="throttle"):
        air.servo_thrust(_load(tmp_path), servo)
