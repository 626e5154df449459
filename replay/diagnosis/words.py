"""Axes, channels and numbers of a diagnosis in the words of a pilot."""

from __future__ import annotations

import math
import re

from models.effects import BelongsTo, Effect, InFlight
from replay.search.curves import CarryingChannel
from replay.search.estimates import IntervalEstimate
from replay.search.least_visible import Visible
from replay.search.results import Found

AXIS_WORDS = (
    "force forward",
    "force to the right",
    "force down",
    "roll moment",
    "pitch moment",
    "yaw moment",
)
"""Fx Fy Fz Mx My Mz, body FRD."""
_CHANNELS = {
    "time_s": "time [s]",
    "north_m": "position north [m]",
    "east_m": "position east [m]",
    "down_m": "position down [m]",
    "vn_m_s": "speed north [m/s]",
    "ve_m_s": "speed east [m/s]",
    "vd_m_s": "speed down [m/s]",
    "roll_rad": "roll angle [rad]",
    "pitch_rad": "pitch angle [rad]",
    "yaw_rad": "heading [rad]",
    "p_rad_s": "roll rate [rad/s]",
    "q_rad_s": "pitch rate [rad/s]",
    "r_rad_s": "yaw rate [rad/s]",
    "ax_m_s2": "acceleration forward [m/s²]",
    "ay_m_s2": "acceleration to the right [m/s²]",
    "az_m_s2": "acceleration down [m/s²]",
    "thrust_command": "thrust command [0 to 1]",
    "battery_voltage_v": "battery voltage [V]",
    "battery_current_a": "battery current [A]",
    "esc_temperature_c": "ESC temperature [°C]",
    "pressure_pa": "air pressure [Pa]",
    "air_temperature_c": "air temperature [°C]",
}
_CAPITALS = {"imu": "IMU", "cg": "CG", "esc": "ESC"}
_NUMBERED = {"rpm": "speed of ESC {} [rpm]", "servo": "servo output {} [µs]"}
_OF_ONE_FLIGHT = {BelongsTo.WEATHER: "the weather", BelongsTo.LOAD: "the battery and the load"}
_UNITS = {
    "weight": "of the weight",
    "weight m": "of the weight times 1 m",
    "N m": "N m",
    "m/s^2": "m/s²",
    "kg m^2": "kg m²",
    "degC": "°C",
    "1": "",
}


def channel_words(name: str) -> str:
    """``az_m_s2`` as ``acceleration down [m/s²]``; a name that is not known as it is, with spaces."""
    if name in _CHANNELS:
        return _CHANNELS[name]
    numbered = re.fullmatch(r"(rpm|servo)_(\d+)", name)
    if numbered:
        return _NUMBERED[numbered[1]].format(numbered[2])
    ranged = re.fullmatch(r"range_(\w+)_m", name)
    if ranged:
        return f"range {ranged[1]} [m]"
    return plain(name)


def carrier_words(carrier: CarryingChannel, name: str) -> str:
    """A channel, by its ``name`` for the reader, and what the force does in time where it follows time alone."""
    if carrier.course is None:
        return name
    return f"{name}, {carrier.course.in_words}"


def plain(name: str) -> str:
    """A name of the JSON with spaces, and what is said in capitals."""
    return " ".join(_CAPITALS.get(word, word) for word in name.split("_"))


def parameter_words(name: str) -> str:
    """The name of a parameter with spaces, less its unit, which stands beside its size."""
    return plain(re.sub(r"_(kg|m|s|v)$", "", name))


def listed(names: list[str]) -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def unit_words(unit: str) -> str:
    """A unit as printed; a plain number has none."""
    return _UNITS.get(unit, unit)


def size_text(value: float) -> str:
    """Three digits, without a power of ten: moments of a small vehicle are millionths of N m."""
    if not math.isfinite(value) or value == 0.0:
        return "0"
    digits = 2 - math.floor(math.log10(abs(value)))
    return f"{value:.{max(digits, 0)}f}"


def estimate_text(e: IntervalEstimate) -> str:
    """``mass_kg = 0.42 [0.38, 0.46] kg``, or ``scale not determined [-0.2, 0.7]``."""
    digits = _digits(e)
    if e.ci95 is None:
        interval = ""
    else:
        interval = f" [{e.ci95[0]:.{digits}g}, {e.ci95[1]:.{digits}g}]"
    unit = f" {unit_words(e.unit)}".rstrip()
    if e.determined:
        size = f"= {e.value:.{digits}g}"
    else:
        size = "not determined"
    if e.at_bound:
        bound = " (at its bound)"
    else:
        bound = ""
    return f"{e.name} {size}{interval}{unit}{bound}"


def _digits(e: IntervalEstimate) -> int:
    """Three, or as many as it takes to tell the ends of the interval apart."""
    if e.ci95 is None or e.ci95[1] <= e.ci95[0]:
        return 3
    largest = max(abs(end) for end in e.ci95)
    return max(3, math.ceil(math.log10(largest / (e.ci95[1] - e.ci95[0]))) + 1)


def least_text(v: Visible) -> str:
    """``mass_kg 0.15 kg``: the smallest size that would have been seen."""
    return f"{v.coefficient} {v.least:.2g} {unit_words(v.unit)}".rstrip()


def explains_text(share: float) -> str:
    """``explains 12 %``; what rounds to nothing is said as that."""
    if share < 0.005:
        return "explains less than 1 %"
    return f"explains {share:.0%}"


def class_text(f: Found) -> str:
    """A class that cannot be told apart, in one sentence."""
    members = [f"{plain(name)} {p:.2g}" for name, p in f.members]
    return f"{f.push}: {', or '.join(members)}; to know which: {f.decided_by}"


def kept_words(effect: Effect, *, ended: bool = False) -> str:
    """What an amended model keeps of an effect, and what not."""
    gone = [plain(c.name) for c in effect.coefficients if effect.of_day(c)]
    left = [plain(c.name) for c in effect.coefficients if not effect.of_day(c)]
    source = _OF_ONE_FLIGHT.get(effect.belongs_to, "one flight")
    if ended and effect.kept:
        return "not kept: it ended in this flight"
    if not effect.kept:
        if effect.stays is not None:
            left = [
                "what of it is the vehicle's, as "
                f"{listed([plain(name) for name in effect.contains])}"
            ]
        if left:
            rest = f"; the amended model keeps {listed(left)}"
        else:
            rest = ""
        return f"not kept: it belongs to {source}, and the next flight starts without it{rest}"
    if effect.belongs_to is BelongsTo.INSTRUMENT:
        if effect.in_flight.use is InFlight.MEASUREMENT:
            corrects = "corrects what this sensor reads"
        else:
            corrects = "corrects its logs"
        return f"kept for this sensor: it {corrects}"
    if effect.belongs_to is BelongsTo.PLACE:
        return "kept: it acts only where a range shows such a place"
    return "kept: it belongs to the vehicle" + (
        f"; of this flight only, not kept: {listed(gone)}" if gone else ""
    )
