"""Block mesh and blade tables, as text: blocks right-handed, walls where they belong, tables as derived."""

from __future__ import annotations

import math
import re
import shutil

import numpy as np
import pytest

from models.cfd import case, config, foam, polars
from models.cfd.mesh import block_mesh
from models.cfd.position import Position

INF = math.inf
SETUP = config.load()
R = SETUP.fan.radius_m
POSITIONS = [
    Position(h=INF, d=INF, rpm=4000.0),
    Position(h=1.0, d=0.15, rpm=4000.0),
    Position(h=2.0, d=INF, rpm=4000.0),
    Position(h=INF, d=5.0, rpm=4000.0),
    Position(h=5.0, d=0.75, rpm=4000.0, level=1.3),
    Position(h=1.5, d=0.3, rpm=4000.0, swirl=True),
    Position(h=INF, d=2.75, rpm=4000.0, swirl=True),
]


def parsed(position):
    """Vertices (n, 3), blocks as (corners, zone, cells), faces by patch."""
    text = block_mesh(SETUP, position)
    body = text[text.index("vertices") : text.index("blocks")]
    vertices = np.array(
        [[float(v) for v in m.split()] for m in re.findall(r"\(([-\d.e+ ]+)\)", body)]
    )
    blocks = [
        ([int(v) for v in corners.split()], zone, [int(n) for n in cells.split()])
        for corners, zone, cells in re.findall(r"hex \(([\d ]+)\) (\w*) ?\(([\d ]+)\)", text)
    ]
    patches = {
        name: [[int(v) for v in f.split()] for f in re.findall(r"\(([\d ]+)\)", faces)]
        for name, faces in re.findall(r"^(\w+) \{ type [^{}]* faces \( (.*) \); \}$", text, re.M)
    }
    return vertices, blocks, patches


@pytest.mark.parametrize("position", POSITIONS, ids=lambda p: p.key)
def test_every_block_is_right_handed_at_every_corner(position):
    vertices, blocks, _ = parsed(position)
    along = ((1, 3, 4), (2, 0, 5), (3, 1, 6), (0, 2, 7), (7, 5, 0), (4, 6, 1), (5, 7, 2), (6, 4, 3))
    for corners, _, cells in blocks:
        p = vertices[corners]
        for i, (a, b, c) in enumerate(along):
            volume = np.linalg.det([p[a] - p[i], p[b] - p[i], p[c] - p[i]])
            assert volume > 0, (corners, i)
        assert min(cells) >= (1 if cells[1] == 1 else 2)


@pytest.mark.parametrize("position", POSITIONS, ids=lambda p: p.key)
def test_ground_and_wall_lie_where_the_position_says(position):
    vertices, _, patches = parsed(position)
    assert ("ground" in patches) == math.isfinite(position.h)
    assert ("wall" in patches) == math.isfinite(position.d)
    assert ("mirror" in patches) == (position.model == "half")
    for face in patches.get("ground", []):
        assert vertices[face][:, 2] == pytest.approx(-position.h * R, abs=1e-7)
    for face in patches.get("wall", []):
        assert vertices[face][:, 0] == pytest.approx(
            SETUP.fan.lip_radius_m + position.d * R, abs=1e-7
        )
    for face in patches.get("mirror", []):
        assert vertices[face][:, 1] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("position", POSITIONS, ids=lambda p: p.key)
def test_every_face_belongs_to_two_blocks_or_one_patch(position):
    _, blocks, patches = parsed(position)
    count: dict[frozenset[int], int] = {}
    sides = ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))
    for corners, _, _ in blocks:
        for side in sides:
            face = frozenset(corners[i] for i in side)
            count[face] = count.get(face, 0) + 1
    outer = {face for face, n in count.items() if n == 1}
    named = [frozenset(face) for faces in patches.values() for face in faces]
    assert len(named) == len(set(named))
    assert set(named) == outer
    assert max(count.values()) == 2


def test_a_finer_level_has_more_cells_but_discs_of_three_layers():
    def cells(level):
        _, blocks, _ = parsed(Position(h=2.0, d=1.0, rpm=4000.0, level=level))
        return sum(math.prod(n) for _, _, n in blocks), {n[2] for _, zone, n in blocks if zone}

    coarse, usual, fine = cells(0.75), cells(1.0), cells(1.3)
    assert coarse[0] < 0.6 * usual[0] < usual[0] < 0.6 * fine[0]
    assert coarse[1] == usual[1] == fine[1] == {3}


def test_blade_tables_tilt_the_lift_by_the_inflow_angle():
    def section(angle_deg, reynolds):
        return np.full_like(angle_deg, 0.8), np.full_like(angle_deg, 0.05)

    for station in polars.stations(SETUP, 4000.0, section, 11.88):
        phi = np.radians(station.pitch_deg - polars.ANGLES_DEG)
        assert np.hypot(station.axial, station.tangential) == pytest.approx(math.hypot(0.8, 0.05))
        inner = np.abs(polars.ANGLES_DEG) < 100
        assert station.axial[inner] == pytest.approx(
            (0.8 * np.cos(phi) - 0.05 * np.sin(phi))[inner]
        )


def test_reynolds_number_grows_with_speed_and_radius():
    seen = []

    def section(angle_deg, reynolds):
        seen.append(reynolds)
        return np.zeros_like(angle_deg), np.zeros_like(angle_deg)

    slow, fast = (polars.stations(SETUP, rpm, section, 11.88) for rpm in (2800.0, 5200.0))
    assert [s.reynolds for s in slow] == sorted(s.reynolds for s in slow)
    assert fast[-1].reynolds / slow[-1].reynolds == pytest.approx(5200 / 2800)
    # Tip at 4000 rpm: 69 m/s on 27 mm.
    assert polars.stations(SETUP, 4000.0, section, 11.88)[-1].reynolds == pytest.approx(
        1.28e5, rel=0.02
    )
    assert len(seen) == 3 * SETUP.rotor.stations


def test_with_swirl_each_disc_has_its_own_pitch():
    def section(angle_deg, reynolds):
        return np.zeros_like(angle_deg), np.zeros_like(angle_deg)

    tips = [disc[-1].pitch_deg for disc in polars.blades(SETUP, 4000.0, section, swirl=True)]
    assert tips == pytest.approx(SETUP.rotor.swirl_tip_pitch_deg)
    same = [disc[-1].pitch_deg for disc in polars.blades(SETUP, 4000.0, section, swirl=False)]
    assert same == pytest.approx([SETUP.rotor.tip_pitch_deg] * 2)


def test_a_disc_that_turns_backwards_looks_up_the_mirrored_table():
    def section(angle_deg, reynolds):
        return np.sin(np.radians(angle_deg)), 0.02 + 0 * angle_deg

    station = polars.stations(SETUP, 4000.0, section, 11.88)[3]

    def table(backwards):
        rows = re.findall(r"\((\S+) (\S+) (\S+)\)", polars.foam_table(station, backwards))
        return np.array(rows, dtype=float)

    forward, backward = table(False), table(True)
    assert np.all(np.diff(backward[:, 0]) > 0)
    assert np.interp(-8.0, backward[:, 0], backward[:, 2]) == pytest.approx(
        np.interp(8.0, forward[:, 0], forward[:, 2]), abs=1e-5
    )
    assert np.interp(-8.0, backward[:, 0], backward[:, 1]) == pytest.approx(
        -np.interp(8.0, forward[:, 0], forward[:, 1]), abs=1e-5
    )


def test_an_unknown_section_is_refused():
    pytest.importorskip("aerosandbox", reason="blade polars (extra cfd) are not installed")
    with pytest.raises(config.ConfigError, match="nosuchsection"):
        polars.neural_section("nosuchsection")


@pytest.mark.slow
@pytest.mark.skipif(
    shutil.which("checkMesh") is None, reason="no flow solver here: apt-get install openfoam"
)
@pytest.mark.parametrize("position", [POSITIONS[2], POSITIONS[5]], ids=lambda p: p.key)
def test_the_solver_itself_finds_nothing_wrong_with_a_mesh(position, tmp_path):
    def section(angle_deg, reynolds):
        return np.zeros_like(angle_deg), np.zeros_like(angle_deg)

    case.write(
        tmp_path, SETUP, position, polars.blades(SETUP, 4000.0, section, swirl=position.swirl)
    )
    for program in ("blockMesh", "topoSet"):
        foam.run(tmp_path, program)
    said = foam.run(tmp_path, "checkMesh")
    assert "Mesh OK." in said
