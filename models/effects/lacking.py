"""Which flights can show an effect."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from models.effects.context import Context

LEAST_COMMANDED = 0.01
"""Probability that the thrust was commanded, below which nothing that hangs on it is asked: odds of 1 to 100."""


def always(_: Context) -> str | None:
    """``lacking`` of effects that need nothing besides rotors and IMU."""
    return None


def where_commanded(ctx: Context) -> str | None:
    """``lacking`` of effects that show in commanded changes of the thrust only.

    A response to a disturbance looks like such an effect however much data there is. So the odds of the effect are
    never better than those of the command.
    """
    if ctx.commanded < LEAST_COMMANDED:
        return "the thrust changed only in response to disturbances"
    return None


def where_seen(distance: str, otherwise: str) -> Callable[[Context], str | None]:
    """``lacking`` of an effect of what is at this ``distance`` of the state; ``otherwise`` says that none was seen."""
    return lambda ctx: None if np.isfinite(getattr(ctx.state, distance)).any() else otherwise
