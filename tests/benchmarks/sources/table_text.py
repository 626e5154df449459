"""Tables of numbers as .csv."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from operator import itemgetter

import numpy as np

from sources.motion import Array

Rows = Sequence[Mapping[str, str]]


def rows_of(text: str) -> Rows:
    """Rows by the names in the first line."""
    return list(csv.DictReader(text.splitlines()))


def columns(rows: Rows, names: str) -> Array:
    """Columns (n, names) in the order of ``names``, which have spaces between; (n,) of one name."""
    wanted = itemgetter(*names.split())
    return np.array([wanted(row) for row in rows], float)
