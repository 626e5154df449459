"""What held-out time takes away from the likeliest set: whole sets, effects, and axes of effects (steps 5 to 9)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import product

import numpy as np

from models.common.frames import AXES
from models.effects import Effect
from replay.search.estimates import SIDE, mean_and_spread
from replay.search.evidence import Fit
from replay.search.held_out import FlightFit, flight_fits
from replay.search.posterior import Walked, aliases
from replay.search.terms import Key, Term
from replay.search.thresholds import HELD_OUT, LIKELY, NEAR, RIVALS, WORSE_SHARE
from replay.search.walk import with_aliases

WORSE = "it makes the error on held-out time larger"
TOO_SMALL = "too small: below 1 % of the weight, and below a tenth of the error on every axis"
UNLIKELY = "less likely than not, among all sets that were weighed"
ONLY_A_PART = "what it has besides a part of it is not told from zero"
"""Why an effect was taken out."""
AxesOfKeys = dict[Key, tuple[str, ...]]


def predictive(walked: Walked) -> Walked:
    """Pass over sets that fit well and leave far more of held-out time than others: they cancel or chase noise.

    The likeliest set is taken whose energy of held-out time is no more than ``HELD_OUT`` times the least. More effects
    of the same kind always leave less: whether they are large enough to be named is decided already.
    """
    rivals = _rivals(walked)
    left = {fit.key: _left(flight_fits(walked.evidence, fit)) for fit in rivals}
    most = HELD_OUT * min(left.values())
    chosen = next(fit for fit in rivals if left[fit.key] <= most)
    if chosen.key == walked.best.key:
        return walked
    return walked.at_most(chosen)


def helpful(walked: Walked) -> tuple[Walked, list[FlightFit]]:
    """The best set without the effects that raise the error of held-out time, and every flight under it."""
    fits = flight_fits(walked.evidence, walked.best)
    gains = {t.key: share(fits, t.key) for t in walked.best.of_effects}
    worst = min(gains, key=lambda key: gains[key], default=None)
    if worst is None or gains[worst] > -WORSE_SHARE:
        return walked, fits
    return helpful(walked.without([worst], WORSE))


def acting(walked: Walked) -> tuple[Walked, list[FlightFit], AxesOfKeys]:
    """The best set with every effect on the axes that it helps; by key, the axes on which it does not act.

    What acts on none of the axes that it carries, or not on all of those on which it acts alike, is no name: the
    set is weighed again without it. What contains another effect is that one, where the coefficients that make it
    act nowhere, or are not told from zero. Nor is what is small in every part of every flight, or what most of
    the weighed sets do without.
    """
    walked, whole = helpful(walked)
    terms = walked.best.of_effects
    joint_names = corrected_together(t.named for t in terms)
    joint = [t.key for t in terms if t.name in joint_names]
    single = [t.key for t in terms if t.name not in joint_names]
    fits, without = _by_axis(whole, single)
    of_joint = set[str]()
    for key in joint:
        of_joint |= carried(whole, key)
    for axis in _worse_axes(fits):
        # A map and its laws leave an axis as one, where it is none of theirs.
        if AXES[axis] not in of_joint:
            fits = [_without(fit, joint, axis) for fit in fits]
            for key in joint:
                without[key] = (*without.get(key, ()), AXES[axis])
    idle = []
    for term in terms:
        nowhere = set(without.get(term.key, ()))
        divided = not nowhere.isdisjoint(term.named.together)
        if divided or (nowhere and _decisive_axes(whole, term) <= nowhere):
            idle.append(term.key)
    if idle:
        worst = min(idle, key=lambda key: (share(whole, key), str(key)))
        return acting(walked.without([worst], WORSE))
    least = _least_small(terms, fits)
    if least:
        return acting(walked.without(least, TOO_SMALL))
    unlikely = least_likely(walked)
    if unlikely:
        return acting(walked.without(unlikely, UNLIKELY))
    parts = only_parts(walked, fits)
    if parts:
        return acting(walked.without(parts, ONLY_A_PART))
    exchanged = with_aliases(walked)
    if exchanged.best.key != walked.best.key:
        return acting(exchanged)
    return exchanged, fits, without


def only_parts(walked: Walked, fits: Sequence[FlightFit]) -> list[Key]:
    """Terms that contain another effect and are no more than that: what they have besides is not told from zero.

    A wind of which no flight knows that it blows is the drag of the rotors.
    """
    out = []
    for term in walked.best.of_effects:
        acts = [fit for fit in fits if term.key in fit.effects]
        if term.named.contains and not any(_told(walked, term, fit) for fit in acts):
            out.append(term.key)
    return out


def _told(walked: Walked, term: Term, fit: FlightFit) -> bool:
    """Whether the 95 % interval of one of the main coefficients leaves out zero."""
    effect = term.named
    mean, sd = mean_and_spread(walked, term, fit)
    main = [c.name in effect.main_names for c in effect.coefficients]
    return bool(np.any(np.abs(mean[main]) > SIDE * sd[main]))


def least_likely(walked: Walked) -> list[Key]:
    """Terms of the effect that is least likely to act, it or an alias; empty where each is likelier than not.

    The likeliest set may hold an effect that most of the others lack: the median probability model (Barbieri and
    Berger 2004, Annals of Statistics 32, 870) does not.
    """
    others = aliases(walked)
    chances: dict[str, float] = {}
    keys_of: dict[str, list[Key]] = {}
    for term in walked.best.of_effects:
        chance = walked.probability(term.name, others[term.key])
        chances[term.name] = max(chance, chances.get(term.name, 0.0))
        keys_of.setdefault(term.name, []).append(term.key)
    name = min(chances, key=lambda one: chances[one], default=None)
    if name is None or chances[name] >= LIKELY:
        return []
    return keys_of[name]


def _least_small(terms: Sequence[Term], fits: Sequence[FlightFit]) -> list[Key]:
    """Terms of the effect that does least, of those too small for a name; empty where there is none.

    One that is large on one flight is named, and shown on all.
    """
    keys_of: dict[tuple[str, int], list[Key]] = {}
    for term in terms:
        keys_of.setdefault((term.name, term.instance), []).append(term.key)
    small = []
    for keys in keys_of.values():
        acts = [(fit, key) for fit in fits for key in keys if key in fit.effects]
        if all(fit.is_small(key) for fit, key in acts):
            small.append(keys)
    return min(small, key=lambda keys: sum(share(fits, key) for key in keys), default=[])


def corrected_together(effects: Iterable[Effect]) -> set[str]:
    """A map of surfaces and the laws that it corrects: only their sum is known well."""
    out: set[str] = set()
    for effect in effects:
        if effect.search.remainder:
            out.update((effect.name, *effect.aliases))
    return out


def share(fits: Sequence[FlightFit], key: Key, axes: Sequence[int] | None = None) -> float:
    """Share of the energy of held-out time, of all or of some axes, that one effect removes beside the others."""
    before, _ = _energies(fits, axes)
    gain = sum(fit.gain(key, axes) for fit in fits)
    return round(gain / max(before, 1e-12), 9)


def carried(fits: Sequence[FlightFit], key: Key) -> set[str]:
    """Axes on which an effect clearly acts."""
    out: set[str] = set()
    for fit in fits:
        if key in fit.effects:
            out.update(fit.effects[key].axes)
    return out


def _decisive_axes(fits: Sequence[FlightFit], term: Term) -> set[str]:
    """Axes of which the name needs one: where it acts clearly, or what makes it more than a part of it does."""
    if not term.named.contains:
        return carried(fits, term.key)
    out: set[str] = set()
    for fit in fits:
        if term.key in fit.effects:
            out.update(fit.effects[term.key].main_axes)
    return out


def _rivals(walked: Walked) -> list[Fit]:
    """The likeliest sets of effects, the best first; none that holds all effects of a likelier one."""
    out: dict[frozenset[str], Fit] = {}
    for fit in (walked.best, *walked.ranked()):
        names = frozenset(fit.effects)
        near = fit.score > walked.best.score - NEAR
        larger = any(other < names for other in out)
        if near and len(out) < RIVALS and not larger:
            out.setdefault(names, fit)
    return list(out.values())


def _left(fits: Sequence[FlightFit]) -> float:
    """Energy of held-out time beside a set; of an axis that it makes worse, as without it: it will not act there."""
    return sum(min(_energies(fits, [axis])) for axis in _judged(fits))


def _judged(fits: Sequence[FlightFit]) -> list[int]:
    """Axes that some flight can judge."""
    axes = set[int]()
    for fit in fits:
        axes.update(fit.record.axes)
    return sorted(axes)


def _energies(fits: Sequence[FlightFit], axes: Sequence[int] | None) -> tuple[float, float]:
    """Of held-out time, of all or of some axes, without and with all effects."""
    before = sum(fit.energy(fit.before, axes) for fit in fits)
    after = sum(fit.energy(fit.after, axes) for fit in fits)
    return before, after


def _worse_axes(fits: Sequence[FlightFit]) -> list[int]:
    """Axes of which all effects together raise the error of held-out time."""
    out = []
    for axis in _judged(fits):
        before, after = _energies(fits, [axis])
        raised = (after - before) / max(before, 1e-12)
        if raised > WORSE_SHARE:
            out.append(axis)
    return out


def _by_axis(fits: Sequence[FlightFit], keys: Sequence[Key]) -> tuple[list[FlightFit], AxesOfKeys]:
    """Every flight without effects on axes of which they raise the error of held-out time; by ``keys``, these axes.

    One after the other, the worst first: the others are judged beside what is left. Each may help beside the others
    while all together do harm: on such an axis the one that helps least goes, until they do none.
    """
    fits = list(fits)
    without: AxesOfKeys = {}
    while True:
        worse = _worse_axes(fits)
        harmful: dict[tuple[Key, int], float] = {}
        for key, axis in product(keys, _judged(fits)):
            if AXES[axis] in without.get(key, ()):
                continue
            gain = share(fits, key, [axis])
            harms_beside = axis in worse and _acts_on(fits, key, axis)
            if gain < -WORSE_SHARE or harms_beside:
                harmful[key, axis] = gain
        if not harmful:
            return fits, without
        key, axis = min(harmful, key=lambda pair: (harmful[pair], str(pair)))
        fits = [_without(fit, [key], axis) for fit in fits]
        without[key] = (*without.get(key, ()), AXES[axis])


def _acts_on(fits: Sequence[FlightFit], key: Key, axis: int) -> bool:
    return any(f.effects[key].held_out[:, axis].any() for f in fits if key in f.effects)


def _without(fit: FlightFit, keys: Sequence[Key], axis: int) -> FlightFit:
    """The same with effects that do not act on one axis."""
    for key in keys:
        if key in fit.effects:
            fit = fit.without_axis(key, axis)
    return fit
