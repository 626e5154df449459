"""A set of terms on the channels: which of its columns act where, and all of them as rows of one array per flight."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from models.frames import Array
from replay.residual.grid import Mask
from replay.search.channel import Columns, Flight
from replay.search.library import Library
from replay.search.terms import Term


@dataclass(frozen=True)
class FlightRows:
    """What a set does on one flight: one row for every column on every channel that it acts on.

    A pair is a term and a channel that it acts on. ``a @ x`` with ``a`` = the coefficients where a mask holds, else 0,
    is what the terms do together on every channel, or what every pair does.
    """

    flight: Flight
    x: Array
    """(rows, n)."""
    column: Columns
    """Of every row, among those of the set."""
    of_channel: Mask
    """(channels, rows)."""
    of_pair: Mask
    """(pairs, rows)."""
    term: NDArray[np.int64]
    """Of every pair."""
    channel: NDArray[np.int64]
    """Of every pair, among those of the flight."""

    def rest(self, b: Array) -> Array:
        """What a set with coefficients ``b`` leaves of every channel, (channels, n)."""
        return np.asarray(self.flight.y - np.where(self.of_channel, b[self.column], 0.0) @ self.x)

    def acting(self, b: Array) -> Array:
        """What every pair does, (pairs, n)."""
        return np.asarray(np.where(self.of_pair, b[self.column], 0.0) @ self.x)


class Design:
    """The columns of some terms, the trims behind them."""

    def __init__(self, library: Library, terms: Sequence[Term]) -> None:
        self.library = library
        self.terms = tuple(terms)
        self.edges = list(accumulate((len(t.columns) for t in terms), initial=0))
        self.columns = np.concatenate([*(t.columns for t in terms), library.trim])
        self.centre = np.concatenate([*(t.centre for t in terms), np.zeros(len(library.trim))])
        places = [c.where[self.columns] for c in library.channels]
        self.on = [np.flatnonzero(p >= 0) for p in places]
        """Of every channel the columns that act on it, among those of the set."""
        self.local = [p[on] for p, on in zip(places, self.on, strict=True)]
        """The same columns, by their places in the channel."""

    @cached_property
    def flights(self) -> list[FlightRows]:
        """The rows of every flight."""
        return [self._rows(flight) for flight in self.library.flights]

    def _rows(self, flight: Flight) -> FlightRows:
        on, local = self.on[flight.numbers], self.local[flight.numbers]
        column = np.concatenate(on)
        channel = np.repeat(np.arange(len(on)), [len(part) for part in on])
        term = np.searchsorted(self.edges, column, "right") - 1  # the trims come after the last term
        pairs = np.unique((term * len(on) + channel)[term < len(self.terms)])
        term_of, channel_of = pairs // len(on), pairs % len(on)
        return FlightRows(
            flight,
            np.concatenate([c.x.T[part] for c, part in zip(flight.channels, local, strict=True)]),
            column,
            np.arange(len(on))[:, None] == channel,
            (term_of[:, None] == term) & (channel_of[:, None] == channel),
            term_of,
            channel_of,
        )
