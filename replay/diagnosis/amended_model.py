"""The amended model: a model directory that holds the adopted effects, also where there was no surrogate before."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from models.air_state import blank_state
from models.effects import AdoptedEffect, Context
from models.errors import ConfigError
from models.surrogate.coordinates import Coordinates
from models.surrogate.domain import NODES, Domain
from models.surrogate.fan_surrogate import Calibration, FanSurrogate
from models.surrogate.free_air import FreeAir
from models.surrogate.polynomial import PolynomialRegressor
from models.surrogate.store import save_model
from models.vehicle import Vehicle

REFERENCE_RPM = 4000.0


def empty_model(vehicle: Vehicle) -> FanSurrogate:
    """Rotors in free air as the vehicle file declares them, and nothing else: the empty model as a directory."""
    state = blank_state((), len(vehicle.fans), len(vehicle.rotors))
    state.rpm[...] = REFERENCE_RPM
    thrust = Context(state, vehicle).thrust
    if float(np.ptp(thrust)) > 1e-6 * float(np.max(thrust)):
        raise ConfigError(
            "--save-model: the fans' ct differ, and a model directory holds one fan; train a model for this vehicle"
        )
    zero = (0.0,) * 6
    return FanSurrogate(
        FreeAir(float(thrust[0]), REFERENCE_RPM, 0.0, (0.0, 0.0, 1.0, 0.0, 0.0, 0.0), zero, "vehicle file"),
        Coordinates(0.0, 0.0, 0.0, 0.0, 1.0, 1e5, True),
        PolynomialRegressor(1, np.zeros((4, 6)), np.zeros(6)),
        Calibration(zero, zero, (1.0,) * 6),
        Domain(np.ones((NODES, NODES)), 0.0, 0.0, 1.0, 1e5),
        info={"method": "none", "data_hash": "", "metrics": {}},
    )


def amended(model: FanSurrogate | None, vehicle: Vehicle, effects: Iterable[AdoptedEffect]) -> FanSurrogate:
    """The model with ``effects`` added to those it has. Times of a log do not carry over: a load found is on."""
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
