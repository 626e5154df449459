"""What a search found in some flights: sizes with intervals, probabilities, aliases, and what is left."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from models.common.frames import AXES
from models.effects import Effect, get
from models.effects.adopted_effect import UNTIL_S
from replay.search.channel import hundredths
from replay.search.estimates import IntervalEstimate, Sizes, shape_estimates, sizes
from replay.search.evidence import Fit
from replay.search.held_out import FlightFit, flight_fits
from replay.search.least_visible import Visible, visible
from replay.search.posterior import Walked, aliases, class_of
from replay.search.regimes import LEAST_S, regimes
from replay.search.repeated_effects import with_others
from replay.search.significance import tops_of_columns
from replay.search.surfaces import with_surface_law
from replay.search.terms import Key, Term
from replay.search.thresholds import (
    HELD_OUT,
    LEARNT,
    NEAR,
    RIVALS,
    SMALL,
    TRUST,
    WORSE_SHARE,
)

_WAYS = (
    ("push forward", "push backward"),
    ("push to the right", "push to the left"),
    ("push down", "push up"),
    ("roll to the right", "roll to the left"),
    ("pitch up", "pitch down"),
    ("turn to the right", "turn to the left"),
)
"""What acts along each axis, and against it."""


@dataclass(frozen=True, kw_only=True)
class Found:
    """An effect that was adopted, over all flights that show it.

    Its parameters are those of ``flight``, where it explains most: flights differ in weather and load.
    """

    effect: Effect
    fitted: tuple[IntervalEstimate, ...]
    """Its parameters as a model directory keeps them."""
    estimates: tuple[IntervalEstimate, ...]
    """Its parameters as people say them."""
    axes: tuple[str, ...]
    explains: float
    probability: float
    aliases: tuple[str, ...]
    flight: int
    without: tuple[str, ...] = ()
    """Axes on which it does not act: there it raises the error of held-out time."""
    confirmed_by: tuple[int, ...] = ()
    """Flights whose residual it lowers where it was fitted on the others."""
    of_flight: dict[int, dict[str, float]] = field(default_factory=dict)
    """Parameters of every flight on which it acts, as a model directory keeps them."""
    said_of_flight: dict[int, tuple[IntervalEstimate, ...]] = field(default_factory=dict)
    """The same as people say them."""
    small: bool = False
    """Whether it explains less than ``SMALL`` of every part of every flight."""
    members: tuple[tuple[str, float], ...] = ()
    """Effects that the flights cannot tell from each other, this one among them, and their probabilities, the largest
    first; empty where it stands alone."""
    push: str = ""
    """What the class does, in words."""

    @property
    def parameters(self) -> dict[str, float]:
        """As a model directory keeps them."""
        return {e.name: e.value for e in self.fitted}

    @property
    def sized(self) -> bool:
        """Whether one of the coefficients that make the effect is determined."""
        return any(e.determined for e in self.fitted if e.name in self.effect.main_names)

    @property
    def ended(self) -> bool:
        """Whether it ended in the flight."""
        return self.parameters.get(UNTIL_S, 0.0) > 0.0

    @property
    def kept(self) -> bool:
        """Whether the next flight has it: neither what is of this flight, nor what ended in it."""
        return self.effect.kept and not self.ended

    @property
    def numbers(self) -> dict[str, float]:
        """As people say them."""
        return {e.name: e.value for e in self.estimates}

    @property
    def decided_by(self) -> str:
        """What to fly so that the members of the class are told apart."""
        return "; ".join(dict.fromkeys(get(name).excite for name, _ in self.members))

    @property
    def status(self) -> str:
        """``confirmed`` (lowers the residual of a flight that it was not fitted on, too), or ``candidate``."""
        if self.confirmed_by and not self.at_bound:
            return "confirmed"
        return "candidate"

    @property
    def at_bound(self) -> bool:
        """Whether a parameter stands at the edge of what was tried."""
        return any(e.at_bound for e in self.estimates)


@dataclass(frozen=True)
class Rejected:
    """An effect that was not adopted, and why; ``excited`` is False where the flights could not have shown it."""

    name: str
    reason: str
    excited: bool
    p: float | None = None


@dataclass(frozen=True, kw_only=True)
class Searched:
    """The answer of a search over some flights together."""

    traces: tuple[FlightFit, ...]
    """Every flight under the best set."""
    found: tuple[Found, ...]
    rejected: tuple[Rejected, ...]
    visible: tuple[Visible, ...] = ()
    """What was not found, and from which size on it would have been."""
    left_out: tuple[str, ...] = ()
    """What was not tried, because it would have taken too long."""


def summarise(walked: Walked) -> Searched:
    """Everything that a reader needs to judge what was found.

    The order of the passes matters: held-out time, then the map of surfaces, which corrects the laws that are left,
    and last what raises the error of held-out time. Each takes the best set of the pass before and gives its own;
    probabilities are those of the sets that remain.
    """
    bare, _ = _helpful(with_others(_predictive(walked)))
    others = aliases(bare)
    walked, fits, without = _acting(with_surface_law(bare))
    groups: dict[tuple[str, int], list[Term]] = {}
    for t in walked.best.of_effects:
        groups.setdefault((t.name, t.instance), []).append(t)
    found = _at_most_all([_found(walked, own, fits, others, without) for own in groups.values()])
    found.sort(key=lambda f: (-round(f.explains, 6), f.effect.name))
    return Searched(
        traces=tuple(fits),
        found=tuple(found),
        rejected=_rejected(walked, walked.best.effects),
        visible=visible(walked),
        left_out=walked.left_out,
    )


def corrected_together(effects: Iterable[Effect]) -> set[str]:
    """A map of surfaces and the laws that it corrects: only their sum is known well."""
    out: set[str] = set()
    for effect in effects:
        if effect.search.remainder:
            out.update((effect.name, *effect.aliases))
    return out


def _at_most_all(found: Sequence[Found]) -> list[Found]:
    """Shares that add up to 1 at most: what effects take back from each other is explained by neither."""
    total = max(sum(max(f.explains, 0.0) for f in found), 1.0)
    return [replace(f, explains=f.explains / total) for f in found]


def _predictive(walked: Walked) -> Walked:
    """Pass over sets that fit well and leave far more of held-out time than others: they cancel or chase noise.

    The likeliest set is taken whose energy of held-out time is no more than ``HELD_OUT`` times the least. More effects
    of the same kind always leave less: whether they are large enough to be named is decided already.
    """
    likeliest: dict[frozenset[str], Fit] = {}
    for fit in (walked.best, *walked.ranked()):
        names = frozenset(fit.effects)
        more = any(other < names for other in likeliest)
        if fit.score > walked.best.score - NEAR and len(likeliest) < RIVALS and not more:
            likeliest.setdefault(names, fit)
    left = {fit.key: _left(flight_fits(walked.evidence, fit)) for fit in likeliest.values()}
    least = min(left.values())
    chosen = next(fit for fit in likeliest.values() if left[fit.key] <= HELD_OUT * least)
    if chosen.key == walked.best.key:
        return walked
    return walked.at_most(chosen)


def _judged(fits: Sequence[FlightFit]) -> list[int]:
    """Axes that some flight can judge."""
    axes = set[int]()
    for f in fits:
        axes.update(f.record.axes)
    return sorted(axes)


def _left(fits: Sequence[FlightFit]) -> float:
    """Energy of held-out time beside a set; of an axis that it makes worse, as without it: it will not act there."""
    return sum(min(_energies(fits, [axis])) for axis in _judged(fits))


def _energies(fits: Sequence[FlightFit], axes: Sequence[int] | None) -> tuple[float, float]:
    """Of held-out time, of all or of some axes, without and with all effects."""
    before = sum(f.energy(f.before, axes) for f in fits)
    after = sum(f.energy(f.after, axes) for f in fits)
    return before, after


def _helpful(walked: Walked) -> tuple[Walked, list[FlightFit]]:
    """The best set without the effects that raise the error of held-out time, and every flight under it."""
    fits = flight_fits(walked.evidence, walked.best)
    gains = {t.key: _share(fits, t.key) for t in walked.best.of_effects}
    worst = min(gains, key=lambda key: gains[key], default=None)
    if worst is None or gains[worst] > -WORSE_SHARE:
        return walked, fits
    return _helpful(walked.without(worst))


def _acting(
    walked: Walked,
) -> tuple[Walked, list[FlightFit], dict[Key, tuple[str, ...]]]:
    """The best set with every effect on the axes that it helps; by key, the axes on which it does not act.

    What acts on none of the axes that it carries is no name: the set is weighed again without it.
    """
    walked, whole = _helpful(walked)
    terms = walked.best.of_effects
    joint = corrected_together(t.named for t in terms)
    fits, without = _by_axis(whole, [t.key for t in terms if t.name not in joint])
    together = [t.key for t in terms if t.name in joint]
    for axis in _worse_axes(fits):
        # A map and its laws leave an axis as one, where it is none of theirs.
        if not any(AXES[axis] in _carried(whole, key) for key in together):
            fits = [_without(f, together, axis) for f in fits]
            without |= {key: (*without.get(key, ()), AXES[axis]) for key in together}
    idle = [key for key, axes in without.items() if _carried(whole, key) <= set(axes)]
    if not idle:
        return walked, fits, without
    worst = min(idle, key=lambda key: (_share(whole, key), str(key)))
    return _acting(walked.without(worst))


def _without(fit: FlightFit, keys: Sequence[Key], axis: int) -> FlightFit:
    """The same with effects that do not act on one axis."""
    for key in keys:
        if key in fit.effects:
            fit = fit.without_axis(key, axis)
    return fit


def _carried(fits: Sequence[FlightFit], key: Key) -> set[str]:
    """Axes on which an effect clearly acts."""
    out: set[str] = set()
    for f in fits:
        if key in f.effects:
            out.update(f.effects[key].axes)
    return out


def _worse_axes(fits: Sequence[FlightFit]) -> list[int]:
    """Axes of which all effects together raise the error of held-out time."""
    return [axis for axis in _judged(fits) if _raised(fits, axis) > WORSE_SHARE]


def _raised(fits: Sequence[FlightFit], axis: int) -> float:
    """Share by which all effects together raise the energy of held-out time on an axis."""
    before, after = _energies(fits, [axis])
    return (after - before) / max(before, 1e-12)


def _by_axis(
    fits: Sequence[FlightFit], keys: Sequence[Key]
) -> tuple[list[FlightFit], dict[Key, tuple[str, ...]]]:
    """Every flight without effects on axes of which they raise the error of held-out time; by ``keys``, these axes.

    One after the other, the worst first: the others are judged beside what is left. Each may help beside the others
    while all together do harm: on such an axis the one that helps least goes, until they do none.
    """
    fits = list(fits)
    without: dict[Key, tuple[str, ...]] = {}
    while True:
        worse = _worse_axes(fits)
        harmful: dict[tuple[Key, int], float] = {}
        for key, axis in product(keys, _judged(fits)):
            if AXES[axis] in without.get(key, ()):
                continue
            gain = _share(fits, key, [axis])
            harms_beside = axis in worse and _acts_on(fits, key, axis)
            if gain < -WORSE_SHARE or harms_beside:
                harmful[key, axis] = gain
        if not harmful:
            return fits, without
        key, axis = min(harmful, key=lambda pair: (harmful[pair], str(pair)))
        fits = [_without(f, [key], axis) for f in fits]
        without[key] = (*without.get(key, ()), AXES[axis])


def _acts_on(fits: Sequence[FlightFit], key: Key, axis: int) -> bool:
    return any(f.effects[key].held_out[:, axis].any() for f in fits if key in f.effects)


def _share(fits: Sequence[FlightFit], key: Key, axes: Sequence[int] | None = None) -> float:
    """Share of the energy of held-out time, of all or of some axes, that one effect removes beside the others."""
    before, _ = _energies(fits, axes)
    return round(sum(f.gain(key, axes) for f in fits) / max(before, 1e-12), 9)


def _found(
    walked: Walked,
    terms: Sequence[Term],
    fits: Sequence[FlightFit],
    others: Mapping[Key, Sequence[str]],
    without: Mapping[Key, tuple[str, ...]],
) -> Found:
    """One effect; where every flight has a term of its own, its numbers are those of the one that explains most."""
    shares = {t.key: _share(fits, t.key) for t in terms}
    term = max(terms, key=lambda t: (shares[t.key], -_shown_by(t, fits)))
    instead = tuple(others.get(term.key, ()))
    flight = _shown_by(term, fits)
    of_flight: dict[int, dict[str, float]] = {}
    sized: dict[int, Sizes] = {}
    small = True
    for t in terms:
        shapes = shape_estimates(walked, t, sorted(t.places))
        for f in (fit for fit in fits if t.key in fit.effects):
            of_flight[f.index] = f.effects[t.key].parameters
            sized[f.index] = sizes(walked, t, f, shapes)
            small = small and _small(f, t.key)
    fitted = sized[flight].fitted
    main = [e for e in fitted if e.name in term.named.main_names]
    sign = max((e.sign_probability for e in main), default=1.0)
    members = class_of(walked, term.named, instead)
    carried = _carried(fits, term.key)
    return Found(
        effect=term.named,
        fitted=fitted,
        estimates=sized[flight].said,
        axes=tuple(a for a in AXES if a in carried),
        explains=sum(shares.values()),
        probability=round(min(walked.probability(term.name, instead), sign), 3),
        aliases=instead,
        flight=flight,
        without=without.get(term.key, ()),
        confirmed_by=tuple(f.index for f in fits if not f.confirms.isdisjoint(shares)),
        of_flight=of_flight,
        said_of_flight={i: size.said for i, size in sized.items()},
        small=small,
        members=members,
        push=_push(fits[flight], term.key) if members else "",
    )


def _small(fit: FlightFit, key: Key) -> bool:
    """Whether an effect removes less than ``SMALL`` of the energy of every part of a flight."""
    removed = fit.after + fit.effects[key].held_out
    step_s = fit.record.step_s
    lasting = [mask for mask in regimes(fit.record).values() if mask.sum() * step_s >= LEAST_S]
    for mask in (fit.record.valid, *lasting):
        within = mask[:, None]
        gain = fit.energy(removed * within) - fit.energy(fit.after * within)
        if gain >= SMALL * fit.energy(fit.before * within):
            return False
    return True


def _push(fit: FlightFit, key: Key) -> str:
    """What an effect does, in words: ``a steady push to the left``."""
    wrench = fit.effects[key].held_out[fit.record.valid] / hundredths(fit.record.context)
    energy = (wrench**2).mean(axis=0)
    axis = int(np.argmax(energy))
    mean = float(wrench[:, axis].mean())
    # Where the mean holds more than half of the energy it hardly changes.
    if 2.0 * mean**2 > energy[axis]:
        return f"a steady {_WAYS[axis][mean < 0.0]}"
    return f"a changing {_WAYS[axis][0]} or {_WAYS[axis][1].split()[-1]}"


def _shown_by(term: Term, fits: Sequence[FlightFit]) -> int:
    """The first flight on which an effect acts; of weather or load the one on which it does most."""
    if term.named.kept or len(term.places) < 2:
        return min(term.places)
    return max(term.places, key=lambda i: fits[i].energy(fits[i].effects[term.key].held_out))


def _rejected(walked: Walked, taken: set[str]) -> tuple[Rejected, ...]:
    """Every effect that is not in the answer, and why."""
    library = walked.evidence.library
    out = [Rejected(name, reason, False) for name, reason in library.lacking.items()]
    gain = walked.evidence.screen(walked.best)
    numbers: dict[str, list[int]] = {}
    for i, t in enumerate(library.terms):
        if t.effect is not None and t.name not in taken:
            numbers.setdefault(t.name, []).append(i)
    for name, own in numbers.items():
        term = library.terms[max(own, key=lambda i: float(gain[i]))]
        excited = name in walked.worse or _excited(walked, term)
        if excited:
            reason = walked.why_not(name)
        else:
            reason = "this flight hardly excites it: " + term.named.excite
        out.append(Rejected(name, reason, excited, walked.probability(name, ())))
    return tuple(out)


def _excited(walked: Walked, term: Term) -> bool:
    """Whether the flights would know one of its main coefficients, beside the set.

    Its standard deviation s / sqrt(TRUST) makes less than a hundredth of the weight, the smallest effect that is named.
    """
    evidence = walked.evidence
    fit = evidence.refit([*walked.best.terms, term], walked.best.noise)
    part = fit.part(term)
    error = np.sqrt(np.diag(fit.cov[part, part]) / TRUST)
    # Where the prior alone says as much, the flight has said nothing.
    known = error < LEARNT / np.sqrt(TRUST)
    unit = np.zeros(len(term.columns))
    for channel in evidence.library.channels:
        unit = np.maximum(unit, tops_of_columns(channel, term))
    return bool((known & (term.main > 0) & (error * unit < 1.0)).any())
