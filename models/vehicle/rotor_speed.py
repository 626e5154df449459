"""Which rotor speeds can carry a multirotor: by its battery, mass and propellers.

T/A = C_T rho (Omega R)^2 of a rotor. Real multirotors fill narrow ranges of T/A and of speed times voltage. Speeds that
miss a range were read in another unit, or with another number of poles: ESCs count electrical turns, one for every pair
of magnets.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from models.common.frames import GRAVITY
from models.vehicle import RHO_SEA_LEVEL
from models.vehicle.estimate import OPEN_ROTOR_CT

DISC_LOADING = (20.0, 350.0)
"""Weight over disc area of all places [N/m^2]: 18-inch quadrotors for endurance 24, small and camera quadrotors 40 to
100, agricultural ones 150 to 180, coaxial lifters for film cameras 345."""
RPM_TIMES_VOLTS = (25_000.0, 400_000.0)
"""Rotor speed in hover times battery voltage: 54 inches at 52 V 5e4, Crazyflie 6e4, camera quadrotors 7 to 10e4, racing
quadrotors 1.8 to 2.8e5; eight measured and simulated vehicles 4.6 to 9.8e4. A motor is wound for its voltage: its speed
per volt goes with one over that."""
CT = (0.006, 0.03)
"""C_T of open propellers of any pitch, and of coaxial pairs."""
USUAL_LOADING = 70.0
USUAL_RPM_VOLTS = 1e5
"""In the middle of the ranges."""
POLE_PARAMETERS = ("SERVO_BLH_POLES", "MOT_POLE_COUNT", "DSHOT_MOT_POL1")
"""ArduPilot's, and PX4's before and since 1.17."""
USUAL_POLES = 14
"""Default of these parameters, and the count of most motors."""
POLES = (2, 12, 14, 22, 24, 28, 36, 40, 42)
"""Counts of motors for multirotors."""
UNITS = (0.01, 0.1, 10.0, 60.0, 100.0)
"""What a speed may have to be multiplied by: units of 10 or 100 rpm, tenths, turns a second."""
NAMED = 2
"""So many explanations are named."""


@dataclass(frozen=True, kw_only=True)
class Hover:
    """What is known of a hovering multirotor besides its rotor speed; NaN is unknown."""

    rotors: int
    places: int
    """Of rotors: coaxial pairs share one."""
    voltage_v: float = math.nan
    mass_kg: float = math.nan
    radius_m: float = math.nan
    radius_spread: float = 1.0
    """Factor by which the radius may be wrong."""


@dataclass(frozen=True)
class Range:
    """Rotor speeds [rpm] that are possible, the usual one, and by what."""

    low: float
    usual: float
    high: float
    basis: str


def possible_speeds(hover: Hover) -> Iterator[Range]:
    """What each number that is known allows."""
    if hover.voltage_v > 0.0:
        low, high = (limit / hover.voltage_v for limit in RPM_TIMES_VOLTS)
        usual = USUAL_RPM_VOLTS / hover.voltage_v
        yield Range(low, usual, high, f"turns propellers on a battery of {hover.voltage_v:.3g} V")
    if hover.mass_kg > 0.0 and hover.radius_m > 0.0:
        low, usual, high = (_by_coefficient(hover, ct) for ct in (CT[1], OPEN_ROTOR_CT, CT[0]))
        yield Range(low, usual, high, f"carries {hover.mass_kg:.3g} kg with such propellers")
    elif hover.mass_kg > 0.0:
        low, usual, high = (_by_mass(hover, loading) for loading in _loadings())
        yield Range(low, usual, high, f"carries {hover.mass_kg:.3g} kg")
    elif hover.radius_m > 0.0:
        low, usual, high = (_rpm(loading, hover, hover.radius_m) for loading in _loadings())
        spread = hover.radius_spread
        yield Range(low / spread, usual, high * spread, "turns such propellers")


def misread(rpm: float, hover: Hover, parameters: Mapping[str, float]) -> str | None:
    """What is wrong with a median speed in hover [rpm] in words, and what would explain it; None where it may be."""
    ranges = list(possible_speeds(hover))
    wrong = [r for r in ranges if not r.low <= rpm <= r.high]
    if not wrong or not rpm > 0.0:
        return None
    worst = max(wrong, key=lambda r: abs(math.log(rpm / r.usual)))
    fits = _explanations(rpm, ranges, worst, parameters)
    if fits:
        share = 1.0 / fits[0][0]
    else:
        share = rpm / worst.usual
    named = " or ".join(text for _, text in fits[:NAMED])
    what = f"rotor speeds of {rpm:.0f} rpm are {share:.2g} of what {worst.basis}"
    advice = f"pole count ({', '.join(POLE_PARAMETERS[:2])}) or unit"
    if named:
        return f"{what}: {advice}; {named} would fit"
    return f"{what}: {advice}"


def _explanations(
    rpm: float, ranges: list[Range], worst: Range, parameters: Mapping[str, float]
) -> list[tuple[float, str]]:
    """Factors that make a possible speed of ``rpm`` and what they mean: usual mistakes, then those that fit best."""
    declared = [parameters[name] for name in POLE_PARAMETERS if parameters.get(name, 0.0) > 0.0]
    if declared:
        poles = int(declared[0])
    else:
        poles = USUAL_POLES
    usual = (0.1, 10.0, 2.0 / USUAL_POLES, poles / 2.0)
    factors = {unit: _unit_text(unit) for unit in UNITS}
    for count in POLES[1:]:
        factors.setdefault(2.0 / count, f"electrical speed (eRPM) of {count} poles")
    for count in POLES:
        factors.setdefault(poles / count, f"{count} poles instead of {poles}")
    known = []
    for f, text in factors.items():
        if all(r.low <= rpm * f <= r.high for r in ranges):
            known.append((f, text))
    by_fit = sorted(known, key=lambda item: abs(math.log(rpm * item[0] / worst.usual)))
    return sorted(by_fit, key=lambda item: item[0] not in usual)


def _unit_text(unit: float) -> str:
    if unit == 60.0:
        return "turns a second"
    return f"units of {unit:g} rpm"


def _loadings() -> tuple[float, float, float]:
    low, high = DISC_LOADING
    return (low, USUAL_LOADING, high)


def _rpm(loading: float, hover: Hover, radius_m: float) -> float:
    """Rotor speed [rpm] at a weight over the area of all places [N/m^2]."""
    per_rotor = loading * hover.places / hover.rotors
    tip = math.sqrt(per_rotor / (OPEN_ROTOR_CT * RHO_SEA_LEVEL))
    return 60.0 / (2.0 * math.pi) * tip / radius_m


def _by_mass(hover: Hover, loading: float) -> float:
    area = hover.mass_kg * GRAVITY / loading / hover.places
    return _rpm(loading, hover, math.sqrt(area / math.pi))


def _by_coefficient(hover: Hover, ct: float) -> float:
    thrust = hover.mass_kg * GRAVITY / hover.rotors
    area = math.pi * hover.radius_m**2
    tip = math.sqrt(thrust / (ct * RHO_SEA_LEVEL * area))
    return 60.0 / (2.0 * math.pi) * tip / hover.radius_m
