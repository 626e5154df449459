"""Turn real flights of a nano quadcopter with a load on a spring into .tlog and a vehicle file.

``python tests/benchmarks/spring_logs.py CLONE OUT``: CLONE is a clone of github.com/WoodyloveBo/Cable-Tension-Estimate,
of which fourteen recordings (rosbag) of commit 1746855 are read; they stay the authors'. Then judge with

    python tests/benchmarks/measured_flights.py --table tests/benchmarks/measured/spring.toml --data OUT

Position and attitude are motion capture's at 100 Hz, velocity and rates their slopes over nine samples. The specific
force is the vehicle's own accelerometer, which the radio sent in the world's frame at 75 Hz. What the radio sent
arrives 2 s late: it is shifted by the delay at which the positions that came with it agree best with motion capture,
whose attitude is turned by the mean difference to the vehicle's. Only the mean command of the four motors was sent:
the outputs are four copies of it. There is no voltage.
"""

from __future__ import annotations

import struct
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
from field_motion import LIMITS, Array, Motion, fans, throttle, vehicle_toml, write_tlog
from scipy.spatial.transform import Rotation
from snapshot import clone_and_out, git

COMMIT = "174685539c31185e7f9f0d84a562020606c706da"
ROOT = "Spring_Test/1Crazyflie_"
LOGS = {
    **{f"hover_{g}g": f"Hover/{g:02d}g/hover/{g}g_T1.bag" for g in (9, 11, 13, 15, 17, 19)},
    **{f"square_{g}g": f"Square/{g}g/{g}g_T{t}_rec.bag" for g, t in ((12, 3), (16, 4))},
    **{f"circle_{g}g": f"Circle/{g}g/{g}g_T1_cir.bag" for g in (10, 14, 18)},
    **{f"updown_{g}g": f"UpDown/{g:02d}g/{g:02d}g_T{t}_updown.bag" for g, t in ((10, 1), (13, 2), (17, 2))},
}  # fmt: skip
TOPICS = ("/natnet_ros/cf4/pose", "/cf4/pose", "/cf4/log1")
LATE = 50
"""Samples before and after one over which the delay of its arrival is averaged."""
GRAVITY, SMOOTHED, CLEAR_M = 9.80665, 9, 0.15
"""A flight counts from this height above the stand that it starts from."""
DELAYS_S = np.arange(0.0, 4.0, 0.05)
MASS_KG, FULL_PWM, HOVER_PWM = 0.040, 65535.0, 28760.0
"""Mass and mean command without a load, by the authors' 1Crazyflie_Hover(Spring).csv and result.py."""
INERTIA, ARM_M, RADIUS_M = (16.6e-6, 16.6e-6, 29.3e-6), 0.0325, 0.0255
"""Of the vehicle without the larger motors; a propeller of 51 mm comes with them."""
PLACES = ((1, 1, "ccw"), (-1, 1, "cw"), (-1, -1, "ccw"), (1, -1, "cw"))
FLIP = np.array([1.0, -1.0, -1.0])
"""From forward-left-up and north-west-up."""


def main() -> int:
    clone, out = clone_and_out(__doc__)
    for name, path in LOGS.items():
        write_tlog(
            out / f"{name}.tlog", _motion(_bag(git(clone, "show", f"{COMMIT}:{ROOT}{path}")))
        )
    (out / "spring.toml").write_text(vehicle_toml(_vehicle()), encoding="utf-8")
    print(f"{len(LOGS)} logs and spring.toml in {out}")
    return 0


def _records(data: bytes, at: int = 0) -> Iterator[tuple[dict[str, bytes], bytes]]:
    """Header and data of each record of a rosbag 2.0, those of its chunks in place of the chunk."""
    while at < len(data):
        (size,) = struct.unpack_from("<I", data, at)
        end, head = at + 4 + size, {}
        at += 4
        while at < end:
            (length,) = struct.unpack_from("<I", data, at)
            key, _, value = data[at + 4 : at + 4 + length].partition(b"=")
            head[key.decode()] = value
            at += 4 + length
        (size,) = struct.unpack_from("<I", data, at)
        body, at = data[at + 4 : at + 4 + size], at + 4 + size
        if head["op"] == b"\x05":
            yield from _records(body)
        else:
            yield head, body


def _bag(data: bytes) -> dict[str, Array]:
    """Rows of each of ``TOPICS``: time of arrival [s], then the numbers of the message behind its header."""
    names: dict[bytes, str] = {}
    rows: dict[str, list[tuple[float, ...]]] = {topic: [] for topic in TOPICS}
    for head, body in _records(data, len(b"#ROSBAG V2.0\n")):
        if head["op"] == b"\x07":
            names[head["conn"]] = head["topic"].decode()
        elif head["op"] == b"\x02" and names[head["conn"]] in rows:
            seconds, nanos = struct.unpack("<II", head["time"])
            start = (
                16
                + struct.unpack_from("<I", body, 12)[0]
                + 4 * ((topic := names[head["conn"]]) == TOPICS[2])
            )
            rows[topic].append((seconds + nanos * 1e-9, *np.frombuffer(body, "<f8", offset=start)))
    return {topic: np.array(sorted(own)) for topic, own in rows.items()}


def _motion(bag: dict[str, Array]) -> Motion:
    world, sent, log = (bag[topic] for topic in TOPICS)
    # Motion capture is even; only its arrival is not.
    index = 0.01 * np.arange(len(world))
    late = np.pad(world[:, 0] - index, LATE, mode="edge")
    time, place = (
        index + np.convolve(late, np.ones(2 * LATE + 1) / (2 * LATE + 1), "valid"),
        world[:, 1:4],
    )
    near = [np.mean((_at(sent[:, 0] - d, time, place) - sent[:, 1:4]) ** 2) for d in DELAYS_S]
    delay = DELAYS_S[int(np.argmin(near))]
    attitude = Rotation.from_quat(world[:, 4:8])
    seen = attitude[np.searchsorted(time, np.clip(sent[:, 0] - delay, time[0], time[-1]))]
    attitude = attitude * (seen.inv() * Rotation.from_quat(sent[:, 4:8])).mean()
    felt = _at(time, log[:, 0] - delay, log[:, 2:5]) * GRAVITY + (0.0, 0.0, GRAVITY)
    command = np.interp(time, log[:, 0] - delay, log[:, 1])
    turn = (attitude[:-1].inv() * attitude[1:]).as_rotvec() / np.diff(time)[:, None]
    w, x, y, z = np.roll(attitude.as_quat(), 1, axis=1).T
    up = np.flatnonzero(place[:, 2] > place[:100, 2].mean() + CLEAR_M)
    kept = slice(up[0], up[-1] + 1)
    return Motion(
        time_s=time[kept],
        position=(place * FLIP)[kept],
        velocity=(_smooth(np.gradient(place, time, axis=0)) * FLIP)[kept],
        quaternion=np.stack([w, x, -y, -z], axis=1)[kept],
        rates=(_smooth(np.vstack([turn, turn[-1:]])) * FLIP)[kept],
        force=(attitude.inv().apply(felt) * FLIP)[kept],
        outputs_us=np.tile(1000.0 + 1000.0 * command[kept, None] / FULL_PWM, 4),
    )


def _at(when: Array, time: Array, values: Array) -> Array:
    """``values`` (n, 3) of ``time``, at ``when``."""
    return np.stack([np.interp(when, time, column) for column in values.T], axis=1)


def _smooth(x: Array) -> Array:
    """Mean (n, 3) over ``SMOOTHED`` samples."""
    return np.stack(
        [np.convolve(column, np.ones(SMOOTHED) / SMOOTHED, mode="same") for column in x.T], axis=1
    )


def _vehicle() -> dict[str, Any]:
    return {
        "name": "spring",
        "mass_kg": MASS_KG,
        "inertia_kgm2": INERTIA,
        "hover_thrust": round(HOVER_PWM / FULL_PWM, 3),
        "rotor_radius_m": RADIUS_M,
        "fan": fans(PLACES, ARM_M, RADIUS_M),
        "throttle": throttle(
            round(MASS_KG * GRAVITY / 4.0 * FULL_PWM / HOVER_PWM, 4), expo=0.0, voltage_v=3.7
        ),
        "limits": LIMITS,
    }


if __name__ == "__main__":
    sys.exit(main())
