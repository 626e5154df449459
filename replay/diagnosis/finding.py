"""What a diagnosis found, in one line: the title of its page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from replay.diagnosis.answer import Diagnosis, Named
from replay.diagnosis.next_step import LIKELY, fault_rows
from replay.diagnosis.pictures import effect_wrench
from replay.diagnosis.words import channel_name, estimate_words, listed, plain


def capital(words: str) -> str:
    """With a capital first letter."""
    return words[:1].upper() + words[1:]


def size_words(n: Named, answer: Diagnosis) -> str:
    """``fan 3 gives 15 % less thrust than declared``; name and numbers where the effect has no such words."""
    f = n.found
    if f.effect.shown.in_words is not None and effect_wrench(n, answer.traces) is not None:
        return f.effect.shown.in_words(answer.traces[n.record].record.context, f.parameters)
    return f"{plain(f.effect.name)}: {', '.join(map(estimate_words, f.estimates))}"


def finding(answer: Diagnosis, model_faults: Sequence[Mapping[str, str]] = ()) -> str:
    """A fault first; else the effect that explains most, and how many more there are."""
    faults = fault_rows(answer, model_faults)
    if faults:
        return f"Fault found: {listed(list(dict.fromkeys(channel_name(channel) for channel, _ in faults)))}"
    if answer.verdict == "not_judged":
        return "Nothing could be judged"
    if answer.verdict == "nothing_missing":
        return "Nothing is missing in the model"
    if not answer.named:
        follows = f", together with {channel_name(answer.channels[0].name)}" if answer.channels else ""
        return f"An unknown force or moment acts{follows}"
    first, *more = answer.named
    sure = first.found.probability >= LIKELY and not first.found.aliases
    words = size_words(first, answer)
    return (capital(words) if sure else f"Possibly {words}") + (f" (and {len(more)} more)" if more else "")
