"""What would be compensated on recordings of real firmwares, against the true force of their simulated air.

``python tests/benchmarks adaptation.adapt_firmware [--data DIR] [--only TEXT] [--json FILE]``. Open loop: every
recording is replayed as modelled and with ``--adapt full``, with models that are wrong about its air: what the shipped
ones say of ground and wall, in radii and shares of this vehicle's lift, and the first of them with the wrong sign. The
recordings are not part of the project: they are looked for in ``../shared/data`` (or ``$CORNER_SHARED/data``, or
``--data``) and left out where they are not there. ``worse``: RMS over the flight of true minus compensated force, over
the RMS of the true force (nothing compensated), minus 1. Of ground, wall and corner only.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import command_line
import numpy as np
from adapt_models import OfThisFan, model_of
from tqdm import tqdm

from adaptation.adapt_recordings import DATA, decisions
from companion.adapt_options import Adapt
from companion.config import PipelineConfig
from companion.sim.air import NOMINAL
from companion.vehicles import default_vehicle
from models.common.frames import GRAVITY, Array
from models.vehicle import Vehicle, load_vehicle

FLIGHTS = (
    ("ardupilot/s1_quad3_ground_wall_corner.toml", "ardupilot/s1_quad3_ground_wall_corner"),
    ("ardupilot/s4_quad3_attitude_target_corner.toml", "ardupilot/s4_quad3_attitude_target_corner"),
    ("firmware/ardupilot/quad3.toml", "firmware/ardupilot/approach_offsets_off"),
    ("firmware/ardupilot/quad3.toml", "firmware/ardupilot/approach_offsets_on_default_model"),
    ("firmware/ardupilot/quad3.toml", "firmware/ardupilot/approach_amended_model"),
    ("firmware/ardupilot/quad3.toml", "firmware/ardupilot/approach_slow_attitude_loop"),
    ("firmware/px4/quad.toml", "firmware/px4/corner_offsets_off"),
)
KINDS = ("default", "corner_cfd", "mirrored", "empty")
MODES = {"on": Adapt.OFF, "full": Adapt.FULL}


AXES = ("vertical", "level")


def true_force(path: Path, time_s: Array) -> Array:
    """(n, 3): force of ground, wall and corner at those times [N], body x, y, z, the vehicle taken as level."""
    table = np.genfromtxt(path, delimiter=",", names=True)
    table = table[np.isfinite(table["t"])]
    corner_down = table["cornD"] if "cornD" in (table.dtype.names or ()) else np.zeros(len(table))
    w, x, y, z = (table[name] for name in ("qw", "qx", "qy", "qz"))
    heading = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    north = table["wallN"] + table["cornN"]
    east = table["wallE"] + table["cornE"]
    c = np.cos(heading)
    s = np.sin(heading)
    force = (c * north + s * east, c * east - s * north, corner_down - table["Tge"])
    return np.stack([np.interp(time_s, table["t"], f) for f in force], axis=1)


def wrong_model(kind: str, vehicle: Vehicle) -> Any:
    """Of another fan, with this vehicle's lift in free air; or none."""
    if kind == "empty":
        return model_of(kind, vehicle, NOMINAL)
    built_in = default_vehicle()
    return OfThisFan(model_of(kind, built_in, NOMINAL), vehicle, built_in.rotor_radius_m)


def compensated(vehicle_file: Path, log: Path, kind: str, mode: str) -> tuple[Array, Array]:
    """Boot times (n,) in the air, and what would be compensated there (n, 3), body x, y, z [N]."""
    vehicle = load_vehicle(vehicle_file)
    config = PipelineConfig(
        vehicle=vehicle, model=wrong_model(kind, vehicle), dry_run=True, adapt=MODES[mode]
    )
    times = []
    rows = []
    for decision in decisions(log, config):
        d = decision.disturbance
        if d is not None and d.free_lift_n > 0.5 * vehicle.mass_kg * GRAVITY:
            times.append(decision.t_s)
            rows.append(d.trust * d.gain * np.array(d.wrench[:3]))
    return np.array(times), np.array(rows)


def rms(force: Array) -> tuple[float, float]:
    """Vertical and level [N]."""
    return float(np.sqrt(np.mean(force[:, 2] ** 2))), float(
        np.sqrt(np.mean((force[:, :2] ** 2).sum(axis=1)))
    )


def main() -> int:
    """Replay and print."""
    p = command_line.parser(__doc__)
    p.add_argument("--data", type=Path, default=DATA, metavar="DIR")
    p.add_argument(
        "--only", default="", metavar="TEXT", help="only recordings whose path holds this"
    )
    p.add_argument("--json", type=Path, metavar="FILE")
    a = p.parse_args()
    told = []
    for vehicle, name in tqdm(
        [f for f in FLIGHTS if a.only in f[1]], file=sys.stderr, disable=not sys.stderr.isatty()
    ):
        log = a.data / f"{name}.tlog"
        truth = a.data / f"{name}.truth.csv"
        if not log.exists():
            print(f"left out: {name}: not there", file=sys.stderr)
            continue
        for kind in KINDS:
            for mode in MODES:
                times, ours = compensated(a.data / vehicle, log, kind, mode)
                true = true_force(truth, times)
                worse = [
                    100.0 * (left / of - 1.0)
                    for left, of in zip(rms(true - ours), rms(true), strict=True)
                ]
                shown = "  ".join(
                    f"{axis} {w:+6.1f} % of {of:5.2f} N"
                    for axis, w, of in zip(AXES, worse, rms(true), strict=True)
                )
                print(f"{Path(name).name:34} {kind:11} {mode:5} {shown}", flush=True)
                told.append(
                    {
                        "flight": name,
                        "model": kind,
                        "mode": mode,
                        "worse": dict(zip(AXES, worse, strict=True)),
                    }
                )
    if a.json is not None:
        a.json.write_text(json.dumps(told, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
