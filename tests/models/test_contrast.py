"""Text of every page is readable: WCAG 2.2, success criterion 1.4.3, in light and in dark."""

from __future__ import annotations

import re

import pytest

from models.common.pages.svg import STYLE

LEAST = 4.5
"""Contrast of normal text."""
TEXT = ("ink", "dim", "mark", "before", "after", "fit", "bad", "a", "b", "c", "d")
GROUNDS = ("paper", "card")


def palettes() -> list[dict[str, str]]:
    """Light, and light with what dark changes."""
    light, dark = (
        dict(re.findall(r"--(\w+):(#[0-9a-f]+)", part)) for part in STYLE.split("@media")
    )
    return [light, light | dark]


def luminance(colour: str) -> float:
    """Relative luminance of #rgb or #rrggbb, as WCAG defines it."""
    digits = colour[1:]
    if len(digits) == 3:
        digits = "".join(2 * digit for digit in digits)
    out = 0.0
    for start, weight in ((0, 0.2126), (2, 0.7152), (4, 0.0722)):
        share = int(digits[start : start + 2], 16) / 255.0
        linear = share / 12.92 if share <= 0.04045 else ((share + 0.055) / 1.055) ** 2.4
        out += weight * linear
    return out


def contrast(one: str, other: str) -> float:
    """From 1 to 21."""
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_the_measure_is_that_of_wcag() -> None:
    assert contrast("#fff", "#000000") == pytest.approx(21.0)
    assert contrast("#777777", "#fff") == pytest.approx(4.48, abs=0.01)


@pytest.mark.parametrize("palette", palettes(), ids=("light", "dark"))
@pytest.mark.parametrize("name", TEXT)
def test_text_stands_out(palette: dict[str, str], name: str) -> None:
    for ground in GROUNDS:
        assert contrast(palette[name], palette[ground]) >= LEAST, ground
