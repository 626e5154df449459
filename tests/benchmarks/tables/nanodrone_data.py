"""Flights of the nano-drone benchmark of IDSIA (Busetto et al. 2026, arXiv:2512.14450), read from a clone.

The published files lie in Git LFS. Earlier commits hold what they were made from: the test flights with offsets taken
out, and the raw logs of the training flights. Steps from there are those of the authors' notebooks.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import butter, correlate, sosfiltfilt
from scipy.spatial.transform import Rotation
from sources.clone import read
from sources.motion import FLIP

from models.common.frames import Array
from models.vehicle_wrench import RPM_TO_RAD_S

COMMIT = "d0cf4ab"
TEST = "data/real/processed/test/melon_20251017_run{}.parquet"
RAW = "data/real/raw/parquets/{}_20251017_run{}.parquet"
TEST_RUNS = (1, 4, 5)
"""Published as runs 1, 2 and 3."""
FIRST_ROW = {
    "square": (4906, 240, 245, 249),
    "random2": (254, 264, 250, 252),
    "multisine": (256, 251, 247, 250),
    "random1": (251, 247, 264, 253),
}
"""Of the published part in the raw log of runs 1 to 4."""
ROWS = {"square": 1900, "random2": 6000, "multisine": 6000, "random1": 6000}
TRAINING = ("square", "random2", "multisine")
"""Published as square, random and chirp; of each, run 4 is for validation."""
STEP_S = 0.01
PLACE = ("x", "y", "z")
SPEED = ("vx", "vy", "vz")
TURN = ("wx", "wy", "wz")
POSE = ("qx", "qy", "qz", "qw")
FELT = ("ax", "ay", "az")
MOTORS = tuple(f"m{k}_erpm" for k in range(1, 5))
RAD_S_PER_ERPM = 2.0 * np.pi / (6 * 60)
"""As the authors convert the electrical speed."""
IMPOSSIBLE_ERPM = 3e5
CUTOFF_HZ = {"place": 10.0, "speed": 18.0, "pose": 12.0, "motors": 20.0}


@dataclass(frozen=True)
class Run:
    """One flight at 100 Hz: states (n, 13) as ``replay.rollout`` takes them, and rotor speeds (n, 4) [rpm]."""

    states: Array
    rpm: Array


def test_runs(clone: Path) -> list[Run]:
    """The published test flights, without their first row, as the authors drop it."""
    out = []
    for number in TEST_RUNS:
        columns = _read(clone, TEST.format(number))
        run = _processed(columns)
        out.append(Run(run.states[1:], run.rpm[1:]))
    return out


def raw_runs(clone: Path, names: Sequence[str], numbers: Sequence[int]) -> list[Run]:
    """Training or validation flights, from the raw logs: repeated samples are taken as missing."""
    out = []
    for name in names:
        for number in numbers:
            first = FIRST_ROW[name][number - 1]
            rows = slice(first, first + ROWS[name])
            columns = _read(clone, RAW.format(name, number))
            cut = {key: values[rows] for key, values in columns.items()}
            out.append(_processed(_without_repeats(cut)))
    return out


def _read(clone: Path, path: str) -> dict[str, Array]:
    """Columns (n,) of a parquet file of the clone. Raises SystemExit where no reader of parquet is installed."""
    try:
        from pyarrow import parquet
    except ImportError:
        raise SystemExit("skipped: reading parquet needs pyarrow: pip install pyarrow") from None
    wanted = [*PLACE, *SPEED, *TURN, *POSE, *FELT, *MOTORS]
    data = io.BytesIO(read(clone, COMMIT, path))
    table = parquet.read_table(data, columns=wanted, use_threads=False)
    return {key: np.asarray(table[key].to_numpy(), dtype=float) for key in wanted}


def _without_repeats(columns: dict[str, Array]) -> dict[str, Array]:
    """Samples that repeat the one before, as after a lost packet, between their neighbours."""
    out = {}
    for group in ((*PLACE, *SPEED, *TURN, *POSE), FELT, MOTORS):
        together = np.stack([columns[key] for key in group], axis=1)
        repeated = np.zeros(len(together), dtype=bool)
        repeated[1:] = (together[1:] == together[:-1]).all(axis=1)
        for key in group:
            out[key] = _bridged(np.where(repeated, np.nan, columns[key]))
    return out


def _bridged(values: Array) -> Array:
    """(n,) with straight lines across NaN."""
    known = np.isfinite(values)
    rows = np.arange(len(values))
    return np.interp(rows, rows[known], values[known])


def _processed(columns: dict[str, Array]) -> Run:
    """As published: motors in time with the lift, and everything through a zero-phase low-pass."""
    quaternion = np.stack([columns[key] for key in POSE], axis=1)
    acceleration = np.stack([columns[key] for key in FELT], axis=1)
    upward = Rotation.from_quat(quaternion).inv().apply(acceleration)[:, 2]
    erpm = np.stack([columns[key] for key in MOTORS], axis=1)
    erpm[np.abs(erpm) > IMPOSSIBLE_ERPM] = np.nan
    speeds = RAD_S_PER_ERPM * np.stack([_bridged(one) for one in erpm.T], axis=1)
    motors = _shifted(speeds, _lag(upward, (speeds**2).sum(axis=1)))
    place = _smooth(np.stack([columns[key] for key in PLACE], axis=1), "place")
    speed = _smooth(np.stack([columns[key] for key in SPEED], axis=1), "speed")
    turn = _smooth(np.stack([columns[key] for key in TURN], axis=1), "speed")
    pose = Rotation.from_rotvec(_smooth(_logarithm(quaternion), "pose"))
    over = Rotation.from_euler("x", 180, degrees=True)
    attitude = (over * pose * over).as_quat()
    states = np.concatenate(
        [FLIP * place, FLIP * speed, np.roll(attitude, 1, axis=1), FLIP * turn], axis=1
    )
    return Run(states, _smooth(motors, "motors") / RPM_TO_RAD_S)


def _logarithm(quaternion: Array) -> Array:
    """Rotation vectors (n, 3) of quaternions (n, 4) that need not have length 1, as the authors take them."""
    vector = quaternion[:, :3]
    size = np.linalg.norm(vector, axis=1, keepdims=True)
    scalar = np.clip(quaternion[:, 3:], -1.0 + 1e-6, 1.0 - 1e-6)
    return np.asarray(2.0 * np.arctan2(size, scalar) / (size + 1e-6) * vector)


def _lag(reference: Array, follower: Array) -> int:
    """Samples by which the follower (n,) has to be moved for the best correlation with the reference (n,)."""
    a = (reference - reference.mean()) / reference.std()
    b = (follower - follower.mean()) / follower.std()
    return int(np.argmax(correlate(a, b, mode="full"))) - len(b) + 1


def _shifted(values: Array, samples: int) -> Array:
    """Rows moved by some samples; the ends hold."""
    rows = np.clip(np.arange(len(values)) - samples, 0, len(values) - 1)
    return np.asarray(values[rows])


def _smooth(values: Array, what: str) -> Array:
    sections = butter(4, CUTOFF_HZ[what], fs=1.0 / STEP_S, output="sos")
    return np.asarray(sosfiltfilt(sections, values, axis=0))
