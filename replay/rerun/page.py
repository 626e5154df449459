"""``replay run --report``: what the companion would have done on a log, as one HTML page."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from companion.control.reasons import Reason
from models.common.pages.svg import Band, Line, figure, keys
from models.common.runs import runs_of
from replay.report import render
from replay.rerun.history import History
from replay.rerun.report import RunReport

_SMALL_THRUST = 0.05
_SMALL_TILT_DEG = 3.0
"""Offsets up to which a first flight with them is reasonable (docs/install.md, checklist)."""
_MOSTLY = 0.5
"""Share of the time from which the offsets are what to look at, and below which the reasons are."""
_ORDINARY = (Reason.NOT_ARMED, Reason.LANDED, Reason.TAKING_OFF, Reason.STOPPING)
"""Reasons that every flight has."""
_PLOTS: tuple[tuple[str, tuple[tuple[str, str, str], ...]], ...] = (
    ("Distance [m]", (("h_m", "to the ground", "a"), ("d_m", "to the wall", "b"))),
    (
        "Force of the air, as modelled [N]",
        (("lift_n", "up", "after"), ("side_n", "sideways", "before")),
    ),
    ("Thrust offset [share of full throttle]", (("thrust", "thrust", "after"),)),
    ("Tilt offset [deg]", (("roll_deg", "roll", "after"), ("pitch_deg", "pitch", "before"))),
    (
        "Trust and authority [0 to 1]",
        (("trust", "trust in the model", "c"), ("authority", "authority", "d")),
    ),
)
_ROWS = {
    "thrust": "thrust offset [share of full]",
    "roll_deg": "roll offset [deg]",
    "pitch_deg": "pitch offset [deg]",
    "h_m": "height [m]",
    "d_m": "to the wall [m]",
    "trust": "trust in the model",
    "lift_n": "lift of the air [N]",
    "side_n": "side force of the air [N]",
}


def page(report: RunReport, history: History) -> str:
    """The whole page."""
    numbers = report.as_json()
    head, step = _verdict(report, numbers)
    return render(
        "run.html",
        report=report,
        numbers=numbers,
        head=head,
        verdict="What the companion would have done",
        sentences=[f"Next: {step}"],
        reasons=[
            (reason.value, f"{s:.1f} s") for reason, s in report.summary.refusals() if s >= 0.05
        ],
        plots=_plots(history),
        ranges=[
            (words, *(f"{numbers[name][k] + 0.0:.3f}" for k in ("min", "mean", "max")))
            for name, words in _ROWS.items()
            if numbers[name]
        ],
    )


def _verdict(report: RunReport, numbers: dict[str, Any]) -> tuple[str, str]:
    """What came out, and what to do next."""
    share = numbers["share_compensated"]
    duration = numbers["duration_s"]
    head = "It would not have compensated"
    if share:
        head = f"It would have compensated {share:.0%} of {duration:.0f} s"
    if share < _MOSTLY:
        why = to_mend(report.summary.refusals())
        if report.summary.too_slow:
            return head, f"{report.summary.too_slow}."
        if not why:
            return (
                head,
                "replay a longer flight. Only take-off and landing kept it from compensating.",
            )
        return head, f"correct the main reason for no offset ({why}). Fly, and replay again."
    thrust, roll, pitch = (
        max(-numbers[n]["min"], numbers[n]["max"]) for n in ("thrust", "roll_deg", "pitch_deg")
    )
    tilt = max(roll, pitch)
    size = f"largest offsets ({thrust:.1%} of full thrust, {tilt:.1f} degrees)"
    if thrust > _SMALL_THRUST or tilt > _SMALL_TILT_DEG:
        return head, (
            f"look at the moments of the {size}: are height and wall distance right there? For "
            "the first flight set smaller ones under [limits] in the vehicle file."
        )
    return (
        head,
        f"the {size} are small enough for a first flight with offsets: checklist in "
        "docs/install.md.",
    )


def to_mend(refusals: Iterable[tuple[Reason, float]]) -> str:
    """What to correct first so that offsets act: the reason that stopped them longest, with its time.

    Empty where there are only those that every flight has.
    """
    own = [
        (seconds, reason.value)
        for reason, seconds in refusals
        if reason not in _ORDINARY and seconds > 0.0
    ]
    seconds, reason = max(own, default=(0.0, ""))
    if reason:
        return f"{reason}, {lasted(seconds)}"
    return ""


def lasted(seconds: float) -> str:
    """A length of time in words."""
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} minutes"


def _plots(history: History) -> str:
    """As HTML, with the time shaded in which it compensated."""
    t_s = history.column("t_s")
    bands = []
    for run in runs_of(history.column("compensating") > 0.0):
        end = min(run.stop, len(t_s) - 1)
        bands.append(Band(t_s[run.start], t_s[end], "fit", "compensating"))
    if bands:
        out = f'<p class="keys">{keys((), bands)}</p>'
    else:
        out = ""
    out += '<div class="plots">'
    for title, curves in _PLOTS:
        lines = [Line(t_s, history.column(name), kind, label) for name, label, kind in curves]
        if any(np.isfinite(line.y).any() for line in lines):
            out += figure(title, lines, "time since boot [s]", "", bands)
    return f"{out}</div>"
