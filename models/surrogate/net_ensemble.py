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
        self.w1, self.b1, self.w2, self.b2 = (
            np.ascontiguousarray(a, dtype=float) for a in (w1, b1, w2, b2)
        )
        k, six, n_in, hidden = self.w1.shape
        self._inner = 2.0 * self.w1.reshape(k * six, n_in, hidden)
        self._inner_shift = 2.0 * self.b1.reshape(k * six, 1, hidden)
        self._outer = -2.0 * self.w2.reshape(k * six, hidden, 1)
        self._outer_shift = (self.b2 + self.w2.sum(axis=-1)).reshape(k * six, 1)

    def predict(self, x: Array) -> tuple[Array, Array]:
        """Mean and spread (standard deviation over members), each (n, 6), at inputs (n, n_in)."""
        mean = np.empty((len(x), 6))
        spread = np.empty((len(x), 6))
        for start in range(0, len(x), CHUNK):
            out = self.outputs(x[start : start + CHUNK])
            middle = out.mean(axis=0)
            mean[start : start + CHUNK] = middle
            if len(out) > 1:
                spread[start : start + CHUNK] = out.std(axis=0, ddof=1, mean=middle[None])
            else:
                spread[start : start + CHUNK] = 0.0
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
