"""The solver's input files of one case."""

from __future__ import annotations

import math
from pathlib import Path

from models.cfd.config import Setup
from models.cfd.meridian import LAYERS
from models.cfd.mesh import block_mesh
from models.cfd.polars import Blades, Station, foam_table
from models.cfd.position import Position

DISCS = ("upper", "lower")
# Blades end within this length [m]; the solver's table of chords wants a number above zero beyond.
EDGE_M, NO_CHORD_M = 1e-5, 1e-9
# Radius over the outermost cell's from which the solver's disc gives no lift. Above 1: it never does.
TIP_EFFECT = 1.1


def write(folder: Path, setup: Setup, position: Position, blades: Blades) -> None:
    """Write system, constant and 0 of a case; an old case in ``folder`` is overwritten file by file."""
    files = {
        "system/blockMeshDict": ("dictionary", block_mesh(setup, position)),
        "system/topoSetDict": ("dictionary", _layers(setup)),
        "system/fvSchemes": ("dictionary", schemes(steady=True)),
        "system/fvSolution": ("dictionary", _solution(setup)),
        "system/controlDict": ("dictionary", control(setup, end=setup.solver.start, steady=True)),
        "constant/transportProperties": (
            "dictionary",
            f"transportModel Newtonian;\nnu {setup.air.viscosity_m2_s:g};\n",
        ),
        "constant/turbulenceProperties": (
            "dictionary",
            "simulationType RAS;\nRAS { RASModel kOmegaSST; turbulence on; printCoeffs off; }\n",
        ),
        "constant/fvOptions": ("dictionary", _rotors(setup, position, blades)),
        **{f"0/{name}": (_kind(name), text) for name, text in _fields(setup, position).items()},
    }
    for name, (kind, text) in files.items():
        put(folder / name, kind, text)


def put(path: Path, kind: str, text: str) -> None:
    """Write one dictionary with the header the solver wants."""
    path.parent.mkdir(parents=True, exist_ok=True)
    head = f"FoamFile {{ version 2.0; format ascii; class {kind}; object {path.name}; }}\n"
    path.write_text(head + text, encoding="utf-8")


def control(setup: Setup, end: float, *, steady: bool) -> str:
    """Run control up to iteration (steady) or time (marched) ``end``, from the newest state on disk."""
    solver = setup.solver
    step = 1.0 if steady else solver.time_step_s
    return (
        f"application {'simpleFoam' if steady else 'pimpleFoam'};\n"
        f"startFrom latestTime;\nstartTime 0;\nstopAt endTime;\nendTime {end:.10g};\ndeltaT {step:g};\n"
        f"writeControl timeStep;\nwriteInterval {solver.sample_every if steady else max(1, solver.march_chunk // 8)};\n"
        "purgeWrite 0;\nwriteFormat binary;\nwritePrecision 10;\nwriteCompression off;\ntimeFormat general;\n"
        "timePrecision 10;\nrunTimeModifiable false;\n"
        f"functions {{ loads {{ type forces; libs (forces); patches (duct hub); rho rhoInf; "
        f"rhoInf {setup.air.density_kg_m3:g}; CofR (0 0 0); log false; writeControl timeStep; writeInterval 1; }} }}\n"
    )


def schemes(*, steady: bool) -> str:
    """Discretisation: second order upwind for U, first order for turbulence; Euler in time where marched."""
    bounded = "bounded " if steady else ""
    return (
        f"ddtSchemes {{ default {'steadyState' if steady else 'Euler'}; }}\n"
        "gradSchemes { default cellLimited Gauss linear 1; grad(p) Gauss linear; }\n"
        f"divSchemes {{ default none; div(phi,U) {bounded}Gauss linearUpwind grad(U); "
        f"div(phi,k) {bounded}Gauss upwind; div(phi,omega) {bounded}Gauss upwind; "
        "div((nuEff*dev2(T(grad(U))))) Gauss linear; }\n"
        "laplacianSchemes { default Gauss linear limited 0.5; }\ninterpolationSchemes { default linear; }\n"
        "snGradSchemes { default limited 0.5; }\nwallDist { method meshWave; }\n"
    )


def _solution(setup: Setup) -> str:
    solver = setup.solver
    u, p = solver.relax_velocity, solver.relax_pressure
    return (
        "solvers {\n"
        "p { solver GAMG; smoother GaussSeidel; tolerance 1e-8; relTol 0.05; }\n"
        "pFinal { $p; relTol 0.02; }\n"
        '"(U|k|omega)" { solver smoothSolver; smoother symGaussSeidel; tolerance 1e-9; relTol 0.1; }\n'
        '"(U|k|omega)Final" { $U; relTol 0.1; }\n}\n'
        "SIMPLE { nNonOrthogonalCorrectors 0; consistent yes; }\n"
        "PIMPLE { nOuterCorrectors 3; nCorrectors 1; nNonOrthogonalCorrectors 0; consistent yes; }\n"
        "relaxationFactors { "
        f'fields {{ p {p:g}; pFinal 1; }} equations {{ U {u:g}; "(k|omega)" {u:g}; ".*Final" 0.9; }} }}\n'
    )


def _layers(setup: Setup) -> str:
    """Cell zones of the discs' layers: the solver's disc must be one cell thick, and one alone is unstable."""
    rotor, m = setup.rotor, setup.fan.radius_m
    actions = []
    for disc, z0 in zip(DISCS, (rotor.upper_height, rotor.lower_height), strict=True):
        step = rotor.thickness / LAYERS
        for layer in range(LAYERS):
            low, high = m * (z0 + layer * step), m * (z0 + (layer + 1) * step)
            name = zone(disc, layer)
            actions.append(
                f"{{ name {name}Set; type cellSet; action new; source zoneToCell; zone {disc}Disc; }}\n"
                f"{{ name {name}Set; type cellSet; action subset; source boxToCell; "
                f"box (-9 -9 {low:.8g}) (9 9 {high:.8g}); }}\n"
                f"{{ name {name}; type cellZoneSet; action new; source setToCellZone; set {name}Set; }}"
            )
    return "actions\n(\n" + "\n".join(actions) + "\n);\n"


def zone(disc: str, layer: int) -> str:
    """Name of one layer's cell zone."""
    return f"{disc}{layer}"


def sources(position: Position) -> list[tuple[str, str, int, float]]:
    """(name, zone, sense of rotation, share of the chord) of every rotor source.

    Without swirl each layer turns both ways with half the chord: one sense alone would show the half model only the
    advancing side. With swirl the upper disc turns clockwise seen from above (negative about z), the lower against it.
    """
    out = []
    for disc, sense in zip(DISCS, (-1, 1), strict=True):
        for layer in range(LAYERS):
            senses = (sense,) if position.swirl else (1, -1)
            for s in senses:
                name = f"{disc}{layer}{'p' if s > 0 else 'n'}"
                out.append((name, zone(disc, layer), s, 1.0 / (LAYERS * len(senses))))
    return out


def _rotors(setup: Setup, position: Position, blades: Blades) -> str:
    rotor, m = setup.rotor, setup.fan.radius_m
    height = dict(zip(DISCS, (rotor.upper_height, rotor.lower_height), strict=True))
    table = dict(zip(DISCS, blades, strict=True))
    profiles = {
        (disc, sense): "\n".join(
            f"section{i} {{ type lookup; data (\n{foam_table(s, backwards=sense < 0)}\n); }}"
            for i, s in enumerate(table[disc])
        )
        for disc in DISCS
        for sense in (1, -1)
    }
    out = []
    for name, where, sense, share in sources(position):
        disc = where[:-1]
        blade = _blade(setup, table[disc], share)
        z = m * (height[disc] + rotor.thickness / 2)
        out.append(
            f"{name}\n{{\ntype rotorDisk; active true; selectionMode cellZone; cellZone {where};\n"
            f"fields (U); nBlades {rotor.blades}; tipEffect {TIP_EFFECT:g}; inletFlowType local; "
            "inflowVelocity (0 0 0);\n"
            f"geometryMode specified; origin (0 0 {z:.8g}); axis (0 0 1); refDirection (1 0 0);\n"
            f"rpm {sense * position.rpm:.8g}; rhoRef {setup.air.density_kg_m3:g}; rhoInf {setup.air.density_kg_m3:g};\n"
            "trimModel fixedTrim; fixedTrimCoeffs { theta0 0; theta1c 0; theta1s 0; }\n"
            "flapCoeffs { beta0 0; beta1c 0; beta2s 0; }\n"
            f"blade {{ data ( {blade} ); }}\nprofiles {{\n{profiles[disc, sense]}\n}}\n}}\n"
        )
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
    return " ".join(f"(section{i} ({r:.8g} {pitch:.8g} {chord:.8g}))" for i, r, pitch, chord in rows)


def _kind(name: str) -> str:
    return "volVectorField" if name == "U" else "volScalarField"


def _fields(setup: Setup, position: Position) -> dict[str, str]:
    """Start fields and boundary conditions."""
    solid = ["duct", "hub"]
    solid += ["ground"] if math.isfinite(position.h) else []
    solid += ["wall"] if math.isfinite(position.d) else []
    names = '"(' + "|".join(solid) + ')"'
    sides = "" if position.swirl else "mirror { type symmetryPlane; } "
    k, w = setup.air.far_k, setup.air.far_omega

    def text(dimensions: str, value: str, wall: str, far: str) -> str:
        return (
            f"dimensions [{dimensions}];\ninternalField uniform {value};\n"
            f"boundaryField {{ {names} {{ {wall} }} far {{ {far} }} {sides}}}\n"
        )

    still = f"type inletOutlet; inletValue uniform {k:g}; value uniform {k:g};"
    omega = f"type inletOutlet; inletValue uniform {w:g}; value uniform {w:g};"
    return {
        "U": text(
            "0 1 -1 0 0 0 0", "(0 0 0)", "type noSlip;", "type pressureInletOutletVelocity; value uniform (0 0 0);"
        ),
        "p": text("0 2 -2 0 0 0 0", "0", "type zeroGradient;", "type totalPressure; p0 uniform 0; value uniform 0;"),
        "k": text("0 2 -2 0 0 0 0", f"{k:g}", f"type kqRWallFunction; value uniform {k:g};", still),
        "omega": text("0 0 -1 0 0 0 0", f"{w:g}", f"type omegaWallFunction; value uniform {w:g};", omega),
        "nut": text(
            "0 2 -1 0 0 0 0",
            "0",
            "type nutUSpaldingWallFunction; value uniform 0;",
            "type calculated; value uniform 0;",
        ),
    }
