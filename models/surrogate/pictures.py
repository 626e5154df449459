"""A surrogate as a page: what ground and wall do to a fan, with the spread of the answer."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from models.common.frames import Array
from models.common.pages.document import document
from models.common.pages.shown import ShownPage
from models.common.pages.svg import Line, figure

POINTS = 121
USUAL_RADIUS_M = 0.13
"""Where a model does not say the radius of its fan."""
REACH_RADII = (0.5, 6.0)
"""Heights and distances that are drawn, in rotor radii."""
USUAL_RPM = 4000.0
LIFT = 2
PULL = 0
MOMENT = 4
"""Components of a wrench in the corner frame."""


class Queried(Protocol):
    """A surrogate of one fan."""

    info: Mapping[str, Any]

    def query(self, h: ArrayLike, d: ArrayLike, rpm: ArrayLike) -> Any:
        """``wrench`` and ``sigma`` (..., 6)."""

    def free_air(self, rpm: ArrayLike) -> Array:
        """Wrench (..., 6) with neither ground nor wall."""


def surfaces(model: Queried, rpm: float | None = None) -> ShownPage:
    """Lift over height, pull and moment over the distance to a wall, at one speed [1/min]."""
    if rpm is None:
        speed = USUAL_RPM
    else:
        speed = rpm
    radius = float(model.info.get("fan", {}).get("radius_m", USUAL_RADIUS_M))
    distance = radius * np.linspace(*REACH_RADII, POINTS)
    lift = float(model.free_air(speed)[LIFT])
    low = _shares(model, distance, np.full(POINTS, np.inf), speed, lift)
    wall = _shares(model, np.full(POINTS, np.inf), distance, speed, lift)
    plots = [
        _plot("Lift above ground", "height [m]", "% of free-air lift", distance, low, LIFT),
        _plot("Pull of a wall", "distance [m]", "% of lift", distance, wall, PULL),
        _plot("Moment of a wall", "distance [m]", "% of lift, m", distance, wall, MOMENT),
    ]
    title = "Surrogate of a fan"
    text = f"<p>{escape(repr(model))}, at {speed:.0f} rpm: {lift:.3g} N in free air.</p>"
    return ShownPage(document(title, [f"<h1>{title}</h1>", text, *plots]))


def _shares(model: Queried, h: Array, d: Array, rpm: float, lift: float) -> tuple[Array, Array]:
    """What surroundings add, and its standard deviation, each (n, 6), in hundredths of the lift."""
    answer = model.query(h, d, rpm)
    scale = 100.0 / max(lift, 1e-12)
    return scale * (answer.wrench - model.free_air(rpm)), scale * answer.sigma


def _plot(
    title: str,
    x_label: str,
    y_label: str,
    distance: Array,
    shares: tuple[Array, Array],
    component: int,
) -> str:
    mean = shares[0][:, component]
    spread = 1.96 * shares[1][:, component]
    lines = [
        Line(distance, mean, "after", "surrogate"),
        Line(distance, mean - spread, "before", "95 %"),
        Line(distance, mean + spread, "before", "95 %"),
    ]
    return figure(title, lines, x_label, y_label)
