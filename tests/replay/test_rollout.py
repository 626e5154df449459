"""Motion ahead of a measured state: mechanics that are known exactly, and a flight that is known."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from field_case_logs import bin_log

import models
import replay
from companion.sim.body import Body, Causes
from companion.sim.body import Surroundings as Surface
from models.common.errors import ConfigError
from models.common.frames import GRAVITY, Array
from models.effects import AdoptedEffect
from models.vehicle import Vehicle, load_vehicle
from replay import FlightModel, rollout
from replay.cli import main
from replay.predict.rollout import POSITION, QUATERNION, RATES, VELOCITY, Surroundings
from replay.predict.windows import _all_known, halfway
from tests.replay.rigid_flight import RATE_HZ, fly

SHIPPED = Path(__file__).parents[2] / "companion" / "vehicles" / "quad.toml"
STEP_S = 0.01


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    return load_vehicle(SHIPPED)


def at_rest(windows: int = 1) -> Array:
    states = np.zeros((windows, 13))
    states[:, 6] = 1.0
    return states


def still(vehicle: Vehicle, steps: int) -> Array:
    """Rotors that do not turn."""
    return np.zeros((1, steps, len(vehicle.rotors)))


def hover(vehicle: Vehicle, steps: int) -> Array:
    """Speeds at which the empty model carries the weight."""
    thrust = FlightModel(vehicle)
    state = at_rest()
    speed = 1000.0
    fell = rollout(thrust, state, np.full((1, 1, len(vehicle.rotors)), speed))[0, 0, 5] / STEP_S
    lift = GRAVITY - fell
    return np.full((1, steps, len(vehicle.rotors)), speed * np.sqrt(GRAVITY / lift))


def test_without_thrust_it_falls(vehicle: Vehicle) -> None:
    out = rollout(FlightModel(vehicle), at_rest(), still(vehicle, 50))
    assert out.shape == (1, 50, 13)
    assert out[0, -1, VELOCITY] == pytest.approx([0.0, 0.0, GRAVITY * 0.5])
    assert out[0, -1, POSITION] == pytest.approx([0.0, 0.0, 0.5 * GRAVITY * 0.25])


def test_it_stays_where_thrust_is_its_weight(vehicle: Vehicle) -> None:
    out = rollout(FlightModel(vehicle), at_rest(), hover(vehicle, 100))
    assert np.abs(out[0, -1] - at_rest()[0]).max() < 1e-6


def test_turning_about_a_main_axis_goes_on(vehicle: Vehicle) -> None:
    state = at_rest()
    state[0, RATES] = [0.0, 0.0, 2.0]
    out = rollout(FlightModel(vehicle), state, still(vehicle, 50))
    assert out[0, -1, RATES] == pytest.approx([0.0, 0.0, 2.0])
    assert out[0, -1, QUATERNION] == pytest.approx([np.cos(0.5), 0.0, 0.0, np.sin(0.5)])


def test_without_a_moment_the_angular_momentum_stays(vehicle: Vehicle) -> None:
    """A body that tumbles about no main axis keeps its angular momentum in the world."""
    state = at_rest()
    state[0, RATES] = [1.0, 2.0, 3.0]
    steps = 1000
    out = rollout(FlightModel(vehicle), state, still(vehicle, steps), step_s=1e-3)
    inertia = np.asarray(vehicle.inertia_kgm2)
    end = replay.predict.rollout.rotation_from_quaternion(out[0, -1, QUATERNION])
    assert end @ (inertia * out[0, -1, RATES]) == pytest.approx(inertia * state[0, RATES], rel=5e-3)


def test_a_load_makes_it_sink_as_newton_says(vehicle: Vehicle) -> None:
    """Thrust m g carries m + dm, so that a quarter more is missed as dF = -T dm / (m + dm)."""
    load = AdoptedEffect("payload", {"mass": vehicle.mass_kg / 5.0})
    out = rollout(FlightModel(vehicle, effects=(load,)), at_rest(), hover(vehicle, 20))
    assert out[0, -1, 5] == pytest.approx(0.2 * GRAVITY * (1.0 - 1.0 / 1.25), rel=1e-3)


def test_ground_is_as_far_as_it_has_moved(vehicle: Vehicle) -> None:
    """Ground effect falls off over a length: it is felt more by what sinks into it."""
    law = AdoptedEffect("ground_effect", {"gain": 0.3, "length_radii": 3.0})
    model = FlightModel(vehicle, effects=(law,))
    fans = len(vehicle.fans)
    high = Surroundings(
        h_m=np.full((1, fans), 2.0), d_m=np.full((1, fans), np.inf), wall_bearing_rad=np.zeros(1)
    )
    state = at_rest()
    state[0, VELOCITY] = [0.0, 0.0, 2.0]
    free = rollout(model, state, hover(vehicle, 90))
    near = rollout(model, state, hover(vehicle, 90), near=high)
    slowed = free[0, :, 5] - near[0, :, 5]
    assert slowed[10] < 0.1 * slowed[-1]
    assert slowed[-1] > 0.1


@pytest.mark.parametrize("step_s", [0.005, 0.0025])
def test_the_simulated_vehicle_moves_by_the_same_mechanics(vehicle: Vehicle, step_s: float) -> None:
    """It takes plain steps, whose error falls with the step: half a second apart by less than two steps of motion."""
    wrench = (0.6, -0.3, -27.0, 0.02, -0.03, 0.01)
    steps = round(0.5 / step_s)
    body = Body(vehicle=vehicle, surroundings=Surface(), dt=step_s, position=[0.0, 0.0, -2.0])
    body.causes = Causes(free=wrench)
    for _ in range(steps):
        body._integrate(body.rotation())
    start = at_rest()
    start[0, 2] = -2.0
    beside = np.broadcast_to(wrench, (1, steps, 6))
    stopped = still(vehicle, steps)
    told = rollout(FlightModel(vehicle), start, stopped, step_s=step_s, beside=beside)[0, -1]
    moved = [*body.position, *body.velocity, *body.quaternion, *body.rates]
    speed = np.linalg.norm([*told[VELOCITY], *told[RATES]])
    assert speed > 0.5
    assert np.abs(moved - told).max() < 2.0 * step_s * speed


def test_a_known_flight_is_foretold(vehicle: Vehicle) -> None:
    """From every second of it half a second ahead: rates and attitude by the rotors' speeds alone."""
    flight = fly(vehicle)
    steps = int(RATE_HZ) // 2
    starts = np.arange(int(RATE_HZ), len(flight.t) - steps - 1, int(RATE_HZ))
    rows = starts[:, None] + np.arange(steps)
    states = np.column_stack([flight.position, flight.velocity, flight.quaternion, flight.rates])
    out = rollout(FlightModel(vehicle), states[starts], flight.speed[rows], step_s=1.0 / RATE_HZ)
    error = np.linalg.norm(out[:, -1, RATES] - states[starts + steps, RATES], axis=1)
    moved = np.linalg.norm(states[starts, RATES] - states[starts + steps, RATES], axis=1)
    assert error.mean() < 0.1 * moved.mean()


def test_a_measured_attitude_is_that_of_the_middle_of_a_step() -> None:
    """A quarter turn about the nose, told with either sign of its quaternion."""
    upright = np.array([[1.0, 0.0, 0.0, 0.0]])
    rolled = np.array([[np.cos(np.pi / 4.0), np.sin(np.pi / 4.0), 0.0, 0.0]])
    half = np.sqrt(0.5)
    eighth = np.array([[1.0, 0.0, 0.0], [0.0, half, -half], [0.0, half, half]])
    for sign in (1.0, -1.0):
        assert halfway(upright, sign * rolled)[0] == pytest.approx(eighth)


def test_with_the_measured_attitude_a_turning_thrust_ends_where_it_should(
    vehicle: Vehicle,
) -> None:
    """Thrust that turns at a steady rate has a known speed; windows have to take the middle of every step."""
    steps = 50
    rate = 4.0
    angle = rate * STEP_S * np.arange(steps + 1)
    quaternions = np.zeros((steps + 1, 4))
    quaternions[:, 0] = np.cos(0.5 * angle)
    quaternions[:, 1] = np.sin(0.5 * angle)
    middle = halfway(quaternions[:-1], quaternions[1:])
    speeds = hover(vehicle, steps)
    out = rollout(FlightModel(vehicle), at_rest(), speeds, step_s=STEP_S, rotations=middle[None])
    east = GRAVITY * (1.0 - np.cos(angle[-1])) / rate
    assert out[0, -1, VELOCITY][1] == pytest.approx(east, rel=1e-3)


@pytest.mark.parametrize(
    ("states", "inputs", "message"),
    [
        (np.zeros((2, 12)), np.zeros((2, 5, 4)), r"states have the shape \(2, 12\)"),
        (np.zeros((2, 13)), np.zeros((3, 5, 4)), r"inputs have the shape \(3, 5, 4\)"),
        (np.zeros((2, 13)), np.zeros((2, 5, 3)), r"not \(2, steps, 4\)"),
    ],
)
def test_shapes_that_do_not_fit(
    vehicle: Vehicle, states: Array, inputs: Array, message: str
) -> None:
    quad = replace(vehicle)
    with pytest.raises(ConfigError, match=message):
        rollout(FlightModel(quad), states, inputs)


def test_a_surrogate_alone_does_not_fly(vehicle: Vehicle) -> None:
    """It says the wrench of a fan; mass and places of the fans are the vehicle's."""
    with pytest.raises(ConfigError, match=r"give FlightModel\(vehicle, surrogate\)"):
        rollout(models.load(), np.zeros((1, 13)), np.zeros((1, 5, 4)))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path]:
    """A log, the vehicle drafted from it, and the model that its diagnosis made."""
    folder = tmp_path_factory.mktemp("ahead")
    log = folder / "flight.BIN"
    bin_log().write(log)
    vehicle = folder / "vehicle.toml"
    model = folder / "model"
    saved = ["--save-vehicle", str(vehicle), "--save-model", str(model)]
    assert main(["diagnose", str(log), "--mass", "2", "--quiet", *saved]) == 0
    return log, vehicle, model


def predict(asked: tuple[Path, Path, Path], *more: str) -> int:
    log, vehicle, model = asked
    return main(
        ["predict", str(log), "--vehicle", str(vehicle), "--model", str(model), "--frozen", *more]
    )


def test_the_command_tells_the_error_by_horizon(
    asked: tuple[Path, Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "answer.json"
    page = ["--report", str(tmp_path)]
    assert predict(asked, "--horizon", "0.5", "--json", str(file), *page) == 0
    assert "motion ahead of" in capsys.readouterr().out
    assert "Motion ahead" in (tmp_path / "report.html").read_text()
    answer = json.loads(file.read_text())
    assert set(answer["horizon"]) == {"position", "velocity", "attitude", "rates"} or set(
        answer["horizon"]
    ) == {"position", "velocity"}
    last = answer["horizon"]["velocity"][-1]
    assert last["s"] == pytest.approx(0.5, abs=0.03)
    assert last["interval"][0] < last["mae"] < last["interval"][1]
    assert last["mae"] < last["mae_naive"]
    counted = answer["windows"]
    assert counted["judged"] > 0
    assert counted["diverged"] == 0
    assert answer["worst_windows"][0]["velocity"] >= last["mae"]


def test_a_horizon_longer_than_the_log_is_one_line(
    asked: tuple[Path, Path, Path],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    log, *_ = asked
    monkeypatch.setattr("replay.predict.cli.MOST_S", 1000.0)
    assert predict(asked, "--horizon", "600") == 3
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert f"{log}: no window of 600 s without a gap" in line


def test_windows_with_a_gap_are_left_out() -> None:
    """A window holds its steps and the state after the last one."""
    known = np.ones(20, dtype=bool)
    known[9] = False
    starts = np.arange(0, 15)
    whole = _all_known(known, starts, steps=3)
    assert list(starts[~whole]) == [6, 7, 8, 9]


def test_a_window_that_runs_away_is_counted_and_in_no_mean(
    asked: tuple[Path, Path, Path], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def runaway(*given: object, **named: object) -> Array:
        path = rollout(*given, **named)
        path[::2, -1, VELOCITY] = 1e6
        return path

    file = tmp_path / "answer.json"
    monkeypatch.setattr("replay.predict.horizon.rollout", runaway)
    assert predict(asked, "--horizon", "0.5", "--json", str(file)) == 0
    answer = json.loads(file.read_text())
    counted = answer["windows"]
    assert abs(counted["diverged"] - counted["judged"]) <= 1
    assert counted["diverged"] > 0
    assert answer["horizon"]["velocity"][-1]["mae"] < 1.0


@pytest.mark.parametrize("wrong", ["0", "-1", "nan", "soon", "60"])
def test_a_horizon_that_is_no_time(asked: tuple[Path, Path, Path], wrong: str) -> None:
    with pytest.raises(SystemExit) as stopped:
        predict(asked, "--horizon", wrong)
    assert stopped.value.code == 2
