"""Turn real flights of a nano quadcopter along a figure eight in a vertical plane into .tlog and a vehicle file.

``python tests/benchmarks/planar_logs.py CLONE OUT``: CLONE is a clone of github.com/utiasDSL/mimo_fmpc_socp, of which
four recordings of commit d764c4c are read. They stay their authors'. Then judge with

    python tests/benchmarks/measured_flights.py --table tests/benchmarks/measured/planar.toml --data OUT

Position, velocity, attitude and rates are the authors' estimate on motion capture at 50 Hz. Outputs are four copies of
the thrust that the controller asks for, so that no moment can be judged. There is no accelerometer and no voltage: the
specific force is the derivative of the velocity over five samples.
"""

from __future__ import annotations

import csv
import sys
from typing import Any

import numpy as np
from field_motion import LIMITS, Array, Motion, fans, throttle, vehicle_toml, write_tlog
from scipy.spatial.transform import Rotation
from snapshot import clone_and_out, git

COMMIT = "d764c4ced5ef8e00078175ce43a87506fe43949c"
FOLDER = "runs_paper/hardware_data"
LOGS = (
    "unconstrained/data_20250421_211307",
    "unconstrained/data_20250421_211350",
    "unconstrained/data_20250421_211431",
    "constrained/data_20250422_143652",
)
RATE_HZ, GRAVITY, SMOOTHED = 50.0, 9.80665, 5
CLEAR_M = 0.4
MASS_KG = 0.033
"""Of gpmpc_acados_TP_quadrotor_2D_attitude_tracking.yaml."""
FULL_N, LEVEL = 0.16, 0.957
"""Force of a quarter of the command that is written as full output, and thrust over command in the first three."""
INERTIA, ARM_M, RADIUS_M = (16.6e-6, 16.6e-6, 29.3e-6), 0.046 * 0.5**0.5, 0.0225
"""Of the standard vehicle, by its firmware."""
PLACES = ((1, 1, "ccw"), (-1, 1, "cw"), (-1, -1, "ccw"), (1, -1, "cw"))


def main() -> int:
    clone, out = clone_and_out(__doc__)
    for path in LOGS:
        text = git(clone, "show", f"{COMMIT}:{FOLDER}/{path}.csv").decode()
        name = path.rpartition("data_")[2]
        write_tlog(out / f"planar_{name}.tlog", _motion(text))
    (out / "planar.toml").write_text(vehicle_toml(_vehicle()), encoding="utf-8")
    print(f"{len(LOGS)} logs and planar.toml in {out}")
    return 0


def _motion(text: str) -> Motion:
    """The flight from the first sample above ``CLEAR_M`` to the last. The world is north-west-up."""
    rows = list(csv.DictReader(text.splitlines()))
    time = np.array([float(row["TIME"]) for row in rows])
    even = np.arange(time[0], time[-1], 1.0 / RATE_HZ)

    def column(name: str) -> Array:
        return np.interp(even, time, [float(row[name]) for row in rows])

    def three(name: str, parts: str = "XYZ") -> Array:
        return np.stack([column(f"{name}_{part}") for part in parts], axis=1) * (1.0, -1.0, -1.0)

    angles = np.stack([column("ROLL"), column("PITCH"), column("YAW")], axis=1) * (1.0, -1.0, -1.0)
    rates = np.stack([column(f"{n}_RATE") for n in ("ROLL", "PITCH", "YAW")], axis=1)
    attitude = Rotation.from_euler("ZYX", angles[:, ::-1])
    position, velocity = three("POS"), three("VEL")
    acceleration = np.gradient(_smooth(velocity), 1.0 / RATE_HZ, axis=0)
    command = column("CMD_FORCE") / 4.0 / FULL_N
    high = np.flatnonzero(position[:, 2] < -CLEAR_M)
    kept = slice(high[0], high[-1] + 1)
    return Motion(
        time_s=even[kept] - even[kept][0],
        position=position[kept],
        velocity=velocity[kept],
        quaternion=np.roll(attitude.as_quat(), 1, axis=1)[kept],
        rates=(rates * (1.0, -1.0, -1.0))[kept],
        force=attitude.inv().apply(acceleration - (0.0, 0.0, GRAVITY))[kept],
        outputs_us=np.tile(1000.0 + 1000.0 * command.clip(0.0, 1.0)[kept, None], (1, 4)),
    )


def _smooth(x: Array) -> Array:
    """Mean (n, 3) over ``SMOOTHED`` samples."""
    padded = np.pad(x, ((SMOOTHED // 2, SMOOTHED // 2), (0, 0)), mode="edge")
    kernel = np.ones(SMOOTHED) / SMOOTHED
    return np.stack([np.convolve(column, kernel, "valid") for column in padded.T], axis=1)


def _vehicle() -> dict[str, Any]:
    return {
        "name": "planar",
        "mass_kg": MASS_KG,
        "inertia_kgm2": INERTIA,
        "hover_thrust": 0.53,
        "rotor_radius_m": RADIUS_M,
        "fan": fans(PLACES, ARM_M, RADIUS_M),
        "throttle": throttle(FULL_N * LEVEL, expo=0.0, voltage_v=3.8),
        "limits": LIMITS,
    }


if __name__ == "__main__":
    sys.exit(main())
