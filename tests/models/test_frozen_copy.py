"""A changed record does not carry what was computed from the old values."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from models.common.frozen_copy import replace


@dataclass(frozen=True)
class Square:
    side: float

    @cached_property
    def area(self) -> float:
        return self.side**2


def test_a_cached_property_is_computed_anew() -> None:
    small = Square(2.0)
    assert small.area == 4.0
    large = replace(small, side=3.0)
    assert (large.area, small.area) == (9.0, 4.0)
