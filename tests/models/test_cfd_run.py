"""Running cases: with programs that stand in for the solver, so that no solver is needed."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from models.cfd import campaign, case, cli, config, foam, polars
from models.cfd.case_run import compute
from models.cfd.position import Position, check
from models.cli import main
from models.errors import ConfigError, LinkError
from models.progress import Bars

INF = math.inf
SETUP = config.load()
FREE = Position(INF, INF, 4000.0)


def section(angle_deg, reynolds):
    """A plain section instead of the neural one."""
    return 5.5 * np.radians(np.clip(angle_deg, -12, 12)), np.full_like(angle_deg, 0.02)


TABLE = polars.stations(SETUP, 4000.0, section)


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


def test_a_diverged_case_is_marked_with_the_solvers_words(tmp_path, solver):
    solver("diverge")
    result = compute(tmp_path / FREE.key, SETUP, FREE, TABLE)
    assert result.status == "diverged"
    assert "maximum number of iterations exceeded" in result.note
    assert math.isnan(result.wrench[0])


def test_a_killed_case_goes_on_and_the_campaign_with_it(tmp_path, solver):
    solver("killed")
    positions = [FREE, Position(INF, 1.0, 4000.0), Position(2.0, INF, 4000.0)]
    campaign.run(tmp_path, SETUP, section, positions, jobs=2)
    rows = campaign.rows(tmp_path, positions)
    assert [r.result.status for r in rows] == ["steady"] * 3


def test_a_campaign_is_resumed_not_repeated(tmp_path, solver):
    positions = [FREE, Position(INF, 1.0, 4000.0), Position(INF, 1.0, 2800.0)]
    campaign.run(tmp_path, SETUP, section, positions[:2])
    again: list[str] = []
    campaign.run(tmp_path, SETUP, section, positions, finished=lambda row: again.append(row.position.key))
    assert again == [positions[2].key]
    last = campaign.load(tmp_path, positions[2])
    # The same mesh at another speed: the state is scaled, not mapped.
    assert last is not None
    assert last.result.start == positions[1].key
    assert not (tmp_path / positions[2].key / "mapped_from").exists()
    assert (tmp_path / positions[1].key / "mapped_from").read_text() == str(tmp_path / FREE.key)
    values = foam.read_field(tmp_path / positions[2].key / "0" / "p")
    assert values == pytest.approx(np.full(6, 0.7**2))


def test_a_cluster_computes_the_same_cases(tmp_path, solver, monkeypatch):
    distributed = pytest.importorskip("distributed", reason="no Dask here: pip install 'corner-compensator[cluster]'")
    positions = [FREE, Position(INF, 1.0, 4000.0), Position(2.0, INF, 4000.0)]
    local = distributed.LocalCluster(n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None)
    with local as dask, cli._cluster(dask.scheduler_address) as (executor, jobs):
        assert jobs == 2
        campaign.run(tmp_path / "there", SETUP, section, positions, executor, jobs)
    campaign.run(tmp_path / "here", SETUP, section, positions, jobs=2)
    there, here = (campaign.rows(tmp_path / name, positions) for name in ("there", "here"))
    assert [r.result.wrench for r in there] == [r.result.wrench for r in here]
    monkeypatch.setattr(cli, "CONNECT_S", 1.0)
    with pytest.raises(LinkError, match="no Dask scheduler"), cli._cluster("tcp://127.0.0.1:9"):
        pass


def test_a_case_that_drifted_goes_on_when_the_limit_is_raised(tmp_path, solver):
    solver("drift")
    with_limit = {n: replace(SETUP, solver=replace(SETUP.solver, limit=n)) for n in (192, 480)}
    places = [FREE, Position(INF, 1.0, 4000.0)]
    campaign.run(tmp_path, with_limit[192], section, places)
    short = campaign.load(tmp_path, places[1])
    campaign.run(tmp_path, with_limit[480], section, places)
    longer = campaign.load(tmp_path, places[1])
    assert short is not None
    assert longer is not None
    assert (short.result.status, short.result.iterations) == ("drifting", 192)
    assert longer.result.status == "steady"
    assert 300 < longer.result.iterations <= 480
    assert longer.result.start == short.result.start
    # The one from rest has twice the limit, and goes on under it too.
    free = campaign.load(tmp_path, FREE)
    assert free is not None
    assert free.result.iterations > 300


def test_a_diverged_case_does_not_stop_the_campaign_nor_start_another(tmp_path, solver):
    solver("diverge")
    campaign.run(tmp_path, SETUP, section, [FREE, Position(INF, 1.0, 4000.0)])
    rows = campaign.rows(tmp_path, [FREE, Position(INF, 1.0, 4000.0)])
    assert [(r.result.status, r.result.start) for r in rows] == [("diverged", "rest")] * 2
    assert not any(r.usable for r in rows)


def test_a_folder_of_another_fan_is_refused(tmp_path, solver):
    campaign.run(tmp_path, SETUP, section, [FREE])
    other = replace(SETUP, rotor=replace(SETUP.rotor, tip_pitch_deg=14.0))
    with pytest.raises(ConfigError, match="another fan or mesh"):
        campaign.run(tmp_path, other, section, [FREE])


def test_a_broken_result_is_named(tmp_path, solver):
    campaign.run(tmp_path, SETUP, section, [FREE])
    (tmp_path / FREE.key / campaign.RESULT).write_text("{}")
    with pytest.raises(ConfigError, match=r"result\.json.*delete it"):
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
        ("h = [1.0,", "h = [0.5,", "runs into the ground"),
        ("h = [1.0,", "h = [0.7,", "too thin a gap"),
        ("d = [0.15,", "d = [0.02,", "too close to the wall"),
        ("blades = 4", "blades = 0", "at least 1"),
        ("radius_m = 0.165", 'radius_m = "wide"', "must be float"),
        ("hub_radius = 0.20", "hub_radius = 0.95", "hub_radius"),
        ("[air]", "[water]", "unknown section [water]"),
        ("chord_m", "chord_mm", "unknown key 'chord_mm'"),
    ],
)
def test_a_wrong_fan_file_is_refused_before_any_work(tmp_path, capsys, old, new, word):
    text = (Path(config.__file__).parent / "fan.toml").read_text()
    fan = tmp_path / "fan.toml"
    fan.write_text(text.replace(old, new, 1))
    assert main(["cfd", "run", "--fan", str(fan), "--work", str(tmp_path / "work"), "--dry-run"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert word in line
    assert not (tmp_path / "work").exists()


def test_the_wall_cannot_be_touched():
    check(SETUP, Position(1.0, 0.15, 4000.0))
    for position in (Position(0.6, INF, 4000.0), Position(2.0, -0.1, 4000.0), Position(2.0, 0.0, 4000.0)):
        with pytest.raises(ConfigError):
            check(SETUP, position)


def test_the_plan_has_what_the_set_needs(capsys):
    assert main(["cfd", "run", "--work", "unused", "--dry-run", "--json", "-"]) == 0
    keys = json.loads(capsys.readouterr().out)["cases"]
    positions = campaign.plan(SETUP)
    assert keys == [p.key for p in positions]
    assert len(set(keys)) == len(keys)
    plain = {p.place for p in positions if p.rpm == 4000 and not p.swirl and p.level == 1.0}
    assert len(plain) >= 100
    for rpm in SETUP.campaign.other_rpm:
        assert len({p.place for p in positions if p.rpm == rpm}) >= 12
    assert sum(p.level != 1.0 for p in positions) >= 6
    assert positions[0].place == (INF, INF)


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
    assert sum(share for _, where, _, share in half if where.startswith("upper")) == pytest.approx(1.0)
    full = case.sources(replace(FREE, swirl=True))
    assert {s for _, where, s, _ in full if where.startswith("upper")} == {-1}
    assert {s for _, where, s, _ in full if where.startswith("lower")} == {1}
