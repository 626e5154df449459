"""What truly happened to the body, as CSV at 50 Hz: for flights whose autopilot is a real firmware."""

from __future__ import annotations

import csv
from pathlib import Path

from companion.sim.body import Body, turned
from models.common.errors import ConfigError

COLUMNS = (
    "time_s",
    "n",
    "e",
    "d",
    "vn",
    "ve",
    "vd",
    "roll",
    "pitch",
    "yaw",
    "clearance_m",
    "contact",
    "wall_contact",
    "push_n",
    "push_e",
    "push_d",
)
PERIOD_S = 0.02
"""Of the rows, in simulated time."""


class BodyTruthFile:
    """SI, radians, world NED; ``time_s`` since the start of the physics, ``clearance_m`` of the lowest foot.

    ``push``: force of ground, wall and corner on the vehicle [N].
    """

    def __init__(self, path: Path, body: Body) -> None:
        try:
            self._file = path.open("w", encoding="utf-8", newline="")
        except OSError as error:
            raise ConfigError(f"--truth {path}: cannot be written ({error.strerror})") from None
        self._rows = csv.writer(self._file)
        self._rows.writerow(COLUMNS)
        self._body = body
        self._next_s = 0.0

    def step(self, body: Body | None = None) -> None:
        """Write a row when due; ``body`` replaces the one watched, after a restart."""
        if body is not None and body is not self._body:
            self._body, self._next_s = body, 0.0
        b = self._body
        if b.time_s + 0.5 * b.dt < self._next_s:
            return
        self._next_s = b.time_s + PERIOD_S
        numbers = (b.time_s, *b.position, *b.velocity, *b.euler(), b.clearance_m)
        x, y, z = b.causes.corner[:3]
        push = turned(b.rotation(), (x, y, z))
        contacts = (int(b.contact), int(b.wall_contact))
        self._rows.writerow(
            [*(f"{v:.5f}" for v in numbers), *contacts, *(f"{v:.4f}" for v in push)]
        )
        self._file.flush()

    def close(self) -> None:
        """Flush and close."""
        self._file.close()
