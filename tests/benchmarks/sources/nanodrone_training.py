"""Training flights of the nano-quadrotor benchmark, cut as published, each in two forms.

``NAME``: every sample at the time at which it came. ``NAME_held``: on the clock of 100 Hz on which it was published,
where a sample that was lost repeats the one before.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from tables.nanodrone_data import FIRST_ROW, ROWS, TRAINING

from sources import nanodrone
from sources.clone import read
from sources.nanodrone import COMMIT, FOLDER, Recording, recording_of

VEHICLES = nanodrone.VEHICLES


def flights(clone: Path) -> Iterator[tuple[str, Recording]]:
    for name in TRAINING:
        for number, first in enumerate(FIRST_ROW[name], 1):
            path = f"{FOLDER}/{name}_20251017_run{number}.parquet"
            rows = slice(first, first + ROWS[name])
            recording = recording_of(read(clone, COMMIT, path), rows)
            yield f"{name}_run{number}", recording
            yield f"{name}_run{number}_held", replace(recording, held=True)
