"""The numpy forward pass of trained nets: all members and all six outputs as one stack."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from models.errors import ModelError
from models.wrench import Array

CHUNK = 8192


class NetEnsemble:
    """K nets of n_in-n_hid-1 per component (the paper's 3-9-1), y = v . tanh(x W + b) + o, and their mean and spread.

    ``w1`` (K, 6, n_in, n_hid), ``b1`` (K, 6, n_hid), ``w2`` (K, 6, n_hid), ``b2`` (K, 6). A net narrower than n_hid is
    padded with zeros. Not safe to share between threads: a single point is computed in buffers of its own.
    """

    kind = "nets"

    def __init__(self, w1: Array, b1: Array, w2: Array, b2: Array) -> None:
        self.w1, self.b1, self.w2, self.b2 = (np.ascontiguousarray(a, dtype=float) for a in (w1, b1, w2, b2))
        k, six, n_in, hidden = self.w1.shape
        if self.b1.shape != (k, six, hidden) or self.w2.shape != (k, six, hidden) or self.b2.shape != (k, six):
            raise ModelError("weights.npz: the arrays of the nets do not fit each other; train the model again")
        self.members = k
        units = k * six * hidden
        # One point: [x, 1] @ first -> tanh -> [z, 1] @ second = mean (6), then deviations (K, 6) over sqrt(K - 1).
        self._first = np.concatenate([self.w1.transpose(2, 0, 1, 3).reshape(n_in, units), self.b1.reshape(1, units)])
        outputs = np.zeros((units + 1, k, six))
        for i in range(k):
            for c in range(six):
                start = (i * six + c) * hidden
                outputs[start : start + hidden, i, c] = self.w2[i, c]
        outputs[units] = self.b2
        mean = outputs.mean(axis=1)
        deviation = (outputs - mean[:, None, :]) / np.sqrt(max(k - 1, 1))
        self._second = np.ascontiguousarray(np.concatenate([mean, deviation.reshape(units + 1, k * six)], axis=1))
        self._mean_only = np.ascontiguousarray(mean)
        self._x = np.ones(n_in + 1)
        self._z = np.ones(units + 1)
        self._hidden = self._z[:units]
        self._out = np.empty(six * (k + 1))
        self._mean = self._out[:six]
        self._deviation = self._out[six:].reshape(k, six)
        self._squares = np.empty((k, six))
        self._spread = np.empty(six)

    def point(self, x: tuple[float, float, float]) -> tuple[Array, Array]:
        """Mean (6,) and spread (6,) at one input; both are buffers that the next call overwrites."""
        self._x[:3] = x
        np.dot(self._x, self._first, out=self._hidden)
        np.tanh(self._hidden, out=self._hidden)
        np.dot(self._z, self._second, out=self._out)
        np.multiply(self._deviation, self._deviation, out=self._squares)
        np.add.reduce(self._squares, axis=0, out=self._spread)
        np.sqrt(self._spread, out=self._spread)
        return self._mean, self._spread

    def predict(self, x: Array) -> tuple[Array, Array]:
        """Mean and spread (standard deviation over members), each (n, 6), at inputs (n, n_in)."""
        mean, spread = np.empty((len(x), 6)), np.empty((len(x), 6))
        for start in range(0, len(x), CHUNK):
            out = self.outputs(x[start : start + CHUNK])
            mean[start : start + CHUNK] = out.mean(axis=0)
            spread[start : start + CHUNK] = out.std(axis=0, ddof=1) if self.members > 1 else 0.0
        return mean, spread

    def outputs(self, x: Array) -> Array:
        """Each member's answer (K, n, 6) at inputs (n, n_in)."""
        k, six, n_in, hidden = self.w1.shape
        z = np.matmul(x, self.w1.reshape(k * six, n_in, hidden))
        z += self.b1.reshape(k * six, 1, hidden)
        np.tanh(z, out=z)
        y = np.matmul(z, self.w2.reshape(k * six, hidden, 1))[..., 0] + self.b2.reshape(k * six, 1)
        out: Array = y.reshape(k, six, len(x)).transpose(0, 2, 1)
        return out

    def arrays(self) -> dict[str, Array]:
        """What weights.npz holds."""
        return {"w1": self.w1, "b1": self.b1, "w2": self.w2, "b2": self.b2}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Array]) -> NetEnsemble:
        """Inverse of ``arrays``."""
        return cls(arrays["w1"], arrays["b1"], arrays["w2"], arrays["b2"])
