"""A set of terms on the channels: which of its columns act where, and what they do there."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import accumulate

import numpy as np

from models.frames import Array
from replay.search.channel import Columns
from replay.search.library import Library
from replay.search.terms import Term


class Design:
    """The columns of some terms, the trims behind them."""

    def __init__(self, library: Library, terms: Sequence[Term]) -> None:
        self.library = library
        self.terms = tuple(terms)
        self.edges = list(accumulate((len(t.columns) for t in terms), initial=0))
        self.columns = np.concatenate([*(t.columns for t in terms), library.trim])
        self.centre = np.concatenate([*(t.centre for t in terms), np.zeros(len(library.trim))])
        widths = [*(len(t.columns) for t in terms), len(library.trim)]
        self.of_term = np.arange(len(self.terms))[:, None] == np.repeat(np.arange(len(widths)), widths)
        """(terms, k) which columns are whose."""

    @cached_property
    def acting(self) -> list[tuple[Columns, Array]]:
        """Of every channel the numbers of the columns that act on it (m,), among those of the set, and these (m, n)."""
        out = []
        for c in self.library.channels:
            local = c.where[self.columns]
            on = np.flatnonzero(local >= 0)
            out.append((on, c.rows[local[on]]))
        return out
