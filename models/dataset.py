"""The data set: one fan's total wrench over height, wall distance and rotor speed.

It is read from a CSV and checked, and cut in parts by place.
"""

from __future__ import annotations

import csv
import hashlib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from models.common.errors import ModelError
from models.common.frames import AXES, Array
from models.common.text_file import read_text

COLUMNS = ("h_m", "d_m", "rpm", "Fx_N", "Fy_N", "Fz_N", "Mx_Nm", "My_Nm", "Mz_Nm")
HEADER = ",".join(COLUMNS)
# Fewer do not determine six surfaces over (h, d); part of the format, docs/formats.md.
MIN_ROWS = 30
# Two rows at one point may differ by rounding in the file (share of the wrench), not by more.
DUPLICATE_TOLERANCE = 1e-6
# Train and test rows are 8:2, as in the paper.
TEST_SHARE = 0.2
# Two files give the same place and speed where they agree to this share.
ROUNDING = 1e-4


@dataclass(frozen=True, kw_only=True)
class DataSet:
    """Rows of one fan in its corner frame (docs/formats.md).

    ``h`` and ``d`` shape (n,) in m, ``inf`` where there is no ground or wall; ``rpm`` shape (n,), positive;
    ``wrench`` shape (n, 6) in N and N m. ``notes`` says in words what was done to the file's rows. ``sigma`` (n, 6) in
    N and N m where it is known how sure each row is.
    """

    h: Array
    d: Array
    rpm: Array
    wrench: Array
    source: str
    sha256: str
    notes: tuple[str, ...] = ()
    sigma: Array | None = None

    def __len__(self) -> int:
        return int(self.h.shape[0])

    def take(self, index: NDArray[np.intp] | NDArray[np.bool_]) -> DataSet:
        """The rows ``index`` (integers or mask)."""
        if self.sigma is None:
            sigma = None
        else:
            sigma = self.sigma[index]
        return replace(
            self,
            h=self.h[index],
            d=self.d[index],
            rpm=self.rpm[index],
            wrench=self.wrench[index],
            sigma=sigma,
        )

    @property
    def free_air(self) -> NDArray[np.bool_]:
        """Rows with neither ground nor wall, shape (n,)."""
        return np.isinf(self.h) & np.isinf(self.d)

    @property
    def locations(self) -> NDArray[np.intp]:
        """One number per distinct (h, d), shape (n,): rows at several rotor speeds share it."""
        order = np.lexsort((self.d, self.h))
        h = self.h[order]
        d = self.d[order]
        out = np.empty(len(self), dtype=np.intp)
        out[order] = np.concatenate([[0], np.cumsum((h[1:] != h[:-1]) | (d[1:] != d[:-1]))])
        return out


def read(path: Path | str) -> DataSet:
    """Read a data set in the format of docs/formats.md.

    Raises ModelError, naming the line, for: unreadable file, another header, a field that is no number, NaN, a negative
    distance or speed, an infinite speed or wrench, duplicates that disagree, a wrench at rest, fewer than 30 rows.
    Duplicates that agree are merged, rows at rest (rpm 0, zero wrench) dropped; ``notes`` says so.
    """
    path = Path(path)
    lines = read_text("data set", path, ModelError).splitlines()
    if not lines or lines[0].strip() != HEADER:
        if lines:
            found = lines[0].strip()[:80]
        else:
            found = "an empty file"
        raise ModelError(f"data set {path}: the header must be exactly '{HEADER}', not '{found}'")
    number = np.array([i for i, line in enumerate(lines[1:], 2) if line.strip()], dtype=np.intp)
    values = np.array([_numbers(path, n, lines[n - 1]) for n in number]).reshape(-1, len(COLUMNS))
    _check_values(path, number, values)
    notes: list[str] = []
    number, values = _merge_duplicates(path, number, values, notes)
    values = _drop_rest(path, number, values, notes)
    if len(values) < MIN_ROWS:
        raise ModelError(
            f"data set {path}: has {len(values)} usable rows; at least {MIN_ROWS} are needed"
        )
    h, d, rpm = values[:, :3].T
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    return DataSet(
        h=h, d=d, rpm=rpm, wrench=values[:, 3:], source=path.name, sha256=sha256, notes=tuple(notes)
    )


def with_sigma(data: DataSet, path: Path | str) -> DataSet:
    """``data`` with the sigma of each row, from the table that ``models cfd assemble`` writes beside a set.

    Rows are found by ``h_m``, ``d_m`` and ``rpm``. Raises ModelError for a table that cannot be read, a missing column,
    a field that is no number or negative, and a row of the set that the table lacks.
    """
    lines = list(csv.DictReader(read_text("sigma table", Path(path), ModelError).splitlines()))
    names = [f"sigma_{name}" for name in COLUMNS[3:]]
    values = np.empty((len(lines), 9))
    for number, line in enumerate(lines):
        try:
            values[number] = [float(line[name]) for name in (*COLUMNS[:3], *names)]
        except KeyError as error:
            raise ModelError(f"sigma table {path}: lacks the column {error}") from None
        except (TypeError, ValueError):
            raise ModelError(
                f"sigma table {path}: line {number + 2} has a field that is no number"
            ) from None
        if not (np.isfinite(values[number, 3:]).all() and (values[number, 3:] >= 0.0).all()):
            raise ModelError(
                f"sigma table {path}: line {number + 2}: sigma must be finite and not negative"
            )
    sigma = np.empty_like(data.wrench)
    for i, here in enumerate(np.column_stack([data.h, data.d, data.rpm])):
        found = np.flatnonzero(np.isclose(values[:, :3], here, rtol=ROUNDING, atol=0.0).all(axis=1))
        if not len(found):
            h, d, rpm = here
            raise ModelError(
                f"sigma table {path}: has no line for h_m {h:g}, d_m {d:g}, rpm {rpm:g} of the set"
            )
        sigma[i] = values[found[0], 3:]
    return replace(data, sigma=sigma)


def held_out(data: DataSet, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Mask (n,) of the rows to test on: whole random places (h, d), about ``TEST_SHARE`` of the rows between them.

    All rotor speeds of a place go the same way: they say almost the same. Free air is the reference that increments are
    counted from and is never held out.
    """
    locations = data.locations
    order = rng.permutation(np.unique(locations[~data.free_air]))
    rows = np.bincount(locations)[order].cumsum()
    cut = int(np.abs(rows - TEST_SHARE * len(data)).argmin()) + 1
    mask: NDArray[np.bool_] = np.isin(locations, order[:cut])
    return mask


def place_means(values: Array, place: NDArray[np.intp]) -> Array:
    """Means (places, k) of ``values`` (n, k) over the rows of each place, which ``place`` (n,) numbers from 0."""
    count = np.bincount(place)
    return np.stack([np.bincount(place, weights=column) / count for column in values.T], axis=1)


def half(data: DataSet, which: str) -> DataSet:
    """The rows of every second place as on a chessboard: rank of h plus rank of d is ``even`` or ``odd``.

    On a grid each half has places on all edges, ground alone and wall alone included. Free air, which increments are
    counted from, belongs to both. All rotor speeds of a place stay together.
    """
    square = (_rank(data.h) + _rank(data.d)) % 2
    kept = data.take((square == ("even", "odd").index(which)) | data.free_air)
    note = f"{which} places only: every second place of the grid, {len(kept)} of {len(data)} rows"
    return replace(kept, notes=(*data.notes, note))


def _rank(distance: Array) -> NDArray[np.intp]:
    """Place (n,) of each distance among the different ones, from 0."""
    return np.unique(distance, return_inverse=True)[1]


def _numbers(path: Path, number: int, line: str) -> list[float]:
    """The fields of a line."""
    fields = line.split(",")
    if len(fields) != len(COLUMNS):
        raise ModelError(
            f"data set {path}: line {number} has {len(fields)} fields, not {len(COLUMNS)}"
        )
    out = []
    for name, field in zip(COLUMNS, fields, strict=True):
        try:
            out.append(float(field))
        except ValueError:
            raise ModelError(
                f"data set {path}: line {number}, column {name}: '{field}' is not a number"
            ) from None
    return out


def _check_values(path: Path, number: NDArray[np.intp], values: Array) -> None:
    column = np.arange(len(COLUMNS))
    for bad, problem in (
        (np.isnan(values), "is not a number; remove or repair the row"),
        ((values < 0.0) & (column < 3), "is negative"),
        (np.isinf(values) & (column >= 2), "must be finite"),
    ):
        for row, k in np.argwhere(bad)[:1]:
            raise ModelError(
                f"data set {path}: line {number[row]}, column {COLUMNS[k]}: {problem} "
                f"({values[row, k]:g})"
            )


def _merge_duplicates(
    path: Path, number: NDArray[np.intp], values: Array, notes: list[str]
) -> tuple[NDArray[np.intp], Array]:
    _, first, point = np.unique(values[:, :3], axis=0, return_index=True, return_inverse=True)
    twin = first[point.ravel()]
    tolerance = DUPLICATE_TOLERANCE * np.maximum(
        np.abs(values[:, 3:]).max(axis=0, initial=0.0), 1e-12
    )
    differ = np.argwhere(np.abs(values[:, 3:] - values[twin, 3:]) > tolerance)
    if len(differ):
        row, k = differ[0]
        raise ModelError(
            f"data set {path}: lines {number[twin[row]]} and {number[row]} are the same point but "
            f"disagree in {COLUMNS[3 + k]} ({values[twin[row], 3 + k]:g} and "
            f"{values[row, 3 + k]:g}); keep one"
        )
    if len(first) < len(values):
        notes.append(f"{len(values) - len(first)} duplicate rows that agree were merged")
    keep = np.sort(first)
    return number[keep], values[keep]


def _drop_rest(path: Path, number: NDArray[np.intp], values: Array, notes: list[str]) -> Array:
    rest = values[:, 2] == 0.0
    size = np.abs(values[:, 3:])
    loaded = np.argwhere(rest[:, None] & (size > 1e-6 * size.max(axis=0, initial=0.0)))
    if len(loaded):
        row, k = loaded[0]
        raise ModelError(
            f"data set {path}: line {number[row]} is at rest (rpm 0) but has {AXES[k]} = "
            f"{values[row, 3 + k]:g}; remove the sensor's offset"
        )
    if rest.any():
        notes.append(
            f"{int(rest.sum())} rows at rest (rpm 0) were dropped: a fan at rest has no wrench "
            "by definition"
        )
    kept: Array = values[~rest]
    return kept
