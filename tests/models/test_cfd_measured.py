"""Fans that were measured: fan files of one rotor, with a table of the blade, without a duct; curve over curve."""

from __future__ import annotations

import json
import math
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

from models.cfd import campaign, case, config, foam, measured, polars, table
from models.cfd.campaign import Row
from models.cfd.case_run import Result
from models.cfd.meridian import Meridian
from models.cfd.mesh import block_mesh
from models.cfd.position import Position
from models.cfd.wedge import TURN
from models.cli import main

INF = math.inf
OPEN = config.load(config.shipped("apc_10x47"))
DUCTED = config.load(config.shipped("x22a"))


def section(angle_deg, reynolds):
    return 0.1 * angle_deg, np.full_like(angle_deg, 0.02)


def edited(tmp_path, name, old, new):
    text = config.shipped(name).read_text("utf-8")
    assert old in text
    path = tmp_path / "fan.toml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("name", "old", "new", "words"),
    [
        ("apc_10x47", "duct = false", "duct = false\nlip_top = 0.3", "duct = false has no 'lip_top'"),
        ("apc_10x47", "duct = false", "duct = true", "lacks 'lip_radius_m'"),
        ("apc_10x47", "duct = false", "duct = 0", "duct: must be true or false"),
        ("apc_10x47", "hub_tail = 0.0", "", "lacks 'hub_tail'"),
        ("apc_10x47", "blades = 2", "blades = 2\nchord_m = 0.02", "blade replaces 'chord_m'"),
        ("apc_10x47", "[0.15, 0.109, 21.11]", "[0.25, 0.109, 21.11]", "from the hub to the tip"),
        ("apc_10x47", "[0.15, 0.109, 21.11]", "[0.15, 0.109]", "a list of \\[radius, chord, pitch\\]"),
        ("apc_10x47", "[0.15, 0.109, 21.11]", "[0.15, 0.0, 21.11]", "a chord must be above 0"),
        ("apc_10x47", "rotors = 1", "rotors = 3", "rotors must be 1 or 2"),
        ("x22a", '"naca2432", ', "", "one name for each row of blade"),
        ("x22a", "lip_crest = 1.1242", "lip_crest = 1.3", "lip_crest must lie between"),
        ("x22a", "hub_nose = 0.16", "hub_nose = 0.3", "hub_nose must end below"),
    ],
)
def test_a_fan_file_of_one_rotor_is_refused_by_key(tmp_path, name, old, new, words):
    with pytest.raises(config.ConfigError, match=words):
        config.load(edited(tmp_path, name, old, new))


def test_a_shipped_fan_is_found_by_its_name(tmp_path, capsys):
    assert main(["cfd", "run", "--fan", "apc_10x47", "--model", "wedge", "--work", str(tmp_path), "--dry-run"]) == 0
    assert "wedge_hinf_dinf_l1.5_n2676" in capsys.readouterr().out


def test_trim_refuses_one_rotor(tmp_path, monkeypatch):
    from models.cfd import trim

    monkeypatch.setattr(foam, "require", lambda: None)
    with pytest.raises(config.ConfigError, match="one rotor"):
        trim.trim(tmp_path, OPEN, section, "wedge")


def test_the_table_of_the_blade_reaches_the_solver():
    stations = polars.stations(OPEN, 4880.0, section, 0.0)
    radius = OPEN.fan.radius_m
    got = [(s.radius_m / radius, s.chord_m / radius, s.pitch_deg) for s in stations]
    assert np.array(got) == pytest.approx(np.array(OPEN.rotor.blade))
    text = case._blade(OPEN, stations, 0.5)
    first = re.search(r"section0 \(([\d.e+-]+) ([\d.]+) ([\d.e+-]+)\)", text)
    assert [float(v) for v in first.groups()] == pytest.approx([0.15 * radius, 21.11, 0.5 * 0.109 * radius])
    # Beyond the tip of an open rotor there is no blade.
    assert "(0.12701 5.04 1e-09)" in text


def test_a_turned_blade_and_its_own_sections(monkeypatch):
    names = []

    def named(name):
        names.append(name)
        return section

    monkeypatch.setattr(polars, "neural_section", named)
    usual, turned = (polars.stations(DUCTED.of(v), 1200.0, section, 0.0) for v in ("", "pitch_29"))
    assert [t.pitch_deg - u.pitch_deg for t, u in zip(turned, usual, strict=True)] == pytest.approx([10.0] * 9)
    assert names[:9] == list(DUCTED.rotor.sections)


def test_one_rotor_turns_alone():
    turning = case.sources(OPEN.rotor, Position(INF, INF, 4880.0, swirl=True, wedge=True))
    assert {(name[:-2], sense) for name, _, sense, _ in turning} == {("upper", -1)}
    assert sum(share for *_, share in turning) == pytest.approx(1.0)


def test_the_lip_is_the_ellipse_of_the_file():
    line, fan = Meridian(DUCTED, Position(INF, INF, 1200.0, wedge=True)), DUCTED.fan
    inner, outer, depth = fan.lip_axes
    inside = line.flank(outer=False)[5:]
    for r, z in (*inside, *line.cap(), *line.flank(outer=True)[5:]):
        half = inner if r < fan.lip_crest else outer
        assert ((r - fan.lip_crest) / half) ** 2 + ((z - fan.lip_foot) / depth) ** 2 == pytest.approx(1.0)
    assert inside[0] == pytest.approx([1.0, fan.lip_foot], abs=0.04)
    assert line.cap()[:, 1].max() == pytest.approx(fan.lip_top, abs=1e-3)


def test_optional_keys_left_out_do_not_make_another_work_folder(tmp_path):
    usual = config.load()
    content = campaign._content(usual, "half")
    assert "duct" not in content["fan"]
    assert "rotors" not in content["rotor"]
    changed = replace(usual, rotor=replace(usual.rotor, pitch_change_deg=1.0))
    assert campaign._content(changed, "half") != content


@pytest.mark.parametrize("swirl", [True, False])
def test_a_mesh_without_a_duct_has_no_wall_but_the_hub(swirl):
    text = block_mesh(OPEN, Position(1.0, 0.3, 4880.0, swirl=swirl))
    assert "\nhub {" in text
    assert "\nduct {" not in text
    assert "\nwall {" in text


@pytest.mark.skipif(shutil.which("checkMesh") is None, reason="no flow solver here: apt-get install openfoam")
@pytest.mark.parametrize("setup", [OPEN, DUCTED], ids=measured.FANS[::-1])
@pytest.mark.parametrize("h", [INF, 1.0])
def test_the_solver_finds_nothing_wrong_with_the_meshes(setup, h, tmp_path, monkeypatch):
    monkeypatch.setattr(polars, "neural_section", lambda name: section)
    position = Position(h, INF, setup.campaign.rpm, swirl=True, level=1.5, wedge=True)
    case.write(tmp_path, setup, position, polars.blades(setup, position.rpm, section, swirl=True))
    for program in ("blockMesh", "topoSet"):
        foam.run(tmp_path, program)
    said = foam.run(tmp_path, "checkMesh")
    assert "Mesh OK." in said
    volume = float(re.search(r"Total volume = ([\d.e+-]*\d)", said)[1])
    lowest = h if math.isfinite(h) else setup.mesh.far_below
    domain = (
        math.pi * (setup.mesh.far * setup.fan.radius_m) ** 2 * (setup.mesh.far + lowest) * setup.fan.radius_m / TURN
    )
    assert volume == pytest.approx(domain, rel=0.02)


def row(h, rpm, lift, torque, **changes):
    six = (0.0,) * 6
    result = Result((0, 0, lift, 0, 0, torque), six, six, (lift, 0.0, 0.0), "steady", 1, 96, 0, 1.0, "rest")
    return Row(Position(h, INF, rpm, swirl=True, level=1.5, wedge=True, **changes), result)


def test_coefficients_are_those_of_propellers():
    # T = C_T rho n^2 D^4 with n = 80 / s, D = 0.254 m.
    unit = 1.225 * 80.0**2 * 0.254**4
    found = measured.coefficients(OPEN, row(INF, 4800.0, 0.12 * unit, -0.05 * unit * 0.254 / (2 * math.pi)))
    assert (found.thrust, found.power) == pytest.approx((0.12, 0.05))


def test_the_ground_is_compared_with_free_air_at_constant_speed_and_at_equal_power():
    rows = [row(INF, 4880.0, 4.0, 0.05), row(1.0, 4880.0, 4.4, 0.04), row(2.0, 4880.0, 4.1, 0.05)]
    found = measured.compare("apc_10x47", OPEN, rows)
    assert np.array(found.ground()) == pytest.approx(np.array([(1.0, 1.1, 1.1 / 0.8 ** (2 / 3)), (2.0, 1.025, 1.025)]))
    text = measured.text([found])
    assert re.search(r"4880 rpm: C_T 0\.\d+, measured 0\.1223: [+-]", text)
    assert "thrust x 1.100" in text


def test_no_wedge_is_said(tmp_path, capsys):
    code = main(["cfd", "measured", "--fan", "apc_10x47", "--work", str(tmp_path)])
    assert code == 3 or code == 2
    assert "no wedge has been computed" in capsys.readouterr().err
    assert main(["cfd", "measured", "--fan", "apc_10x47"]) == 2
    assert "belong together" in capsys.readouterr().err


def test_helicopters_gain_less_the_higher_they_hover():
    gain = measured.helicopters(np.array([0.5, 1.0, 2.0, 4.0]))
    assert np.all(np.diff(gain) < 0)
    # Kan et al. 2019, eq. 5: 0.9926 + 0.03794 / (z / 2R)^2 to the power 2/3, at z = 2 R.
    assert gain[2] == pytest.approx(1.0305 ** (2 / 3), rel=1e-4)


def test_the_shipped_cases_say_what_the_documents_say():
    """Figures of docs/cfd.md, "Fans that were measured", from the tables that ship."""
    ducted, propeller = measured.shipped()
    beside = {(p.variant, p.rpm): p for p in ducted.points}
    (one,) = ducted.free("wedge", "section_2412")
    known = beside["section_2412", 1200.0]
    assert one.thrust / known.thrust == pytest.approx(1.01, abs=0.01)
    assert one.power / known.power == pytest.approx(1.03, abs=0.01)
    (stalled,) = ducted.free("wedge", "pitch_29")
    assert stalled.thrust < 0.6 * beside["pitch_29", 1200.0].thrust
    measured_at = {p.rpm: p for p in propeller.points if not p.variant}
    for case_ in propeller.free():
        point = measured_at[case_.rpm]
        assert -0.18 < case_.thrust / point.thrust - 1 < -0.13
        merit = (case_.thrust / point.thrust) ** 1.5 / (case_.power / point.power)
        assert merit == pytest.approx(1.0, abs=0.05)
    ground = {h: thrust for h, thrust, _ in propeller.ground()}
    assert ground[1.0] < 1.0 < measured.helicopters(np.array([1.0]))[0] - 0.05
    assert ground[4.0] == pytest.approx(1.0, abs=0.02)


def test_the_command_draws_measured_and_computed(tmp_path, capsys):
    assert main(["cfd", "measured", "--report", str(tmp_path / "report"), "--json", str(tmp_path / "out.json")]) == 0
    said = capsys.readouterr().out
    assert "section_2412, 1200 rpm: C_T 0.297" in said
    assert (tmp_path / "report/measured.png").stat().st_size > 10_000
    numbers = json.loads((tmp_path / "out.json").read_text())
    assert {p["rpm"] for p in numbers["apc_10x47"]["free"]} >= {2676.0, 6528.0}


def test_every_measured_point_has_a_source_and_a_variant_of_its_fan():
    for point in measured.points():
        setup = config.load(config.shipped(point.fan))
        assert point.source
        assert not point.variant or point.variant in setup.variants
        assert 0 < point.power < point.thrust < 1


def test_a_case_table_written_from_a_work_folder_gives_the_same_comparison(tmp_path):
    rows = table.read(measured.shipped_cases("x22a"))
    for r in rows:
        campaign._store(tmp_path, r.position, r.result)
    out = tmp_path / "cases.csv"
    code = main(["cfd", "measured", "--fan", "x22a", "--work", str(tmp_path), "--cases", str(out), "--quiet"])
    assert code == 0
    assert {r.position: r.result.wrench for r in table.read(out)} == {r.position: r.result.wrench for r in rows}


def test_a_fan_without_measured_points_is_drawn_alone():
    rows = [row(INF, 4880.0, 4.0, 0.05), row(INF, 3000.0, 1.5, 0.02), row(1.0, 4880.0, 4.4, 0.04)]
    found = measured.compare("mine", OPEN, rows)
    assert found.points == ()
    drawn = measured.figure([found])
    coefficients, ground = drawn.axes
    assert any(list(line.get_xdata()) == [3000.0, 4880.0] for line in coefficients.lines)
    assert any(list(line.get_xdata()) == [1.0] for line in ground.lines)
    assert "C_T" in measured.text([found])
