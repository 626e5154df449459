"""A data set cut in two by place, every second one of its grid: one half to train on, one to be judged in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from models.dataset import DataSet
from models.frames import Array


def half(data: DataSet, which: str) -> DataSet:
    """The rows of every second place as on a chessboard: rank of h plus rank of d is ``even`` or ``odd``.

    On a grid each half has places on all edges, ground alone and wall alone included. Free air, which increments are
    counted from, belongs to both. All rotor speeds of a place stay together.
    """
    square = (_rank(data.h) + _rank(data.d)) % 2
    kept = data.take((square == ("even", "odd").index(which)) | data.free_air)
    note = f"{which} places only: every second place of the grid (models/halves.py), {len(kept)} of {len(data)} rows"
    return replace(kept, notes=(*data.notes, note))


def _rank(distance: Array) -> NDArray[np.intp]:
    """Place (n,) of each distance among the different ones, from 0."""
    return np.unique(distance, return_inverse=True)[1]
