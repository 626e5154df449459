"""What a joint look takes back: two names for one thing, names without need, and stand-ins for strangers."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from models.frames import AXES, Array
from replay.search.forward import SMALLEST_GAIN
from replay.search.free_curves import Channel
from replay.search.library import Candidate, columns_of, freedom
from replay.search.shapes import refined
from replay.search.workspace import CARRIES, THRUST_TO_MASS, Workspace

CONSTANT = 0.1
"""Share of an effect's energy that varies, below which it is a constant."""
MERGED = 0.9
"""One effect in place of two has to keep this much of what the smaller one adds."""
WORSE = 0.1
"""Share by which the held-out energy of an axis may grow before it tells against what carries that axis."""
FELT = 0.1
"""Of the smallest wrench worth a name: what an axis grows by less than this tells against nothing. A simulated flight's
yaw torque is quiet to 1e-4 N m, and any wall or ground model is off by more."""
MEAN_OF_CURVE = 2.0
"""A constant below so many times the RMS of an unknown curve on its axis may be that curve's mean."""


def merged(w: Workspace, chosen: list[Candidate], p_of: dict[str, float]) -> list[Candidate]:
    """One effect in place of two where it, with less freedom, does nearly as well: a drift is no scale with a step."""
    full = w.gram.held_out(columns_of(chosen)).sum()
    names, costs = {c.effect.name for c in chosen}, w.costs(chosen)
    for (one, cost), (other, other_cost) in combinations(zip(chosen, costs, strict=True), 2):
        rest = [c for c in chosen if c is not one and c is not other]
        columns = columns_of(rest)
        for rival in w.scores(w.gram, columns, names - {one.effect.name, other.effect.name}):
            if rival.candidate.effect in (one.effect, other.effect):
                continue
            if freedom(rival.candidate) >= freedom(one) + freedom(other):
                continue
            instead = refined(w, [*rest, rival.candidate])
            lost = float(w.gram.held_out(columns_of(instead)).sum() - full)
            if lost >= (1.0 - MERGED) * min(cost, other_cost):
                continue
            if w.kinematics(instead[-1], w.sizes(instead)[-1]) is None and sound(w, instead) == instead:
                name = rival.candidate.effect.name
                p_of[name] = max(p_of[c.effect.name] for c in (one, other))
                for c in (one, other):
                    w.reasons[c.effect.name] = (f"{name} does what it and another did", None)
                return merged(w, instead, p_of)
    return chosen


def backward(w: Workspace, chosen: list[Candidate]) -> list[Candidate]:
    """Drop what takes too little off its axes on held-out time beside the others."""
    while chosen:
        shares = []
        for candidate, size, cost in zip(chosen, w.sizes(chosen), w.costs(chosen), strict=True):
            others = columns_of([c for c in chosen if c is not candidate])
            own = w.contribution(candidate, size)
            shares.append(cost / w.energy_on_axes_of(own, w.rest(w.gram, others)))
        i = int(np.argmin(shares))
        if shares[i] >= SMALLEST_GAIN:
            break
        w.reasons[chosen[i].effect.name] = ("the other effects do as well without it", None)
        chosen = [c for c in chosen if c is not chosen[i]]
    return chosen


def sound(w: Workspace, chosen: list[Candidate]) -> list[Candidate]:
    """The final set, less what joint refits made implausible or what worsens an axis on held-out time."""
    while chosen:
        columns = columns_of(chosen)
        sizes = w.sizes(chosen)
        bad: tuple[Candidate, str] | None = None
        for candidate, size in zip(chosen, sizes, strict=True):
            reason = w.implausible(candidate, size) or w.late(candidate, size)
            if reason is None and not w.core_large(candidate, size):
                reason = f"its {' and '.join(candidate.effect.main)} are too small to matter"
            if reason is not None:
                bad = (candidate, reason)
                break
        if bad is None:
            valid = w.record.valid
            before, after = ((x[valid] ** 2).mean(axis=0) for x in (w.y, w.held_out(columns)))
            felt = np.sqrt(np.maximum(after - before, 0.0)) > FELT * w.worth_a_name
            grown = np.where(felt, after / before, 0.0)
            rms = np.array([w.strength(c, size) for c, size in zip(chosen, sizes, strict=True)])
            blamed = np.where(rms > CARRIES * rms.max(axis=1, keepdims=True), rms, 0.0)
            worst = np.where(blamed.any(axis=0), grown, 0.0)
            axis = int(worst.argmax())
            if worst[axis] < 1.0 + WORSE:
                return chosen
            name = AXES[w.record.axes[axis]]
            bad = (chosen[int(blamed[:, axis].argmax())], f"makes {name} worse on held-out time")
            lighter = _without_side_term(w, bad[0], sizes[chosen.index(bad[0])], axis)
            if lighter is not None:
                chosen = [lighter if c is bad[0] else c for c in chosen]
                continue
        w.reasons[bad[0].effect.name] = (bad[1], None)
        chosen = [c for c in chosen if c is not bad[0]]
    return chosen


def _without_side_term(w: Workspace, candidate: Candidate, size: Array, axis: int) -> Candidate | None:
    """The candidate without the side term that is strongest on an axis; None where it has none there."""
    effect = candidate.effect
    x = w.library.x[:, axis, candidate.columns][w.record.valid] * w.library.scale[candidate.columns]
    strength = np.mean((x * size) ** 2, axis=0)
    for i, coefficient in enumerate(effect.coefficients):
        if not effect.main or coefficient.name in effect.main:
            strength[i] = 0.0
    if not strength.any():
        return None
    lighter = w.library.without(candidate, int(strength.argmax()))
    w.take_in()
    return lighter


def believed(w: Workspace, chosen: list[Candidate]) -> list[Candidate]:
    """The set less what stands in for an unknown force, of which free curves find the rest."""
    while chosen:
        riddle = w.riddle(chosen)
        found = _weaker_than_curve(w, chosen) or _mean_of_curve(w, chosen, riddle) or _part_of_curve(w, chosen, riddle)
        if found is None:
            return chosen
        candidate, reason = found
        w.reasons[candidate.effect.name] = (reason, None)
        chosen = [c for c in chosen if c is not candidate]
    return chosen


def _weaker_than_curve(w: Workspace, chosen: list[Candidate]) -> tuple[Candidate, str] | None:
    """What takes less off an axis than a free curve still finds there."""
    free = w.free(chosen)
    if not free.significant:
        return None
    rest = w.rest(w.gram, columns_of(chosen))[w.record.valid]
    energy = rest.var(axis=0) * len(rest) / w.gram.noise.total**2
    doubtful: list[tuple[float, Candidate, Channel]] = []
    for candidate, size, cost in zip(chosen, w.sizes(chosen), w.costs(chosen), strict=True):
        own = w.contribution(candidate, size)[w.record.valid]
        for channel in free.channels:
            axis = w.record.axes.index(AXES.index(channel.axis))
            # Curves have no mean: they cannot stand for what hardly varies.
            varies = own[:, axis].var() > CONSTANT * (own[:, axis] ** 2).mean()
            if channel.axis in w.carries(candidate, size) and varies and channel.score * energy[axis] > cost:
                doubtful.append((cost, candidate, channel))
    if not doubtful:
        return None
    _, candidate, channel = min(doubtful, key=lambda d: d[0])
    return candidate, f"a free curve in {channel.name} finds more in {channel.axis} than it explains"


def _mean_of_curve(w: Workspace, chosen: list[Candidate], riddle: tuple[Channel, ...]) -> tuple[Candidate, str] | None:
    """A scale or mass that may be the mean of an unknown force: curves have no mean."""
    rest = w.rest(w.gram, columns_of(chosen))[w.record.valid]
    for candidate, size in zip(chosen, w.sizes(chosen), strict=True):
        if candidate.effect.name not in THRUST_TO_MASS or not w.from_start(candidate):
            continue
        rms = np.sqrt((w.contribution(candidate, size)[w.record.valid] ** 2).mean(axis=0))
        for channel in riddle:
            axis = w.record.axes.index(AXES.index(channel.axis))
            curve = float(np.sqrt(channel.score) * rest[:, axis].std())
            if channel.axis in w.carries(candidate, size) and rms[axis] < MEAN_OF_CURVE * curve:
                return candidate, f"may be the mean of an unknown force in {channel.axis} that goes with {channel.name}"
    return None


def _part_of_curve(w: Workspace, chosen: list[Candidate], riddle: tuple[Channel, ...]) -> tuple[Candidate, str] | None:
    """What one unknown force alone does as well as the effect and an unknown force, if of another channel."""

    def left(channel: Channel, beside: list[Candidate]) -> float:
        axis = w.record.axes.index(AXES.index(channel.axis))
        return (1.0 - channel.score) * float(w.rest(w.gram, columns_of(beside))[w.record.valid][:, axis].var())

    for candidate, size in zip(chosen, w.sizes(chosen), strict=True):
        carried = w.carries(candidate, size)
        others = [c for c in chosen if c is not candidate]
        for channel in (c for c in riddle if c.axis in carried):
            alone = next((c for c in w.free(others).channels if c.axis == channel.axis), None)
            if alone is None or alone.name in candidate.effect.channels:
                continue
            if left(alone, others) <= left(channel, chosen):
                return candidate, f"an unknown force in {alone.axis} that goes with {alone.name} does as well alone"
    return None
