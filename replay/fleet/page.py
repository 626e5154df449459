"""The page of a folder: what its logs have in common, and every log in a row."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from companion.control.reasons import Reason
from replay.report import render
from replay.rerun.page import lasted, to_mend

_COMMON = 0.5
"""Share of the judged logs from which an effect belongs to the vehicle rather than to single flights."""
MOST_ROWS = 1000
"""A page of more opens slowly."""
_SHOWN = (
    "log",
    "date",
    "page",
    "error",
    "verdict",
    "identity",
    "effects",
    "aliases",
    "duration_s",
    "compensated_s",
    "refusals_s",
)
"""Of an answer; the rest takes memory."""
Answer = Mapping[str, Any]


def page(title: str, found: Sequence[Answer]) -> str:
    """The whole page."""
    answers = [_shown_of(answer) for answer in found]
    good = [a for a in answers if "error" not in a]
    diagnosed = any("verdict" in a for a in answers)
    head, step = _said(good) if diagnosed else _replayed(good)
    rows = _latest(answers)
    return render(
        "folder.html",
        title=title,
        head=head,
        verdict=title,
        sentences=[f"Next: {step}"],
        answers=rows,
        names=_names([a["log"] for a in rows]),
        count=len(answers),
        good=len(good),
        length=lasted(sum(a["duration_s"] for a in good)),
        verdicts=Counter(a["verdict"] for a in good).most_common() if diagnosed else [],
        reason=_reason,
        columns=("log", "answer", "judged")
        if diagnosed
        else ("log", "compensated", "main reason for no offset"),
    )


def _latest(answers: Sequence[Answer]) -> list[Answer]:
    """Those that the page has a row for, in their order."""
    by_date = sorted(range(len(answers)), key=lambda place: answers[place]["date"])
    return [answers[place] for place in sorted(by_date[-MOST_ROWS:])]


def _names(logs: Sequence[str]) -> list[str]:
    """File names; where one is there twice, paths from the folder that all share."""
    names = [Path(log).name for log in logs]
    if len(set(names)) == len(names):
        return names
    shared = os.path.commonpath(logs)
    return [os.path.relpath(log, shared) for log in logs]


def _shown_of(answer: Answer) -> dict[str, Any]:
    """What the page looks at; of effects the names."""
    out = {name: answer[name] for name in _SHOWN if name in answer}
    if "effects" in answer:
        out["effects"] = [{"name": effect["name"]} for effect in answer["effects"]]
    return out


def _said(judged: Sequence[Answer]) -> tuple[str, str]:
    """Verdict and next action: of one vehicle, or how many vehicles show an effect. They are never pooled."""
    vehicles: dict[str, list[Answer]] = {}
    for a in judged:
        vehicles.setdefault(a.get("identity", {}).get("vehicle") or "", []).append(a)
    if len(vehicles) < 2:
        return _diagnosed(judged)
    shown = sum(bool(common_effects(logs)) for logs in vehicles.values())
    return (
        f"{shown} of {len(vehicles)} vehicles show an effect on most of their logs",
        "replay season, with the folder of these answers: it says what every vehicle shows, and "
        "since when.",
    )


def _diagnosed(judged: Sequence[Answer]) -> tuple[str, str]:
    """Verdict and next action from the effects that the logs show."""
    if not any(a["effects"] for a in judged):
        return (
            "No log shows an effect that the model lacks",
            "nothing: the model explains these logs.",
        )
    common = common_effects(judged)
    if not common:
        return (
            "Some logs show an effect, most do not",
            "look at those logs one by one: the effect belongs to a flight, not to the vehicle. "
            "Adopt nothing for all.",
        )
    names = "; ".join(" or ".join(name.replace("_", " ") for name in group) for group in common)
    return (
        f"Most logs show the same effect: {names}",
        "diagnose a few of these logs together, by their names: that confirms it and gives one "
        "size for the vehicle.",
    )


def common_effects(judged: Sequence[Answer]) -> list[list[str]]:
    """Effects that half of the logs name, or cannot tell from one that they name; these stand together in a list."""
    groups = []
    for a in judged:
        for group in a["aliases"]:
            groups.append(set(group))
    shown = Counter(name for a in judged for name in _shown(a))
    named = Counter(effect["name"] for a in judged for effect in a["effects"])
    out: list[list[str]] = []
    for name, _ in named.most_common():
        if shown[name] < max(_COMMON * len(judged), 2.0):
            continue
        beside = next(
            (known for known in out if any({name, known[0]} <= group for group in groups)), None
        )
        if beside is None:
            out.append([name])
        else:
            beside.append(name)
    return out


def _shown(a: Answer) -> set[str]:
    """What a log names, and what it cannot tell from that."""
    names = {effect["name"] for effect in a["effects"]}
    return names.union(*(group for group in a["aliases"] if names & set(group)))


def _replayed(good: Sequence[Answer]) -> tuple[str, str]:
    acted = sum(a["compensated_s"] > 0.0 for a in good)
    total: Counter[str] = Counter()
    for a in good:
        total.update(a["refusals_s"])
    reason = _reason(total)
    step = "nothing: only take-off and landing kept it from compensating."
    if reason:
        step = f"correct the main reason for no offset: {reason}."
    return f"The companion would have compensated in {acted} of {len(good)} logs", step


def _reason(refusals_s: Mapping[str, float]) -> str:
    return to_mend((Reason[name.upper()], seconds) for name, seconds in refusals_s.items())
