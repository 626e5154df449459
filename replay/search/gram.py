"""Least squares over many columns, block by block: what a search needs is small linear algebra."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from models.frames import Array
from replay.residual.record import Record
from replay.search.library import Columns
from replay.search.noise import FOLDS, Noise, block_numbers, embargo_blocks, fold_of_block, training_blocks, whiten

BLOCK_S = 1.5


class Gram:
    """Whitened and raw inner products of all columns, block by block; the search itself is small linear algebra."""

    def __init__(self, record: Record, x: Array, y: Array, noise: Noise) -> None:
        self.noise = noise
        valid = record.valid
        self.xw, _ = whiten(x, valid, noise)
        self.yw, _ = whiten(y, valid, noise)
        tau = float(np.max(noise.tau_s))
        self.block = block_numbers(valid, record.step_s, BLOCK_S)
        count = int(self.block.max()) + 1
        k = x.shape[2]
        coarse = self.block * min(count, 128) // count
        blocks = int(coarse.max()) + 1
        seconds = record.seconds / blocks
        self.folds = fold_of_block(blocks, seconds)
        self.embargo = embargo_blocks(float(np.median(noise.tau_s)), seconds)
        self.coarse = coarse
        self.w, self.wy = np.zeros((blocks, k, k)), np.zeros((blocks, k))
        self.r, self.ry, self.yy = np.zeros((blocks, k, k)), np.zeros((blocks, k)), np.zeros(blocks)
        sigma = noise.total
        for b in range(blocks):
            rows = coarse == b
            xb, yb = self.xw[rows].reshape(-1, k), self.yw[rows].reshape(-1)
            self.w[b], self.wy[b] = xb.T @ xb, xb.T @ yb
            use = rows & valid
            xr = (x[use] / sigma[:, None]).reshape(-1, k)
            yr = (y[use] / sigma).reshape(-1)
            self.r[b], self.ry[b], self.yy[b] = xr.T @ xr, xr.T @ yr, yr @ yr
        self.total_w, self.total_wy = self.w.sum(0), self.wy.sum(0)
        self.total_r, self.total_ry = self.r.sum(0), self.ry.sum(0)
        self.effective = max(record.seconds / tau, 10.0)

    def solve(self, columns: Columns, blocks: NDArray[np.bool_] | NDArray[np.int64] | None = None) -> Array:
        """Generalised least squares on (some of) the blocks."""
        if blocks is None:
            w, wy = self.total_w[np.ix_(columns, columns)], self.total_wy[columns]
        else:
            w, wy = self.w[blocks][:, columns][:, :, columns].sum(0), self.wy[blocks][:, columns].sum(0)
        out: Array = np.linalg.lstsq(w + 1e-9 * np.trace(w) / max(len(columns), 1) * np.eye(len(columns)), wy)[0]
        return out

    def size(self, columns: Columns, blocks: NDArray[np.bool_] | NDArray[np.int64] | None = None) -> Array:
        """Least squares weighted by axis only: sizes that errors of form in the fast part do not bend."""
        if not len(columns):
            return np.empty(0)
        if blocks is None:
            r, ry = self.total_r[np.ix_(columns, columns)], self.total_ry[columns]
        else:
            r, ry = self.r[blocks][:, columns][:, :, columns].sum(0), self.ry[blocks][:, columns].sum(0)
        out: Array = np.linalg.lstsq(r + 1e-9 * np.trace(r) / len(columns) * np.eye(len(columns)), ry)[0]
        return out

    def fold_coefficients(self, columns: Columns) -> list[Array]:
        """One fit a fold, each without the fold and its embargo."""
        return [self.size(columns, training_blocks(self.folds, f, self.embargo)) for f in range(FOLDS)]

    def held_out(self, columns: Columns) -> Array:
        """Energy left in every fold (FOLDS,) by fits that never saw it, in units of the noise."""
        energy = np.zeros(FOLDS)
        fits = self.fold_coefficients(columns) if len(columns) else [np.empty(0)] * FOLDS
        for f in range(FOLDS):
            rows = self.folds == f
            energy[f] = self.yy[rows].sum()
            if len(columns):
                b = fits[f]
                r = self.r[rows][:, columns][:, :, columns].sum(0)
                energy[f] += -2.0 * b @ self.ry[rows][:, columns].sum(0) + b @ r @ b
        return energy

    def project(self, selected: Columns, beside: Columns | None = None) -> tuple[Array, Array, Array]:
        """Schur complement of the selected columns (K, K), the map (s, K) to it, X^T e by flip block (blocks, K).

        ``e`` is what the selected columns leave of the residual, or, if given, the columns ``beside``.
        """
        count = int(self.block.max()) + 1
        taken = selected if beside is None else beside
        e = self.yw - (self.xw[:, :, taken] @ self.solve(taken) if len(taken) else 0.0)
        products = np.einsum("nak,na->nk", self.xw, e)
        parts = np.zeros((count, products.shape[1]))
        np.add.at(parts, self.block, products)
        if not len(selected):
            return self.total_w, np.zeros((0, products.shape[1])), parts
        ws = self.total_w[np.ix_(selected, selected)]
        cross = self.total_w[selected]
        mapping = np.linalg.solve(ws + 1e-9 * np.trace(ws) / len(selected) * np.eye(len(selected)), cross)
        return self.total_w - cross.T @ mapping, mapping, parts - parts[:, selected] @ mapping


def inverse(schur: Array, total: Array, columns: Columns) -> Array:
    """Inverse of a candidate's Schur block; zero where the selected columns leave nothing of it."""
    block = schur[np.ix_(columns, columns)]
    own = np.diag(total)[columns]
    live = (own > 1e-9) & (np.diag(block) > 0.01 * own)
    out = np.zeros_like(block)
    if len(columns) == 1:
        return np.where(live, 1.0 / np.where(live, block, 1.0), 0.0)
    if live.any():
        out[np.ix_(live, live)] = np.linalg.pinv(block[np.ix_(live, live)], rcond=1e-6, hermitian=True)
    return out
