"""Sizes of effects over logs, in order of date. Light: the page of ``replay serve`` draws them, too."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from models.pages.svg import Line, figure
from replay.diagnosis.words import plain, unit_words

Size = tuple[int, float, float]
"""Number of the log, value, half of its 95 % interval."""


def plots(answers: Sequence[Mapping[str, Any]]) -> list[str]:
    """A plot of each parameter that two logs or more show, as SVG; the most frequent first.

    ``answers``: ``logs`` in the JSON of ``replay diagnose FOLDER``.
    """
    judged = sorted((a for a in answers if "verdict" in a), key=lambda a: str(a.get("date", "")))
    sizes: dict[tuple[str, str, str], list[Size]] = {}
    for number, answer in enumerate(judged, 1):
        for effect in answer["effects"]:
            for name, found in effect["parameters"].items():
                low, high = (math.nan if end is None else end for end in found.get("ci95") or (None, None))
                size = (number, found["value"], float(np.nan_to_num(0.5 * (high - low))))
                sizes.setdefault((effect["name"], name, found.get("unit", "")), []).append(size)
    often = sorted((item for item in sizes.items() if len(item[1]) > 1), key=lambda item: -len(item[1]))
    return [_plot(*key, found) for key, found in often]


def _plot(effect: str, parameter: str, unit: str, sizes: Iterable[Size]) -> str:
    number, value, half = np.array(list(sizes), dtype=float).T
    said = unit_words(unit)
    line = Line(number, value, "after", points=True, error=half)
    label = plain(parameter) + (f" [{said}]" if said else "")
    return figure(plain(effect), [line], "log, in order of date", label)
