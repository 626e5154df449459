"""A changed record does not carry what was computed from the old values."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import pytest

from models.common.frozen_copy import with_changes


@dataclass(frozen=True)
class Square:
    side: float

    @cached_property
    def area(self) -> float:
        return self.side**2


def test_a_cached_property_is_computed_anew() -> None:
    small = Square(2.0)
    assert small.area == 4.0
    large = with_changes(small, side=3.0)
    assert (large.area, small.area) == (9.0, 4.0)


def test_a_misspelt_field_is_an_error() -> None:
    with pytest.raises(TypeError, match="has no field 'sidee'"):
        with_changes(Square(2.0), sidee=3.0)  # type: ignore[call-arg]
