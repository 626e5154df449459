"""``replay run --report``: what the companion would have done on a log, as one HTML page."""

from __future__ import annotations

from html import escape
from typing import Any

import numpy as np

from models.pages.document import document, folded, items, table, verdict
from models.pages.svg import Band, Line, figure, keys
from replay.rerun.history import History
from replay.rerun.mend import lasted, to_mend
from replay.rerun.report import RunReport

_SMALL_THRUST, _SMALL_TILT_DEG = 0.05, 3.0
"""Offsets up to which a first flight with them is reasonable (docs/install.md, checklist)."""
_MOSTLY = 0.5
"""Share of the time from which the offsets are what to look at, and below which the reasons are."""
_PLOTS: tuple[tuple[str, tuple[tuple[str, str, str], ...], str], ...] = (
    ("Distance", (("h_m", "to the ground", "a"), ("d_m", "to the wall", "b")), "[m]"),
    ("Force of the air, as modelled", (("lift_n", "up", "after"), ("side_n", "sideways", "before")), "[N]"),
    ("Thrust offset", (("thrust", "thrust", "after"),), "[% of full throttle]"),
    ("Tilt offset", (("roll_deg", "roll", "after"), ("pitch_deg", "pitch", "before")), "[deg]"),
    ("Trust and authority", (("trust", "trust in the model", "c"), ("authority", "authority", "d")), "[0 to 1]"),
)
_ROWS = {
    "thrust": "thrust offset [share of full]", "roll_deg": "roll offset [deg]", "pitch_deg": "pitch offset [deg]",
    "h_m": "height [m]", "d_m": "to the wall [m]", "trust": "trust in the model", "lift_n": "lift of the air [N]",
    "side_n": "side force of the air [N]",
}  # fmt: skip


def page(report: RunReport, history: History) -> str:
    """The whole page."""
    numbers = report.as_json()
    head, steps = _verdict(report, numbers)
    bands = [Band(s.start_s, s.end_s, "fit", "compensating") for s in history.spans() if s.reason is None]
    about = (
        f"{report.log.name}: {numbers['duration_s']:.0f} s with decisions, vehicle file “{report.vehicle}”, model "
        f"“{report.model}”, {report.boots} boot(s). Nothing was sent: this is a replay."
    )
    return document(
        f"{report.log.name}: {head}",
        [
            f"<h1>{escape(head)}</h1>",
            verdict("What the companion would have done", steps),
            f'<p class="dim">{escape(about)}</p>',
            "<h2>Why it gave no offset</h2>" if numbers["gravest_s"] else "",
            _reasons(report),
            "<h2>Over time</h2>",
            _plots(history, bands),
            "<h2>Numbers</h2>",
            table(("", "min", "mean", "max"), _ranges(numbers), numbers=(1, 2, 3)),
            folded("Notes", items(report.notes)),
            folded("Messages", table(("sample", "count"), _samples(numbers), numbers=(1,))),
        ],
    )


def _verdict(report: RunReport, numbers: dict[str, Any]) -> tuple[str, list[str]]:
    share, duration = numbers["share_compensated"], numbers["duration_s"]
    if not share:
        head = "It would not have compensated"
    else:
        head = f"It would have compensated {share:.0%} of {duration:.0f} s"
    if share < _MOSTLY:
        first = to_mend(report.summary.refusals())
        if report.summary.too_slow:
            return head, [f"Next: {report.summary.too_slow}."]
        if first is None:
            return head, ["Next: replay a longer flight. Only take-off and landing kept it from compensating."]
        reason, seconds = first
        return head, [
            f"Next: correct the main reason for no offset ({reason.value}, {lasted(seconds)}). Fly, and replay again."
        ]
    thrust = max((abs(numbers["thrust"][k]) for k in ("min", "max")), default=0.0)
    tilt = max(abs(numbers[n][k]) for n in ("roll_deg", "pitch_deg") for k in ("min", "max"))
    size = f"largest offsets ({thrust:.1%} of full thrust, {tilt:.1f} degrees)"
    if thrust > _SMALL_THRUST or tilt > _SMALL_TILT_DEG:
        return head, [
            f"Next: look at the moments of the {size}: are height and wall distance right there? For the first flight "
            "set smaller ones under [limits] in the vehicle file."
        ]
    return head, [f"Next: the {size} are small enough for a first flight with offsets: checklist in docs/install.md."]


def _reasons(report: RunReport) -> str:
    rows = [
        [escape(reason.value), f"{seconds:.1f} s"] for reason, seconds in report.summary.refusals() if seconds >= 0.05
    ]
    return table(("reason", "time"), rows, numbers=(1,))


def _plots(history: History, bands: list[Band]) -> str:
    t_s = history.column("t_s")
    out = []
    for title, curves, unit in _PLOTS:
        lines = [
            Line(t_s, history.column(name) * (100.0 if name == "thrust" else 1.0), kind, label)
            for name, label, kind in curves
        ]
        if not any(np.isfinite(line.y).any() for line in lines):
            continue
        out.append(figure(f"{title} {unit}", lines, "time since boot [s]", "", bands))
    legend = f'<p class="keys">{keys((), bands)}</p>' if bands else ""
    return f'{legend}<div class="plots">{"".join(out)}</div>'


def _ranges(numbers: dict[str, Any]) -> list[list[str]]:
    return [
        [escape(words), *(f"{numbers[name][k] + 0.0:.3f}" for k in ("min", "mean", "max"))]
        for name, words in _ROWS.items()
        if numbers.get(name)
    ]


def _samples(numbers: dict[str, Any]) -> list[list[str]]:
    return [[escape(kind), str(count)] for kind, count in numbers["samples_by_kind"].items()]
