"""What the vehicle said last, and which inputs of an offset it has given how long ago."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

from companion.control.lateness import LATE_FADE_S
from companion.invariants.air_evidence import AirEvidence
from companion.mavlink import AUTOPILOT_COMPONENT, NO_AUTOPILOT, samples
from companion.mavlink.range_beams import DOWN, dot, orientation_direction
from companion.mavlink.samples import Sample
from models.vehicle import Vehicle
from models.vehicle.vehicle import NO_ORIENTATION

_SAME_BEAM_COS = 0.98
"""Two beams within 11 degrees look the same way."""
_SAYS_SOMETHING = (samples.RangeVerdict.OK, samples.RangeVerdict.ABOVE_MAX)


@dataclass(kw_only=True)
class Heard:
    """What the vehicle said last, on its boot axis [s]. ``vehicle`` None: only rangefinders as a whole are known."""

    vehicle: Vehicle | None
    heartbeat: samples.Heartbeat | None = None
    beat_us: int = 0
    """When it arrived."""
    now_s: float = -math.inf
    """Stamp of the newest attitude."""
    basis_s: float = -math.inf
    """Stamp of the attitude, or of the upstream setpoint, that the next setpoint answers."""
    upstream: samples.SetAttitudeTarget | None = None
    inputs_s: dict[str, float] = field(default_factory=dict)
    """When each input of an offset was last given."""
    counts: dict[int, int] = field(default_factory=dict)
    """Telemetry packets of each ESC: one that does not count on repeats an old value."""
    counting: set[int] = field(default_factory=set)
    """ESCs whose counter is known to move: some never do."""
    air: AirEvidence = field(default_factory=AirEvidence)

    def take(self, sample: Sample, arrival_us: int) -> None:
        """One more message."""
        match sample:
            case samples.Heartbeat() if (
                sample.component == AUTOPILOT_COMPONENT and sample.autopilot != NO_AUTOPILOT
            ):
                self.heartbeat = sample
                self.beat_us = arrival_us
            case samples.LandedState():
                self.air.landed_state = sample.landed_state
            case samples.Attitude():
                self.now_s = sample.t_s
                self.basis_s = sample.t_s
                self.inputs_s["attitude"] = sample.t_s
                if sample.late_s <= LATE_FADE_S:
                    self.inputs_s["timely telemetry"] = sample.t_s
            case samples.LocalPosition():
                self.inputs_s["position"] = sample.t_s
            case samples.SetAttitudeTarget():
                self.upstream = sample
                self.basis_s = sample.t_s
            case samples.Range() if sample.verdict in _SAYS_SOMETHING:
                self._take_range(sample)
            case samples.Ring() if any(not math.isnan(distance) for distance in sample.distances_m):
                self.inputs_s[f"rangefinder {NO_ORIENTATION}"] = sample.t_s
                self.inputs_s["rangefinders"] = sample.t_s
            case samples.RotorSpeeds():
                self.air.hear_rotors(sample)
                for name in self._rotors(sample):
                    self.inputs_s[name] = sample.t_s
            case samples.ServoOutput():
                self.inputs_s["servo outputs"] = sample.t_s

    def _take_range(self, sample: samples.Range) -> None:
        for name in self._beams(sample):
            self.inputs_s[name] = sample.t_s
        direction = sample.direction_frd
        if sample.verdict is not samples.RangeVerdict.OK or direction is None:
            return
        if dot(direction, DOWN) > _SAME_BEAM_COS:
            self.air.hear_range(sample.distance_m)

    def _beams(self, sample: samples.Range) -> Iterator[str]:
        """Names of the inputs that a range gives."""
        yield "rangefinders"
        if self.vehicle is None or sample.direction_frd is None:
            return
        for sensor in self.vehicle.rangefinders:
            beam = orientation_direction(sensor.orientation)
            if beam is not None and dot(beam, sample.direction_frd) > _SAME_BEAM_COS:
                yield f"rangefinder {sensor.orientation}"

    def _rotors(self, sample: samples.RotorSpeeds) -> Iterator[str]:
        """The same of rotor speeds."""
        yield "rotor speeds"
        counts = sample.count or (None,) * len(sample.rpm)
        for esc, (rpm, count) in enumerate(zip(sample.rpm, counts, strict=True), sample.first_esc):
            before = self.counts.get(esc)
            if before is not None and before != count:
                self.counting.add(esc)
            if count is not None:
                self.counts[esc] = count
            repeated = count is not None and before == count and esc in self.counting
            if math.isfinite(rpm) and not repeated:
                yield f"rotor speed {esc}"


def needed_inputs(vehicle: Vehicle | None, hold: bool) -> tuple[str, ...]:
    """Names of what an offset needs."""
    out = ["attitude", "timely telemetry", *(["position"] if hold else [])]
    if vehicle is None:
        return (*out, "rangefinders")
    out += [
        f"rangefinder {r.orientation}"
        for r in vehicle.rangefinders
        if r.target in ("ground", "wall")
    ]
    if not vehicle.telemetered:
        return (*out, "servo outputs")
    return (*out, *(f"rotor speed {rotor.esc}" for rotor in vehicle.rotors))
