"""The design matrix of a set of terms: its columns on every channel, the trims behind those of the terms."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import accumulate

import numpy as np

from models.common.frames import Array
from replay.search.channel import Columns, ResidualChannel, Whitened
from replay.search.library import Library
from replay.search.terms import Term


class Design:
    """``columns`` (k,) of the library with prior means ``centre`` (k,); ``edges`` (terms + 1,): first one of each."""

    def __init__(self, library: Library, terms: Sequence[Term]) -> None:
        self.library = library
        self.terms = tuple(terms)
        columns = [*(t.columns for t in terms), library.trim]
        centres = [*(t.centre for t in terms), np.zeros(len(library.trim))]
        self.columns = np.concatenate(columns)
        self.centre = np.concatenate(centres)
        widths = [len(part) for part in columns]
        self.edges = list(accumulate(widths[:-1], initial=0))
        term_of_column = np.repeat(np.arange(len(widths)), widths)
        self.of_term = np.arange(len(terms))[:, None] == term_of_column
        """(terms, k) which columns are whose."""
        self.products: dict[Whitened, Array] = {}
        """Inner products of residual and columns (1 + k, 1 + k), as far as they were needed."""

    @cached_property
    def _acting(self) -> list[list[tuple[Columns, Array]]]:
        """Of every axis of every flight the columns that act on it, by their numbers (m,), and their rows (m, n)."""
        out = []
        for axes in self.library.flights:
            out.append([self._acting_on(channel) for channel in axes])
        return out

    def _acting_on(self, channel: ResidualChannel) -> tuple[Columns, Array]:
        rows = channel.where[self.columns]
        acting = np.flatnonzero(rows >= 0)
        return acting, channel.rows[rows[acting]]

    def times(self, b: Array) -> list[Array]:
        """What rows of coefficients (m, k) do on every flight, (axes, m, n)."""
        out = []
        for axes in self._acting:
            _, first = axes[0]
            samples = first.shape[1]
            product = np.empty((len(axes), len(b), samples))
            for number, (acting, x) in enumerate(axes):
                np.matmul(b[:, acting], x, out=product[number])
            out.append(product)
        return out
