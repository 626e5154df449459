"""The flight simulator behind the diagnosis suite: physics by independent arguments, files by independent readers."""

from __future__ import annotations

import numpy as np
import pytest
from flights import near_wall, rotor_flow
from flights.craft import GRAVITY, QUAD, RHO0, TANDEM, rangers, vehicle_toml
from flights.effects import CATALOGUE
from flights.oracle import residual
from flights.plan import Leg
from flights.power import Battery
from flights.recorder import Logging, frames, sense, write_tlog
from flights.scenarios import scenarios
from flights.unlisted import UNLISTED
from flights.world import Job, World

from models.dataset import read
from models.vehicle import load_vehicle

HOVER = (Leg(60.0, 0.0, 0.0, -1.0),)


def fly(craft, jobs, seconds=1.5):
    return World(craft, jobs, seconds, settle_s=1.5).fly()


@pytest.fixture(scope="module")
def every_effect():
    """All effects side by side, each in its own short hover over the home point."""
    names = [None, *CATALOGUE, *UNLISTED]
    jobs = []
    for k, name in enumerate(names):
        kind = (CATALOGUE | UNLISTED).get(name)
        jobs.append(
            Job(k, HOVER, {name: kind.draw(np.random.default_rng(k), TANDEM)} if kind else {})
        )
    return dict(zip(names, range(len(names)), strict=True)), fly(TANDEM, jobs)


@pytest.mark.slow
def test_with_nothing_undeclared_the_noise_free_residual_is_zero(every_effect):
    index, tape = every_effect
    assert np.abs(tape.effect[:, :, index[None]]).max() < 1e-9


def test_the_vehicle_hovers_where_it_is_told(every_effect):
    index, tape = every_effect
    place = tape.position[:, :, index[None]]
    assert np.abs(place - [0.0, 0.0, -1.0]).max() < 0.25
    # The mean specific force of something that stays in place is gravity.
    felt = tape.specific_force[:, :, index[None]].mean(axis=0)
    assert felt[2] == pytest.approx(-GRAVITY, abs=0.3)


CONTRACT = """
ceiling second_wall partial_ground wind rotor_drag body_drag vertical_inflow air_density thrust_scale fan_imbalance
payload cg_offset range_offset imu_bias thermal_derating battery_sag gyroscopic ground_effect wall_effect motor_lag
contact slung_load rate_damping flapping_moment trim_moment rotor_inertia momentum_thrust
"""


def test_every_catalogue_name_of_the_contract_is_flown():
    contract = CONTRACT.split()
    assert sorted(CATALOGUE) == sorted(contract)
    flown = {e for s in scenarios(1) if s.group == "single" for e in s.effects}
    assert flown == set(contract)
    assert sum(s.group == "unlisted" for s in scenarios(1)) >= 6


@pytest.mark.parametrize(
    ("name", "axis", "newtons"), [("payload", 2, 0.0), ("imu_bias", 0, 0.1), ("wind", 0, 0.05)]
)
def test_effects_show_on_their_axes(every_effect, name, axis, newtons):
    index, tape = every_effect
    seen = np.abs(tape.effect[:, :, index[name]]).mean(axis=0)
    assert seen[axis] >= newtons


def test_a_lump_attached_shows_as_missing_thrust_of_its_own_weight():
    job = Job(3, HOVER, {"payload": {"kg": 0.3, "below_m": 0.05, "at_s": -10.0}})
    tape = fly(TANDEM, [job], 4.0)
    # In hover the rotors carry the lump too: the model expects more lift than the declared mass feels.
    assert tape.effect[-50:, 2, 0].mean() == pytest.approx(0.3 * GRAVITY, rel=0.15)


def test_thrust_scale_is_exactly_its_share_of_lift():
    tape = fly(TANDEM, [Job(3, HOVER, {"thrust_scale": {"share": -0.04}})])
    assert tape.effect[:, 2, 0].mean() == pytest.approx(
        0.04 / 0.96 * TANDEM.mass_kg * GRAVITY, rel=0.1
    )


def test_glauert_reduces_to_hover_and_to_the_climb_solution():
    thrust = np.array([20.0])
    hover = np.sqrt(thrust / (2 * RHO0 * TANDEM.area))
    assert rotor_flow.induced(TANDEM, thrust, np.zeros(1), np.zeros(1)) == pytest.approx(
        hover, rel=1e-3
    )
    climb = 3.0
    exact = -climb / 2 + np.sqrt(climb**2 / 4 + hover**2)
    assert rotor_flow.induced(TANDEM, thrust, np.zeros(1), np.full(1, climb)) == pytest.approx(
        exact, rel=1e-2
    )


def test_climbing_costs_thrust_and_drag_opposes_motion():
    rpm = np.array([4000.0])
    zero = np.zeros(1)
    up = rotor_flow.thrust_ratio(TANDEM, rpm, zero, np.ones(1))
    assert 0.9 < up[0] < 0.99
    assert rotor_flow.thrust_ratio(TANDEM, rpm, zero, zero)[0] == pytest.approx(1.0, abs=2e-3)
    fx, fy = rotor_flow.side_force(
        TANDEM, np.array([22.5]), rpm, np.array([0.5]), np.array([-0.2]), zero, np.ones(1)
    )
    assert fx[0] < 0.0 < fy[0]


def test_a_battery_sags_under_load_and_recovers():
    pack = Battery.fresh(1, 6, np.array([np.nan]), np.ones(1))
    rest = pack.volts[0]
    for _ in range(200):
        pack.step(0.1, np.array([60.0]))
    loaded = pack.volts[0]
    for _ in range(200):
        pack.step(0.1, np.array([5.0]))
    assert loaded < pack.volts[0] < rest + 1.0


def test_the_declared_air_is_free_air_far_away_and_pulls_to_the_wall():
    far = near_wall.fan_wrench(TANDEM, np.array(np.inf), np.array(np.inf), np.array(4000.0))
    assert far[2] == pytest.approx(TANDEM.mass_kg * GRAVITY / 2)
    assert np.allclose(far[[0, 1, 3, 4, 5]], 0.0)
    near = near_wall.fan_wrench(TANDEM, np.array(1.0), np.array(0.1), np.array(4000.0))
    assert near[0] > 0.0 < near[4]
    right = near_wall.to_body(near, np.array(np.pi / 2))
    assert right[1] == pytest.approx(near[0])  # a wall on the right pulls to the right
    assert right[3] == pytest.approx(near[4])  # and rolls to the right


def test_the_table_is_a_data_set_of_the_contract(tmp_path):
    near_wall.write_table(TANDEM, tmp_path / "table.csv")
    data = read(tmp_path / "table.csv")
    assert len(data.rpm) > 1000


@pytest.mark.parametrize("craft", [TANDEM, QUAD], ids=["tandem", "quad"])
@pytest.mark.parametrize("by_servo", [False, True])
def test_vehicle_files_are_accepted(tmp_path, craft, by_servo):
    path = tmp_path / "v.toml"
    path.write_text(
        vehicle_toml(
            craft, rangers(craft, ceiling=True, front=True), by_servo=by_servo, mass_factor=0.7
        )
    )
    vehicle = load_vehicle(path)
    assert vehicle.mass_kg == pytest.approx(0.7 * craft.mass_kg)
    assert vehicle.telemetered is not by_servo
    assert len(vehicle.fans) == len(craft.fan_position)


def test_a_tlog_holds_what_was_flown(tmp_path):
    tape = fly(TANDEM, [Job(5, HOVER)], 2.0)
    sensors = rangers(TANDEM, ceiling=False, front=False)
    seen = sense(TANDEM, tape, 0, 5, sensors, Logging())
    path = tmp_path / "f.tlog"
    write_tlog(TANDEM, seen, 5, sensors, Logging(), path)
    from pymavlink import mavutil

    link = mavutil.mavlink_connection(str(path))
    messages = iter(lambda: link.recv_msg(), None)
    kinds: dict[str, list] = {}
    for message in messages:
        kinds.setdefault(message.get_type(), []).append(message)
    assert "BAD_DATA" not in kinds
    assert len(kinds["HIGHRES_IMU"]) == len(kinds["ATTITUDE"]) == 100
    assert len(kinds["LOCAL_POSITION_NED"]) == 50
    assert np.mean([m.zacc for m in kinds["HIGHRES_IMU"]]) == pytest.approx(-GRAVITY, abs=0.3)
    assert np.mean([m.rpm[0] for m in kinds["ESC_TELEMETRY_1_TO_4"]]) == pytest.approx(
        4000, rel=0.05
    )
    down = [
        m.current_distance
        for m in kinds["DISTANCE_SENSOR"]
        if m.orientation == 25 and m.signal_quality > 1
    ]
    assert np.median(down) == pytest.approx(95, abs=10)  # cm from a sensor 5 cm below a CG at 1 m


def test_the_oracle_residual_of_a_null_is_sensor_noise_and_unsteady_air():
    tape = fly(TANDEM, [Job(6, HOVER)], 4.0)
    sensors = rangers(TANDEM, ceiling=False, front=False)
    seen = sense(TANDEM, tape, 0, 6, sensors, Logging())
    rest = residual(TANDEM, seen, sensors, by_servo=False)
    assert np.abs(rest[:, :3].mean(axis=0)).max() < 0.6  # N, of 45
    assert np.abs(rest[:, 3:].mean(axis=0)).max() < 0.25  # N m


@pytest.mark.slow
def test_a_reboot_restarts_the_boot_clock_and_two_vehicles_have_two_systems():
    tape = fly(TANDEM, [Job(7, HOVER)], 8.0)
    sensors = rangers(TANDEM, ceiling=False, front=False)
    log = Logging(reboot_at_s=1.0, system=7)
    stream = frames(TANDEM, sense(TANDEM, tape, 0, 7, sensors, log), 7, sensors, log)
    assert {frame[8 + 5] for _, frame in stream} == {7}
    assert [t for t, _ in stream] == sorted(t for t, _ in stream)
    gaps = np.diff([t for t, _ in stream])
    assert gaps.max() > 5.0
