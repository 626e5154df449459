"""The solver's input files of one case."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from string import Template

from models.cfd.config import Setup
from models.cfd.meridian import LAYERS
from models.cfd.mesh import block_mesh
from models.cfd.polars import Blades, Station, foam_table
from models.cfd.position import Position

DISCS = ("upper", "lower")
# Blades end within this length [m]; the solver's table of chords wants a number above zero beyond.
EDGE_M = 1e-5
NO_CHORD_M = 1e-9
# Radius over the outermost cell's from which the solver's disc gives no lift. Above 1: it never does.
TIP_EFFECT = 1.1


class _Template(Template):
    """``@name`` stands for a value; the solver's own macros begin with $."""

    delimiter = "@"


TEMPLATES = resources.files("models.cfd") / "templates"


def write(folder: Path, setup: Setup, position: Position, blades: Blades) -> None:
    """Write system, constant and 0 of a case; an old case in ``folder`` is overwritten file by file."""
    air = setup.air
    solver = setup.solver
    for name in ("0/U", "0/p", "0/k", "0/omega", "0/nut", "constant/transportProperties"):
        fill(folder, name, k=air.far_k, omega=air.far_omega, viscosity=air.viscosity_m2_s)
    fill(folder, "constant/turbulenceProperties")
    fill(
        folder,
        "system/fvSolution",
        relax_pressure=solver.relax_pressure,
        relax_velocity=solver.relax_velocity,
    )
    put(folder / "system/blockMeshDict", block_mesh(setup, position))
    put(folder / "system/topoSetDict", _layers(setup))
    put(folder / "constant/fvOptions", _rotors(setup, position, blades))
    control(folder, setup, solver.start, steady=True)


def fill(folder: Path, name: str, **values: float | str) -> None:
    """Write the template ``name`` with these values."""
    target = folder / name
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(_filled(name, **values), encoding="utf-8")


def _filled(name: str, **values: float | str) -> str:
    texts = {}
    for key, v in values.items():
        texts[key] = v if isinstance(v, str) else f"{v:.10g}"
    return _Template((TEMPLATES / name).read_text("utf-8")).substitute(texts)


def put(path: Path, text: str) -> None:
    """Write one dictionary with the header the solver wants."""
    path.parent.mkdir(parents=True, exist_ok=True)
    head = f"FoamFile {{ version 2.0; format ascii; class dictionary; object {path.name}; }}\n"
    path.write_text(head + text, encoding="utf-8")


def control(folder: Path, setup: Setup, end: float, *, steady: bool) -> None:
    """Write run control up to iteration (steady) or time (marched) ``end``, from the newest state on disk."""
    solver = setup.solver
    fill(
        folder,
        "system/controlDict",
        program="simpleFoam" if steady else "pimpleFoam",
        end=end,
        step=1.0 if steady else solver.time_step_s,
        every=solver.sample_every if steady else max(1, solver.march_chunk // 8),
        density=setup.air.density_kg_m3,
    )
    time, bounded = ("steadyState", "bounded") if steady else ("Euler", "")
    fill(folder, "system/fvSchemes", time=time, bounded=bounded)


def _layers(setup: Setup) -> str:
    """Cell zones of the discs' layers: the solver's disc must be one cell thick, and one alone is unstable."""
    rotor = setup.rotor
    m = setup.fan.radius_m
    actions = []
    for disc, z0 in zip(DISCS, (rotor.upper_height, rotor.lower_height), strict=True):
        step = rotor.thickness / LAYERS
        for layer in range(LAYERS):
            low = m * (z0 + layer * step)
            high = m * (z0 + (layer + 1) * step)
            name = f"{disc}{layer}"
            actions.append(
                f"{{ name {name}Set; type cellSet; action new; source zoneToCell; zone "
                f"{disc}Disc; }}\n"
                f"{{ name {name}Set; type cellSet; action subset; source boxToCell; box (-9 -9 "
                f"{low:.8g}) (9 9 {high:.8g}); }}\n"
                f"{{ name {name}; type cellZoneSet; action new; source setToCellZone; set "
                f"{name}Set; }}"
            )
    return "actions\n(\n" + "\n".join(actions) + "\n);\n"


def sources(position: Position) -> list[tuple[str, str, int, float]]:
    """(name, zone, sense of rotation, share of the chord) of every rotor source.

    Without swirl each layer turns both ways with half the chord: one sense alone would show the half model only the
    advancing side. With swirl the upper disc turns clockwise seen from above (negative about z), the lower against it.
    """
    out = []
    for disc, sense in zip(DISCS, (-1, 1), strict=True):
        for layer in range(LAYERS):
            senses: tuple[int, ...]
            if position.swirl:
                senses = (sense,)
            else:
                senses = (1, -1)
            for s in senses:
                zone = f"{disc}{layer}"
                out.append(
                    (f"{zone}{'p' if s > 0 else 'n'}", zone, s, 1.0 / (LAYERS * len(senses)))
                )
    return out


def _rotors(setup: Setup, position: Position, blades: Blades) -> str:
    rotor = setup.rotor
    m = setup.fan.radius_m
    height = dict(zip(DISCS, (rotor.upper_height, rotor.lower_height), strict=True))
    table = dict(zip(DISCS, blades, strict=True))
    out = []
    for source, zone, sense, share in sources(position):
        disc = zone[:-1]
        profiles = (
            f"section{i} {{ type lookup; data (\n{foam_table(s, backwards=sense < 0)}\n); }}"
            for i, s in enumerate(table[disc])
        )
        values: dict[str, float | str] = {
            **{"source": source, "zone": zone, "blades": rotor.blades, "rpm": sense * position.rpm},
            **{
                "z": f"{m * (height[disc] + rotor.thickness / 2):.8g}",
                "density": f"{setup.air.density_kg_m3:g}",
            },
            **{
                "blade": _blade(setup, table[disc], share),
                "profiles": "\n".join(profiles),
                "tip_effect": TIP_EFFECT,
            },
        }
        out.append(_filled("constant/rotorDisk", **values))
    return "".join(out)


def _blade(setup: Setup, stations: tuple[Station, ...], share: float) -> str:
    """Radius, pitch and ``share`` of the chord along the blade.

    The solver goes on beyond the ends with what it finds there. That is no chord, where there is a gap; a blade that
    reaches the bore follows the diffuser.
    """
    rows = [(i, s.radius_m, s.pitch_deg, s.chord_m * share) for i, s in enumerate(stations)]
    (root, *_), (*_, tip) = rows, rows
    if setup.rotor.root_radius > setup.fan.hub_radius:
        rows.insert(0, (root[0], root[1] - EDGE_M, root[2], NO_CHORD_M))
    if setup.rotor.tip_radius < 1.0:
        rows.append((tip[0], tip[1] + EDGE_M, tip[2], NO_CHORD_M))
    return " ".join(
        f"(section{i} ({r:.8g} {pitch:.8g} {chord:.8g}))" for i, r, pitch, chord in rows
    )
