"""Public tables: their protocols on made-up flights; the real data lie in clones of their authors' repositories."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from sources.nanodrone import VEHICLES
from sources.vehicle_file import vehicle_toml
from tables import cable_tension, nanobench, nanodrone, neurobem, rotor_pairs
from tables.cable_tension import Flight
from tables.multistep import Parameter, fit
from tables.nanodrone import Cut, Fitted, reproduced, vehicle
from tables.nanodrone_data import STEP_S, Run, _bridged, _lag, _without_repeats
from tables.nanodrone_score import STEPS, naive, score, starts

from models.air_state import blank_state
from models.common.frames import GRAVITY, Array
from models.effects import Context
from models.vehicle import load_vehicle
from replay.predict.rollout import FlightModel, rollout

TRUE = {
    "rotor_drag.drag": 0.3,
    "rate_damping.tilting": 2.0,
    "flapping_moment.moment": 0.1,
    "rotor_inertia.inertia": 1e-9,
}


def hover_rpm() -> float:
    fans = vehicle().fans
    return (
        float(np.sqrt(nanodrone.MASS_KG * GRAVITY / len(fans) / nanodrone.THRUST_N_S2))
        * 30.0
        / np.pi
    )


def flown(model: Fitted, steps: int = 300) -> Run:
    """A flight of a known model with rotors that go to and fro."""
    rng = np.random.default_rng(1)
    wave = np.sin(
        np.arange(steps)[:, None] * np.array([0.11, 0.13, 0.17, 0.19]) + rng.uniform(size=4)
    )
    rpm = hover_rpm() * (1.0 + 0.01 * wave)
    start = np.zeros((1, 13))
    start[0, 6] = 1.0
    path = model.predict(start, rpm[None])[0]
    return Run(np.concatenate([start, path[:-1]]), rpm)


def straight(speed: float, rows: int = 200) -> Run:
    """A flight at a constant speed forward."""
    states = np.zeros((rows, 13))
    states[:, 0] = speed * STEP_S * np.arange(rows)
    states[:, 3] = speed
    states[:, 6] = 1.0
    return Run(states, np.full((rows, 4), hover_rpm()))


def test_where_nothing_changes_the_place_is_as_far_off_as_it_flew() -> None:
    scored = score([straight(2.0)], naive, seam=False)
    assert scored["position"][:3] == pytest.approx([0.02, 0.2, 1.0])
    assert scored["position"][3] == pytest.approx(0.02 * STEPS * (STEPS + 1) / 2)
    assert scored["velocity"] == pytest.approx([0.0] * 4)


def test_the_seam_compares_the_end_of_a_flight_with_the_start_of_the_next() -> None:
    apart = [straight(1.0), straight(-1.0)]
    assert score(apart, naive, seam=False)["velocity"][2] == pytest.approx(0.0)
    windows = len(starts(apart[0]))
    compared = 2 * windows - (STEPS - 1)
    across = 2.0 * (STEPS - 1) / compared
    assert score(apart, naive, seam=True)["velocity"][2] == pytest.approx(across)


def test_a_table_that_is_not_reproduced_is_refused() -> None:
    with pytest.raises(SystemExit, match=r"refused: .*Naive position h1: 0.0200, published 0.0143"):
        reproduced([straight(2.0)])


def test_without_a_clone_it_is_skipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["nanodrone", str(tmp_path / "nowhere")])
    with pytest.raises(SystemExit, match=r"skipped: .*no clone"):
        nanodrone.main()


def test_the_model_that_flew_foretells_its_flight() -> None:
    """But for the first step of a window, whose change of speed is not known."""
    model = Fitted(TRUE | {"rotor_inertia.inertia": 0.0})
    scored = score([flown(model)], model.predict, seam=False)
    assert max(max(values) for values in scored.values()) < 1e-9


def test_the_measured_attitude_takes_the_rotation_out_of_a_fit_of_forces() -> None:
    model = Fitted(TRUE)
    run = flown(model)
    cut = Cut.of([run])
    wrong = Fitted({"rotor_drag.drag": 0.3})
    path = wrong.predict(cut.states, cut.inputs, cut.halfway)
    free = wrong.predict(cut.states, cut.inputs)
    off = np.abs(path[..., 3:6] - cut.measured[..., 3:6]).max()
    assert off < 0.1 * np.abs(free[..., 3:6] - cut.measured[..., 3:6]).max()


def test_a_multistep_fit_finds_the_numbers_that_made_the_path() -> None:
    t = np.linspace(0.0, 2.0, 40)

    def path(x: Array) -> Array:
        decay = np.exp(-x[0] * t)
        return np.stack([x[1] * decay, np.sin(x[0] * t), 0.0 * t], axis=1)

    true = np.array([0.7, 3.0])
    found = fit(
        lambda x: path(x) - path(true),
        [Parameter("rate", 0.2, 0.5, 0.0), Parameter("size", 1.0, 1.0)],
    )
    assert found == pytest.approx({"rate": 0.7, "size": 3.0}, rel=1e-3)


def test_repeated_samples_lie_between_their_neighbours() -> None:
    columns = {key: np.array([0.0, 1.0, 1.0, 3.0]) for key in ("x", "y", "z")}
    columns |= {key: np.array([0.0, 1.0, 1.0, 3.0]) for key in ("vx", "vy", "vz", "wx", "wy", "wz")}
    columns |= {key: np.array([0.0, 1.0, 1.0, 3.0]) for key in ("qx", "qy", "qz", "qw")}
    columns |= {key: np.array([0.0, 1.0, 2.0, 3.0]) for key in ("ax", "ay", "az")}
    columns |= {f"m{k}_erpm": np.array([0.0, 1.0, 2.0, 3.0]) for k in range(1, 5)}
    assert _without_repeats(columns)["x"] == pytest.approx([0.0, 1.0, 2.0, 3.0])
    assert _bridged(np.array([1.0, np.nan, 3.0])) == pytest.approx([1.0, 2.0, 3.0])


@pytest.mark.parametrize("late", [-2, 0, 3])
def test_the_lag_is_how_far_the_motors_have_to_be_moved(late: int) -> None:
    lift = np.random.default_rng(0).normal(size=400)
    assert _lag(lift, np.roll(lift, -late)) == late


def test_half_steps_make_a_turning_vehicle_fall_as_it_should() -> None:
    """Thrust turns at a constant rate: its velocity is a known integral."""
    own = vehicle(inertia=nanodrone.ROUND)
    start = np.zeros((1, 13))
    start[0, 6] = 1.0
    start[0, 11] = 3.0
    path = rollout(FlightModel(own), start, np.full((1, 50, 4), hover_rpm()), step_s=STEP_S)
    seconds = STEP_S * 50
    forward = -GRAVITY / 3.0 * (1.0 - np.cos(3.0 * seconds))
    down = GRAVITY * seconds - GRAVITY / 3.0 * np.sin(3.0 * seconds)
    assert path[0, -1, 3:6] == pytest.approx([forward, 0.0, down], abs=1e-3)


PAIRS = """
Fz0 =[{law}];
std_Fz0 =[0.1 0.1];
Fz30_beta0 = [3.0 2.0 1.0 1.0 1.0 1.0 1.0 1.0 1.0];
"""


def test_curves_of_the_rotor_pairs_are_read_with_their_heights() -> None:
    law = rotor_pairs.exponential(rotor_pairs.HEIGHTS, 0.4, 2.0)
    text = PAIRS.format(law=" ".join(f"{20.0 * value:.6f}" for value in law))
    found = rotor_pairs.curves(text)
    assert set(found) == {"Fz0", "Fz30_beta0"}
    height, ratio = found["Fz0"]
    assert ratio == pytest.approx(law / law[-1], abs=1e-6)
    assert rotor_pairs.fitted(height, law) == pytest.approx((0.4, 2.0))
    assert np.abs(rotor_pairs.left_out(height, law)).max() < 1e-6
    assert list(found["Fz30_beta0"][0]) == [0.6, 0.75, 1.0, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0]


def test_a_displaced_image_is_found_and_no_law_of_height_is_nearer_than_the_mean() -> None:
    height = rotor_pairs.HEIGHTS
    law = rotor_pairs.displaced(height, 0.2, 0.5)
    assert rotor_pairs.fitted(height, law, rotor_pairs.displaced) == pytest.approx((0.2, 0.5))
    twice = np.concatenate([height, height])
    spread = np.concatenate([law + 0.01, law - 0.01])
    assert rotor_pairs.floor(twice, spread) == pytest.approx(0.01)


def test_a_flight_that_is_left_out_is_told_by_the_others() -> None:
    rng = np.random.default_rng(2)
    columns = [rng.normal(size=(50, 3, 2)) for _ in range(3)]
    true = np.array([2.0, -1.0])
    measured = [x @ true for x in columns]
    measured[2] = measured[2] + 1.0
    errors = neurobem.left_out(columns, measured)
    assert errors[2] == pytest.approx(-1.0, abs=1e-9)
    assert np.abs(errors[0]).max() > 1e-3


def test_where_the_accelerometer_is_is_found_by_the_turns_it_feels() -> None:
    vehicle = neurobem.vehicle()
    time_s = np.arange(200) / 400.0
    rates = np.stack([np.sin(9.0 * time_s), 2.0 * np.cos(7.0 * time_s), 3.0 * time_s], axis=1)
    blank = blank_state((200,), 4, 4)
    speed = np.full_like(blank.rpm, 12000.0)
    # It turns on its place: the laws of speed are silent.
    turning = replace(blank, time_s=time_s, rates=rates, rpm=speed, velocity_ned=np.zeros((200, 3)))
    x = neurobem.force_columns(Context(state=turning, vehicle=vehicle))
    place = np.array([-0.02, 0.025, -0.02])
    change = np.gradient(rates, time_s, axis=0)
    felt = np.cross(change, place) + np.cross(rates, np.cross(rates, place))
    found, *_ = np.linalg.lstsq(
        x.reshape(-1, x.shape[2]), (vehicle.mass_kg * felt).ravel(), rcond=None
    )
    assert found[-3:] == pytest.approx(place)


def test_a_vehicle_file_alone_is_rolled_as_its_vehicle_is(tmp_path: Path) -> None:
    file = tmp_path / "a.toml"
    file.write_text(vehicle_toml(VEHICLES["nanodrone"]))
    start = np.zeros((1, 13))
    start[0, 6] = 1.0
    speeds = np.full((1, STEPS, 4), 1.01 * hover_rpm())
    path = nanodrone.rolled(file, None)(start, speeds)
    own = FlightModel(load_vehicle(file))
    assert np.array_equal(path, rollout(own, start, speeds, step_s=STEP_S))
    assert path[0, -1, 2] < 0.0


def test_a_model_is_scored_with_its_vehicle_file(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr("sys.argv", ["nanodrone", str(tmp_path), "--model", "nowhere"])
    with pytest.raises(SystemExit, match="2"):
        nanodrone.main()
    assert "go together" in capsys.readouterr().err


def test_another_neurobem_than_the_known_one_is_refused() -> None:
    with pytest.raises(SystemExit, match=r"refused: NeuroBEM's force .* known 0.6060"):
        neurobem.check({"force": [np.ones((5, 3))], "moment": [np.zeros((5, 3))]})


def pulled(scale: float) -> Flight:
    """A vehicle at rest beside a cell that pulls with 2 N, its thrust 1 + scale of the commanded one. Made up."""
    samples = 400
    angle = np.linspace(0.2, 1.2, samples)
    to_cell = -np.stack([np.sin(angle), np.zeros(samples), np.cos(angle)], axis=1)
    thrust = np.tile([0.0, 0.0, 14.0], (samples, 1))
    tension = np.full(samples, 2.0)
    inertial = (1.0 + scale) * thrust + tension[:, None] * to_cell
    flying = np.ones(samples, dtype=bool)
    return Flight(inertial, thrust, np.zeros((samples, 3)), to_cell, tension, flying)


def test_what_no_cable_can_make_says_the_scale_of_the_thrust() -> None:
    one = pulled(-0.3)
    assert cable_tension.thrust_scale([one]) == pytest.approx(-0.3)
    nothing, _, theirs, ours = cable_tension.errors(one, -0.3)
    assert neurobem.rms(nothing) == pytest.approx(2.0)
    assert neurobem.rms(theirs) == pytest.approx(0.3 * 14.0)
    assert ours == pytest.approx(0.0)
    assert cable_tension.interval(nothing) == pytest.approx((2.0, 2.0))


def test_other_forces_of_the_cable_than_the_published_ones_are_refused() -> None:
    with pytest.raises(SystemExit, match=r"refused: NeuroMHE: .* published 0.5742"):
        cable_tension.check([pulled(0.0)] * 3)


def commanded(late_s: float, seed: int) -> nanobench.Flight:
    """A flight whose thrust follows its commands and voltage through motors that are so late. Made up."""
    rng = np.random.default_rng(seed)
    steps = np.repeat(rng.uniform(0.4, 0.8, 40), 25)
    volts = np.linspace(4.1, 3.4, steps.size)
    rows = np.column_stack([*[steps] * 4, volts, np.zeros(steps.size)])
    flying = np.ones(steps.size, dtype=bool)
    late = nanobench.Flight(rows, flying).lagged(late_s)
    rows[:, nanobench.GOAL] = nanobench.law(late, most=15.0, expo=0.4, power=1.2)
    return nanobench.Flight(rows, flying)


def test_lag_and_sag_of_the_teaching_flights_tell_the_test_flight() -> None:
    teach, test = [commanded(0.03, seed) for seed in (1, 2)], [commanded(0.03, 3)]
    assert nanobench.lag(teach) == 0.03
    (missed,) = nanobench.errors(teach, test, "with `battery_sag`", 0.03)
    assert missed == pytest.approx(0.0, abs=1e-4)
    (without,) = nanobench.errors(teach, test, "with `battery_sag`", 0.0)
    assert without.std() > 0.1
    assert nanobench.interval([without]) == pytest.approx([nanobench.rms(without)] * 2)


def test_a_file_that_goes_on_beyond_its_log_is_no_flight() -> None:
    one = commanded(0.0, 1)
    assert one.real
    one.rows[-1, 0] = 1.3
    assert not one.real


@pytest.mark.parametrize("command", [cable_tension, neurobem, rotor_pairs])
def test_every_table_is_skipped_without_its_clone(
    command: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["table", str(tmp_path / "nowhere")])
    with pytest.raises(SystemExit, match=r"skipped: .*no clone"):
        command.main()
