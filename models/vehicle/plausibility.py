"""Whether a vehicle file describes a vehicle that can fly: what cannot be is refused, what is odd is said.

The one place for it. ``load_vehicle`` refuses on errors, so every command that reads a vehicle file does; the warnings
are for the command to print (``warnings``).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

from models.common.frames import GRAVITY
from models.vehicle.vehicle import RHO_SEA_LEVEL, Vehicle

_DISC_LOADING_N_M2 = (3.0, 3000.0)
"""Weight over disc area. Crazyflie 40, camera quadrotors 50 to 100, ducted fans 250, electric jets 1500 N/m^2."""
_TIP_SPEED_M_S = (8.0, 320.0)
"""Of the hover that ``ct`` implies; the upper end is just below the speed of sound. Drones 50 to 150."""
_GYRATION_OVER_REACH = 1.0
"""sqrt(I/m) over the vehicle's reach: 0.2 to 0.5 is usual; at 1 all mass would sit at the outermost lips."""
_SMALL_GYRATION = 0.05
"""The same ratio below which the inertia was probably given in another unit."""
_SAME_HEIGHT_M = 0.03
"""Fans closer in height than this lie in one plane: the thickness of a rotor with its motor."""
_SAME_PLACE_M = 0.01
"""Fans nearer than this are one place: below the accuracy of a tape measure."""
_TOUCHING = 0.98
"""Share of the sum of the lip radii at which fans touch; less is an overlap, the rest is rounding in the file."""
_OFF_CENTRE = 0.25
"""Distance of the fans' centre from the CG over the reach, above which hover needs very unequal thrusts."""
_THRUST_TO_WEIGHT = (1.1, 1.3)
"""Below the first it cannot fly, below the second hardly."""
_UPSIDE_M = 0.02
"""How far above its fan a vane must lie before the sign of z is in doubt."""
_SENSOR_ABOVE_M = 0.005
"""The same for a down-looking sensor above all rotors."""
_DIRECTIONS = {24: "up", 25: "down", **dict.fromkeys(range(8), "to the side")}
"""MAV_SENSOR_ORIENTATION: PITCH_90, PITCH_270, and the eight yaw angles in steps of 45 deg."""
_SEEN = {
    "down": ("ground", "ground: 25 looks down"),
    "up": ("ceiling", "ceiling: 24 looks up"),
    "to the side": ("wall", "a wall: 0 looks ahead"),
}
"""Direction of a rangefinder, what it sees there, and what is usual for that."""
_HOVER_LIFT_OFF = 0.5
"""``hover_thrust`` contradicts ``[throttle]`` where it lifts more or less than the weight by this share."""
_GONE_S = 0.2
"""A full offset is to be gone so long after a sensor was found lost."""


class Finding(NamedTuple):
    """One thing that is odd: the key it is about, what is odd, with what would be usual, and whether it refuses."""

    key: str
    text: str
    refused: bool = False


Check = tuple[bool, Finding]
"""Whether something is odd, and what."""


def findings(vehicle: Vehicle) -> Iterator[Finding]:
    """Everything that is odd about ``vehicle``."""
    for checks in (
        _assumed,
        _masses,
        _places,
        _spins,
        _rotor_speed,
        _throttle,
        _ranges,
        _vertical,
        _slews,
    ):
        yield from (finding for odd, finding in checks(vehicle) if odd)


def warnings(vehicle: Vehicle) -> list[str]:
    """The findings that do not refuse the vehicle, one line each."""
    return [f"key '{f.key}': {f.text}" for f in findings(vehicle) if not f.refused]


def _error(key: str, text: str) -> Finding:
    return Finding(key, text, True)


def _reach(vehicle: Vehicle) -> float:
    return max(math.hypot(*fan.position_m) + fan.lip_radius_m for fan in vehicle.fans)


def _assumed(vehicle: Vehicle) -> Iterator[Check]:
    text = f"{', '.join(vehicle.assumed)}: typical numbers, not those of this vehicle"
    yield bool(vehicle.assumed), Finding("assumed", text)


def _masses(vehicle: Vehicle) -> Iterator[Check]:
    low, high = _DISC_LOADING_N_M2
    loading = vehicle.mass_kg * GRAVITY / (len(vehicle.fans) * vehicle.disc_area_m2)
    text = (
        f"{vehicle.mass_kg:g} kg on {len(vehicle.fans)} discs of radius "
        f"{vehicle.rotor_radius_m:g} m is {loading:.3g} N per m^2 of disc, and rotors carry "
        f"{low:g} to {high:g}: check mass_kg and rotor_radius_m"
    )
    yield not low <= loading <= high, _error("mass_kg", text)
    gyration = math.sqrt(max(vehicle.inertia_kgm2) / vehicle.mass_kg)
    reach = _reach(vehicle)
    text = (
        f"{max(vehicle.inertia_kgm2):g} kg m^2 needs all {vehicle.mass_kg:g} kg to sit "
        f"{gyration:.2f} m from the CG, and the vehicle reaches {reach:.2f} m"
    )
    yield gyration > _GYRATION_OVER_REACH * reach, _error("inertia_kgm2", text)
    text = f"is very small for {vehicle.mass_kg:g} kg over {reach:.2f} m: in kg m^2?"
    yield gyration < _SMALL_GYRATION * reach, Finding("inertia_kgm2", text)


def _places(vehicle: Vehicle) -> Iterator[Check]:
    for (i, a), (j, b) in combinations(enumerate(vehicle.fans, 1), 2):
        apart = math.dist(a.position_m[:2], b.position_m[:2])
        if abs(a.position_m[2] - b.position_m[2]) >= _SAME_HEIGHT_M:
            continue  # rotors above each other may overlap
        text = f"is the place of fan[{i}]: two fans cannot be in one place"
        yield apart < _SAME_PLACE_M, _error(f"fan[{j}].position_m", text)
        text = (
            f"fan[{i}] and fan[{j}] are {apart:.3g} m apart and overlap with lips of "
            f"{a.lip_radius_m:g} and {b.lip_radius_m:g} m: is a diameter given for a radius?"
        )
        yield (
            apart < _TOUCHING * (a.lip_radius_m + b.lip_radius_m),
            _error(f"fan[{j}].lip_radius_m", text),
        )
    off = math.hypot(
        *(sum(fan.position_m[k] for fan in vehicle.fans) / len(vehicle.fans) for k in (0, 1))
    )
    text = f"the fans' centre is {off:.2f} m from the CG: positions are from the CG, body FRD"
    yield off > _OFF_CENTRE * _reach(vehicle), Finding("fan.position_m", text)


def _spins(vehicle: Vehicle) -> Iterator[Check]:
    spins = [rotor.spin for rotor in vehicle.rotors]
    if len(spins) < 2 or vehicle.vanes:
        return
    # A tricopter balances it with a servo at the tail, which the file cannot say.
    alike = Finding(
        "fan.rotors.spin",
        "all rotors turn the same way: nothing balances their torque",
        refused=len(spins) != 3,
    )
    yield abs(sum(spins)) == len(spins), alike
    text = f"{spins.count(1)} rotors turn cw and {spins.count(-1)} ccw"
    yield len(spins) % 2 == 0 and 0 < abs(sum(spins)) < len(spins), Finding("fan.rotors.spin", text)


def _rotor_speed(vehicle: Vehicle) -> Iterator[Check]:
    low, high = _TIP_SPEED_M_S
    share = vehicle.mass_kg * GRAVITY / len(vehicle.fans)
    for i, fan in enumerate(vehicle.fans, 1):
        if fan.ct is not None:
            tip = math.sqrt(share / (fan.ct * RHO_SEA_LEVEL * vehicle.disc_area_m2))
            text = (
                f"{fan.ct:g} means a hover with blade tips at {tip:.3g} m/s, and they move at "
                f"{low:g} to {high:g}: C_T is T/(rho A Omega^2 R^2) of the whole fan"
            )
            yield not low <= tip <= high, _error(f"fan[{i}].ct", text)


def _throttle(vehicle: Vehicle) -> Iterator[Check]:
    throttle = vehicle.throttle
    if throttle is None:
        return
    impossible, hard = _THRUST_TO_WEIGHT
    ratio = throttle.max_thrust_n * len(vehicle.rotors) / (vehicle.mass_kg * GRAVITY)
    text = f"all rotors at full throttle lift {ratio:.2g} of the weight"
    yield ratio < hard, Finding("throttle.max_thrust_n", text, refused=ratio < impossible)
    e = throttle.expo
    u = vehicle.hover_thrust
    lift = ratio * ((1.0 - e) * u + e * u * u)
    text = f"{u:g} lifts {lift:.2g} of the weight by [throttle]"
    yield ratio >= impossible and abs(lift - 1.0) > _HOVER_LIFT_OFF, Finding("hover_thrust", text)


def _ranges(vehicle: Vehicle) -> Iterator[Check]:
    text = "none is declared: nothing is known of ground and wall, no offset will be given"
    yield not vehicle.rangefinders, Finding("rangefinder", text)
    for i, sensor in enumerate(vehicle.rangefinders, 1):
        looks = _DIRECTIONS.get(sensor.orientation)
        usual = dict(_SEEN.values()).get(sensor.target)
        odd = (
            looks is not None
            and usual is not None
            and target_of(sensor.orientation) != sensor.target
        )
        text = f"{sensor.orientation} looks {looks}, and the target is {usual}"
        yield odd, _error(f"rangefinder[{i}].orientation", text)
    blind = bool(vehicle.rangefinders) and not vehicle.rangefinders_for("ground")
    yield blind, Finding("rangefinder", "none looks at the ground: its effect is not compensated")


def target_of(orientation: int) -> str:
    """What a rangefinder of this MAV_SENSOR_ORIENTATION looks at, as a rule; ``none`` where it is inclined."""
    if orientation in _DIRECTIONS:
        return _SEEN[_DIRECTIONS[orientation]][0]
    return "none"


def _vertical(vehicle: Vehicle) -> Iterator[Check]:
    """z is positive down: exhaust vanes lie below their fan, a down-looking sensor not above all rotors."""
    for i, vane in enumerate(vehicle.vanes, 1):
        above = vane.position_m[2] < vehicle.fans[vane.fan - 1].position_m[2] - _UPSIDE_M
        text = "is above its fan, and exhaust leaves below: z is positive down"
        yield above, _error(f"vane[{i}].position_m", text)
    top = min(fan.position_m[2] for fan in vehicle.fans)
    for i, sensor in enumerate(vehicle.rangefinders, 1):
        above = sensor.target == "ground" and sensor.position_m[2] < top - _SENSOR_ABOVE_M
        text = "looks down from above the rotors: z is positive down; is a sign flipped?"
        yield above, Finding(f"rangefinder[{i}].position_m", text)


def _slews(vehicle: Vehicle) -> Iterator[Check]:
    limits = vehicle.limits
    for most, rate, key in (
        (limits.thrust, limits.slew_thrust_per_s, "slew_thrust_per_s"),
        (limits.tilt_deg, limits.slew_tilt_deg_per_s, "slew_tilt_deg_per_s"),
    ):
        text = (
            f"{rate:g} takes {most / rate:.2g} s to take back a full offset: after a lost sensor "
            f"offsets are to be gone within {_GONE_S:g} s"
        )
        yield most / rate > _GONE_S * (1.0 + 1e-9), Finding(f"limits.{key}", text)
