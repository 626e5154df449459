"""Sizes of effects over the logs of a season, in order of date."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from models.pages.svg import Line, figure


def plots(answers: Sequence[Mapping[str, Any]]) -> list[str]:
    """A plot of each parameter that two logs or more show, with 95 % intervals, as SVG; the most frequent first.

    ``answers``: ``logs`` in the JSON of ``replay diagnose FOLDER``.
    """
    judged = sorted((a for a in answers if "verdict" in a), key=lambda a: str(a.get("date", "")))
    sizes: dict[tuple[str, str, str], list[tuple[int, float, float]]] = {}
    for number, answer in enumerate(judged, 1):
        for effect in answer["effects"]:
            for name, found in effect["parameters"].items():
                low, high = (math.nan if end is None else end for end in found.get("ci95") or (None, None))
                size = (number, found["value"], float(np.nan_to_num(0.5 * (high - low))))
                sizes.setdefault((effect["name"], name, found.get("unit", "")), []).append(size)
    often = sorted((item for item in sizes.items() if len(item[1]) > 1), key=lambda item: -len(item[1]))
    return [_plot(*key, np.array(found)) for key, found in often]


def _plot(effect: str, name: str, unit: str, sizes: np.ndarray[Any, np.dtype[np.float64]]) -> str:
    line = Line(sizes[:, 0], sizes[:, 1], "after", points=True, error=sizes[:, 2])
    label = name.replace("_", " ") + (f" [{unit}]" if unit not in ("", "1") else "")
    return figure(effect.replace("_", " "), [line], "log, in order of date", label)
