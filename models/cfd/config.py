"""A fan and its simulation, from one TOML file."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields
from importlib import resources
from pathlib import Path
from typing import Any

from models.errors import ConfigError


@dataclass(frozen=True)
class Fan:
    """Duct and hub; lengths over ``radius_m`` unless in m, heights above the reference point, z up.

    The lip is a semicircle, the ends of the hub are flat.
    """

    name: str
    radius_m: float
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


@dataclass(frozen=True)
class Rotor:
    """Two equal discs; pitch linear from the hub to the tip.

    Blades reach from ``root_radius`` to ``tip_radius`` (over R); between them and hub or duct lies a gap.
    ``tip_pitch_deg`` of both without swirl; ``swirl_tip_pitch_deg`` of upper and lower disc with it.
    """

    blades: int
    chord_m: float
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

    density_kg_m3: float
    viscosity_m2_s: float
    far_k: float
    far_omega: float


@dataclass(frozen=True)
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


@dataclass(frozen=True)
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


@dataclass(frozen=True)
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


@dataclass(frozen=True)
class Campaign:
    """Which cases make the data set; positions are (h, d) over R."""

    rpm: float
    h: tuple[float, ...]
    d: tuple[float, ...]
    other_rpm: tuple[float, ...]
    rpm_at: tuple[tuple[float, float], ...]
    grid_levels: tuple[float, ...]
    grid_at: tuple[tuple[float, float], ...]
    again_from_far: tuple[tuple[float, float], ...]
    again_from_wall: tuple[tuple[float, float], ...]
    full_level: float
    full_at: tuple[tuple[float, float], ...]
    full_other_rpm_at: tuple[tuple[float, float], ...]
    full_grid_levels: tuple[float, ...]
    full_grid_at: tuple[tuple[float, float], ...]
    full_again_from_far: tuple[tuple[float, float], ...] = ()
    """Second starts of full models, from the state without ground at the same distance to the wall."""


@dataclass(frozen=True)
class Setup:
    """Everything a case needs but its position."""

    fan: Fan
    rotor: Rotor
    air: Air
    mesh: Mesh
    solver: Solver
    converged: Converged
    campaign: Campaign


_SECTIONS: Mapping[str, type] = {
    "fan": Fan,
    "rotor": Rotor,
    "air": Air,
    "mesh": Mesh,
    "solver": Solver,
    "converged": Converged,
    "campaign": Campaign,
}


def load(path: Path | None = None) -> Setup:
    """Read a fan file, or the built-in one. Raises ConfigError naming the file and the key."""
    name = str(path) if path else "models/cfd/fan.toml"
    try:
        text = (
            path.read_text("utf-8") if path else resources.files("models.cfd").joinpath("fan.toml").read_text("utf-8")
        )
        table = tomllib.loads(text)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise ConfigError(f"fan file {name}: cannot be read ({reason})") from None
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"fan file {name}: not TOML ({error})") from None
    unknown = set(table) - set(_SECTIONS)
    if unknown:
        raise ConfigError(f"fan file {name}: unknown section [{min(unknown)}]")
    setup = Setup(**{section: _section(name, section, kind, table) for section, kind in _SECTIONS.items()})
    _check(name, setup)
    return setup


def _section(name: str, section: str, kind: type, table: Mapping[str, Any]) -> Any:
    values = table.get(section)
    if not isinstance(values, dict):
        raise ConfigError(f"fan file {name}: section [{section}] is missing")
    known = {f.name: str(f.type) for f in fields(kind)}
    optional = {f.name for f in fields(kind) if f.default is not MISSING}
    for key in values:
        if key not in known:
            raise ConfigError(f"fan file {name}: [{section}] has an unknown key '{key}'")
    for key in known:
        if key not in values and key not in optional:
            raise ConfigError(f"fan file {name}: [{section}] lacks '{key}'")
    return kind(
        **{
            key: _value(f"fan file {name}: [{section}] {key}", values[key], kind)
            for key, kind in known.items()
            if key in values
        }
    )


def _value(where: str, value: Any, kind: str) -> Any:
    """``value`` as the type named ``kind``. Raises ConfigError that begins with ``where``."""
    if kind == "int" and _whole(value) and value < 1:
        raise ConfigError(f"{where}: must be at least 1, not {value}")
    accepts, convert = _KINDS[kind]
    if not accepts(value):
        raise ConfigError(f"{where}: must be {_WORDS.get(kind, kind)}, not {value!r}")
    return convert(value)


def _list_of(accepts: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, list) and all(accepts(v) for v in value)


def _whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and value == value


def _pair(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(_number(v) for v in value)


_PAIRS = "tuple[tuple[float, float], ...]"
_KINDS: Mapping[str, tuple[Callable[[Any], bool], Callable[[Any], Any]]] = {
    "str": (lambda value: isinstance(value, str), str),
    "float": (_number, float),
    "int": (_whole, int),
    "tuple[int, ...]": (_list_of(lambda v: _whole(v) and v > 0), tuple),
    "tuple[float, ...]": (_list_of(lambda v: _number(v) and v > 0), lambda value: tuple(float(v) for v in value)),
    _PAIRS: (_list_of(_pair), lambda value: tuple((float(h), float(d)) for h, d in value)),
}
"""Type of a field as written in its class: what TOML gives for it, and how it is converted."""
_WORDS = {
    "str": "text",
    "float": "a number",
    "int": "a whole number",
    "tuple[int, ...]": "a list of whole numbers above 0",
    "tuple[float, ...]": "a list of numbers above 0",
    _PAIRS: "a list of [h, d]",
}


def _check(name: str, setup: Setup) -> None:
    """Refuse a geometry that cannot be meshed."""
    fan, rotor, mesh = setup.fan, setup.rotor, setup.mesh

    def need(holds: bool, what: str) -> None:
        if not holds:
            raise ConfigError(f"fan file {name}: {what}")

    need(fan.radius_m > 0, "[fan] radius_m must be positive")
    need(fan.lip_thickness > 0.05, "[fan] lip_radius_m must exceed radius_m by 5 % or more")
    need(0 < fan.hub_radius < 0.9, "[fan] hub_radius must lie between 0 and 0.9")
    need(1.0 <= fan.exit_radius < fan.exit_skin <= fan.lip_radius, "[fan] needs 1 <= exit_radius < exit_skin <= lip")
    need(rotor.stations >= 2 and rotor.blades >= 1 and rotor.chord_m > 0, "[rotor] stations, blades, chord_m too small")
    need(len(rotor.swirl_tip_pitch_deg) == 2, "[rotor] swirl_tip_pitch_deg needs two pitches: upper and lower disc")
    _check_rotors(fan, rotor, need)
    need(len(mesh.duct) == 5 and mesh.duct[1] == mesh.duct[3] == 3, "[mesh] duct needs five counts, 3 for each disc")
    need(setup.air.density_kg_m3 > 0 and setup.air.viscosity_m2_s > 0, "[air] must be positive")
    need(mesh.box > fan.lip_radius + 0.2 and mesh.far > mesh.box + 1, "[mesh] needs lip + 0.2 < box and box + 1 < far")
    need(setup.solver.sample_every <= setup.solver.chunk // 3, "[solver] sample_every must be a third of chunk or less")


def _check_rotors(fan: Fan, rotor: Rotor, need: Callable[[bool, str], None]) -> None:
    """Refuse rotors that cut into the hub, the duct or each other, and a hub that leaves the duct."""
    need(
        fan.exit_height < rotor.lower_height < rotor.lower_height + rotor.thickness < rotor.upper_height,
        "the rotors cut into each other or leave the duct: exit_height < lower disc < upper disc is needed",
    )
    need(rotor.root_radius >= fan.hub_radius, "the rotors cut into the hub: [rotor] root_radius is below hub_radius")
    need(rotor.tip_radius <= 1.0, "the rotors cut into the duct: [rotor] tip_radius is beyond the bore, 1")
    need(rotor.root_radius < rotor.tip_radius - 0.1, "[rotor] root_radius must lie 0.1 or more below tip_radius")
    need(
        rotor.upper_height + rotor.thickness < fan.lip_foot,
        "the rotors cut into the duct: the upper disc must lie below the curved part of the lip",
    )
