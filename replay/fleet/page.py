"""The page of a folder: what its logs have in common, and every log in a row."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from companion.control.authority import Reason
from models.pages.document import document, table, verdict
from replay.rerun.mend import lasted, to_mend

_REASONS = {reason.name.lower(): reason for reason in Reason}
"""By their names in the JSON of a log, which may be of another version."""
_COMMON = 0.5
"""Share of the judged logs from which an effect belongs to the vehicle rather than to single flights."""


def write_page(folder: Path, title: str, answers: Sequence[Mapping[str, Any]]) -> Path:
    """Write ``report.html`` into ``folder``."""
    target = folder / "report.html"
    target.write_text(page(folder, title, answers), encoding="utf-8")
    return target


def page(folder: Path, title: str, answers: Sequence[Mapping[str, Any]]) -> str:
    """The whole page; ``folder`` is where it will lie, for links to the pages of single logs."""
    diagnosed = any("verdict" in a for a in answers)
    head, step = _diagnosed(answers) if diagnosed else _replayed(answers)
    rows = [_failed(a) if "error" in a else (_row(a, folder) if diagnosed else _run_row(a)) for a in answers]
    names = ("log", "answer", "judged") if diagnosed else ("log", "compensated", "main reason for no offset")
    return document(
        title,
        [
            f"<h1>{escape(head)}</h1>",
            verdict(title, [f"Next: {step}"]),
            f'<p class="dim">{escape(_counts(answers))}</p>',
            "<h2>Every log</h2>",
            table(names, rows),
        ],
    )


def _diagnosed(answers: Sequence[Mapping[str, Any]]) -> tuple[str, str]:
    """Verdict and next action from the effects that the logs show."""
    judged = [a for a in answers if "verdict" in a]
    if not any(a["effects"] for a in judged):
        return "No log shows an effect that the model lacks", "nothing: the model explains these logs."
    common = common_effects(judged)
    if not common:
        return (
            "Some logs show an effect, most do not",
            "look at those logs one by one: the effect belongs to a flight, not to the vehicle. Adopt nothing for all.",
        )
    names = "; ".join(" or ".join(name.replace("_", " ") for name in group) for group in common)
    return (
        f"Most logs show the same effect: {names}",
        "diagnose a few of these logs together, by their names: that confirms it and gives one size for the vehicle.",
    )


def common_effects(judged: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """Effects that half of the logs name, or cannot tell from one that they name; these stand together in a list."""
    seen: Counter[str] = Counter()
    named: Counter[str] = Counter()
    groups = [set(group) for a in judged for group in a.get("aliases", [])]
    for a in judged:
        names = {e["name"] for e in a["effects"]}
        named.update(names)
        seen.update(names | {other for group in a.get("aliases", []) if names & set(group) for other in group})
    out: list[list[str]] = []
    for name, _ in named.most_common():
        if seen[name] < max(_COMMON * len(judged), 2.0):
            continue
        beside = next((known for known in out if any({name, known[0]} <= group for group in groups)), None)
        if beside is None:
            out.append([name])
        else:
            beside.append(name)
    return out


def _replayed(answers: Sequence[Mapping[str, Any]]) -> tuple[str, str]:
    good = [a for a in answers if "error" not in a]
    acted = sum(a["compensated_s"] > 0.0 for a in good)
    total: Counter[str] = Counter()
    for a in good:
        total.update(a["refusals_s"])
    head = f"The companion would have compensated in {acted} of {len(good)} logs"
    first = to_mend((_REASONS[name], s) for name, s in total.items() if name in _REASONS)
    if first is None:
        return head, "nothing: only take-off and landing kept it from compensating."
    reason, seconds = first
    return head, f"correct the main reason for no offset: {reason.value} ({lasted(seconds)})."


def _counts(answers: Sequence[Mapping[str, Any]]) -> str:
    good = [a for a in answers if "error" not in a]
    seconds = sum(float(a.get("duration_s", 0.0)) for a in good)
    text = f"{len(good)} of {len(answers)} logs could be used, {lasted(seconds)} in all."
    verdicts = Counter(str(a["verdict"]).replace("_", " ") for a in good if "verdict" in a)
    if verdicts:
        text += " Verdicts: " + ", ".join(f"{name} {count}" for name, count in verdicts.most_common()) + "."
    return text


def _failed(a: Mapping[str, Any]) -> list[str]:
    return [_log_cell(a), f'<span class="bad">{escape(a["error"])}</span>', ""]


def _log_cell(a: Mapping[str, Any], link: str = "") -> str:
    """Name of the log, and below it the date."""
    name = escape(Path(a["log"]).name)
    name = f'<a href="{escape(link)}">{name}</a>' if link else name
    return f'{name}<br><span class="dim small">{escape(a["date"][:10])}</span>'


def _row(a: Mapping[str, Any], folder: Path) -> list[str]:
    effects = ", ".join(escape(e["name"].replace("_", " ")) for e in a["effects"])
    said = escape(str(a["verdict"]).replace("_", " ")) + (f": <b>{effects}</b>" if effects else "")
    link = _relative(Path(a["page"]), folder) if a.get("page") else ""
    return [_log_cell(a, link), said, f"{a['duration_s']:.0f}&nbsp;s"]


def _relative(target: Path, folder: Path) -> str:
    """A link that still works when the folder is moved."""
    try:
        return target.relative_to(folder.resolve()).as_posix()
    except ValueError:
        return target.as_uri()


def _run_row(a: Mapping[str, Any]) -> list[str]:
    first = to_mend((_REASONS[name], s) for name, s in a["refusals_s"].items() if name in _REASONS)
    why = "" if first is None or first[1] < 1.0 else f"{first[0].value}, {lasted(first[1])}"
    duration, done = a["duration_s"], a["compensated_s"]
    return [_log_cell(a), f"{done:.0f} of {duration:.0f}&nbsp;s", escape(why)]
