"""The numpy forward pass of trained nets: all members and all six outputs as one stack."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from models.errors import ModelError
from models.frames import Array

# Rows at a time: the hidden layer then stays in the processor's cache.
CHUNK = 512
# A unit steeper than this everywhere in [-1, 1] is a step; e^600 is still a number.
LARGEST = 600.0
# Looked up once: at one point the calls cost more than the arithmetic.
_vecdot, _exp, _add, _reciprocal = np.vecdot, np.exp, np.add, np.reciprocal


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
        # One point: a = [x, 1] @ first, s = 1/(1 + e^(2a)), [s, 1] @ second = deviations (6, K) over sqrt(K - 1), then
        # the mean (6). tanh(a) = 1 - 2 s takes half the time of numpy's tanh; |2a| must stay below overflow at 700.
        # Units that nothing hangs on are left out.
        used = np.flatnonzero(self.w2)
        units = len(used)
        first = np.concatenate([self.w1.transpose(2, 0, 1, 3).reshape(n_in, -1), self.b1.reshape(1, -1)])[:, used]
        steepest = np.abs(2.0 * first).sum(axis=0)
        self._first = np.ascontiguousarray(2.0 * first * np.minimum(1.0, LARGEST / np.maximum(steepest, 1e-12)))
        outputs = np.zeros((units + 1, six, k))
        member, component, _ = np.unravel_index(used, self.w2.shape)
        outputs[np.arange(units), component, member] = -2.0 * self.w2.ravel()[used]
        outputs[units] = (self.b2 + self.w2.sum(axis=-1)).T
        mean = outputs.mean(axis=2)
        deviation = (outputs - mean[:, :, None]) / np.sqrt(max(k - 1, 1))
        self._second = np.asfortranarray(np.concatenate([deviation.reshape(units + 1, six * k), mean], axis=1))
        self._x = np.ones(n_in + 1)
        self._z = np.ones(units + 1)
        self._hidden = self._z[:units]
        buffer = np.empty(six * (k + 2))
        self._out, self._both, self._variance = buffer[: six * (k + 1)], buffer[six * k :], buffer[six * (k + 1) :]
        self._deviation = buffer[: six * k].reshape(six, k)
        self._one = np.ones(())

    def point(self, x0: float, x1: float, x2: float) -> Array:
        """Mean (6) and variance over members (6) at one input, shape (12,): a buffer that the next call overwrites."""
        x, hidden, deviation = self._x, self._hidden, self._deviation
        x[0] = x0
        x[1] = x1
        x[2] = x2
        x.dot(self._first, hidden)
        _exp(hidden, hidden)
        _add(hidden, self._one, hidden)
        _reciprocal(hidden, hidden)
        self._z.dot(self._second, self._out)
        _vecdot(deviation, deviation, self._variance)
        return self._both

    def few(self, x: Array) -> Array:
        """Mean (6) and variance over members (6) side by side, shape (n, 12), at few inputs with a one behind, (n, 4).

        The same sums as ``point`` in one product of matrices; the last bit may differ.
        """
        n, k = len(x), self.members
        hidden = np.ones((n, len(self._z)))
        z = hidden[:, :-1]
        _exp(x @ self._first, z)
        _add(z, self._one, z)
        _reciprocal(z, z)
        out = hidden @ self._second
        deviation = out[:, : 6 * k].reshape(n, 6, k)
        both = np.empty((n, 12))
        both[:, :6] = out[:, 6 * k :]
        _vecdot(deviation, deviation, both[:, 6:])
        return both

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
        z = np.matmul(x, 2.0 * self.w1.reshape(k * six, n_in, hidden))
        z += 2.0 * self.b1.reshape(k * six, 1, hidden)
        with np.errstate(over="ignore"):
            np.exp(z, out=z)
        z += 1.0
        np.reciprocal(z, out=z)
        y = np.matmul(z, -2.0 * self.w2.reshape(k * six, hidden, 1))[..., 0]
        y += (self.b2 + self.w2.sum(axis=-1)).reshape(k * six, 1)
        out: Array = y.reshape(k, six, len(x)).transpose(0, 2, 1)
        return out

    def arrays(self) -> dict[str, Array]:
        """What weights.npz holds."""
        return {"w1": self.w1, "b1": self.b1, "w2": self.w2, "b2": self.b2}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Array]) -> NetEnsemble:
        """Inverse of ``arrays``."""
        return cls(arrays["w1"], arrays["b1"], arrays["w2"], arrays["b2"])
