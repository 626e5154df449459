"""The amended model: a model directory that holds the adopted effects, also where there was no surrogate before."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from models.effects import AdoptedEffect
from models.errors import ConfigError
from models.surrogate.empty import declared_thrust, empty_model
from models.surrogate.fan_surrogate import FanSurrogate
from models.surrogate.store import save_model
from models.vehicle import Vehicle

__all__ = ["amended", "empty_model", "save_amended"]


def amended(model: FanSurrogate | None, vehicle: Vehicle, effects: Iterable[AdoptedEffect]) -> FanSurrogate:
    """The model with ``effects`` added to those it has. Times of a log do not carry over: a load found is on."""
    if model is None and np.ptp(declared_thrust(vehicle)) > 1e-6 * float(np.max(declared_thrust(vehicle))):
        raise ConfigError(
            "--save-model: the fans' ct differ, and a model directory holds one fan; train a model for this vehicle"
        )
    base = empty_model(vehicle) if model is None else model
    new = tuple(
        AdoptedEffect(e.name, {k: 0.0 if k == "from_s" else v for k, v in e.parameters.items()}) for e in effects
    )
    return base.with_effects((*base.effects, *new))


def save_amended(
    directory: Path, model: FanSurrogate | None, vehicle: Vehicle, effects: Iterable[AdoptedEffect]
) -> None:
    """Write the amended model as a directory that ``companion --model`` flies."""
    save_model(directory, amended(model, vehicle, effects))
