"""The empty model: rotors in free air as the vehicle file declares them, and nothing else (``--model none``)."""

from __future__ import annotations

import numpy as np

from models.surrogate.coordinates import Coordinates
from models.surrogate.domain import NODES, Domain
from models.surrogate.fan_identity import identity
from models.surrogate.fan_surrogate import Calibration, FanSurrogate
from models.surrogate.free_air import FreeAir
from models.surrogate.polynomial import PolynomialRegressor
from models.vehicle import Vehicle
from models.vehicle_wrench import REFERENCE_RPM, reference_thrust


def empty_model(vehicle: Vehicle) -> FanSurrogate:
    """A surrogate without increments. Fans of unequal ``ct`` lift their mean.

    Raises ConfigError where rotor speeds are telemetered and a fan has no ``ct``.
    """
    thrust = reference_thrust(vehicle, None)
    zero = (0.0,) * 6
    law = FreeAir(
        lift_n=float(thrust.mean()),
        rpm_ref=REFERENCE_RPM,
        exponent=0.0,
        share=(0.0, 0.0, 1.0, 0.0, 0.0, 0.0),
        scatter=zero,
        origin="vehicle file",
    )
    fan = identity(law, vehicle.rotor_radius_m, vehicle.fans[0].lip_radius_m)
    return FanSurrogate(
        free_air_law=law,
        coordinates=Coordinates(
            h_near=0.0,
            h_far=0.0,
            d_near=0.0,
            d_far=0.0,
            rpm_low=1.0,
            rpm_high=1e5,
            axisymmetric=True,
        ),
        regressor=PolynomialRegressor(1, np.zeros((4, 6)), np.zeros(6)),
        calibration=Calibration(zero, zero, (1.0,) * 6),
        domain=Domain(np.ones((NODES, NODES)), 0.0, 0.0, 1.0, 1e5),
        info={"method": "none", "data_hash": "", "metrics": {}, "fan": fan.as_info()},
    )


def is_empty(model: FanSurrogate) -> bool:
    """True for a model that says nothing about ground and wall and has no adopted effect."""
    return not model.effects and model.info.get("method") == "none"
