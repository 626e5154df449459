"""What a search found in some flights: sizes with intervals, probabilities, aliases, and what is left."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from models.common.frames import AXES
from models.effects import Effect, get
from models.effects.adopted_effect import UNTIL_S
from replay.search.channel import hundredths
from replay.search.estimates import IntervalEstimate, Sizes, sizes
from replay.search.held_out import FlightFit
from replay.search.least_visible import Visible, excited, visible
from replay.search.posterior import Walked, aliases, class_of
from replay.search.pruning import acting, carried, helpful, predictive, share
from replay.search.repeated_effects import with_others
from replay.search.shape_estimates import shape_estimates
from replay.search.surfaces import with_surface_law
from replay.search.terms import Key, Term

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
    shown_of_flight: dict[int, tuple[IntervalEstimate, ...]] = field(default_factory=dict)
    """The same as people say them."""
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
    def told_from_zero(self) -> bool:
        """Whether zero lies outside of the interval of a coefficient that makes the effect; True where none is known.

        An effect is likelier than none together with those that may act in its place; its own size may be none.
        """
        main = [e for e in self.fitted if e.determined and e.name in self.effect.main_names]
        return not main or not all(e.holds_zero for e in main)

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
    walked, _ = helpful(with_others(predictive(walked)))
    others = aliases(walked)
    walked, fits, without = acting(with_surface_law(walked))
    # What came in the place of another effect has aliases of its own.
    for key, names in aliases(walked).items():
        others[key] = list(dict.fromkeys([*others.get(key, ()), *names]))
    terms_of: dict[tuple[str, int], list[Term]] = {}
    for term in walked.best.of_effects:
        terms_of.setdefault((term.name, term.instance), []).append(term)
    found = []
    for terms in terms_of.values():
        found.append(_found(walked, terms, fits, others=others, without=without))
    found = _at_most_all(found)
    found.sort(key=lambda f: (-round(f.explains, 6), f.effect.name))
    return Searched(
        traces=tuple(fits),
        found=tuple(found),
        rejected=_rejected(walked, walked.best.effects),
        visible=visible(walked),
        left_out=walked.left_out,
    )


def _at_most_all(found: Sequence[Found]) -> list[Found]:
    """Shares that add up to 1 at most: what effects take back from each other is explained by neither."""
    positive = sum(max(f.explains, 0.0) for f in found)
    total = max(positive, 1.0)
    return [replace(f, explains=f.explains / total) for f in found]


def _found(
    walked: Walked,
    terms: Sequence[Term],
    fits: Sequence[FlightFit],
    *,
    others: Mapping[Key, Sequence[str]],
    without: Mapping[Key, tuple[str, ...]],
) -> Found:
    """One effect; where every flight has a term of its own, its numbers are those of the one that explains most."""
    shares = {t.key: share(fits, t.key) for t in terms}
    term = max(terms, key=lambda t: (shares[t.key], -_shown_by(t, fits)))
    flight = _shown_by(term, fits)
    of_flight: dict[int, dict[str, float]] = {}
    sizes_of_flight: dict[int, Sizes] = {}
    for one in terms:
        shapes = shape_estimates(walked, one, sorted(one.places))
        for fit in fits:
            if one.key in fit.effects:
                of_flight[fit.index] = fit.effects[one.key].parameters
                sizes_of_flight[fit.index] = sizes(walked, one, fit, shapes)
    fitted = sizes_of_flight[flight].fitted
    instead = tuple(others.get(term.key, ()))
    probability = walked.probability(term.name, instead)
    main = [e for e in fitted if e.name in term.named.main_names]
    of_sign = max((e.sign_probability for e in main), default=1.0)
    members = class_of(walked, term.named, instead)
    axes = carried(fits, term.key)
    return Found(
        effect=term.named,
        fitted=fitted,
        estimates=sizes_of_flight[flight].shown,
        axes=tuple(a for a in AXES if a in axes),
        explains=sum(shares.values()),
        probability=round(min(probability, of_sign), 3),
        aliases=instead,
        flight=flight,
        without=without.get(term.key, ()),
        confirmed_by=tuple(f.index for f in fits if not f.confirms.isdisjoint(shares)),
        of_flight=of_flight,
        shown_of_flight={i: size.shown for i, size in sizes_of_flight.items()},
        members=members,
        push=_push(fits[flight], term.key) if members else "",
    )


def _push(fit: FlightFit, key: Key) -> str:
    """What an effect does, in words: ``a steady push to the left``."""
    wrench = fit.effects[key].held_out[fit.record.valid] / hundredths(fit.record.context)
    energy = (wrench**2).mean(axis=0)
    axis = int(np.argmax(energy))
    mean = float(wrench[:, axis].mean())
    along, against = _WAYS[axis]
    # Where the mean holds more than half of the energy it hardly changes.
    if 2.0 * mean**2 <= energy[axis]:
        other_way = against.split()[-1]
        return f"a changing {along} or {other_way}"
    if mean < 0.0:
        return f"a steady {against}"
    return f"a steady {along}"


def _shown_by(term: Term, fits: Sequence[FlightFit]) -> int:
    """The first flight on which an effect acts; of weather or load the one on which it does most."""
    if term.named.kept or len(term.places) < 2:
        return min(term.places)
    return max(term.places, key=lambda i: fits[i].energy(fits[i].effects[term.key].held_out))


def _rejected(walked: Walked, taken: set[str]) -> tuple[Rejected, ...]:
    """Every effect that is not in the answer, and why."""
    library = walked.evidence.library
    gain = walked.evidence.screen(walked.best)
    out = [Rejected(name, reason, False) for name, reason in library.lacking.items()]
    numbers: dict[str, list[int]] = {}
    for i, term in enumerate(library.terms):
        if term.effect is not None and term.name not in taken:
            numbers.setdefault(term.name, []).append(i)
    for name, own in numbers.items():
        likeliest = max(own, key=lambda i: float(gain[i]))
        term = library.terms[likeliest]
        shown = name in walked.dropped or excited(walked, term)
        if shown:
            reason = walked.why_not(name)
        else:
            reason = "this flight hardly excites it: " + term.named.excite
        out.append(Rejected(name, reason, shown, walked.probability(name, ())))
    return tuple(out)
