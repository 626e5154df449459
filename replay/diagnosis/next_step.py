"""What was found, in one line, and what to do next, by how sure it is: one action, and the reason for it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from models.effects import InFlight
from replay.diagnosis.answer import CONFIRMED, Diagnosis, Named
from replay.diagnosis.pictures import effect_wrench
from replay.diagnosis.words import channel_words, estimate_text, listed, plain

SURE, LIKELY = 0.95, 0.75
"""Probability from which an effect may be adopted after a look, and below which it is only a hint (docs/results.md says
how often names were wrong)."""


_FAULTY = "The log or the vehicle file has a fault."


@dataclass(frozen=True)
class NextStep:
    """The first lines of the page."""

    verdict: str
    action: str
    reasons: tuple[str, ...]
    bad: bool = False
    """Whether the log or the vehicle file is to be corrected first."""


def next_step(answer: Diagnosis, model_faults: Sequence[Mapping[str, str]] = ()) -> NextStep:
    """The verdict in words, and the one thing to do. ``model_faults``: of a model or file of another vehicle."""
    names = listed([plain(n.found.effect.name) for n in answer.named])
    faults = fault_rows(answer, model_faults)
    if faults:
        wrong = tuple(f"{channel_words(channel)}: {what}." for channel, what in faults)
        action = "Check this in the log and the vehicle file first: the effects below may follow from it."
        head = f"The model lacks {names}, but the log or the vehicle file has a fault." if names else _FAULTY
        return NextStep(head, action, wrong, bad=True)
    if answer.verdict == "not_judged":
        return NextStep("Nothing could be judged.", "Record the flight again, with what the notes name.", ())
    if answer.verdict == "nothing_missing":
        return NextStep(
            "Nothing is missing: the model explains this flight.", "There is nothing to change.", _not_shown(answer)
        )
    if answer.verdict == "unexplained":
        return NextStep(
            "The model lacks something, and no effect of the catalogue fits it.", _look(answer),
            ("Adopt nothing: its cause is not known.",),
        )  # fmt: skip
    rest = answer.verdict == "partly_explained"
    head = f"The model lacks: {names}." + (" Something else remains." if rest else "")
    action, *reasons = _act(answer)
    return NextStep(head, action, (*reasons, *((_look(answer),) if rest else ())))


def fault_rows(answer: Diagnosis, model_faults: Sequence[Mapping[str, str]]) -> list[tuple[str, str]]:
    """(channel, what is wrong) of the model or vehicle file, then of the log."""
    return [*((f["channel"], f["what"]) for f in model_faults), *((f.channel, f.what) for f in answer.faults)]


def certainty(n: Named) -> str:
    """How sure a name is, in a sentence."""
    chance = f"probability {n.found.probability:.2f}"
    if n.found.at_bound:
        return f"Uncertain ({chance}): a parameter is at the limit of what was tried."
    if n.status == CONFIRMED:
        return f"Confirmed ({chance}): as found on one flight, it also removes error from another."
    if n.found.probability >= SURE:
        return f"Likely ({chance}), seen on one flight."
    return f"{'Possible' if n.found.probability >= LIKELY else 'A hint only'} ({chance}), seen on one flight."


def _act(answer: Diagnosis) -> list[str]:
    """The action, then reasons; the least sure effect decides."""
    weak = min(answer.named, key=lambda n: n.found.probability)
    open_ = [n for n in answer.named if n.found.aliases]
    if open_:
        f = open_[0].found
        others = listed([plain(name) for name in f.aliases])
        return [
            f"Separate {plain(f.effect.name)} from {others}: {f.effect.excite}. Then diagnose again, with both logs.",
            "On this flight alone they look the same: do not adopt any of them before.",
        ]
    worse = [n for n in answer.named if n.explains <= 0.0]
    if worse:
        name = plain(worse[0].found.effect.name)
        return [
            f"Fly this: {worse[0].found.effect.excite}. Then diagnose both logs together.",
            f"On held-out time {name} does not lower the error: do not adopt it.",
        ]
    if any(n.found.at_bound for n in answer.named):
        effect = next(n for n in answer.named if n.found.at_bound).found.effect
        return [
            f"Fly this: {effect.excite}. Then diagnose both logs together.",
            f"A parameter of {plain(effect.name)} is at the limit of what was tried: do not adopt it.",
        ]
    if all(n.status == CONFIRMED for n in answer.named) and weak.found.probability >= SURE:
        return [_adopt(answer), "Every effect was found on one flight and removed error from another."]
    if weak.found.probability >= SURE:
        return [
            "Fly the same once more and diagnose both logs together; adopt the effect if it is confirmed.",
            "It is likely, but seen on one flight. If it makes sense for this vehicle (a known load, a known wall), "
            "the amended model may be tried high above the ground first.",
        ]
    excite = weak.found.effect.excite
    return [
        f"Fly this: {excite}. Then diagnose both logs together.",
        f"{plain(weak.found.effect.name)} has a probability of {weak.found.probability:.2f}: do not adopt it yet.",
    ]


def _adopt(answer: Diagnosis) -> str:
    effects = [n.found.effect for n in answer.named]
    kept = [e for e in effects if e.kept]
    if not kept:
        return "There is nothing to adopt: all of it belongs to this flight. The next flight starts without it."
    text = "Adopt it: run the same command with --save-model DIR, then fly companion --model DIR, first with --dry-run."
    idle = [plain(e.name) for e in kept if e.in_flight.use is InFlight.NONE]
    gone = [plain(e.name) for e in effects if not e.kept]
    text += f" Of this flight only, not kept: {listed(gone)}." if gone else ""
    return text + (f" Not compensated in flight: {listed(idle)}." if idle else "")


def _look(answer: Diagnosis) -> str:
    if answer.channels:
        names = listed([channel_words(c.name) for c in answer.channels[:3]])
        return f"Look at what changes on the vehicle, or around it, together with: {names}."
    spans = [(t.record.name, o) for t in answer.traces for o in t.outside if o.intervals_s]
    if spans:
        name, first = spans[0]
        when = ", ".join(f"{a:.0f} to {b:.0f} s" for a, b in first.intervals_s[:3])
        return (
            f"What remains follows no logged quantity. Remember, or look in a video, what happened at {when} ({name})."
        )
    return (
        "What remains follows no logged quantity: gusts, a rope, a person's hand, or a sensor that is not in the log."
    )


def _not_shown(answer: Diagnosis) -> tuple[str, ...]:
    missing = [r.name for r in answer.rejected if not r.excited]
    if not missing:
        return ()
    names = listed([plain(name) for name in missing[:4]])
    more = f" and {len(missing) - 4} more" if len(missing) > 4 else ""
    return (f"This flight could not have shown {names}{more}; what to fly for each is listed below.",)


def capital(words: str) -> str:
    """With a capital first letter."""
    return words[:1].upper() + words[1:]


def size_words(n: Named, answer: Diagnosis) -> str:
    """``fan 3 gives 15 % less thrust than declared``; name and numbers where the effect has no such words."""
    f = n.found
    if f.effect.shown.in_words is not None and effect_wrench(n, answer.traces) is not None:
        return f.effect.shown.in_words(answer.traces[n.record].record.context, f.parameters)
    return f"{plain(f.effect.name)}: {', '.join(map(estimate_text, f.estimates))}"


def _name(channel: str) -> str:
    """A channel without its unit."""
    return channel_words(channel).split(" [")[0]


def finding(answer: Diagnosis, model_faults: Sequence[Mapping[str, str]] = ()) -> str:
    """A fault first; else the effect that explains most, and how many more there are."""
    faults = fault_rows(answer, model_faults)
    if faults:
        return f"Fault found: {listed(list(dict.fromkeys(_name(channel) for channel, _ in faults)))}"
    if answer.verdict == "not_judged":
        return "Nothing could be judged"
    if answer.verdict == "nothing_missing":
        return "Nothing is missing in the model"
    if not answer.named:
        follows = f", together with {_name(answer.channels[0].name)}" if answer.channels else ""
        return f"An unknown force or moment acts{follows}"
    first, *more = answer.named
    sure = first.found.probability >= LIKELY and not first.found.aliases
    words = size_words(first, answer)
    return (capital(words) if sure else f"Possibly {words}") + (f" (and {len(more)} more)" if more else "")
