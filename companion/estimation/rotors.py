"""Speeds of the rotors: which message moves which track, and what is no speed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from functools import lru_cache

import numpy as np

from companion.config import PipelineConfig
from companion.estimation.estimates import Estimates, Packets
from companion.estimation.kalman import Track, TrackModel, measure
from companion.mavlink.samples import RotorSpeeds, ServoOutput
from models.common.frozen_copy import with_changes
from models.vehicle import Vehicle
from models.vehicle_wrench import rpm_from_servos

ROTOR_AGE_S = 0.22
"""An older speed is stale, as a range is."""
_TRACK = TrackModel(
    acceleration_sd=6000.0, initial_rate_sd=2000.0, gate=25.0, restart_after=3, agree_within=400.0
)
_DELAY_S = 0.03
"""Age of a speed when it is stamped (a sensor's own averaging)."""
_SIGMA_RPM = 15.0
_STOPPED_RPM = 100.0
"""A zero, and what an ESC reports of a rotor that coasts: a tenth of the slowest idle speeds."""
_SPINNING_RPM = 500.0
"""Half of the slowest idle speeds; no rotor lifts anything below it."""
_SPUN_S = 1.0
"""A rotor that turned this short ago still does: none stops faster by itself."""
_SOUND_M_S = 340.0
"""Blade tips are never faster: such a speed is no speed but a damaged or saturated number."""


def take_rotors(estimates: Estimates, sample: RotorSpeeds, config: PipelineConfig) -> Estimates:
    """Speeds by ESC number.

    A zero of a rotor that was spinning, or while others spin, is a lost frame, not a stopped rotor. Telemetry that
    counts its packets and does not count on repeats an old value. Blade tips beyond the speed of sound are no speed.
    """
    vehicle = config.vehicle
    first = sample.first_esc
    spinning = [first + k for k, rpm in enumerate(sample.rpm) if abs(rpm) > _SPINNING_RPM]
    places = _rotor_places(vehicle)
    some_spin = any(esc in places for esc in spinning)
    packets, repeated = _counted(estimates, sample)
    fastest_rpm = _SOUND_M_S / vehicle.rotor_radius_m * 30.0 / math.pi
    rotors = list(estimates.rotors)
    for slot, signed_rpm in enumerate(sample.rpm):
        rpm = abs(signed_rpm)
        if repeated[slot] or rpm > fastest_rpm:
            continue
        for k in places.get(first + slot, ()):
            if rpm >= _STOPPED_RPM or not (some_spin or _spun(rotors[k], sample.t_s)):
                rotors[k], _ = measure(rotors[k], _TRACK, sample.t_s, rpm, _SIGMA_RPM, _DELAY_S)
    undeclared = vehicle.telemetered and any(esc not in places for esc in spinning)
    if undeclared:
        undeclared_s = sample.t_s
    else:
        undeclared_s = estimates.undeclared_s
    estimates = with_changes(
        estimates, rotors=tuple(rotors), packets=packets, undeclared_s=undeclared_s
    )
    return take_temperatures(estimates, sample.temperature_c)


@lru_cache(maxsize=4)
def _rotor_places(vehicle: Vehicle) -> dict[int, list[int]]:
    """Places in ``vehicle.rotors`` by ESC number."""
    places: dict[int, list[int]] = {}
    for place, rotor in enumerate(vehicle.rotors):
        if rotor.esc is not None:
            places.setdefault(rotor.esc, []).append(place)
    return places


def _spun(track: Track | None, t_s: float) -> bool:
    """Whether a rotor turned within the last second."""
    return track is not None and track.value > _SPINNING_RPM and track.age(t_s) < _SPUN_S


def _counted(estimates: Estimates, sample: RotorSpeeds) -> tuple[Mapping[int, Packets], list[bool]]:
    """Packets so far, and which places of ``sample`` repeat an old value: of counters that are known to count."""
    if sample.count is None:
        return estimates.packets, [False] * len(sample.rpm)
    counts = dict(estimates.packets)
    repeated = []
    for k, count in enumerate(sample.count):
        before = counts.get(sample.first_esc + k)
        moves = before is not None and (before.moves or count != before.count)
        repeated.append(moves and before is not None and count == before.count)
        counts[sample.first_esc + k] = Packets(count, moves)
    return counts, repeated


def take_servo(estimates: Estimates, sample: ServoOutput, config: PipelineConfig) -> Estimates:
    """Servo outputs: vanes, and rotor speeds where none is telemetered."""
    if config.vehicle.telemetered:
        return with_changes(estimates, servo=sample)
    rpm = rpm_from_servos(config.vehicle, config.model, np.asarray(sample.pwm_us, dtype=float))
    return with_changes(estimates, servo=sample, servo_rpm=tuple(rpm.tolist()))


def take_temperatures(estimates: Estimates, celsius: Iterable[float]) -> Estimates:
    """The hottest ESC; places that read NaN are left out."""
    known = [t for t in celsius if math.isfinite(t)]
    if known:
        return with_changes(estimates, esc_temperature_c=max(known))
    return estimates


def rotor_speeds(
    estimates: Estimates, config: PipelineConfig, t_s: float
) -> tuple[float, ...] | None:
    """Rotor speeds [rpm], of every rotor, at ``t_s``, or None where any is missing or too old."""
    if not config.vehicle.telemetered:
        fresh = estimates.servo is not None and t_s - estimates.servo.t_s <= ROTOR_AGE_S
        if fresh:
            return estimates.servo_rpm
        return None
    out = []
    for track in estimates.rotors:
        if track is None or track.age(t_s) > ROTOR_AGE_S:
            return None
        # A speed changes within tens of ms: between messages hold the value rather than extrapolate its slope.
        out.append(max(track.value, 0.0))
    return tuple(out)
