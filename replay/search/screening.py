"""How much every term of the library would add to the evidence of a set, by an update of the set's posterior.

For a term with columns X and prior mean c, beside a set with columns A and the posterior N(m, S) of its coefficients,
the gain in log evidence with the noise kept is

    1/2 (v^T P^-1 v - c^T c - log det P),  P = I + X^T W X - X^T W A S A^T W X,  v = X^T W (y - A m) + c

P is Schur's complement: the posterior precision of the term's coefficients once those of the set are integrated out.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from models.common.frames import Array
from replay.search.channel import Columns, Whitened
from replay.search.library import Alike, Library

WhitenedChannels = Sequence[tuple[Whitened, float]]
"""Every channel through the filter of its noise, and the variance of that."""


class Screening:
    """Inner products of the terms of some groups (K columns in all) with a set and with what it leaves."""

    def __init__(
        self,
        library: Library,
        set_columns: Columns,
        groups: Sequence[Alike],
        channels: WhitenedChannels,
    ) -> None:
        self._groups = groups
        self._channels = channels
        self._count = len(library.terms)
        columns = [group.columns.ravel() for group in groups]
        self._columns = np.unique(np.concatenate(columns))
        self._x_bias = library.x_bias[:, self._columns]
        self._with_residual = library.bias @ self._x_bias
        """X^T W y (K,)."""
        self._with_set = library.x_bias[:, set_columns].T @ self._x_bias
        """A^T W X (k, K)."""
        for white, variance in channels:
            row_of = white.channel.where
            residual_and_set = np.concatenate([[0], row_of[set_columns]])
            products = white.between(residual_and_set, row_of[self._columns]) / variance
            self._with_residual += products[0]
            self._with_set += products[1:]

    def gains(self, mean: Array, cov: Array) -> Array:
        """Of every term of the library (terms,) by the set's posterior; NaN of those in none of the groups."""
        out = np.full(self._count, np.nan)
        with_rest = self._with_residual - mean @ self._with_set
        regression = (cov @ self._with_set).T
        for group in self._groups:
            at = np.searchsorted(self._columns, group.columns)
            taken_by_set = regression[at] @ self._with_set[:, at].transpose(1, 0, 2)
            precision = self._precision(group, at, taken_by_set)
            v = with_rest[at] + group.centre
            out[group.numbers] = _gain(precision, v, group.centre)
        return out

    def _precision(self, group: Alike, at: Columns, taken_by_set: Array) -> Array:
        """P of every term of a group (t, k, k), whose columns stand ``at`` (t, k) among those of all groups."""
        width = group.columns.shape[1]
        bias = self._x_bias[:, at].transpose(1, 2, 0)
        precision = np.eye(width) - taken_by_set
        precision += bias @ bias.transpose(0, 2, 1)
        for white, variance in self._channels:
            rows = white.channel.where[group.columns]
            precision += white.within(rows) / variance
        return precision


def _gain(precision: Array, v: Array, centre: Array) -> Array:
    """1/2 (v^T P^-1 v - c^T c - log det P) of terms (t,) with ``precision`` (t, k, k), v and c (t, k)."""
    mean = np.linalg.solve(precision, v[..., None])[..., 0]
    v_p_v = (v * mean).sum(axis=1)
    c_c = (centre**2).sum(axis=1)
    _, log_det = np.linalg.slogdet(precision)
    return np.asarray(0.5 * (v_p_v - c_c - log_det))
