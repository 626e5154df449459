"""The catalogue: one missing effect a file. A module here with an ``EFFECT`` is in it; nothing else is needed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from importlib import import_module
from pkgutil import iter_modules

import numpy as np

from models.air_state import AirState
from models.common.errors import ModelError
from models.common.frames import AXES, Array
from models.effects.adopted_effect import AdoptedEffect
from models.effects.coefficient import BelongsTo, Coefficient
from models.effects.context import Context
from models.effects.effect import Effect
from models.effects.flight_use import FlightUse, InFlight

__all__ = [
    "AdoptedEffect",
    "BelongsTo",
    "Coefficient",
    "Context",
    "Effect",
    "FlightUse",
    "InFlight",
    "adopted",
    "adopted_wrench",
    "adopted_wrenches",
    "catalogue",
    "corrected_state",
    "get",
]


@lru_cache(maxsize=1)
def catalogue() -> tuple[Effect, ...]:
    """Every effect, in alphabetical order of its file."""
    modules = []
    for name in sorted(m.name for m in iter_modules(__path__)):
        modules.append(import_module(f"{__name__}.{name}"))
    return tuple(module.EFFECT for module in modules if hasattr(module, "EFFECT"))


def get(name: str) -> Effect:
    """The effect of that name; ModelError where there is none."""
    for effect in catalogue():
        if effect.name == name:
            return effect
    raise ModelError(
        f"effect {name!r} is not in the catalogue; train the model with this version of the program"
    )


def adopted(
    name: str, parameters: Mapping[str, float], without: Sequence[str] = ()
) -> AdoptedEffect:
    """The effect with these parameters, optional ones 0; ModelError where one is missing, unknown or not finite.

    Models are adopted on the ground and flown later, perhaps by another version: this refuses before take-off.
    """
    effect = get(name)
    optional = (*(c.name for c in effect.coefficients if c.optional), *effect.in_flight.covered)
    parameters = dict.fromkeys(optional, 0.0) | dict(parameters)
    known = (
        {c.name for c in effect.coefficients}
        | {s.name for s in effect.shapes}
        | set(effect.in_flight.covered)
    )
    for wrong, what in (
        (known - parameters.keys(), "lacks"),
        (parameters.keys() - known, "does not know"),
    ):
        if wrong:
            raise ModelError(
                f"effect {name!r} {what} parameter {min(wrong)!r}; diagnose the flight with this "
                "version"
            )
    for key, value in parameters.items():
        if not math.isfinite(value):
            raise ModelError(
                f"effect {name!r}: parameter {key!r} is {value}; diagnose the flight with this "
                "version"
            )
    for axis in set(without) - set(AXES):
        raise ModelError(f"effect {name!r}: axis {axis!r} is not one of {', '.join(AXES)}")
    return AdoptedEffect(name, parameters, tuple(without))


def adopted_wrenches(
    effects: Sequence[AdoptedEffect], ctx: Context, *, in_flight: bool = False
) -> Array:
    """Wrench of each adopted effect (n, ..., 6), body FRD about the CG.

    What corrects a measurement is left to ``corrected_state``. ``in_flight`` leaves out what is not compensated in
    flight. Unknown quantities contribute nothing.
    """
    out = np.zeros((len(effects), *ctx.state.time_s.shape, 6))
    for k, one in enumerate(effects):
        effect = get(one.name)
        use = effect.in_flight.use
        if use is InFlight.WRENCH or (use is InFlight.NONE and not in_flight):
            wrench = effect.wrench(ctx, one.parameters)
            out[k] = np.nan_to_num(wrench, nan=0.0, posinf=0.0, neginf=0.0)
            if one.without:
                out[k][..., [AXES.index(a) for a in one.without]] = 0.0
    return out


def adopted_wrench(
    effects: Sequence[AdoptedEffect], ctx: Context, *, in_flight: bool = False
) -> Array:
    """Sum (..., 6) of ``adopted_wrenches``."""
    out: Array = adopted_wrenches(effects, ctx, in_flight=in_flight).sum(axis=0)
    return out


def corrected_state(effects: Sequence[AdoptedEffect], state: AirState) -> AirState:
    """The state with adopted corrections of measurements."""
    for one in effects:
        correct = get(one.name).in_flight.corrected
        if correct is not None:
            state = correct(state, one.parameters)
    return state
