"""Running cases: with small programs in place of the solver, so that no solver is needed."""

from __future__ import annotations

import json
import math
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from models.cfd import campaign, case, config, foam, polars
from models.cfd.case_run import Result, Row, compute
from models.cfd.position import Position, check
from models.cli import main
from models.common.errors import ConfigError, ModelError
from models.common.progress import Bars

INF = math.inf
SETUP = config.load()
FREE = Position(h=INF, d=INF, rpm=4000.0)


def section(angle_deg, reynolds):
    """A plain section instead of the neural one."""
    return 5.5 * np.radians(np.clip(angle_deg, -12, 12)), np.full_like(angle_deg, 0.02)


TABLE = polars.blades(SETUP, 4000.0, section, swirl=False)


@pytest.fixture
def solver(tmp_path, monkeypatch):
    """Puts the stand-ins on the path; call with how they behave."""
    programs = tmp_path / "bin"
    programs.mkdir()
    body = (Path(__file__).parent / "fake_solver.py").read_text()
    for name in foam.PROGRAMS:
        program = programs / name
        program.write_text(f"#!{sys.executable} -S\n{body}")
        program.chmod(0o755)
    monkeypatch.setenv("PATH", str(programs))

    def behave(how: str) -> None:
        (programs / "behave").write_text(how)

    behave("steady")
    return behave


def test_a_case_settles_and_both_halves_and_all_discs_are_counted(tmp_path, solver):
    result = compute(tmp_path / FREE.key, SETUP, FREE, TABLE)
    assert result.status == "steady"
    assert SETUP.solver.start <= result.iterations <= SETUP.solver.limit
    assert result.cells == 6
    # Half model doubled: 5 N on the surface, 1 N in each of 12 sources; what symmetry forbids is zero.
    assert result.wrench == pytest.approx((0.5, 0.0, 34.0, 0.0, 0.02, 0.0), abs=0.01)
    assert result.parts == pytest.approx((12.0, 12.0, 10.0), abs=0.01)


def test_the_full_model_is_not_doubled_and_keeps_all_six(tmp_path, solver):
    position = replace(FREE, swirl=True)
    result = compute(tmp_path / position.key, SETUP, position, TABLE)
    assert result.wrench == pytest.approx((0.25, 7.0, 11.0, 7.0, 0.01, 7.0), abs=0.01)


def test_a_case_that_moves_is_marched_in_time(tmp_path, solver):
    solver("cycle")
    left = compute(tmp_path / FREE.key, SETUP, FREE, TABLE, march=False)
    assert (left.status, left.steps) == ("cycling", 0)
    assert left.swing[2] > SETUP.converged.swing * SETUP.rotor.hover_lift_n
    marched = compute(tmp_path / FREE.key, SETUP, FREE, TABLE, march=True)
    assert (marched.status, marched.iterations) == ("marched", left.iterations)
    assert marched.steps >= 2 * SETUP.solver.march_chunk
    assert marched.swing[2] < 0.01
    # What the iterations gave is kept beside it, so that the two can be compared.
    assert marched.iterated == pytest.approx(left.wrench)
    assert marched.iterated_error == pytest.approx(np.maximum(left.swing, 2 * np.array(left.drift)))
    assert np.isnan(left.iterated).all()


@pytest.mark.slow
def test_a_flow_that_swings_on_is_marched_until_its_mean_is_known(tmp_path, solver):
    solver("swing")
    result = compute(tmp_path / FREE.key, SETUP, FREE, TABLE)
    assert result.status == "averaged"
    assert result.steps < SETUP.solver.march_limit
    # 34 N and a wave of 2 N (half model doubled) that the mean must not follow.
    assert result.swing[2] > 1.5
    assert 0 < result.error[2] <= SETUP.converged.mean * SETUP.rotor.hover_lift_n
    assert result.wrench[2] == pytest.approx(34.0, abs=3 * result.error[2])
    # Asked for more than the limit allows, it stays without a known mean, and goes on when the limit is raised.
    strict = replace(SETUP, converged=replace(SETUP.converged, mean=1e-9, drift_of_effect=1e-9))
    short = replace(strict, solver=replace(strict.solver, march_limit=160))
    campaign.run(tmp_path / "short", short, section, [FREE])
    (row,) = campaign.rows(tmp_path / "short", [FREE])
    assert (row.result.status, row.result.steps) == ("cycling", 160)
    campaign.run(tmp_path / "short", SETUP, section, [FREE])
    (row,) = campaign.rows(tmp_path / "short", [FREE])
    assert row.result.status == "averaged"


def test_a_diverged_case_is_marked_with_the_solvers_words(tmp_path, solver):
    solver("diverge")
    result = compute(tmp_path / FREE.key, SETUP, FREE, TABLE)
    assert result.status == "diverged"
    assert "maximum number of iterations exceeded" in result.note
    assert math.isnan(result.wrench[0])


def test_a_killed_case_stops_no_other_and_goes_on_in_the_next_run(tmp_path, solver):
    solver("killed")
    positions = [FREE, Position(h=INF, d=1.0, rpm=4000.0), Position(h=2.0, d=INF, rpm=4000.0)]
    campaign.run(tmp_path, SETUP, section, positions, jobs=2)
    assert campaign.rows(tmp_path, positions) == []
    campaign.run(tmp_path, SETUP, section, positions, jobs=2)
    rows = campaign.rows(tmp_path, positions)
    assert [r.result.status for r in rows] == ["steady"] * 3


def test_a_campaign_is_resumed_not_repeated(tmp_path, solver):
    positions = [FREE, Position(h=INF, d=1.0, rpm=4000.0), Position(h=INF, d=1.0, rpm=2800.0)]
    campaign.run(tmp_path, SETUP, section, positions[:2])
    seen: list[tuple[str, int, int]] = []
    campaign.run(tmp_path, SETUP, section, positions, progress=lambda *a: seen.append(a))
    assert seen == [("cases", 3, 3)]
    *_, last = campaign.rows(tmp_path, positions)
    # The same mesh at another speed: the state is scaled, not mapped.
    assert last.result.start == positions[1].key
    assert not (tmp_path / positions[2].key / "mapped_from").exists()
    assert (tmp_path / positions[1].key / "mapped_from").read_text() == str(tmp_path / FREE.key)
    values = foam.read_field(tmp_path / positions[2].key / "0" / "p")
    assert values == pytest.approx(np.full(6, 0.7**2))


@pytest.mark.slow
def test_a_case_that_drifted_goes_on_when_the_limit_is_raised(tmp_path, solver):
    solver("drift")
    with_limit = {n: replace(SETUP, solver=replace(SETUP.solver, limit=n)) for n in (192, 480)}
    places = [FREE, Position(h=INF, d=1.0, rpm=4000.0)]
    campaign.run(tmp_path, with_limit[192], section, places)
    _, short = campaign.rows(tmp_path, places)
    campaign.run(tmp_path, with_limit[480], section, places)
    free, longer = campaign.rows(tmp_path, places)
    assert (short.result.status, short.result.iterations) == ("drifting", 192)
    assert longer.result.status == "steady"
    assert 300 < longer.result.iterations <= 480
    assert longer.result.start == short.result.start
    # The one from rest has twice the limit, and goes on under it too.
    assert free.result.iterations > 300


def test_a_diverged_case_does_not_stop_the_campaign_nor_start_another(tmp_path, solver):
    solver("diverge")
    campaign.run(tmp_path, SETUP, section, [FREE, Position(h=INF, d=1.0, rpm=4000.0)])
    rows = campaign.rows(tmp_path, [FREE, Position(h=INF, d=1.0, rpm=4000.0)])
    assert [(r.result.status, r.result.start) for r in rows] == [("diverged", "rest")] * 2


def test_a_folder_of_another_fan_is_refused(tmp_path, solver):
    campaign.run(tmp_path, SETUP, section, [FREE])
    other = replace(SETUP, rotor=replace(SETUP.rotor, tip_pitch_deg=14.0))
    with pytest.raises(ConfigError, match="another fan or mesh"):
        campaign.run(tmp_path, other, section, [FREE])


def test_half_and_full_models_share_a_folder(tmp_path, solver):
    full = campaign.plan(SETUP, "full")[:1]
    for positions in ([FREE], full):
        campaign.run(tmp_path, SETUP, section, positions)
    rows = campaign.rows(tmp_path, [FREE, *full])
    assert [r.position.model for r in rows] == ["half", "full"]
    # Neither starts from the other's mesh.
    assert [r.result.start for r in rows] == ["rest", "rest"]


def test_blades_end_at_root_and_tip(tmp_path, solver):
    short = replace(SETUP, rotor=replace(SETUP.rotor, root_radius=0.3, tip_radius=0.95))
    tables = polars.blades(short, 4000.0, section, swirl=False)
    compute(tmp_path / FREE.key, short, FREE, tables)
    blade = re.search(r"blade {(.*?)}", (tmp_path / FREE.key / "constant/fvOptions").read_text())[1]
    radius, _, chord = np.array(
        re.findall(r"\(([\d.]+) ([\d.]+) ([\d.e-]+)\)", blade), dtype=float
    ).T
    there = chord > 1e-6
    assert radius[there] / short.fan.radius_m == pytest.approx(np.linspace(0.3, 0.95, 7))
    assert list(there) == [False, *[True] * 7, False]
    # Blades that reach hub and bore have no such ends: in the diffuser the bore is wider than at the upper disc.
    assert case._blade(SETUP, tables[0], 0.01).count("section") == SETUP.rotor.stations


def test_no_cell_of_a_disc_is_left_without_lift(tmp_path, solver):
    # The solver's disc takes the lift from cells at or beyond this share of its outermost cell's radius.
    compute(tmp_path / FREE.key, SETUP, FREE, TABLE)
    shares = re.findall(
        r"tipEffect ([\d.]+);", (tmp_path / FREE.key / "constant/fvOptions").read_text()
    )
    assert len(shares) == 12
    assert all(float(s) > 1.0 for s in shares)


def test_a_broken_result_is_named(tmp_path, solver):
    campaign.run(tmp_path, SETUP, section, [FREE])
    (tmp_path / FREE.key / campaign.RESULT).write_text("{}")
    with pytest.raises(ModelError, match=r"result\.csv: has another header"):
        campaign.rows(tmp_path, [FREE])


def test_without_a_solver_one_line_names_the_package(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert main(["cfd", "run", "--work", str(tmp_path / "work")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "openfoam" in line
    assert not (tmp_path / "work").exists()


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("h = [1.0,", "h = [0.5,", "no room above the ground"),
        ("h = [1.0,", "h = [0.7,", "h = 0.7 R must exceed 0.75 R"),
        ("d = [0.15,", "d = [0.02,", "no room beside the wall"),
        ("blades = 4", "blades = 0", "at least 1"),
        ("radius_m = 0.165", 'radius_m = "wide"', "must be a finite number"),
        ("hub_radius = 0.20", "hub_radius = 0.95", "hub_radius"),
        ("[air]", "[water]", "key 'air' is missing"),
        ("chord_m", "chord_mm", "'rotor.chord_mm' is not known"),
        ("root_radius = 0.20", "root_radius = 0.15", "rotors cut into the hub"),
        ("tip_radius = 1.0 ", "tip_radius = 1.02 ", "rotors cut into the duct"),
        ("lower_height = -0.40", "lower_height = -0.05", "rotors cut into each other"),
        ("lower_height = -0.40", "lower_height = -0.70", "leave the duct"),
        ("[13.06, 10.98]", "[13.06]", "two pitches"),
        ("exit_radius = 1.05", "exit_radius = 0.9", "exit_radius"),
    ],
)
def test_a_wrong_fan_file_is_refused_before_any_work(tmp_path, capsys, old, new, word):
    text = (Path(config.__file__).parent / "fan.toml").read_text()
    fan = tmp_path / "fan.toml"
    fan.write_text(text.replace(old, new, 1))
    assert (
        main(["cfd", "run", "--fan", str(fan), "--work", str(tmp_path / "work"), "--dry-run"]) == 2
    )
    (line,) = capsys.readouterr().err.splitlines()
    assert word in line
    assert not (tmp_path / "work").exists()


def test_the_wall_cannot_be_touched():
    check(SETUP, Position(h=1.0, d=0.15, rpm=4000.0))
    for position in (
        Position(h=0.6, d=INF, rpm=4000.0),
        Position(h=2.0, d=-0.1, rpm=4000.0),
        Position(h=2.0, d=0.0, rpm=4000.0),
    ):
        with pytest.raises(ConfigError):
            check(SETUP, position)


def test_the_plan_has_what_the_set_needs(capsys):
    assert main(["cfd", "run", "--work", "unused", "--dry-run", "--json", "-"]) == 0
    keys = json.loads(capsys.readouterr().out)["cases"]
    positions = campaign.plan(SETUP, "half")
    assert keys == [p.key for p in positions]
    assert len(set(keys)) == len(keys)
    plain = {p.place for p in positions if p.rpm == 4000 and not p.swirl and p.level == 1.0}
    assert len(plain) >= 100
    for rpm in SETUP.campaign.other_rpm:
        assert len({p.place for p in positions if p.rpm == rpm}) >= 12
    assert sum(p.level != 1.0 for p in positions) >= 6
    assert positions[0].place == (INF, INF)


def test_full_models_come_to_every_position_the_spread_first():
    c = SETUP.campaign
    half = {p.place for p in campaign.plan(SETUP, "half") if p.rpm == c.rpm}
    full = [p for p in campaign.plan(SETUP, "full") if p.rpm == c.rpm and p.level == c.full_level]
    assert [p.place for p in full[: len(c.full_at)]] == list(c.full_at)
    assert {p.place for p in full} == half
    assert len(full) == len(half)


def test_a_bad_number_of_jobs_is_refused(tmp_path, capsys):
    assert main(["cfd", "run", "--work", str(tmp_path), "--jobs", "0"]) == 2
    assert "--jobs 0" in capsys.readouterr().err


def test_the_progress_counts_cases(tmp_path, solver):
    seen: list[tuple[str, int, int]] = []
    campaign.run(tmp_path, SETUP, section, [FREE], progress=lambda *a: seen.append(a))
    assert seen == [("cases", 1, 1)]
    assert Bars(quiet=True)("cases", 1, 1) is None


def test_every_disc_layer_turns_as_the_model_says():
    half = case.sources(FREE)
    assert sum(s * share for _, _, s, share in half) == pytest.approx(0.0)
    assert sum(share for _, where, _, share in half if where.startswith("upper")) == pytest.approx(
        1.0
    )
    full = case.sources(replace(FREE, swirl=True))
    assert {s for _, where, s, _ in full if where.startswith("upper")} == {-1}
    assert {s for _, where, s, _ in full if where.startswith("lower")} == {1}


def test_second_starts_of_full_models_come_last_and_start_without_ground():
    setup = replace(SETUP, campaign=replace(SETUP.campaign, full_again_from_far=((1.25, 0.5),)))
    plan = campaign.plan(setup, "full")
    assert plan[:-1] == campaign.plan(SETUP, "full")
    again = plan[-1]
    assert (again.place, again.approach, again.swirl) == ((1.25, 0.5), "far", True)
    result = Result(
        wrench=(0,) * 6,
        swing=(0,) * 6,
        drift=(0,) * 6,
        parts=(0, 0, 0),
        status="steady",
        cells=1,
        iterations=96,
        steps=0,
        seconds=1.0,
        start="rest",
    )
    finished = [Row(p, result) for p in plan[:-1]]
    assert campaign.start_for(again, finished).place == (INF, 0.5)
