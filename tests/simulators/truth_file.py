"""What truly happened in a simulated flight, as CSV."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import TextIO

import numpy as np

from companion.sim.body import DT
from companion.sim.flight import SimulatedFlight
from companion.sim.scenario import lip_reach
from models.common.errors import ConfigError
from models.common.frames import Array

_AXES = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")


class TruthFile:
    """The truth as CSV at 50 Hz: SI, radians, world NED, wrenches by cause about the CG in body FRD.

    ``need_*`` is the tilt that balances the true air, ``command_*`` the last attitude command taken (its own position
    controller's where the autopilot flies), ``hand`` who flies, ``gap_m`` lip to wall.
    """

    def __init__(self, path: Path, flight: SimulatedFlight) -> None:
        self._flight = flight
        try:
            self._file: TextIO = path.open("w", encoding="utf-8")
        except OSError as error:
            raise ConfigError(f"--truth {path}: cannot be written ({error.strerror})") from None
        self._file.write(",".join(self._row()) + "\n")
        self._next_s = 0.0

    def step(self) -> None:
        """Write a row when due."""
        now_s = self._flight.time_s
        if now_s + 0.5 * DT < self._next_s:
            return
        self._next_s = round(now_s + 0.02, 4)
        self._file.write(",".join(self._row().values()) + "\n")

    def _row(self) -> dict[str, str]:
        """The present numbers by the names of their columns."""
        f = self._flight
        b, a, reference = f.body, f.autopilot, f.reference
        gap = b.wall_gap_m - lip_reach(f.vehicle, b.surroundings.wall_azimuth_rad - b.euler()[2])
        row = {
            "time_s": f"{f.time_s:.4f}",
            "script_s": f"{f.script_s:.4f}",
            "phase": reference.phase,
        }
        row |= _named("ref_n ref_e ref_d", reference.position)
        row |= _named("ref_vn ref_ve ref_vd", reference.velocity)
        row |= _named("n e d", b.position)
        row |= _named("vn ve vd", b.velocity)
        row |= _named("roll pitch yaw", b.euler())
        row |= _named("p q r", b.rates)
        row |= _named("est_n est_e est_d", f.estimate.position)
        row |= _named("target_roll target_pitch", a.shaped[:2])
        row |= _named("command_roll command_pitch", a.command)
        row |= _named("need_roll need_pitch", f.needed_tilt())
        row |= _named("throttle", [a.throttle])
        row["hand"] = a.hand
        for cause, wrench in vars(b.causes).items():
            row |= _named(" ".join(f"{cause}_{axis}" for axis in _AXES), wrench)
        row |= _named("contact height_m gap_m", (float(b.contact), -b.position[2], gap))
        row |= _named("voltage_v current_a", (b.pack.voltage_v, b.pack.current_a))
        return row | _named(" ".join(f"rpm_{i + 1}" for i in range(len(b.rpm))), b.rpm)

    def close(self) -> None:
        """Flush and close."""
        self._file.close()


def _named(names: str, values: Sequence[float]) -> dict[str, str]:
    return {name: f"{value:.6g}" for name, value in zip(names.split(), values, strict=True)}


def read_truth(path: Path) -> dict[str, Array]:
    """The numbers of a truth file by column, from the moment its script begins. ``streamed``: 1 where a companion flew.

    A row that was cut short is left out.
    """
    with path.open(encoding="utf-8", newline="") as file:
        rows = csv.reader(file)
        names = next(rows)
        keep = [i for i, name in enumerate(names) if name not in ("phase", "hand")]
        started, hand = names.index("script_s"), names.index("hand")
        flown_rows = [row for row in rows if len(row) == len(names) and float(row[started]) >= 0.0]
    table = np.array([[float(row[i]) for i in keep] for row in flown_rows]).reshape(
        len(flown_rows), len(keep)
    )
    columns = {names[i]: table[:, k] for k, i in enumerate(keep)}
    columns["streamed"] = np.array([float(row[hand] == "stream") for row in flown_rows])
    return columns
