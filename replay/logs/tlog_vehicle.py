"""Which vehicle of a .tlog is read, and its parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from companion.mavlink import AUTOPILOT_COMPONENT
from companion.mavlink.dialect import mavlink
from companion.mavlink.sample_builders import parameter_value
from models.common.errors import LogError
from replay.logs.tlog import GROUND_STATION, Tlog

_HEARTBEAT = 0
_PARAM_VALUE = 22
_MOTION = (27, 30, 31, 32, 105)
"""RAW_IMU, ATTITUDE, ATTITUDE_QUATERNION, LOCAL_POSITION_NED, HIGHRES_IMU."""
_SPEEDS = (*range(11030, 11033), *range(11040, 11045), 291)
"""ESC_TELEMETRY_1_TO_4 ... 29_TO_32, ESC_STATUS."""
_SERVOS = 36
_IDLE_US = 30
"""SERVO_OUTPUT_RAW; outputs that never move by more than 30 us, of some 1000, drive nothing."""
_SERVO_COUNT = 8


@dataclass(frozen=True)
class VehicleChoice:
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
            if self.flying:
                more = "; more than one of them flies"
            else:
                more = ""
            out.append(
                f"system {self.system} chosen (flying, most data); also in the log: {rest}{more}; "
                "--target-system N reads it"
            )
        if not self.heartbeat:
            out.append(f"no autopilot HEARTBEAT; system {self.system} taken from its telemetry")
        return out


def choose(log: Tlog, target: int | None = None) -> VehicleChoice:
    """The vehicle to read: ``target``, or of those that fly (of all, where none does) the one with most motion data.

    A vehicle is a system whose component 1 sends HEARTBEAT with an autopilot; without any, one that sends attitudes.
    It flies where it was armed at some time and its rotors turned. Raises LogError where there is none.
    """
    of_autopilot = log.component == AUTOPILOT_COMPONENT
    beats = np.flatnonzero(of_autopilot & (log.message_id == _HEARTBEAT))
    beat = log.records(_HEARTBEAT, beats)
    sender = log.system[beats]
    vehicles = np.unique(sender[beat["autopilot"] != mavlink.MAV_AUTOPILOT_INVALID]).tolist()
    armed = sender[beat["base_mode"] & mavlink.MAV_MODE_FLAG_SAFETY_ARMED > 0]
    moving = of_autopilot & np.isin(log.message_id, _MOTION)
    motion = np.bincount(log.system[moving], minlength=256)
    heartbeat = bool(vehicles)
    if not heartbeat:
        vehicles = np.flatnonzero(motion).tolist()
    if not vehicles:
        raise LogError(
            f"{log.path}: no vehicle in it: neither HEARTBEAT nor attitude of an autopilot "
            "(component 1)"
        )
    flying = {}
    for system in vehicles:
        flying[system] = len(vehicles) == 1 or (system in armed and _rotors_turned(log, system))
    ranked = sorted(vehicles, key=lambda system: (-flying[system], -motion[system], system))
    if target is None:
        first, *others = ranked
        any_flies = any(flying[system] for system in others)
        return VehicleChoice(first, tuple(others), any_flies, heartbeat)
    if target not in ranked:
        held = ", ".join(map(str, ranked))
        raise LogError(f"{log.path}: no vehicle with system id {target}; it holds {held}")
    return VehicleChoice(target, heartbeat=heartbeat)


def _rotors_turned(log: Tlog, system: int) -> bool:
    """By their speeds, or without any by servo outputs that moved."""
    found = [log.records(number, log.indices(number, system)) for number in _SPEEDS]
    if any(map(len, found)):
        return any(records["rpm"].any() for records in found)
    outputs = log.records(_SERVOS, log.indices(_SERVOS, system))
    if not len(outputs):
        return False
    pulses = [outputs[f"servo{k + 1}_raw"].astype(int) for k in range(_SERVO_COUNT)]
    return bool(np.ptp(pulses, axis=1).max() > _IDLE_US)


def parameters(log: Tlog, system: int) -> list[tuple[int, str, float]]:
    """PARAM_VALUE as place in the file, name, value: a ground station's own copy before what the autopilot sent."""
    index = log.indices(_PARAM_VALUE)
    component = log.component[index]
    station = index[component == GROUND_STATION]
    own = index[(component == AUTOPILOT_COMPONENT) & (log.system[index] == system)]
    places = np.concatenate([station, own])
    out = []
    records = log.records(_PARAM_VALUE, places)
    for place, record in zip(places.tolist(), records, strict=True):
        number = parameter_value(float(record["param_value"]), int(record["param_type"]))
        if math.isfinite(number):
            name, _, _ = bytes(record["param_id"]).partition(b"\0")
            out.append((place, name.decode("ascii", "replace"), number))
    return out


def parameter_count(log: Tlog, system: int) -> int:
    """How many parameters the autopilot says it has; 0 where it does not say."""
    index = log.indices(_PARAM_VALUE, system)
    own = index[log.component[index] == AUTOPILOT_COMPONENT]
    return int(log.records(_PARAM_VALUE, own)["param_count"].max(initial=0))
