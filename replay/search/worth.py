"""What deserves a name: contributions of a set's terms against the weight, each other, and physical bounds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import accumulate, pairwise

import numpy as np
from scipy.special import log_ndtr

from models.frames import Array
from replay.search.channel import Channel, Columns
from replay.search.library import Library
from replay.search.terms import STEP_S, Term

FORM_LEFT = 0.06
"""RMS that an effect leaves by its error of form, as a share of its own."""
CURVE_FORM = 1.2
"""What a free curve may leave by its form, as a share of its own: it has no mean, and what is beside it may be that."""
SLOW_S = 2.0
"""What is left is averaged over this time before it counts as acting unexplained [s]."""
SOFT = 0.02
"""Width of the threshold of attention, as a share of it: a size on the threshold must not decide by its last digits."""
CANCEL, CANCEL_COST, CANCEL_FREE = 2.6, 40.0, 2.0
"""Terms (root of the sum of squares) may exceed what they take off together by this factor; each more costs so much.

What is below ``CANCEL_FREE`` hundredths of the weight does not count.
"""


class Contributions:
    """What every term of a set does to every channel it acts on; ``b`` (k,) with the trims behind."""

    def __init__(self, library: Library, terms: Sequence[Term], b: Array) -> None:
        self.library = library
        self.terms = terms
        self._b = b
        self._edges = list(accumulate((len(t.columns) for t in terms), initial=0))
        columns = np.concatenate([*(t.columns for t in terms), library.trim])
        self._on: list[Columns] = []
        self._x: list[Array] = []
        self.rest: list[Array] = []
        """What the set leaves of every channel, (n,) each."""
        for channel in library.channels:
            local = channel.where[columns]
            on = np.flatnonzero(local >= 0)
            x = channel.x.T[local[on]]
            self._on.append(on)
            self._x.append(x)
            self.rest.append(channel.y - b[on] @ x)
        self.whole = self._acting(b)
        """(term, channel) to (n,)."""

    def _acting(self, b: Array) -> dict[tuple[int, int], Array]:
        return {
            (i, c): b[on[begin:end]] @ x[begin:end]
            for c, (on, x) in enumerate(zip(self._on, self._x, strict=True))
            for i, begin, end in self._places(on)
        }

    def _places(self, on: Columns) -> Iterator[tuple[int, int, int]]:
        """Terms that act on a channel, and from where to where their columns are among those of the channel."""
        at = np.searchsorted(on, self._edges).tolist()
        for i, (begin, end) in enumerate(pairwise(at)):
            if begin < end:
                yield i, begin, end

    @cached_property
    def main(self) -> dict[tuple[int, int], Array]:
        """As ``whole``, of the coefficients that make the effect what it is, no farther than their bounds."""
        possible = self._b.copy()
        for term, part in zip(self.terms, map(slice, self._edges, self._edges[1:]), strict=True):
            main = term.main if (term.main == 0.0).any() else np.ones_like(term.main)
            possible[part] = np.clip(self._b[part], term.low, term.high) * main
        return self._acting(possible)


def form_variance(u: Contributions) -> Array:
    """Variance (channels,) of what is left by the effects' errors of form."""
    out = np.zeros(len(u.library.channels))
    for (i, c), own in u.whole.items():
        if u.terms[i].effect is not None:
            count = max(u.library.channels[c].count, 1)  # what is not valid is 0
            out[c] += FORM_LEFT**2 * max(float(own @ own) / count - (float(own.sum()) / count) ** 2, 0.0)
    return out


def worth(u: Contributions) -> float:
    """Log factor of a set for what is too small to be named, softly, and for what cancels.

    - 1/2 sum max((1 - z) / SOFT, 0)^2 - CANCEL_COST max(k - CANCEL, 0)

    over the terms, with z of ``standing`` and k of ``cancelled``. It is no part of the posterior but a loss: a name
    that nobody could act on is worth nothing.
    """
    short = np.maximum(1.0 - standing(u), 0.0) / SOFT
    return float(-0.5 * short @ short - CANCEL_COST * max(cancelled(u) - CANCEL, 0.0))


def cancelled(u: Contributions) -> float:
    """Contributions over what they take off together, on the axis where that ratio is largest.

    k^2 = sum |u_i|^2 / (|sum u_i|^2 + n (CANCEL_FREE l)^2), u_i (n,) what a term does and l a hundredth of the weight.
    """
    worst = 0.0
    for c, channel in enumerate(u.library.channels):
        parts = [own for (_, at), own in u.whole.items() if at == c]
        if len(parts) > 1:
            both = float((np.sum(parts, axis=0) ** 2).sum()) + channel.count * (CANCEL_FREE * channel.limit) ** 2
            worst = max(worst, float(np.sqrt(sum(float(p @ p) for p in parts) / both)))
    return worst


def standing(u: Contributions) -> Array:
    """How far every term stands out, (terms,): 1 is just worth a name.

    z = max over channels of T / sqrt(1 + F^2 + R^2). In hundredths of the weight: T the top of what a term does, F what
    the other terms may leave by their form, R the slow rest.
    """
    if not u.terms:
        return np.empty(0)
    channels = u.library.channels
    tops = np.zeros((len(u.terms), len(channels)))
    for (i, c), part in u.main.items():
        tops[i, c] = top(part, channels[c].count) / channels[c].limit
    form = np.array([CURVE_FORM if t.effect is None else t.effect.form for t in u.terms])
    left = (tops * form[:, None]) ** 2
    open_ = np.array([slow_rms(e, c) / c.limit for e, c in zip(u.rest, channels, strict=True)])
    beside = left.sum(axis=0) - left + open_**2
    return np.asarray((tops / np.sqrt(1.0 + beside)).max(axis=1))


def slow_rms(rest: Array, channel: Channel) -> float:
    """RMS of what is left of a channel, averaged over ``SLOW_S``."""
    width = max(round(SLOW_S / STEP_S), 1)
    total, known = (np.concatenate([[0.0], np.cumsum(v)]) for v in (rest, channel.valid))
    mean = (total[width:] - total[:-width]) / np.maximum(known[width:] - known[:-width], 1.0)
    return float(np.sqrt(mean @ mean / max(len(mean), 1)))


def top(x: Array, count: int) -> float:
    """About the 99th percentile of the size of (n,), of which ``count`` samples are valid and the rest 0."""
    size = np.abs(x)
    m = max(count // 100, 1)
    return float(np.partition(size, -m)[-m])


def beyond_bounds(terms: Sequence[Term], b: Array, cov: Array) -> float:
    """Log share of the posterior within the bounds, over that of the prior, coefficient by coefficient.

    sum log(Phi((h - m) / s) - Phi((l - m) / s)) of N(m, s) between l and h, less the same of the prior: the factor by
    which truncating both changes the evidence (Klugkist & Hoijtink 2007, Comput. Stat. & Data Analysis 51, 6367).
    """
    if not terms:
        return 0.0
    low, high, mean = (np.concatenate(v) for v in zip(*((t.low, t.high, t.centre) for t in terms), strict=True))
    k = len(low)
    sd = np.sqrt(np.diag(cov)[:k])
    return float((_log_mass(low, high, b[:k], sd) - _log_mass(low, high, mean, np.ones(k))).sum())


def _log_mass(low: Array, high: Array, mean: Array, sd: Array) -> Array:
    """Log of the probability of N(mean, sd) between low and high, element by element."""
    lo, hi = np.maximum((low - mean) / sd, -1e8), np.minimum((high - mean) / sd, 1e8)
    flip = lo > 0.0
    lo, hi = np.where(flip, -hi, lo), np.where(flip, -lo, hi)
    upper, lower = log_ndtr(hi), log_ndtr(lo)
    return np.asarray(upper + np.log1p(-np.exp(np.minimum(lower - upper, -1e-12))))
