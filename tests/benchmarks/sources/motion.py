"""Motion of a vehicle as .tlog, for sources whose own format no reader knows."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields

import numpy as np
from log_writers import record
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mav
from scipy.spatial.transform import Rotation

from models.common.frames import GRAVITY

Array = NDArray[np.float64]
Message = mav.MAVLink_message
BOOT_S = 10.0
WALL_S = 1.72e9
"""Boot clock and (nominal) wall clock at the start of a flight [s]."""
FLIP = np.array([1.0, -1.0, -1.0])
"""From left and up to right and down."""


@dataclass(frozen=True)
class Motion:
    """Samples at ``time_s`` (n,), north-east-down and forward-right-down, SI; outputs in microseconds."""

    time_s: Array
    position: Array
    velocity: Array
    attitude: Rotation
    """Body to world."""
    rates: Array
    force: Array
    """Specific force (n, 3) in the body frame."""
    outputs_us: Array

    def __getitem__(self, kept: slice) -> Motion:
        """A part of the samples."""
        return Motion(**{field.name: getattr(self, field.name)[kept] for field in fields(self)})

    def records(self) -> Iterator[bytes]:
        """The .tlog of an armed vehicle."""
        return records(self._messages())

    def _messages(self) -> Iterator[tuple[float, Message]]:
        since = self.time_s - self.time_s[0]
        beats = np.diff(np.floor(since + 1e-6), prepend=-1.0) > 0.0
        wxyz = np.roll(self.attitude.as_quat(), 1, axis=1)
        for i, time_s in enumerate(since.tolist()):
            ms, us = boot_clock(time_s)
            outputs = [round(value) for value in self.outputs_us[i]]
            if beats[i]:
                yield time_s, mav.MAVLink_heartbeat_message(2, 12, 157, 6 << 16, 4, 3)
            for message in (
                mav.MAVLink_attitude_quaternion_message(ms, *wxyz[i], *self.rates[i]),
                mav.MAVLink_local_position_ned_message(ms, *self.position[i], *self.velocity[i]),
                imu(us, self.force[i], self.rates[i]),
                servos(us, outputs),
            ):
                yield time_s, message


def records(messages: Iterable[tuple[float, Message]], wall_s: float = WALL_S) -> Iterator[bytes]:
    """Records of a .tlog from messages in order, with their time since the start [s]."""
    link = mav.MAVLink(None, 1, 1)
    for time_s, message in messages:
        link.seq = (link.seq + 1) % 256
        yield record(int((wall_s + BOOT_S + time_s) * 1e6), message.pack(link))


def boot_clock(time_s: float) -> tuple[int, int]:
    """Time since boot [ms] and [us]."""
    return round((BOOT_S + time_s) * 1e3), int((BOOT_S + time_s) * 1e6)


def imu(us: int, force: Array, rates: Array) -> Message:
    """Specific force and rates, nothing else."""
    return mav.MAVLink_highres_imu_message(us, *force, *rates, *[0] * 7, 63)


def servos(us: int, outputs: list[int]) -> Message:
    """Up to eight outputs."""
    rest = [0] * (8 - len(outputs))
    return mav.MAVLink_servo_output_raw_message(us, 0, *outputs, *rest)


def from_wxyz(quaternion: Array) -> Rotation:
    """Attitudes from quaternions (n, 4), w first."""
    return Rotation.from_quat(np.roll(quaternion, -1, axis=1))


def specific_force(attitude: Rotation, acceleration: Array) -> Array:
    """f = R^T (a - g) (n, 3), of the acceleration in the world, where no accelerometer was."""
    return attitude.inv().apply(acceleration - (0.0, 0.0, GRAVITY))


def turn_rates(attitude: Rotation, rate_hz: float) -> Array:
    """Angular rate (n, 3) in the body frame: the turn from the sample before to the one after."""
    turn = (attitude[:-2].inv() * attitude[2:]).as_rotvec()
    return np.pad(turn * rate_hz / 2.0, ((1, 1), (0, 0)), mode="edge")


def averaged(x: Array, samples: int) -> Array:
    """Mean (n, 3) over ``samples``; beyond the ends there are zeros."""
    kernel = np.ones(samples) / samples
    return np.stack([np.convolve(column, kernel, "same") for column in x.T], axis=1)


def smoothed(x: Array, samples: int) -> Array:
    """Mean (n, 3) over ``samples``, an odd number; the ends go on."""
    half = samples // 2
    padded = np.pad(x, ((half, half), (0, 0)), mode="edge")
    return averaged(padded, samples)[half : half + len(x)]


def means(x: Array, samples: int) -> Array:
    """Means (n / samples, columns) of so many samples each."""
    count = len(x) // samples
    parts: Array = x[: count * samples].reshape(count, samples, -1).mean(axis=1)
    return parts


def at(when: Array, time_s: Array, values: Array) -> Array:
    """``values`` (n, columns) of ``time_s``, at ``when``, by lines between samples."""
    return np.stack([np.interp(when, time_s, column) for column in values.T], axis=1)


def span(flying: NDArray[np.bool_]) -> slice:
    """From the first sample that flies to the last."""
    where = np.flatnonzero(flying)
    return slice(where[0], where[-1] + 1)
