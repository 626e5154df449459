"""Would a fixed-interval smoother of ranges and velocities lower what a diagnosis leaves on held-out time?

``python tests/benchmarks measured.smoothed_residual LOG.tlog VEHICLE.toml [LOG VEHICLE...] [--model none]``: diagnoses
every log twice, as it is and with the distances, positions and velocities of the residual smoothed by the tracks' own
design (``companion.estimation.track_design``), and prints the ratio of the held-out RMS on every axis.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

import command_line
import numpy as np
from tqdm import tqdm

from companion.estimation import beams
from companion.estimation.kalman import TrackModel
from companion.estimation.range_geometry import PlaneDistance
from companion.estimation.track_design import smoothed
from models.common.frames import Array
from replay.cli import main as replay
from replay.flightlog import Beam, FlightLog
from replay.residual import distances, record
from replay.residual.grid import Mask
from replay.residual.motion import Trajectory

MOTION = TrackModel(
    acceleration_sd=3.0, initial_rate_sd=1.0, gate=16.0, restart_after=5, agree_within=0.1
)
POSITION_SD_M = 0.05
VELOCITY_SD_M_S = 0.05
RANGE_SD_M = 0.012
JUMP_M = 0.25
"""Between two readings: another surface, or a position that was set anew."""
LEAST_SAMPLES = 4


def stretches(values: Array) -> Iterator[slice]:
    """Where (n,) is known without a gap or a jump."""
    rows = np.flatnonzero(np.isfinite(values))
    if not rows.size:
        return
    apart = (np.diff(rows) > 1) | (np.abs(np.diff(values[rows])) > JUMP_M)
    for part in np.split(rows, np.flatnonzero(apart) + 1):
        if len(part) >= LEAST_SAMPLES:
            yield slice(part[0], part[-1] + 1)


def at_stamps(values: Array, t: Array, stamps: Array) -> Array:
    """(n,) at the times ``t`` nearest to a sample, NaN between them."""
    rows = np.clip(np.rint((stamps - t[0]) / (t[1] - t[0])).astype(int), 0, len(t) - 1)
    out = np.full(len(t), np.nan)
    out[rows] = values[rows]
    return out


def with_smooth_motion(log: FlightLog, motion: Trajectory) -> Trajectory:
    """Position and velocity by all of their samples."""
    if log.velocity is None or log.position is None:
        return motion
    t = motion.grid.t
    position = motion.position.copy()
    velocity = motion.velocity.copy()
    for axis in range(3):
        places = at_stamps(motion.position[:, axis], t, log.position.t_s)
        speeds = at_stamps(motion.velocity[:, axis], t, log.velocity.t_s)
        for part in stretches(motion.position[:, axis]):
            seen = places[part].copy()
            seen[0] = motion.position[part.start, axis]
            found = smoothed(
                MOTION,
                1.0 / motion.grid.rate,
                seen,
                speeds[part],
                sigma=POSITION_SD_M,
                rate_sigma=VELOCITY_SD_M_S,
            )
            position[part, axis] = found[:, 0]
            velocity[part, axis] = found[:, 1]
    velocity[np.isnan(motion.velocity)] = np.nan
    return replace(motion, position=position, velocity=velocity)


class SmoothRanges:
    """Stands where the residual reads a beam and carries its distance through gaps."""

    def __init__(self) -> None:
        self.read = distances.beam_reading
        self.carried = distances._carried
        self.known: Array | None = None
        """Rows (n,) of the newest beam at which it was read: NaN at the others."""

    def beam_reading(self, beam: Beam, t: Array, doubted: Mask | None = None) -> Array:
        out = self.read(beam, t, doubted)
        self.known = at_stamps(np.zeros(len(t)), t, beam.distance.t_s)
        return out

    def smoothed(self, plane: PlaneDistance, t: Array, position: Array) -> PlaneDistance:
        """The distance by all readings, and by the vehicle's own motion along the normal."""
        plane = self.carried(plane, t, position)
        if self.known is None:
            return plane
        distance = plane.distance_m.copy()
        readings = plane.distance_m + self.known
        dt = float(t[1] - t[0])
        rates = -np.einsum("ij,ij->i", plane.normal_ned, np.gradient(position, dt, axis=0))
        for part in stretches(plane.distance_m):
            seen = readings[part].copy()
            seen[0] = plane.distance_m[part.start]
            found = smoothed(
                beams._TRACK,
                dt,
                seen,
                rates[part],
                sigma=RANGE_SD_M,
                rate_sigma=beams._VELOCITY_SIGMA_M_S,
            )
            distance[part] = found[:, 0]
        self.known = None
        return PlaneDistance(distance, plane.normal_ned)


def diagnosed(log: Path, vehicle: Path, model: str) -> dict[str, Any]:
    """The answer of ``replay diagnose``."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "answer.json"
        words = ["diagnose", str(log), "--vehicle", str(vehicle), "--model", model]
        code = replay([*words, "--json", str(out), "--quiet"])
        if code:
            raise SystemExit(f"{log}: exit code {code}")
        return dict(json.loads(out.read_text()))


def diagnosed_smooth(log: Path, vehicle: Path, model: str) -> dict[str, Any]:
    """The same of a smoothed residual."""
    read = record.read_motion
    ranges = SmoothRanges()
    with (
        mock.patch.object(record, "read_motion", lambda a, v: with_smooth_motion(a, read(a, v))),
        mock.patch.object(distances, "beam_reading", ranges.beam_reading),
        mock.patch.object(distances, "_carried", ranges.smoothed),
    ):
        return diagnosed(log, vehicle, model)


def main() -> int:
    p = command_line.parser(__doc__)
    p.add_argument("files", nargs="+", type=Path, metavar="LOG VEHICLE")
    p.add_argument("--model", default="none")
    a = p.parse_args()
    if len(a.files) % 2:
        p.error("a vehicle file for every log")
    ratios = []
    pairs = list(zip(a.files[::2], a.files[1::2], strict=True))
    for log, vehicle in tqdm(pairs, disable=None):
        before = diagnosed(log, vehicle, a.model)
        after = diagnosed_smooth(log, vehicle, a.model)
        shares = {
            axis: after["axes"][axis]["rms_after"] / one["rms_after"]
            for axis, one in before["axes"].items()
            if one["rms_after"] and axis in after["axes"]
        }
        ratios += shares.values()
        names = [[one["name"] for one in answer["effects"]] for answer in (before, after)]
        same = "same names" if set(names[0]) == set(names[1]) else f"{names[0]} -> {names[1]}"
        print(log.stem, " ".join(f"{k} {v:.3f}" for k, v in shares.items()), same)
    lower = sum(ratio < 0.999 for ratio in ratios)
    higher = sum(ratio > 1.001 for ratio in ratios)
    mean = float(np.exp(np.mean(np.log(ratios))))
    print(f"{len(ratios)} axes: geometric mean {mean:.4f}, lower {lower}, higher {higher}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
