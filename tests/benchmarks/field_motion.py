"""Motion of a vehicle as .tlog, and its vehicle file, for sources whose own format the reader does not know."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from log_writers import record
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mav

Array = NDArray[np.float64]
BOOT_S, WALL_S = 10.0, 1.72e9
LIMITS = {"thrust": 0.1, "tilt_deg": 8.0, "slew_thrust_per_s": 0.5, "slew_tilt_deg_per_s": 60.0}
"""Of a vehicle file; a diagnosis does not use them."""


@dataclass(frozen=True)
class Motion:
    """Samples at ``time_s`` (n,), north-east-down and forward-right-down, SI; outputs in microseconds."""

    time_s: Array
    position: Array
    velocity: Array
    quaternion: Array
    """(n, 4), w first, body to world."""
    rates: Array
    force: Array
    """Specific force (n, 3) in the body frame."""
    outputs_us: Array


def write_tlog(path: Path, motion: Motion) -> None:
    """Write ``motion`` as a .tlog of an armed vehicle."""
    with path.open("wb") as file:
        for time_s, frame in _frames(motion):
            file.write(record(int((WALL_S + BOOT_S + time_s) * 1e6), frame))


def _frames(motion: Motion) -> Iterator[tuple[float, bytes]]:
    link = mav.MAVLink(None, 1, 1)
    beats = np.diff(np.floor(motion.time_s - motion.time_s[0] + 1e-6), prepend=-1.0) > 0.0
    for i, time_s in enumerate(motion.time_s - motion.time_s[0]):
        ms, us = round((BOOT_S + time_s) * 1e3), int((BOOT_S + time_s) * 1e6)
        outputs = [round(value) for value in motion.outputs_us[i]]
        out = [mav.MAVLink_heartbeat_message(2, 12, 157, 6 << 16, 4, 3)] if beats[i] else []
        out += [
            mav.MAVLink_attitude_quaternion_message(ms, *motion.quaternion[i], *motion.rates[i]),
            mav.MAVLink_local_position_ned_message(ms, *motion.position[i], *motion.velocity[i]),
            mav.MAVLink_highres_imu_message(
                us, *motion.force[i], *motion.rates[i], 0, 0, 0, 0, 0, 0, 0, 63
            ),
            mav.MAVLink_servo_output_raw_message(us, 0, *outputs, *[0] * (8 - len(outputs))),
        ]
        for message in out:
            link.seq = (link.seq + 1) % 256
            yield float(time_s), message.pack(link)


def fans(
    places: Sequence[tuple[float, float, str]], arm_m: float, radius_m: float
) -> list[dict[str, Any]]:
    """One rotor a fan: ``places`` ahead and to the right over the arm with its spin, in order of the outputs."""
    return [
        {
            "position_m": [x * arm_m, y * arm_m, 0.0],
            "lip_radius_m": radius_m,
            "rotors": [{"servo": output, "spin": spin}],
        }
        for output, (x, y, spin) in enumerate(places, 1)
    ]


def throttle(max_thrust_n: float, expo: float, voltage_v: float) -> dict[str, float]:
    """The keys of ``[throttle]`` for outputs from 1000 to 2000."""
    span = {"pwm_min_us": 1000.0, "pwm_max_us": 2000.0}
    return {"max_thrust_n": max_thrust_n, "expo": expo, "voltage_v": voltage_v} | span


def vehicle_toml(keys: Mapping[str, Any]) -> str:
    """A vehicle file of ``keys``: numbers, texts and lists first, then tables, then lists of tables."""
    plain = [
        f"{k} = {_value(v)}"
        for k, v in keys.items()
        if not isinstance(v, Mapping) and not _tables(v)
    ]
    tables = [f"\n[{k}]\n" + vehicle_toml(v) for k, v in keys.items() if isinstance(v, Mapping)]
    lists = [
        f"\n[[{k}]]\n" + vehicle_toml(item) for k, v in keys.items() if _tables(v) for item in v
    ]
    return "\n".join(plain) + "\n" + "".join(lists + tables)


def _tables(value: Any) -> bool:
    return (
        isinstance(value, list)
        and bool(value)
        and isinstance(value[0], Mapping)
        and "spin" not in value[0]
    )


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{k} = {_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return "[" + ", ".join(_value(v) for v in value) + "]"
    return json.dumps(value)
