"""With the model or without it: two hypotheses about lift, pull or tilt, judged by how well each predicts.

Multiple-model estimation (Magill 1965, IEEE Trans. Automatic Control 10, 434): a Kalman filter for each, and the odds
of one against the other from the likelihoods of what they had not yet seen. What they are of: ``channel``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from companion.adaptation.apply import MOST
from companion.adaptation.channel import WITH_MODEL, WITHOUT_MODEL, Channel
from companion.adaptation.filter import ROBUST_SIGMAS, SURPRISED_BLOCKS, in_a_row
from companion.adaptation.near_map import MAP, cheeseman_bennett
from models.common.frames import Array

_EVIDENCE = 0.5
"""Of a block's log likelihood: neighbours are alike."""
_MOST_LOG_ODDS = 4.0
"""Bound of the odds, so that a model that was contradicted can come back: 0.02 to 0.98."""
_LOW_RADII = 1.6
"""Where the ground's lift is reported: low, and yet where most flights have been."""
_OPENED = 0.1
"""Of the prior's variance: what a block adds to that of steady things after a jump."""
_LEAST_LIKELY = ROBUST_SIGMAS**2
"""A hypothesis is charged no more than this for one axis of a block."""

Measurement = tuple[float, Array, float]
"""z, H (n,) and R: an axis of a block is z = H x + noise of variance R, x the state of a channel."""


class Belief(NamedTuple):
    """What is believed of one channel: ``mean`` (2, n) and ``covariance`` (2, n, n) as in ``Channel``, and the odds."""

    mean: Array
    covariance: Array
    log_odds: float
    """Of the model against none."""
    surprised: tuple[int, ...]
    """For how many blocks in a row each axis has been far off to one side of both."""
    waited_s: float = 0.0
    """Since something was taken in."""

    @property
    def probability(self) -> float:
        """Of the model."""
        return 1.0 / (1.0 + math.exp(-self.log_odds))


def initial(channel: Channel) -> Belief:
    """Before anything is seen in this flight."""
    return Belief(channel.mean, channel.covariance, 0.0, (0,) * len(channel.axes))


class Prediction(NamedTuple):
    """How well one hypothesis predicted a measurement, before it learns from it."""

    innovation: float
    """y = z - H x."""
    spread: float
    """S = H P H' + R, the variance of y."""
    sigmas: float
    """d = |y| / sqrt(S)."""
    weight: float
    """w = min(1, c / d), Huber's, with c = ``ROBUST_SIGMAS``."""

    @property
    def side(self) -> int:
        """On which side the measurement lies: 1 or -1."""
        if self.innovation > 0.0:
            return 1
        return -1

    @property
    def far(self) -> bool:
        """Whether it is further off than counts in full."""
        return self.sigmas > ROBUST_SIGMAS

    @property
    def gain(self) -> float:
        """w y / S: P H' times this is what the mean moves by."""
        return self.innovation * self.weight / self.spread

    @property
    def shrink(self) -> float:
        """sqrt(w (2 - w) / S): the outer square of P H' times this is what the covariance loses."""
        return math.sqrt((2.0 - self.weight) * self.weight / self.spread)

    @property
    def cost(self) -> float:
        """d^2 / 2, as far as it counts."""
        return min(0.5 * self.sigmas * self.sigmas, _LEAST_LIKELY)


def predicted(measured: float, expected: float, spread: float) -> Prediction:
    """Of z ``measured`` where H x is ``expected`` and S is ``spread``."""
    innovation = measured - expected
    sigmas = abs(innovation) / math.sqrt(spread)
    if sigmas > ROBUST_SIGMAS:
        weight = ROBUST_SIGMAS / sigmas
    else:
        weight = 1.0
    return Prediction(innovation, spread, sigmas, weight)


def learn(channel: Channel, judged: Belief, seconds: float, seen: Sequence[Measurement]) -> Belief:
    """One block on, by a measurement of each axis of the channel; an axis that is not a number tells nothing.

    Each hypothesis has its own mean x and covariance P. One axis after another, y, S, d and w as in ``Prediction``:

        K = w P H' / S
        x = x + K y
        P = (1 - K H) P (1 - K H)' + R K K' = P - w (2 - w) P H' H P / S      (Joseph's form, which holds for any gain)
        log odds = log odds + e (log(S_none / S_model) / 2 + d_none^2 / 2 - d_model^2 / 2),  e = ``_EVIDENCE``

    What is far off to the same side of both is a jump of something steady, and says nothing for either.
    """
    mean = judged.mean
    covariance = _later(channel, judged.covariance, seconds)
    log_odds = judged.log_odds
    surprised = []
    for (z, H, R), before in zip(seen, judged.surprised, strict=True):
        if not math.isfinite(z) or not R > 0.0:
            surprised.append(0)
            continue
        PH = covariance @ H
        model, none = _predictions(z, mean @ H, PH @ H, R)
        if model.far and none.far and model.side == none.side:
            mean = _jumped(channel, mean, covariance, PH, (model, none))
            surprised.append(in_a_row(before, model.side))
            continue
        mean = mean + np.array(((model.gain,), (none.gain,))) * PH
        # One product, symmetric to the last bit.
        PH *= np.array(((model.shrink,), (none.shrink,)))
        covariance -= PH[:, :, None] * PH[:, None, :]
        likelier = 0.5 * math.log(none.spread / model.spread) + none.cost - model.cost
        log_odds += _EVIDENCE * likelier
        surprised.append(0)
    if mean is not judged.mean:
        gain = float(mean[WITH_MODEL, channel.gain])
        mean[WITH_MODEL, channel.gain] = min(max(gain, 0.0), MOST)
    if max(surprised) >= SURPRISED_BLOCKS or min(surprised) <= -SURPRISED_BLOCKS:
        covariance = _opened(channel, covariance)
    log_odds = min(max(log_odds, -_MOST_LOG_ODDS), _MOST_LOG_ODDS)
    return Belief(mean, covariance, log_odds, tuple(surprised))


def _later(channel: Channel, covariance: Array, seconds: float) -> Array:
    """The covariance after some time. No variance grows beyond that before any flight."""
    out = covariance.copy()
    diagonal = out.reshape(2, -1)[:, :: out.shape[1] + 1]
    diagonal += np.minimum(
        channel.growth_1_s * seconds, np.maximum(channel.variance - diagonal, 0.0)
    )
    return out


def _predictions(
    z: float, expected: Array, spread: Array, R: float
) -> tuple[Prediction, Prediction]:
    """With the model and without it: ``expected`` (2,) H x, ``spread`` (2,) H P H'."""
    of_model, of_none = expected.tolist()
    spread_of_model, spread_of_none = spread.tolist()
    return (
        predicted(z, of_model, spread_of_model + R),
        predicted(z, of_none, spread_of_none + R),
    )


def _jumped(
    channel: Channel,
    mean: Array,
    covariance: Array,
    PH: Array,
    seen: tuple[Prediction, Prediction],
) -> Array:
    """The mean after something that came at once, which is no surface: a load, a hand, a gust; ``covariance`` becomes
    what it then is.

    Joseph's form, which is right for any gain: here that of the gain on the model, the ground and the map is zero. With
    K the gain, P = P - K (P H' - S K / 2)' - (P H' - S K / 2) K'.
    """
    y = np.array([[one.innovation] for one in seen])
    S = np.array([[one.spread] for one in seen])
    w = np.array([[one.weight] for one in seen])
    K = w / S * PH
    K[:, channel.gain :] = 0.0
    half = K[:, :, None] * (PH - 0.5 * S * K)[:, None, :]
    covariance -= half + half.transpose(0, 2, 1)
    out: Array = mean + y * K
    return out


def _opened(channel: Channel, covariance: Array) -> Array:
    """Less sure of what is steady: a load, a gust front, something that shifts in a bay."""
    out = covariance.copy()
    for k in range(channel.gain):
        more = np.maximum(channel.variance[:, k] - out[:, k, k], 0.0)
        out[:, k, k] += np.minimum(_OPENED * channel.variance[:, k], more)
    return out


def believed(channel: Channel, judged: Belief) -> tuple[float, float, list[float]]:
    """Gain on the model, the ground's lift in Cheeseman and Bennett's, and the map (CELLS,): both hypotheses' mean."""
    p = judged.probability
    gain = channel.gain
    mixed = (p * judged.mean[WITH_MODEL] + (1.0 - p) * judged.mean[WITHOUT_MODEL]).tolist()
    return mixed[gain], mixed[gain + 1], mixed[gain + 2 :]


def ground_measured(channel: Channel, judged: Belief) -> tuple[float, float]:
    """The ground's lift 1.6 radii above it, in Cheeseman and Bennett's, as measured without a model; and its sd."""
    row = np.zeros(channel.mean.shape[1])
    row[channel.gain + 1] = 1.0
    for k, weight in MAP.cells(_LOW_RADII, math.inf):
        row[channel.gain + 2 + k] = weight / cheeseman_bennett(_LOW_RADII)
    variance = float(row @ judged.covariance[WITHOUT_MODEL] @ row)
    return float(row @ judged.mean[WITHOUT_MODEL]), math.sqrt(max(variance, 0.0))
