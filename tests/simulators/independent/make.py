"""Simulate the flights of a seed and write ``.tlog``, vehicle ``.toml`` and ``.truth.json``, and the declared table."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from . import surfaces, tlog
from .airframes import GUARDED, G, vehicle_toml
from .cases import SECONDS, Case, cases
from .explain import explain, lag_beyond_delay, largest, size, sizes
from .flight import Flight, Track
from .power import bent
from .sensors import sense

TOGETHER = 40


def make(
    folder: Path, seeds: Iterable[int], only: Iterable[str] = (), say: Callable[[str], None] = print
) -> list[Case]:
    """Write the flights that are not there yet, one folder a seed; returns all that were asked for."""
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / "guarded.csv").exists():
        surfaces.write_table(GUARDED, folder / "guarded.csv")
    wanted = [
        c for seed in seeds for c in cases(seed) if not only or any(part in c.name for part in only)
    ]
    missing = [c for c in wanted if not truth_file(folder, c).exists()]
    for batch in _alike(missing):
        say(f"flying {len(batch)} x {batch[0].frame.name}")
        tracks = Flight(batch[0].frame, [c.sortie() for c in batch], SECONDS).fly()
        for case, track in zip(batch, tracks, strict=True):
            _write(folder, case, track)
    return wanted


def stem(folder: Path, case: Case) -> Path:
    """Path of a flight's files without suffix."""
    return folder / f"seed{case.seed}" / case.name


def truth_file(folder: Path, case: Case) -> Path:
    """Written last: a flight is complete where it is there."""
    return stem(folder, case).with_name(case.name + ".truth.json")


def read_truth(folder: Path, case: Case) -> dict[str, Any]:
    """The truth of a flight."""
    out: dict[str, Any] = json.loads(truth_file(folder, case).read_text())
    return out


def _alike(missing: list[Case]) -> Iterable[list[Case]]:
    by: dict[str, list[Case]] = {}
    for case in missing:
        by.setdefault(case.vehicle, []).append(case)
    for group in by.values():
        for start in range(0, len(group), TOGETHER):
            yield group[start : start + TOGETHER]


def _write(folder: Path, case: Case, track: Track) -> None:
    path, frame, c = stem(folder, case), case.frame, case.conditions()
    path.parent.mkdir(parents=True, exist_ok=True)
    path.with_name(case.name + ".toml").write_text(
        vehicle_toml(frame, bent(frame, float(c.declared_slope)), case.beams)
    )
    seen = sense(frame, c, track, case.beams, case.number)
    tlog.write(frame, track, seen, case.beams, case.number, path.with_name(case.name + ".tlog"))
    parts = explain(frame, c, track)
    lump = parts.parts["payload"].copy()
    lump[:3] = 0.0
    truth = {
        "seed": case.seed, "name": case.name, "group": case.group, "vehicle": case.vehicle,
        "made_large": list(case.effects), "model": "table" if frame.table else "none",
        "weight_n": frame.mass_kg * G, "arm_m": frame.arm_m,
        "sizes": {name: round(value, 5) for name, value in sizes(frame, parts).items()},
        "largest": {name: round(value, 5) for name, value in largest(frame, parts).items()},
        "payload_moment": size(frame, lump), "lag_beyond_delay": lag_beyond_delay(frame, parts),
        "conditions": {name: value if np.isfinite(value) else None for name, value in asdict(c).items()},
    }  # fmt: skip
    truth_file(folder, case).write_text(json.dumps(truth, indent=1))
