"""A fan and its simulation, from one TOML file."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from models.common.errors import ConfigError
from models.common.text_file import read_text
from models.common.toml_table import Bounds, Table, above

_Positive = Annotated[float, above(0.0)]
_Distances = Annotated[tuple[float, ...], Bounds(0.0, above=True, finite=False)]
_Places = Annotated[tuple[tuple[float, float], ...], Bounds(finite=False)]
"""(h, d) over R, inf without ground or wall."""


@dataclass(frozen=True, kw_only=True)
class FanSetup:
    """Duct and hub; lengths over ``radius_m`` unless in m, heights above the reference point, z up.

    The lip is a semicircle, the ends of the hub are flat.
    """

    name: str
    radius_m: _Positive
    lip_radius_m: float
    lip_top: float
    exit_height: float
    exit_radius: float
    exit_skin: float
    hub_radius: float

    @property
    def lip_radius(self) -> float:
        """Outer lip over R."""
        return self.lip_radius_m / self.radius_m

    @property
    def lip_thickness(self) -> float:
        """Thickness of the duct at the lip over R."""
        return self.lip_radius - 1.0

    @property
    def lip_foot(self) -> float:
        """Height at which the lip begins, over R."""
        return self.lip_top - self.lip_thickness / 2


@dataclass(frozen=True, kw_only=True)
class RotorSetup:
    """Two equal discs; pitch linear from the hub to the tip.

    Blades reach from ``root_radius`` to ``tip_radius`` (over R); between them and hub or duct lies a gap.
    ``tip_pitch_deg`` of both without swirl; ``swirl_tip_pitch_deg`` of upper and lower disc with it.
    """

    blades: int
    chord_m: _Positive
    root_radius: float
    tip_radius: float
    root_pitch_deg: float
    tip_pitch_deg: float
    swirl_tip_pitch_deg: tuple[float, ...]
    section: str
    thickness: float
    upper_height: float
    lower_height: float
    stations: int
    hover_lift_n: float
    hover_rpm: float


@dataclass(frozen=True)
class Air:
    """The fluid; ``far_k`` [m2/s2] and ``far_omega`` [1/s] are the turbulence of the air that enters from afar."""

    density_kg_m3: _Positive
    viscosity_m2_s: _Positive
    far_k: float
    far_omega: float


@dataclass(frozen=True, kw_only=True)
class Mesh:
    """Cell counts at level 1 and the extent of the domain over R."""

    azimuth: int
    hub: int
    bore: int
    lip: int
    ring: int
    outer: int
    above: int
    below: int
    duct: tuple[int, ...]
    box: float
    far: float
    far_below: float


@dataclass(frozen=True, kw_only=True)
class Solver:
    """Iterations, relaxation and time step."""

    relax_velocity: float
    relax_pressure: float
    chunk: int
    start: int
    limit: int
    sample_every: int
    time_step_s: float
    march_chunk: int
    march_limit: int


@dataclass(frozen=True, kw_only=True)
class Converged:
    """What counts as converged: shares of hover lift (forces) and hover lift times R (moments), or of the effect.

    ``mean``: error of the mean of a flow that swings on, as a share of hover lift.
    """

    drift: float
    mean: float
    drift_free: float
    swing: float
    drift_of_effect: float
    swing_of_effect: float


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """Which cases make the data set; positions are (h, d) over R."""

    rpm: _Positive
    h: _Distances
    d: _Distances
    other_rpm: _Distances
    rpm_at: _Places
    grid_levels: _Distances
    grid_at: _Places
    again_from_far: _Places
    again_from_wall: _Places
    full_level: float
    full_at: _Places
    full_other_rpm_at: _Places
    full_grid_levels: _Distances
    full_grid_at: _Places
    full_again_from_far: _Places = ()
    """Second starts of full models, from the state without ground at the same distance to the wall."""


@dataclass(frozen=True, kw_only=True)
class Setup:
    """Everything a case needs but its position."""

    fan: FanSetup
    rotor: RotorSetup
    air: Air
    mesh: Mesh
    solver: Solver
    converged: Converged
    campaign: Campaign


def load(path: Path | None = None) -> Setup:
    """Read a fan file, or the built-in one. Raises ConfigError naming the file and the key."""
    path = path or Path(__file__).with_name("fan.toml")
    setup = Table.of(read_text("fan file", path), f"fan file {path}").read(Setup)
    _check(str(path), setup)
    return setup


def _check(name: str, setup: Setup) -> None:
    """Refuse a geometry that cannot be meshed."""
    fan = setup.fan
    rotor = setup.rotor
    mesh = setup.mesh
    solver = setup.solver
    discs = (
        fan.exit_height,
        rotor.lower_height,
        rotor.lower_height + rotor.thickness,
        rotor.upper_height,
    )
    needed = {
        "[fan] lip_radius_m must exceed radius_m by 5 % or more": fan.lip_thickness > 0.05,
        "[fan] hub_radius must lie between 0 and 0.9": 0 < fan.hub_radius < 0.9,
        "[fan] needs 1 <= exit_radius < exit_skin <= lip": 1.0
        <= fan.exit_radius
        < fan.exit_skin
        <= fan.lip_radius,
        "[rotor] stations must be at least 2": rotor.stations >= 2,
        "[rotor] swirl_tip_pitch_deg needs two pitches: upper and lower disc": len(
            rotor.swirl_tip_pitch_deg
        )
        == 2,
        "the rotors cut into each other or leave the duct: exit_height < lower disc < upper disc "
        "is needed": (all(low < high for low, high in itertools.pairwise(discs))),
        "the rotors cut into the hub: [rotor] root_radius is below hub_radius": rotor.root_radius
        >= fan.hub_radius,
        "the rotors cut into the duct: [rotor] tip_radius is beyond the bore, 1": rotor.tip_radius
        <= 1.0,
        "[rotor] root_radius must lie 0.1 or more below tip_radius": rotor.root_radius
        < rotor.tip_radius - 0.1,
        "the rotors cut into the duct: the upper disc must lie below the curved part of the lip": (
            rotor.upper_height + rotor.thickness < fan.lip_foot
        ),
        "[mesh] duct needs five counts, 3 for each disc": len(mesh.duct) == 5
        and mesh.duct[1] == mesh.duct[3] == 3,
        "[mesh] needs lip + 0.2 < box and box + 1 < far": fan.lip_radius + 0.2
        < mesh.box
        < mesh.far - 1,
        "[solver] sample_every must be a third of chunk or less": solver.sample_every
        <= solver.chunk // 3,
    }
    for what, holds in needed.items():
        if not holds:
            raise ConfigError(f"fan file {name}: {what}")
