"""From cases to the data set and the check, on made-up cases whose answers are known."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from surrogates.cfd_statements import summary, text

from models import dataset
from models.cfd import campaign, config, table
from models.cfd.assemble import assemble, mesh_error, write_data, write_marks
from models.cfd.case_run import Result, Row, error_of_mean
from models.cfd.labels import labels
from models.cfd.position import Position, near
from models.cfd.statements import AGREES, DISAGREES, check
from models.cli import main
from models.common.errors import ModelError

INF = math.inf
SETUP = config.load()
SPEEDS = (4000.0, 2800.0, 5200.0)
EXPONENT = {0: 0.30, 2: -0.20, 4: 0.10}
FREE_EXPONENT = 0.05
GROUND_GAIN, PULL, TILT = 3.0, 1.2, 0.15


def increment(h: float, d: float) -> np.ndarray:
    """Made-up effect of ground and wall, (6,) at 4000 rpm."""
    ground = GROUND_GAIN * math.exp(-h) if math.isfinite(h) else 0.0
    wall = math.exp(-d) if math.isfinite(d) else 0.0
    return np.array([PULL * wall, 0.0, ground - 0.1 * wall, 0.0, TILT * wall * (1 + ground), 0.0])


def wrench(position: Position) -> np.ndarray:
    """Made-up wrench of a case, with a mesh error of 1 % of the lift a level."""
    ratio = position.rpm / 4000.0
    out = increment(position.h, position.d)
    for k, a in EXPONENT.items():
        out[k] *= ratio ** (2 + a)
    out[2] += (
        22.6
        * ratio ** (2 + FREE_EXPONENT)
        * (1 + (0.0 if position.swirl else 0.01) * (position.level - 1.0))
    )
    if position.swirl:
        wall = math.isfinite(position.d)
        out += [0.0, 0.05 * math.exp(1.0 - position.d), 0.0, 0.01 * wall, 0.0, 0.03]
    return out


def row(position: Position, status: str = "steady", **changes) -> Row:
    lift = wrench(position)[2]
    result = Result(
        wrench=tuple(wrench(position)),
        swing=(0.01, 0.0, 0.02, 0.0, 0.001, 0.0),
        drift=(0.0,) * 6,
        parts=(0.3 * lift, 0.3 * lift, 0.4 * lift),
        status=status,
        cells=100_000,
        iterations=144,
        steps=0,
        seconds=60.0,
        start="rest",
    )
    return Row(position, replace(result, **changes))


@pytest.fixture(scope="module")
def rows() -> list[Row]:
    """Every half model, and full ones at the spread of positions that come first."""
    c = SETUP.campaign
    others = len(c.other_rpm) * len(c.full_other_rpm_at) + len(c.full_grid_levels) * len(
        c.full_grid_at
    )
    full = campaign.plan(SETUP, "full")[: len(c.full_at) + others]
    return [row(p) for p in (*campaign.plan(SETUP, "half"), *full)]


@pytest.fixture(scope="module")
def made(rows):
    """The set of these rows, to be read by tests, not changed."""
    return assemble(rows, SETUP)


@pytest.fixture(scope="module")
def checked(rows):
    """The check of these rows, to be read by tests, not changed."""
    return check(rows, SETUP)


def at(made, h: float, d: float, rpm: float) -> int:
    radius = SETUP.fan.radius_m
    (index,) = np.flatnonzero(
        (made.table[:, 0] == h * radius)
        & (made.table[:, 1] == d * radius)
        & (made.table[:, 2] == rpm)
    )
    return int(index)


def test_the_law_of_rotor_speed_is_recovered_and_its_rows_are_marked(made):
    for k, a in EXPONENT.items():
        assert made.law.exponent[k] == pytest.approx(a, abs=1e-3)
    assert made.law.free == pytest.approx(FREE_EXPONENT, abs=1e-6)
    assert made.law.positions == 11
    filled = at(made, 1.25, 0.5, 5200.0)
    assert made.marks[filled].made == "law"
    assert made.table[filled, 3:] == pytest.approx(
        wrench(Position(h=1.25, d=0.5, rpm=5200.0)) * [1, 0, 1, 0, 1, 0]
        + made.table[filled, 3:] * [0, 1, 0, 1, 0, 1],
        abs=1e-3,
    )
    other_speed = at(made, 2.0, 1.0, 2800.0)
    assert made.marks[other_speed].made == "corrected"
    count = {
        kind: sum(m.made == kind for m in made.marks) for kind in ("solved", "corrected", "law")
    }
    assert count["solved"] == len(SETUP.campaign.full_at) + 2 * len(
        SETUP.campaign.full_other_rpm_at
    )
    assert count["solved"] + count["corrected"] == 110 + 2 * 13
    assert sum(count.values()) == len(made.marks)


def test_the_set_is_read_by_the_trainer_and_the_marks_lie_beside_it(tmp_path, made):
    write_data(tmp_path / "set.csv", made)
    write_marks(tmp_path / "marks.csv", made)
    data = dataset.read(tmp_path / "set.csv")
    assert len(data) == 330
    assert data.free_air.sum() == 3
    marks = (tmp_path / "marks.csv").read_text().splitlines()
    assert len(marks) == 331
    lines = (tmp_path / "set.csv").read_text().splitlines()
    assert [m.split(",")[:3] for m in marks] == [line.split(",")[:3] for line in lines]


def test_without_a_wall_the_label_is_the_mean_of_two_mirrored_states():
    position = Position(h=1.0, d=INF, rpm=4000.0)
    tilted = np.array([1.1, 0.0, 30.0, 0.0, -0.07, 0.0])
    label = labels([row(position, wrench=tuple(tilted))], 4000.0)[position.place]
    assert label.wrench == pytest.approx([0, 0, 30, 0, 0, 0])
    assert label.amplitude[[0, 4]] == pytest.approx([1.1, 0.07])


def test_two_states_give_their_mean_and_half_their_difference():
    near = Position(h=1.0, d=0.5, rpm=4000.0)
    low, high = np.array([-0.3, 0, 31.0, 0, 0.2, 0]), np.array([1.1, 0, 30.0, 0, 0.1, 0])
    other = replace(near, approach="wall")
    label = labels([row(near, wrench=tuple(low)), row(other, wrench=tuple(high))], 4000.0)[
        near.place
    ]
    assert label.wrench == pytest.approx((low + high) / 2)
    assert label.amplitude == pytest.approx([0.7, 0, 0.5, 0, 0.05, 0])
    assert label.starts == 2


def test_a_case_that_still_moves_is_marked_and_a_diverged_one_left_out(rows):
    moving, gone = Position(h=3.0, d=1.0, rpm=4000.0), Position(h=4.0, d=0.5, rpm=4000.0)
    changed = [
        row(moving, "cycling", swing=(0.4, 0, 0.9, 0, 0.05, 0))
        if r.position == moving
        else replace(r, result=replace(r.result, status="diverged"))
        if r.position == gone
        else r
        for r in rows
    ]
    made = assemble(changed, SETUP)
    mark = made.marks[at(made, 3.0, 1.0, 4000.0)]
    assert mark.status == "cycling"
    assert mark.amplitude[2] >= 0.9
    assert mark.sigma[2] >= 0.9
    with pytest.raises(ValueError, match="unpack"):
        at(made, 4.0, 0.5, 4000.0)


def test_the_error_of_the_mean_covers_it_for_correlated_samples():
    rng = np.random.default_rng(1)
    inside, stated, plain, runs = 0, 0.0, 0.0, 300
    for _ in range(runs):
        samples, x = np.empty(256), 0.0
        for i in range(len(samples)):
            x = 0.8 * x + rng.normal()
            samples[i] = x
        error = error_of_mean(samples[:, None])[0]
        stated, plain = stated + error, plain + samples.std() / 16
        inside += abs(samples.mean()) < 2 * error
    # Uncorrelated samples of the same spread would give a third of the error; blocks find the rest.
    assert stated > 2 * plain
    assert 0.9 < inside / runs < 1.0
    assert np.isnan(error_of_mean(np.ones((3, 6)))).all()


def test_sigma_is_the_error_of_the_mean_and_amplitude_the_swing(rows, made):
    place = Position(h=1.75, d=1.0, rpm=4000.0)
    swing = {"swing": (0.2, 0, 0.9, 0, 0.02, 0), "error": (0.02, 0, 0.05, 0, 0.002, 0)}
    changed = [row(place, "averaged", **swing) if r.position == place else r for r in rows]
    swung = assemble(changed, SETUP)
    index = at(swung, 1.75, 1.0, 4000.0)
    mark, usual = swung.marks[index], made.marks[index]
    assert mark.status == "averaged"
    assert mark.amplitude[2] == pytest.approx(0.9)
    expected = math.sqrt(usual.sigma[2] ** 2 - 0.02**2 + 0.05**2)
    assert mark.sigma[2] == pytest.approx(expected, abs=1e-6)


def rms(values: np.ndarray) -> float:
    """Of the lift."""
    return math.sqrt(np.mean(values[:, 2] ** 2))


@pytest.mark.slow
def test_what_full_models_add_is_learnt_and_its_error_is_that_of_places_left_out(rows):
    def added(h, d):
        """Made-up effect of swirl: a smooth lift lost near the ground, and a pull."""
        x, y = near((h, d))
        return np.array([0.3 * x * y, 0.0, -2.0 * x**2, 0.0, 0.0, 0.0])

    def swirling(r):
        p = r.position
        return row(p, wrench=tuple(np.array(r.result.wrench) + added(p.h, p.d))) if p.swirl else r

    made = assemble([swirling(r) for r in rows], SETUP)
    assert made.correction.learnt[2]
    assert rms(made.correction.missed) < 0.2 * rms(made.correction.change)
    here = at(made, 1.75, 1.0, 4000.0)
    assert made.marks[here].made == "corrected"
    truth = wrench(Position(h=1.75, d=1.0, rpm=4000.0))[2] + added(1.75, 1.0)[2]
    assert made.table[here, 5] == pytest.approx(truth, abs=0.1)
    solved = at(made, 1.5, 0.3, 4000.0)
    assert made.marks[solved].made == "solved"
    assert made.table[solved, 5] == pytest.approx(
        wrench(Position(h=1.5, d=0.3, rpm=4000.0))[2] + added(1.5, 0.3)[2], abs=0.02
    )
    # A row that nobody solved in full is less sure by what full models left out show.
    assert made.marks[here].sigma[2] > made.marks[solved].sigma[2]


@pytest.mark.slow
def test_a_full_model_that_swings_is_weighted_with_what_the_other_places_give(rows):
    swinging = Position(h=1.5, d=0.3, rpm=4000.0, swirl=True, level=SETUP.campaign.full_level)
    lift = -2.0

    def changed(off: float, error: float) -> list[Row]:
        """All full models lose a lift; one swings, and its mean is off by so much, known to that error."""
        out = []
        for r in rows:
            p = r.position
            if p.swirl and math.isfinite(p.h):
                w = np.array(r.result.wrench) + np.array(
                    [0, 0, lift + off * (p == swinging), 0, 0, 0]
                )
                errors = (0.0, 0.0, error, 0.0, 0.0, 0.0)
                r = (
                    row(p, "cycling", wrench=tuple(w), error=errors)
                    if p == swinging
                    else row(p, wrench=tuple(w))
                )
            out.append(r)
        return out

    def got(off: float, error: float) -> tuple[float, float]:
        made = assemble(changed(off, error), SETUP)
        here = at(made, 1.5, 0.3, 4000.0)
        truth = wrench(Position(h=1.5, d=0.3, rpm=4000.0))[2] + lift
        return made.table[here, 5] - truth, made.marks[here].sigma[2]

    sure, doubtful = got(0.8, 0.01), got(0.8, 3.0)
    assert abs(doubtful[0]) < 0.2 * abs(sure[0])
    assert sure[0] > 0.5
    assert doubtful[1] < 1.0


def test_a_difference_that_cannot_be_learnt_leaves_half_models_alone_and_stands_in_their_sigma(
    rows,
):
    rng = np.random.default_rng(5)
    noisy = [
        row(
            r.position,
            wrench=tuple(np.array(r.result.wrench) + rng.normal(0, [0.5, 0, 0.8, 0, 0.05, 0.02])),
        )
        if r.position.swirl and r.position.place in SETUP.campaign.full_at[1:6]
        else r
        for r in rows
        if not r.position.swirl or r.position.place in SETUP.campaign.full_at[:6]
    ]
    made = assemble(noisy, SETUP)
    assert not made.correction.learnt[[0, 2, 4]].any()
    assert {m.made for m in made.marks} == {"half", "law"}
    # Their side force can: it is learnt.
    assert made.table[at(made, 2.0, 1.0, 4000.0), 4] == pytest.approx(0.05)
    with_ground = at(made, 1.75, 1.0, 4000.0)
    assert made.marks[with_ground].sigma[2] > 0.3
    assert made.table[with_ground, 5] == pytest.approx(
        wrench(Position(h=1.75, d=1.0, rpm=4000.0))[2]
    )


@pytest.mark.slow
def test_a_component_that_cannot_be_learnt_stays_that_of_half_models_beside_one_that_can(rows):
    """Full models lose lift smoothly near the ground and gain a pull at random: lift is corrected, pull is not."""
    rng = np.random.default_rng(2)

    def added(p: Position) -> np.ndarray:
        out = np.zeros(6)
        if p.swirl and math.isfinite(p.h):
            out[0], out[2] = rng.normal(0, 0.6), -6 * near(p.place)[0] ** 2
        return out

    changed = [
        row(r.position, wrench=tuple(np.array(r.result.wrench) + added(r.position))) for r in rows
    ]
    made = assemble(changed, SETUP)
    assert made.correction.learnt[2]
    assert not made.correction.learnt[0]
    solved = at(made, 1.5, 0.3, 4000.0)
    assert made.marks[solved].made == "solved"
    truth = wrench(Position(h=1.5, d=0.3, rpm=4000.0))
    assert made.table[solved, 3] == pytest.approx(truth[0], abs=1e-6)
    assert made.table[solved, 5] == pytest.approx(truth[2] - 6 * near((1.5, 0.3))[0] ** 2, abs=0.05)
    assert made.marks[solved].sigma[0] > 0.3
    assert made.marks[solved].scatter[0] < 0.1


def test_what_symmetry_forbids_comes_from_the_cases_with_swirl(made):
    here = at(made, 2.0, 1.0, 4000.0)
    assert made.table[here, [4, 6, 8]] == pytest.approx([0.05, 0.01, 0.03])
    filled = at(made, 1.75, 1.0, 4000.0)
    assert 0.0 < made.table[filled, 4] < 0.4
    # Without a wall the fan stands on an axis of symmetry: only the net torque is left.
    alone = at(made, 2.5, INF, 4000.0)
    assert made.table[alone, [4, 6, 8]] == pytest.approx([0.0, 0.0, 0.03])


def test_the_mesh_error_is_that_of_what_a_place_adds(rows):
    # A mesh that changes the lift alike everywhere changes no increment.
    assert mesh_error(rows, SETUP) == pytest.approx(np.zeros(6), abs=1e-9)
    place = Position(h=2.0, d=0.5, rpm=4000.0, level=1.3)
    changed = [
        row(place, wrench=tuple(np.add(wrench(place), [0, 0, 0.4, 0, 0, 0])))
        if r.position == place
        else r
        for r in rows
    ]
    # Half of 0.4 N at one of two places.
    assert mesh_error(changed, SETUP)[2] == pytest.approx(0.2 / math.sqrt(2))


def test_the_table_comes_back_as_it_was_written(tmp_path, rows):
    odd = [
        *rows[:5],
        row(
            Position(h=1.0, d=0.5, rpm=4000.0),
            "diverged",
            wrench=(math.nan,) * 6,
            note="blew up, at once",
        ),
    ]
    table.write(tmp_path / "cases.csv", odd)
    back = table.read(tmp_path / "cases.csv")
    assert [r.position for r in back] == [r.position for r in odd]
    assert back[2].result.wrench == pytest.approx(odd[2].result.wrench, rel=1e-5)
    assert (back[-1].result.status, back[-1].result.note) == ("diverged", "blew up, at once")
    assert math.isnan(back[-1].result.wrench[0])


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda s: s.replace("h_over_r", "height"), "header"),
        (lambda s: s.replace("half", "third", 1), "line 2: model 'third'"),
        (lambda s: s.replace("100000", "many", 1), "line 2"),
        (lambda s: s.replace("22.6", "nought", 1), "line 2"),
        (lambda s: s + "half,1\n", "line"),
    ],
)
def test_a_broken_table_is_named(tmp_path, rows, spoil, words, capsys):
    path = tmp_path / "cases.csv"
    table.write(path, rows[:3])
    path.write_text(spoil(path.read_text()))
    with pytest.raises(ModelError, match=words):
        table.read(path)
    assert main(["cfd", "assemble", "--cases", str(path), "--out", str(tmp_path)]) == 2
    assert str(path) in capsys.readouterr().err


def test_the_check_says_what_agrees_and_what_does_not(rows, checked):
    verdict = {s.claim: s.verdict for s in checked.statements}
    assert len(verdict) == 14
    assert verdict["lift ratio rises as the ground comes near"] == AGREES
    assert verdict["the fan tilts towards the wall, more when nearer"] == AGREES
    assert verdict["lift rises slightly near the wall"] == DISAGREES
    found = summary(checked, rows, SETUP)
    assert found["usable"] == len(rows)
    assert found["C_T"] == pytest.approx(0.0451, abs=2e-4)
    assert found["rpm_law"]["increment_exponent"]["Fx"] == pytest.approx(2.3, abs=1e-3)
    for statement in checked.statements:
        assert statement.claim in text(found)
    json.dumps(found)


@pytest.mark.slow
def test_the_check_judges_the_set_not_the_half_models_alone(rows):
    """Full models that gain less near the ground than half models: the ratio said is the set's."""
    less = [
        row(
            r.position,
            wrench=tuple(
                np.array(r.result.wrench) - [0, 0, 3.0 * near(r.position.place)[0] ** 2, 0, 0, 0]
            ),
        )
        if r.position.swirl
        else r
        for r in rows
    ]
    checked = check(less, SETUP)
    half = checked.half[1.0, INF].wrench[2] / checked.half[INF, INF].wrench[2]
    assert checked.ratio(1.0) == pytest.approx(
        half - 3.0 * near((1.0, INF))[0] ** 2 / 22.6, abs=0.005
    )
    truth = (
        wrench(Position(h=1.25, d=INF, rpm=4000.0))[2] - 3.0 * near((1.25, INF))[0] ** 2
    ) / 22.6
    assert checked.ratio(1.25) == pytest.approx(truth, abs=0.01)


def test_the_check_says_nothing_of_places_that_are_not_there(rows):
    places = [(INF, INF), (2.0, INF), (3.0, INF)]
    checked = check([r for r in rows if r.position.place in places and not r.position.swirl], SETUP)
    assert {s.source for s in checked.statements} == {
        "paper, figs 5 and 9", "Zhou 2025", "Zhao 2022, Zhou 2025", "Pereira 2008", "paper, eq. 1",
    }  # fmt: skip
    with pytest.raises(ModelError, match="free air"):
        check([r for r in rows if r.position.place != (INF, INF)], SETUP)


def test_the_command_writes_the_set(tmp_path, rows, checked, capsys):
    table.write(tmp_path / "cases.csv", rows)
    source = ["--cases", str(tmp_path / "cases.csv")]
    assert main(["cfd", "assemble", *source, "--out", str(tmp_path / "out")]) == 0
    assert "136 from the solver" in capsys.readouterr().out
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        "corner_cfd.csv",
        "corner_cfd_rows.csv",
    ]
    found = summary(checked, rows, SETUP)
    assert found["positions"] == 110
    assert found["made"]["solved"] + found["made"]["corrected"] == 136
    assert (
        main(["cfd", "assemble", "--work", str(tmp_path / "nothing"), "--out", str(tmp_path)]) == 2
    )
    assert "no finished cases" in capsys.readouterr().err


SHIPPED = Path(campaign.__file__).parents[1] / "data"


@pytest.mark.slow
@pytest.mark.skipif(
    not (SHIPPED / "corner_cfd_cases.csv").exists(), reason="no computed set in this checkout"
)
def test_the_shipped_set_is_what_its_cases_give(tmp_path):
    made = assemble(table.read(SHIPPED / "corner_cfd_cases.csv"), SETUP)
    write_data(tmp_path / "set.csv", made)
    write_marks(tmp_path / "marks.csv", made)
    assert (tmp_path / "set.csv").read_text() == (SHIPPED / "corner_cfd.csv").read_text()
    assert (tmp_path / "marks.csv").read_text() == (SHIPPED / "corner_cfd_rows.csv").read_text()
    assert len({(h, d) for h, d in made.table[:, :2]}) >= 100
