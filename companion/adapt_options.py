"""What adaptation may do about what it learns."""

from __future__ import annotations

from argparse import ArgumentTypeError
from enum import Enum


class Adapt(Enum):
    """What the sizes that are measured in flight do to the offsets."""

    OFF = "off"
    """Nothing is measured."""
    FULL = "full"
    """Offsets follow the measured sizes, up to half more than the model's."""


def read_adapt(text: str) -> Adapt:
    """The value of ``--adapt``, for argparse."""
    if text == "gate":
        raise ArgumentTypeError("gate is not available; use full, which measures the same, or off")
    try:
        return Adapt(text)
    except ValueError:
        raise ArgumentTypeError(
            f"invalid choice: '{text}' (choose from {', '.join(m.value for m in Adapt)})"
        ) from None
