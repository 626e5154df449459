"""Figures 5 to 10 of the paper: lift over the ground, lift and tilt beside a wall, from the flow simulation."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from models.cfd.statements import Checked
from models.common.frames import Array
from models.common.pages.svg import Line, figure
from models.paper.exhibit import Exhibit

LIFT = 2
TILT = 4
"""Of a wrench."""


def flow_exhibits(checked: Checked) -> Iterator[Exhibit]:
    """Those whose places are among the cases."""
    heights = np.array(checked.heights)
    walls = np.array(checked.walls)
    ratio = np.array([checked.ratio(h) for h in checked.heights])
    beside = np.array([checked.labels[math.inf, d].wrench for d in checked.walls])
    plots = {
        "paper, figs 5 and 9": _plot(
            "Lift over free lift above ground", heights, ratio, "height / R", "1"
        ),
        "paper, figs 6 and 10": _plot(
            "Lift over free lift beside a wall", walls, beside[:, LIFT] / checked.free, "d / R", "1"
        ),
        "paper, fig. 7": _plot(
            "Tilting moment beside a wall", walls, beside[:, TILT], "d / R", "N m"
        ),
    }
    for statement in checked.statements:
        if not statement.source.startswith("paper"):
            continue
        source = statement.source
        yield Exhibit(
            title=source.removeprefix("paper, "),
            paper=statement.claim,
            here=statement.ours,
            verdict=statement.verdict,
            plots=(plots[source],) if source in plots else (),
        )


def _plot(title: str, x: Array, y: Array, x_label: str, y_label: str) -> str:
    return figure(title, [Line(x, y, "after", points=True), Line(x, y, "after")], x_label, y_label)
