from __future__ import annotations

import math
from dataclasses import replace

import pytest
from simflight import hovering, vehicle

from companion.sim.air import NOMINAL
from companion.sim.body import ARDUPILOT_MOTOR, Body, Surroundings, thrust_share
from companion.sim.mixer import Mixer
from companion.sim.scenario import lip_reach
from companion.sim.sensors import OUT_OF_RANGE_M, RangeSensor, true_range
from models.common.errors import ConfigError
from models.common.frames import GRAVITY
from models.vehicle import Rangefinder

NEUTRAL = [1000.0] * 4 + [1500.0] * 2 + [0.0] * 10


def still(name: str = "tandem", **surroundings: float) -> Body:
    return Body(
        vehicle=vehicle(name), surroundings=Surroundings(**surroundings), law=NOMINAL, seed=1
    )


def test_it_stands_still_on_its_feet():
    body = still()
    before = list(body.position)
    for _ in range(800):
        body.step(NEUTRAL)
    assert body.contact
    assert math.dist(body.position, before) < 1e-4
    assert body.specific_force[2] == pytest.approx(-GRAVITY, abs=1e-6)


def test_without_rotors_it_falls_freely():
    body = still()
    body.position[2] = -50.0
    for _ in range(400):
        body.step(NEUTRAL)
    assert body.velocity[2] == pytest.approx(GRAVITY, rel=0.01)
    assert body.specific_force[2] == pytest.approx(0.0, abs=1e-3)


def test_thrust_is_affine_in_the_command_as_measured():
    """d(T/W)/d(command) at hover: 1.46...1.62 on the real autopilot, where 1/hover would say 2."""

    def thrust(command: float) -> float:
        return thrust_share(ARDUPILOT_MOTOR.output(command))

    slope = (thrust(0.55) - thrust(0.45)) / 0.1 / thrust(0.5)
    assert 1.46 <= slope <= 1.62
    assert thrust(0.0) > 0.05


@pytest.mark.parametrize("azimuth", [0.0, 0.5 * math.pi, math.pi, -0.5 * math.pi])
def test_a_wall_pulls_and_tilts_towards_itself(azimuth):
    reach = lip_reach(still().vehicle, azimuth)
    body = still(wall_m=reach + 0.08, wall_azimuth_rad=azimuth)
    body.position[2] = -3.0
    body.rpm = [4000.0] * 4
    body.step([1673.0] * 4 + NEUTRAL[4:])
    fx, fy, _, mx, my, _ = body.causes.corner
    towards = math.cos(azimuth) * fx + math.sin(azimuth) * fy
    tilt = math.sin(azimuth) * mx - math.cos(azimuth) * my  # + tips towards the wall
    assert towards > 0.1
    assert tilt > 0.05


def test_the_ground_lifts_and_its_air_can_be_taken_away():
    lifts = []
    for air in (True, False):
        body = Body(vehicle=vehicle(), surroundings=Surroundings(air=air), law=NOMINAL, seed=1)
        body.position[2] = -0.165
        body.rpm = [4000.0] * 4
        body.step([1673.0] * 4 + NEUTRAL[4:])
        lifts.append(-body.causes.corner[2])
    assert lifts[0] == pytest.approx(2.0 * 22.555 * NOMINAL.increments(1.0, math.inf).z, rel=0.03)
    assert lifts[1] == 0.0


def test_a_solid_wall_stops_it():
    body = still(wall_m=1.0)
    body.position[:] = [0.0, 0.7, -2.0]
    body.velocity[:] = [0.0, 0.5, 0.0]
    touched = False
    for _ in range(200):
        body.step(NEUTRAL)
        touched |= body.contact
    assert touched
    assert body.position[1] + 0.21 < 1.02
    assert body.velocity[1] < 0.1


def test_vanes_roll_it_at_the_price_of_a_side_force():
    body = still()
    body.position[2] = -3.0
    body.rpm = [4000.0] * 4
    pwm = [1673.0] * 4 + [1400.0, 1400.0] + [0.0] * 10
    for _ in range(40):
        body.step(pwm)
    _, fy, _, mx, _, mz = body.causes.vanes
    assert mx > 0.1
    assert fy == pytest.approx(-mx / 0.15, rel=1e-6)
    assert abs(mz) < 0.1 * mx


@pytest.mark.parametrize("name", ["tandem", "quad"])
def test_hover_needs_about_the_throttle_of_the_vehicle_file(name):
    peer = hovering(name)
    assert peer.flight.autopilot.throttle == pytest.approx(vehicle(name).hover_thrust, rel=0.12)
    assert math.dist(peer.flight.body.position, (0.0, 0.0, -1.5)) < 0.1


def test_a_vehicle_that_cannot_yaw_is_refused():
    v = vehicle("quad")
    lame = replace(v, fans=tuple(type(f)(f.position_m, f.lip_radius_m, f.rotors) for f in v.fans))
    with pytest.raises(ConfigError, match="cannot hold"):
        Mixer(lame, 0.4)


def test_beams_meet_ground_and_wall():
    body = still(wall_m=2.0)
    body.position[:] = [0.0, 0.5, -1.2]
    assert true_range(body, (0.0, 0.0, 0.05), (0.0, 0.0, 1.0)) == pytest.approx(1.15)
    assert true_range(body, (0.0, 0.21, 0.0), (0.0, 1.0, 0.0)) == pytest.approx(1.29)
    assert true_range(body, (0.0, 0.0, 0.0), (0.0, -1.0, 0.0)) == math.inf


def test_a_range_is_quantised_late_noisy_and_sometimes_lost():
    body = still()
    body.position[2] = -1.234
    sensor = RangeSensor(Rangefinder(25, "ground", (0.0, 0.0, 0.0)), "seed")
    readings = []
    for i in range(4000):
        body.time_s = 0.02 * i
        sensor.step(body)
        readings.append(sensor.reading_m)
    seen = [r for r in readings[2:] if r != OUT_OF_RANGE_M]
    assert readings[0] == OUT_OF_RANGE_M
    assert 0.005 < 1.0 - len(seen) / len(readings[2:]) < 0.02
    assert sum(seen) / len(seen) == pytest.approx(1.234, abs=0.002)
    assert all(abs(100.0 * r - round(100.0 * r)) < 1e-9 for r in seen)
