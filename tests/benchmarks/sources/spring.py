"""Flights of a nano quadcopter with a load on a spring.

A clone of github.com/WoodyloveBo/Cable-Tension-Estimate, of which fourteen recordings (rosbag) of commit 1746855 are
read.

Position and attitude are motion capture's at 100 Hz, velocity and rates their slopes over nine samples. The specific
force is the vehicle's own accelerometer, which the radio sent in the world's frame at 75 Hz. What the radio sent
arrives 2 s late: it is shifted by the delay at which the positions that came with it agree best with motion capture,
whose attitude is turned by the mean difference to the vehicle's. Only the mean command of the four motors was sent:
the outputs are four copies of it. There is no voltage.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from models.common.frames import GRAVITY
from sources.clone import read
from sources.motion import FLIP, Array, Motion, at, averaged, span
from sources.vehicle_file import CRAZYFLIE_PLACES, fans, throttle, vehicle

COMMIT = "174685539c31185e7f9f0d84a562020606c706da"
ROOT = "Spring_Test/1Crazyflie_"
LOGS = {
    "hover_9g": "Hover/09g/hover/9g_T1.bag",
    "hover_11g": "Hover/11g/hover/11g_T1.bag",
    "hover_13g": "Hover/13g/hover/13g_T1.bag",
    "hover_15g": "Hover/15g/hover/15g_T1.bag",
    "hover_17g": "Hover/17g/hover/17g_T1.bag",
    "hover_19g": "Hover/19g/hover/19g_T1.bag",
    "square_12g": "Square/12g/12g_T3_rec.bag",
    "square_16g": "Square/16g/16g_T4_rec.bag",
    "circle_10g": "Circle/10g/10g_T1_cir.bag",
    "circle_14g": "Circle/14g/14g_T1_cir.bag",
    "circle_18g": "Circle/18g/18g_T1_cir.bag",
    "updown_10g": "UpDown/10g/10g_T1_updown.bag",
    "updown_13g": "UpDown/13g/13g_T2_updown.bag",
    "updown_17g": "UpDown/17g/17g_T2_updown.bag",
}
WORLD = "/natnet_ros/cf4/pose"
SENT = "/cf4/pose"
LOG = "/cf4/log1"
"""Topics: pose by motion capture, pose by the vehicle, and its mean command with its specific force."""
MORE_HEADER = {LOG: 4}
"""Bytes between a message's header and its numbers."""
CHUNK = b"\x05"
MESSAGE = b"\x02"
CONNECTION = b"\x07"
"""Kinds of records of a rosbag."""
LATE = 50
"""Samples before and after one over which the delay of its arrival is averaged."""
STEP_S = 0.01
SMOOTHED = 9
CLEAR_M = 0.15
"""A flight counts from this height above the stand that it starts from."""
DELAYS_S = np.arange(0.0, 4.0, 0.05)
MASS_KG = 0.040
FULL_PWM = 65535.0
HOVER_PWM = 28760.0
"""Mass and mean command without a load, by the authors' 1Crazyflie_Hover(Spring).csv and result.py."""
MAX_THRUST_N = MASS_KG * GRAVITY / 4.0 * FULL_PWM / HOVER_PWM
INERTIA = (16.6e-6, 16.6e-6, 29.3e-6)
ARM_M = 0.0325
RADIUS_M = 0.0255
"""Of the vehicle without the larger motors; a propeller of 51 mm comes with them."""
VEHICLES = {
    "spring": vehicle(
        name="spring",
        mass_kg=MASS_KG,
        inertia=INERTIA,
        hover_thrust=round(HOVER_PWM / FULL_PWM, 3),
        radius_m=RADIUS_M,
        fan=fans(CRAZYFLIE_PLACES, ARM_M, RADIUS_M),
        throttle=throttle(round(MAX_THRUST_N, 4), expo=0.0, voltage_v=3.7),
    )
}


def flights(clone: Path) -> Iterator[tuple[str, Motion]]:
    for name, path in LOGS.items():
        yield name, motion_of(bag(read(clone, COMMIT, f"{ROOT}{path}")))


def records(data: bytes, place: int = 0) -> Iterator[tuple[dict[str, bytes], bytes]]:
    """Header and data of each record of a rosbag 2.0, those of its chunks in place of the chunk."""
    while place < len(data):
        fields, place = sized(data, place)
        head = dict(header(fields))
        body, place = sized(data, place)
        if head["op"] == CHUNK:
            yield from records(body)
        else:
            yield head, body


def header(data: bytes) -> Iterator[tuple[str, bytes]]:
    """Keys and values of a record's header."""
    place = 0
    while place < len(data):
        field, place = sized(data, place)
        key, _, value = field.partition(b"=")
        yield key.decode(), value


def sized(data: bytes, place: int) -> tuple[bytes, int]:
    """Bytes behind their number, and the place behind them."""
    (size,) = struct.unpack_from("<I", data, place)
    start = place + 4
    return data[start : start + size], start + size


def bag(data: bytes) -> dict[str, Array]:
    """Rows of each topic: time of arrival [s], then the numbers of the message behind its header."""
    names: dict[bytes, str] = {}
    rows: dict[str, list[tuple[float, ...]]] = {topic: [] for topic in (WORLD, SENT, LOG)}
    for head, body in records(data, len(b"#ROSBAG V2.0\n")):
        if head["op"] == CONNECTION:
            names[head["conn"]] = head["topic"].decode()
        elif head["op"] == MESSAGE and names[head["conn"]] in rows:
            topic = names[head["conn"]]
            seconds, nanos = struct.unpack("<II", head["time"])
            (frame_id,) = struct.unpack_from("<I", body, 12)
            start = 16 + frame_id + MORE_HEADER.get(topic, 0)
            numbers = np.frombuffer(body, "<f8", offset=start)
            rows[topic].append((seconds + nanos * 1e-9, *numbers))
    return {topic: np.array(sorted(own)) for topic, own in rows.items()}


def motion_of(topics: dict[str, Array]) -> Motion:
    """The world is north-west-up, the body forward-left-up."""
    world = topics[WORLD]
    sent = topics[SENT]
    log = topics[LOG]
    time = even(world[:, 0])
    place = world[:, 1:4]
    delay = delay_of(sent, time, place)
    attitude = Rotation.from_quat(world[:, 4:8])
    moment = np.clip(sent[:, 0] - delay, time[0], time[-1])
    seen = attitude[np.searchsorted(time, moment)]
    attitude = attitude * (seen.inv() * Rotation.from_quat(sent[:, 4:8])).mean()
    logged = at(time, log[:, 0] - delay, log[:, 1:5])
    felt = logged[:, 1:] * GRAVITY + (0.0, 0.0, GRAVITY)
    turn = (attitude[:-1].inv() * attitude[1:]).as_rotvec() / np.diff(time)[:, None]
    x, y, z, w = attitude.as_quat().T
    whole = Motion(
        time_s=time,
        position=FLIP * place,
        velocity=FLIP * averaged(np.gradient(place, time, axis=0), SMOOTHED),
        attitude=Rotation.from_quat(np.stack([x, -y, -z, w], axis=1)),
        rates=FLIP * averaged(np.vstack([turn, turn[-1:]]), SMOOTHED),
        force=FLIP * attitude.inv().apply(felt),
        outputs_us=np.tile(1000.0 + 1000.0 * logged[:, :1] / FULL_PWM, 4),
    )
    stand = place[:100, 2].mean()
    return whole[span(place[:, 2] > stand + CLEAR_M)]


def even(arrival_s: Array) -> Array:
    """Times (n,) of motion capture, which is even; only its arrival is not."""
    index = STEP_S * np.arange(len(arrival_s))
    late = np.pad(arrival_s - index, LATE, mode="edge")
    kernel = np.ones(2 * LATE + 1) / (2 * LATE + 1)
    return index + np.convolve(late, kernel, "valid")


def delay_of(sent: Array, time: Array, place: Array) -> float:
    """The delay of what was ``sent`` at which its places agree best with ``place`` [s]."""
    off = [np.mean((at(sent[:, 0] - delay, time, place) - sent[:, 1:4]) ** 2) for delay in DELAYS_S]
    return float(DELAYS_S[np.argmin(off)])
