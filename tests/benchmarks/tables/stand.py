"""Thrust stands: rows of command, voltage and thrust by run, and how well a law tells the run that it has not seen."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.optimize import curve_fit
from sources.clone import read

from models.common.frames import Array

Teller = Callable[[Array, Array], Array]
"""Fits itself to rows (n, columns) and tells the rows (m, columns) of another run: (m,)."""


def rows_of(clone: Path, commit: str, path: str, names: Sequence[str]) -> Array:
    """Columns (n, names) of a file of the clone, the rows that hold all of them."""
    text = read(clone, commit, path).decode("utf-8-sig")
    kept = []
    for line in csv.DictReader(io.StringIO(text)):
        cells = [line[name] for name in names]
        if all(cells):
            kept.append([float(cell) for cell in cells])
    return np.array(kept)


def thrust(
    command: Array, volts: Array, most: float, expo: float, power: float, full: float
) -> Array:
    """Thrust of a command from 0 to 1: ``[throttle]`` of a vehicle file, and ``battery_sag`` of the catalogue.

    T = T_max ((1 - e) u + e u^2) (1 + p (V / V_0 - 1))
    """
    curve = (1.0 - expo) * command + expo * command**2
    return np.asarray(most * curve * sagged(volts, power, full))


def sagged(volts: Array, power: float, full: float) -> Array:
    """The share of thrust at a voltage: 1 + p (V / V_0 - 1)."""
    return np.asarray(1.0 + power * (volts / full - 1.0))


def surface(x: Array, y: Array) -> Array:
    """Terms (n, 6) of a polynomial of degree 2."""
    return np.stack([np.ones_like(x), x, y, x**2, x * y, y**2], axis=1)


def linear(terms: Callable[[Array], Array], goal: int) -> Teller:
    """Least squares of terms (n, k) of rows; ``goal``: the column that is told."""

    def told(seen: Array, other: Array) -> Array:
        found = np.linalg.lstsq(terms(seen), seen[:, goal], rcond=None)[0]
        return np.asarray(terms(other) @ found)

    return told


def curved(law: Callable[..., Array], start: Sequence[float], goal: int) -> Teller:
    """The same of a law of rows and numbers, from ``start``."""

    def told(seen: Array, other: Array) -> Array:
        found, _ = curve_fit(law, seen, seen[:, goal], p0=start, maxfev=20_000)
        return law(other, *found)

    return told


def left_out(runs: Mapping[str, Array], teller: Teller, goal: int) -> dict[str, Array]:
    """Errors (n,) on every run, told by the others."""
    out = {}
    for name, rows in runs.items():
        others = [other for key, other in runs.items() if key != name]
        out[name] = teller(np.concatenate(others), rows) - rows[:, goal]
    return out
