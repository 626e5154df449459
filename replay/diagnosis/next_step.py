"""What was found, in one line, and what to do next, by how sure it is: one action, and the reason for it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from replay.diagnosis.answer import Diagnosis
from replay.diagnosis.words import channel_words, estimate_text, listed, plain
from replay.search.results import Found

SURE = 0.95
LIKELY = 0.75
"""Probability from which an effect may be adopted after a look, and below which it is only a hint (docs/results.md says
how often names were wrong)."""


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
    names = listed([plain(f.effect.name) for f in answer.found])
    faults = [
        *((f["channel"], f["what"]) for f in model_faults),
        *((f.channel, f.what) for f in answer.faults if f.loss is None),
    ]
    if answer.motor_losses:
        return NextStep(
            "A motor fails in flight.",
            "Look at this motor, its ESC, its propeller and their wiring before the next flight.",
            tuple(f"{fault.what}." for fault in answer.motor_losses),
            bad=True,
        )
    if faults:
        wrong = tuple(f"{channel_words(channel)}: {what}." for channel, what in faults)
        action = (
            "Check this in the log and the vehicle file first: the effects below may follow from "
            "it."
        )
        if names:
            head = f"The model lacks {names}, but the"
        else:
            head = "The"
        return NextStep(f"{head} log or the vehicle file has a fault.", action, wrong, bad=True)
    if answer.verdict == "not_judged":
        return NextStep(
            "Nothing could be judged.", "Record the flight again, with what the notes name.", ()
        )
    if answer.verdict == "nothing_missing":
        idle = "What this flight could not have shown is listed below, with what to fly for it."
        reasons: tuple[str, ...]
        if all(r.excited for r in answer.rejected):
            reasons = ()
        else:
            reasons = (idle,)
        return NextStep(
            "Nothing is missing: the model explains this flight.",
            "There is nothing to change.",
            reasons,
        )
    if answer.verdict == "unexplained":
        return NextStep(
            "The model lacks something, and no effect of the catalogue fits it.",
            _look(answer),
            ("Adopt nothing: its cause is not known.",),
        )
    rest = answer.verdict == "partly_explained"
    head = f"The model lacks: {names}." + (" Something else remains." if rest else "")
    action, reason = _act(answer)
    return NextStep(head, action, (reason, *((_look(answer),) if rest else ())))


def certainty(f: Found) -> str:
    """How sure a name is, in a sentence."""
    chance = f"probability {f.probability:.2f}"
    if f.at_bound:
        return f"Uncertain ({chance}): a parameter is at the limit of what was tried."
    if f.status == "confirmed":
        return f"Confirmed ({chance}): as found on one flight, it also removes error from another."
    if f.probability >= SURE:
        likely = "Likely"
    elif f.probability >= LIKELY:
        likely = "Possible"
    else:
        likely = "A hint only"
    return f"{likely} ({chance}), seen on one flight."


def _act(answer: Diagnosis) -> tuple[str, str]:
    """The action and its reason; the least sure effect decides."""
    for f in answer.found:
        if f.aliases:
            others = listed([plain(name) for name in f.aliases])
            return (
                f"Separate {plain(f.effect.name)} from {others}: {f.effect.excite}. Then diagnose "
                "both logs together.",
                "On this flight alone they look the same: do not adopt any of them before.",
            )
    for f in sorted(answer.found, key=lambda f: f.probability):
        if _doubt(f):
            return f"Fly this: {f.effect.excite}. Then diagnose both logs together.", _doubt(f)
    if any(f.status != "confirmed" for f in answer.found):
        return (
            "Fly the same once more and diagnose both logs together; adopt the effect if it is "
            "confirmed.",
            "It is likely, but seen on one flight. If it makes sense for this vehicle (a known "
            "load, a known wall), the amended model may be tried high above the ground first.",
        )
    action = (
        "Adopt it: run the same command with --save-model DIR, then fly companion --model DIR, "
        "first with --dry-run."
    )
    if not any(f.kept for f in answer.found):
        action = (
            "There is nothing to adopt: all of it belongs to this flight. The next flight starts "
            "without it."
        )
    return action, "Every effect was found on one flight and removed error from another."


def _doubt(f: Found) -> str:
    """Why an effect is not to be adopted yet; empty where nothing speaks against it."""
    name = plain(f.effect.name)
    if f.explains <= 0.0:
        return f"On held-out time {name} does not lower the error: do not adopt it."
    if f.at_bound:
        return f"A parameter of {name} is at the limit of what was tried: do not adopt it."
    if f.probability >= SURE:
        return ""
    return f"{name} has a probability of {f.probability:.2f}: do not adopt it yet."


def _look(answer: Diagnosis) -> str:
    """Where the cause of what remains may be found."""
    in_time = [c.course.to_look_for for c in answer.channels if c.course is not None]
    names = [channel_words(c.name) for c in answer.channels if c.course is None]
    sentences = []
    if in_time:
        sentences.append(f"Look on the vehicle, or around it, for {listed(in_time)}.")
    if names:
        together = listed(names[:3])
        sentences.append(
            f"Look at what changes on the vehicle, or around it, together with: {together}."
        )
    if sentences:
        return " ".join(sentences)
    return (
        "What remains follows no logged quantity: gusts, a rope, a person's hand, or a sensor "
        "that is not in the log. Remember, or look in a video, what happened at the times listed "
        "below."
    )


def size_words(f: Found, answer: Diagnosis) -> str:
    """``fan 3 gives 15 % less thrust than declared``; name and numbers where the effect has no such words."""
    shown = f.effect.shown
    if shown.in_words is not None and f.sized:
        context = answer.records[f.flight].context
        words = shown.in_words(context, f.numbers)
        if shown.push is not None:
            words += f" ({shown.push(context, f.parameters)})"
        return words
    return f"{plain(f.effect.name)}: {', '.join(map(estimate_text, answer.numbers_of(f)))}"
