"""Turn a recorded flight in which two fans lose thrust for a minute each into .tlog and a vehicle file.

``python tests/benchmarks/loss_logs.py CLONE OUT``: CLONE is a clone of github.com/rfly-openha/documents (Reliable
Flight Control Group, Beihang University), of which one flight of commit 3489a2c is read: a PX4 log as .csv, hardware in
the loop. It stays its authors'. Then judge with

    python tests/benchmarks/measured_flights.py --table tests/benchmarks/measured/loss.toml --data OUT

The flight is written whole, and as two parts with one fan each. The estimator's own acceleration (10 Hz) is the
specific force; rates are the turn from one attitude (20 Hz) to the next.
"""

from __future__ import annotations

import csv
import io
import sys
from pathlib import Path
from typing import Any

import numpy as np
from field_motion import LIMITS, Array, Motion, throttle, vehicle_toml, write_tlog
from scipy.spatial.transform import Rotation
from snapshot import clone_and_out, git

COMMIT = "3489a2cc395a4de8937f38086d059a0a92354d3f"
LOG = "2_tutorial/examples/log_7_2022-5-12-16-22-12_{}_0.csv"
PARTS_S = {
    "loss_1": (30.0, 112.0),
    "loss_3": (145.0, 226.0),
    "loss_1_3": (30.0, 226.0),
}
"""From and to, on the autopilot's clock: after take-off, before the landing."""
RATE_HZ, GRAVITY = 20.0, 9.80665
# 2_tutorial/examples/lossfactor.ipynb
MASS_KG, INERTIA, ARM_M = 1.4, (0.0211, 0.0219, 0.0366), 0.225
THRUST_PER_SPEED2, SPEED_PER_THROTTLE, SPEED_AT_ZERO = 1.105e-5, 1148.0, -141.4
RADIUS_M = 0.127
"""Guess: ten inches."""
PLACES = (
    (1, 1, "ccw"),
    (-1, -1, "ccw"),
    (1, -1, "cw"),
    (-1, 1, "cw"),
)
"""Forward, right and spin: PX4's quadrotor x, and the authors' allocation."""


def main() -> int:
    clone, out = clone_and_out(__doc__)
    attitude = _columns(clone, "vehicle_attitude")
    place = _columns(clone, "vehicle_local_position")
    outputs = _columns(clone, "actuator_outputs")
    for name, (start, end) in PARTS_S.items():
        time = np.arange(start, end, 1.0 / RATE_HZ)
        motion = _motion(time, attitude, place, outputs)
        write_tlog(out / f"{name}.tlog", motion)
    vehicle = vehicle_toml(_vehicle())
    (out / "loss.toml").write_text(vehicle, encoding="utf-8")
    print(f"{len(PARTS_S)} logs and loss.toml in {out}")
    return 0


def _columns(clone: Path, kind: str) -> dict[str, Array]:
    text = git(clone, "show", f"{COMMIT}:{LOG.format(kind)}").decode()
    rows = list(csv.reader(io.StringIO(text)))
    values = np.array([list(map(float, row)) for row in rows[1:]])
    return dict(zip(rows[0], values.T, strict=True))


def _at(time: Array, table: dict[str, Array], names: str) -> Array:
    """Columns ``names`` (n, k) of ``table`` at ``time`` (n,), by lines between samples."""
    clock = table["timestamp"] * 1e-6
    columns = [np.interp(time, clock, table[name]) for name in names.split()]
    return np.stack(columns, axis=1)


def _motion(
    time: Array,
    attitude: dict[str, Array],
    place: dict[str, Array],
    outputs: dict[str, Array],
) -> Motion:
    wxyz = _at(time, attitude, "q[0] q[1] q[2] q[3]")
    turned = Rotation.from_quat(np.roll(wxyz, -1, axis=1))
    steps = (turned[:-1].inv() * turned[1:]).as_rotvec() * RATE_HZ
    force = _at(time, place, "ax ay az") - (0.0, 0.0, GRAVITY)
    return Motion(
        time_s=time,
        position=_at(time, place, "x y z"),
        velocity=_at(time, place, "vx vy vz"),
        quaternion=np.roll(turned.as_quat(), 1, axis=1),
        rates=np.vstack([steps[:1], steps]),
        force=turned.inv().apply(force),
        outputs_us=_at(time, outputs, "output[0] output[1] output[2] output[3]"),
    )


def _vehicle() -> dict[str, Any]:
    """The authors' curve, thrust of the square of a speed that is linear in the throttle."""
    side = ARM_M * 0.5**0.5
    fans = [
        {
            "position_m": [x * side, y * side, 0.0],
            "lip_radius_m": RADIUS_M,
            "rotors": [{"servo": k, "spin": spin}],
        }
        for k, (x, y, spin) in enumerate(PLACES, 1)
    ]
    full_n = THRUST_PER_SPEED2 * (SPEED_PER_THROTTLE + SPEED_AT_ZERO) ** 2
    still_us = 1000.0 - 1000.0 * SPEED_AT_ZERO / SPEED_PER_THROTTLE
    share = MASS_KG * GRAVITY / 4.0 / full_n
    curve = throttle(full_n, expo=1.0, voltage_v=12.6)
    return {
        "name": "quadrotor with two weak fans",
        "mass_kg": MASS_KG,
        "inertia_kgm2": list(INERTIA),
        "hover_thrust": round(share**0.5, 3),
        "rotor_radius_m": RADIUS_M,
        "fan": fans,
        "throttle": curve | {"pwm_min_us": still_us},
        "limits": LIMITS,
    }


if __name__ == "__main__":
    sys.exit(main())
