"""How wrong the model that flies is about the air of a simulated flight: lift, pull and tilt of the whole vehicle."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from companion.sim.air import CORNER_PLACES, RPM_HOVER, LawError, SurfaceLaw
from companion.sim.scenario import wall_azimuth
from models.air_state import AirState, blank_state
from models.common.frames import GRAVITY, Array, at_cg, corner_to_body
from models.effects import Context, adopted_wrench, corrected_state
from models.surrogate.fan_surrogate import FanSurrogate
from models.vehicle import Vehicle
from models.vehicle_wrench import disturbance_wrench

WITHOUT_OFFSETS = 1.0
"""What a model that says nothing is wrong by."""


def model_error(model: FanSurrogate, vehicle: Vehicle, truth: SurfaceLaw) -> LawError:
    """RMS of modelled minus true disturbance over RMS of the true one, at the places of a corner flight.

    The vehicle hovers level beside a wall where its wall sensor looks. What the model states, adopted effects included,
    counts as a share of the lift it states in free air; trust and limits of the offsets do not.
    """
    free_n = sum(fan[2] for fan in model.free_air_now([RPM_HOVER] * len(vehicle.fans)))
    rpm = RPM_HOVER * math.sqrt(vehicle.mass_kg * GRAVITY / free_n)
    lift_n = sum(fan[2] for fan in model.free_air_now([rpm] * len(vehicle.fans)))

    def effects(state: AirState) -> Array:
        context = Context(state=state, vehicle=vehicle, model=model)
        return adopted_wrench(model.effects, context, in_flight=True)

    alone = effects(_hover(vehicle, math.inf, math.inf, rpm))
    believed = []
    true = []
    for eta, delta in CORNER_PLACES:
        here = _hover(vehicle, eta, delta, rpm)
        seen = corrected_state(model.effects, here)
        stated = disturbance_wrench(vehicle, model, seen) + effects(seen) - alone
        believed.append(_lift_pull_tilt(stated / lift_n, vehicle))
        true.append(_lift_pull_tilt(_true_shares(truth, vehicle, here), vehicle))
    return LawError.of(believed, true)


def _hover(vehicle: Vehicle, eta: float, delta: float, rpm: float) -> AirState:
    """Level, with the lowest fan at ``eta`` and the foremost lip at ``delta`` rotor radii from ground and wall."""
    radius = vehicle.rotor_radius_m
    azimuth = wall_azimuth(vehicle)
    place = vehicle.fan_positions_m
    towards = place[:, :2] @ (math.cos(azimuth), math.sin(azimuth))
    lip = towards + vehicle.lip_radii_m
    still = blank_state((), len(vehicle.fans), len(vehicle.rotors))
    return replace(
        still,
        h_m=eta * radius + place[:, 2].max() - place[:, 2],
        d_m=delta * radius + lip.max() - lip,
        wall_bearing_rad=np.array(azimuth),
        rpm=np.full(len(vehicle.rotors), rpm),
    )


def _true_shares(truth: SurfaceLaw, vehicle: Vehicle, state: AirState) -> Array:
    """The true disturbance (6,) about the CG, body FRD, as a share of the vehicle's lift in free air."""
    total = np.zeros(6)
    radius = vehicle.rotor_radius_m
    each = 1.0 / len(vehicle.fans)
    for fan, h_m, d_m in zip(vehicle.fans, state.h_m.tolist(), state.d_m.tolist(), strict=True):
        own = truth.increments(h_m / radius, d_m / radius)
        moments = (radius * own.mx, radius * own.my, 0.0)
        wrench = each * np.array([own.x, own.y, own.z, *moments])
        in_body = corner_to_body(wrench, state.wall_bearing_rad)
        total += at_cg(in_body, fan.position_m)
    return total


def _lift_pull_tilt(wrench: Array, vehicle: Vehicle) -> tuple[float, float, float]:
    """Force up, force to the wall, and the moment that tilts towards it [1/R] of a wrench (6,), body FRD."""
    azimuth = wall_azimuth(vehicle)
    c = math.cos(azimuth)
    s = math.sin(azimuth)
    fx, fy, fz, mx, my, _ = wrench.tolist()
    return -fz, c * fx + s * fy, (s * mx - c * my) / vehicle.rotor_radius_m
