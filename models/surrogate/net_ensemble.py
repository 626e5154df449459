"""The numpy forward pass of trained nets: all members and all six outputs as one stack."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from models.common.frames import Array

# Rows at a time: the hidden layer then stays in the processor's cache.
CHUNK = 512


class NetEnsemble:
    """K nets of n_in-n_hid-1 per component (the paper's 3-9-1), y = v . tanh(x W + b) + o, and their mean and spread.

    ``w1`` (K, 6, n_in, n_hid), ``b1`` (K, 6, n_hid), ``w2`` (K, 6, n_hid), ``b2`` (K, 6). A net narrower than n_hid is
    padded with zeros.
    """

    kind = "nets"

    def __init__(self, w1: Array, b1: Array, w2: Array, b2: Array) -> None:
        self.w1 = np.ascontiguousarray(w1, dtype=float)
        self.b1 = np.ascontiguousarray(b1, dtype=float)
        self.w2 = np.ascontiguousarray(w2, dtype=float)
        self.b2 = np.ascontiguousarray(b2, dtype=float)
        k, six, n_in, hidden = self.w1.shape
        nets = k * six
        self._inner = 2.0 * self.w1.reshape(nets, n_in, hidden)
        self._inner_shift = 2.0 * self.b1.reshape(nets, 1, hidden)
        self._outer = -2.0 * self.w2.reshape(nets, hidden, 1)
        self._outer_shift = (self.b2 + self.w2.sum(axis=-1)).reshape(nets, 1)

    def predict(self, x: Array) -> tuple[Array, Array]:
        """Mean and spread (standard deviation over members), each (n, 6), at inputs (n, n_in)."""
        mean = np.empty((len(x), 6))
        spread = np.empty((len(x), 6))
        for start in range(0, len(x), CHUNK):
            rows = slice(start, start + CHUNK)
            out = self.outputs(x[rows])
            # numpy's mean and std give the same sums, and take longer over few numbers.
            middle = np.add.reduce(out) / len(out)
            mean[rows] = middle
            out -= middle
            out *= out
            spread[rows] = np.sqrt(np.add.reduce(out) / max(len(out) - 1, 1))
        return mean, spread

    def outputs(self, x: Array) -> Array:
        """Each member's answer (K, n, 6) at inputs (n, n_in), with tanh(a) = 1 - 2 / (1 + e^(2a))."""
        z = np.matmul(x, self._inner)
        z += self._inner_shift
        with np.errstate(over="ignore"):
            np.exp(z, out=z)
        z += 1.0
        np.reciprocal(z, out=z)
        y = np.matmul(z, self._outer)[..., 0]
        y += self._outer_shift
        return np.asarray(y.reshape(*self.b2.shape, len(x)).transpose(0, 2, 1))

    def arrays(self) -> dict[str, Array]:
        """What weights.npz holds."""
        return {"w1": self.w1, "b1": self.b1, "w2": self.w2, "b2": self.b2}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Array]) -> NetEnsemble:
        """Inverse of ``arrays``."""
        return cls(arrays["w1"], arrays["b1"], arrays["w2"], arrays["b2"])
