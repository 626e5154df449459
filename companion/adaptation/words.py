"""What the pilot reads of the sizes: numbers for a ground station, a sentence where a model is contradicted."""

from __future__ import annotations

from collections.abc import Iterator

from companion.adaptation.adaptation import Adaptation
from companion.adaptation.judge import ground_measured
from companion.adaptation.sizes import GAINS, LIFT, channels

NAMED = (
    ("ad_gnd", "ground_lift"),
    ("ad_wall", "wall_pull"),
    ("ad_tilt", "wall_tilt"),
    ("ad_thr", "thrust_scale"),
    ("ad_wn", "wind_north"),
    ("ad_we", "wind_east"),
)
"""NAMED_VALUE_FLOAT and the size that it carries."""
_TELL = 0.25
_SURE = 2.0
"""A share that moved by so much is reported again, once the size is so many standard deviations from the model's."""
_CONTRADICTED = 0.5
"""Probability of the model in a channel, below which the pilot reads that it is contradicted."""


def named_values(known: Adaptation) -> Iterator[tuple[str, float]]:
    """(name of at most 10 characters, value): gains and thrust scale, 1 as modelled; wind in m/s."""
    sizes = known.estimates()
    for name, size in NAMED:
        yield name, sizes[size].value


def sentences(known: Adaptation, reported: dict[str, float]) -> Iterator[tuple[str, float, str]]:
    """(size, share, sentence) of every channel whose share has left what was last ``reported``."""
    for n, (k, share, learned) in enumerate(
        zip(channels(known.table), known.shares, known.learned, strict=True)
    ):
        size = known.table[k]
        before = reported.get(size.name, 1.0)
        ended = share == 0.0 < before
        if not learned or (abs(share - before) < _TELL and not ended):
            continue
        value = size.as_modelled + float(known.sizes.offset[k])
        sd = known.sizes.sd(k)
        if n < len(GAINS) and known.judged[n].probability < _CONTRADICTED:
            yield size.name, share, contradicted(size.name, value, known)
            continue
        back = abs(share - 1.0) < _TELL
        if not back and abs(value - 1.0) < _SURE * sd:
            continue
        yield size.name, share, sentence(size.name, value, share)


def contradicted(name: str, value: float, known: Adaptation) -> str:
    """``ground lift: model contradicted (0.1); measured as 0.8 of Cheeseman-Bennett``."""
    what = f"{name.replace('_', ' ')}: model contradicted ({value:.1f})"
    if name == GAINS[LIFT]:
        ground, sd = ground_measured(known.channels[LIFT], known.judged[LIFT])
        if abs(ground) > _SURE * sd:
            return f"{what}; measured as {ground:.1f} of Cheeseman-Bennett"
    return f"{what}; compensating what is measured"


def sentence(name: str, value: float, share: float) -> str:
    """``ground lift measured 0.2 of the model's: compensating with that``."""
    what = f"{name.replace('_', ' ')} measured {value:.1f} of the model's"
    if share < 0.05:
        return f"{what}: not compensating it"
    if value - share < 0.15:
        return f"{what}: compensating with that"
    return f"{what}: compensating with {share:.1f}"
