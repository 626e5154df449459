"""Which vehicle of a .tlog is read: what its systems did is counted stretch by stretch, then one is chosen."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from companion.mavlink.dialect import mavlink
from companion.mavlink.sample_builders import parameter_value
from models.errors import LogError
from replay.logs.tlog import AUTOPILOT, GROUND_STATION, Tlog

_MOTION = (27, 30, 31, 32, 105)
"""RAW_IMU, ATTITUDE, ATTITUDE_QUATERNION, LOCAL_POSITION_NED, HIGHRES_IMU."""
_SPEEDS = (*range(11030, 11033), *range(11040, 11045), 291)
"""ESC_TELEMETRY_1_TO_4 ... 29_TO_32, ESC_STATUS."""
_SERVOS, _IDLE_US = 36, 30
"""SERVO_OUTPUT_RAW; outputs that never move by more than 30 us, of some 1000, drive nothing."""
_SERVO_COUNT = 8
_PARAM_VALUE = 22


@dataclass
class _System:
    """What one system did."""

    autopilot: bool = False
    """Its component 1 sent HEARTBEAT with an autopilot."""
    armed_at: int | None = None
    """Number of the frame, from 0, that first said so."""
    speeds_sent: bool = False
    turned: bool = False
    """A rotor speed above 0."""
    servo_low: int | NDArray[np.int64] = 1 << 16
    servo_high: int | NDArray[np.int64] = -1
    motion: int = 0
    """Frames that tell of motion."""

    @property
    def flies(self) -> bool:
        """Whether it was armed at some time and its rotors turned: by their speeds, or by servo outputs that moved."""
        if self.armed_at is None:
            return False
        if self.speeds_sent:
            return self.turned
        return bool(np.any(self.servo_high - self.servo_low > _IDLE_US))


class Census:
    """Everything that the choice of a vehicle depends on, of a whole file; parameters too, which are of every boot."""

    def __init__(self) -> None:
        self._systems: defaultdict[int, _System] = defaultdict(_System)
        self._parameters: defaultdict[tuple[int, int], dict[str, float]] = defaultdict(dict)
        self.counts: Counter[tuple[int, int, int]] = Counter()
        """Frames by (system, component, message id)."""

    def add(self, log: Tlog) -> None:
        """Count a stretch of the file; stretches come in file order."""
        before = self.counts.total()
        self.counts.update(log.counts())
        beats = log.indices(0)
        beats = beats[log.component[beats] == AUTOPILOT]
        records = log.records(0, beats)
        for number in np.unique(log.system[beats]).tolist():
            own = log.system[beats] == number
            one = self._systems[number]
            one.autopilot |= bool((records["autopilot"][own] != mavlink.MAV_AUTOPILOT_INVALID).any())
            armed = beats[own & (records["base_mode"] & mavlink.MAV_MODE_FLAG_SAFETY_ARMED).astype(bool)]
            if one.armed_at is None and armed.size:
                one.armed_at = before + int(armed[0])
        motion = np.isin(log.message_id, _MOTION) & (log.component == AUTOPILOT)
        for number in np.unique(log.system[motion]).tolist():
            self._systems[number].motion += int((log.system[motion] == number).sum())
        self._add_rotors(log)
        self._add_parameters(log)

    def _add_rotors(self, log: Tlog) -> None:
        for message in _SPEEDS:
            index = log.indices(message)
            rpm = log.records(message, index)["rpm"] if index.size else None
            for number in np.unique(log.system[index]).tolist():
                one = self._systems[number]
                one.speeds_sent = True
                one.turned |= rpm is not None and bool(rpm[log.system[index] == number].any())
        index = log.indices(_SERVOS)
        outputs = log.records(_SERVOS, index)
        for number in np.unique(log.system[index]).tolist():
            one, own = self._systems[number], outputs[log.system[index] == number]
            values = np.stack([own[f"servo{k + 1}_raw"] for k in range(_SERVO_COUNT)]).astype(np.int64)
            one.servo_low = np.minimum(one.servo_low, values.min(axis=1))
            one.servo_high = np.maximum(one.servo_high, values.max(axis=1))

    def _add_parameters(self, log: Tlog) -> None:
        index = log.indices(_PARAM_VALUE)
        records = log.records(_PARAM_VALUE, index)
        for system, component, record in zip(
            log.system[index].tolist(), log.component[index].tolist(), records, strict=True
        ):
            if component not in (AUTOPILOT, GROUND_STATION):
                continue
            number = parameter_value(float(record["param_value"]), int(record["param_type"]))
            if math.isfinite(number):
                name = bytes(record["param_id"]).split(b"\0")[0].decode("ascii", "replace")
                self._parameters[system if component == AUTOPILOT else 0, component][name] = number

    def parameters(self, system: int) -> dict[str, float]:
        """The autopilot's parameters of the whole file; a ground station's own copy of them where it sent none."""
        return {**self._parameters[0, GROUND_STATION], **self._parameters[system, AUTOPILOT]}

    def armed_at(self, system: int) -> int | None:
        """Number of the frame, from 0, that first said that a vehicle is armed; None where none did."""
        return self._systems[system].armed_at

    def choose(self, path: Path, target: int | None = None) -> Choice:
        """The vehicle to read: ``target``, or of those that fly (of all, where none does) the one with most motion
        data.

        A vehicle is a system whose component 1 sends HEARTBEAT with an autopilot; without any, one that sends
        attitudes. Raises LogError where there is none.
        """
        vehicles = [s for s, one in self._systems.items() if one.autopilot]
        heartbeat = bool(vehicles)
        vehicles = vehicles or [s for s, one in self._systems.items() if one.motion]
        if not vehicles:
            raise LogError(f"{path}: no vehicle in it: neither HEARTBEAT nor attitude of an autopilot (component 1)")
        alone = len(vehicles) == 1
        flying = {s: alone or self._systems[s].flies for s in vehicles}
        ranked = sorted(flying, key=lambda s: (-flying[s], -self._systems[s].motion, s))
        if target is None:
            return Choice(ranked[0], tuple(ranked[1:]), any(flying[s] for s in ranked[1:]), heartbeat)
        if target not in ranked:
            raise LogError(f"{path}: no vehicle with system id {target}; it holds {', '.join(map(str, ranked))}")
        return Choice(target, heartbeat=heartbeat)


@dataclass(frozen=True)
class Choice:
    """The vehicle that a log is read for, and whether it was chosen among several."""

    system: int
    others: tuple[int, ...] = ()
    flying: bool = False
    """Whether one of the others flies as well."""
    heartbeat: bool = True

    def notes(self) -> list[str]:
        """What a reader should know, in words."""
        out = []
        if self.others:
            rest = ", ".join(map(str, self.others))
            more = "; more than one of them flies" if self.flying else ""
            out.append(
                f"system {self.system} chosen (flying, most data); also in the log: {rest}{more}; "
                "--target-system N reads it"
            )
        if not self.heartbeat:
            out.append(f"no autopilot HEARTBEAT; system {self.system} taken from its telemetry")
        return out
