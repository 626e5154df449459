"""The modelled wrench of a whole vehicle: fans by rotor speed, surrogate, vanes, torque differences."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from models.air_state import AirState
from models.common.errors import ConfigError
from models.common.frames import GRAVITY, Array, at_cg, corner_to_body
from models.vehicle import RHO_SEA_LEVEL, Fan, Vehicle

RPM_TO_RAD_S = 2.0 * np.pi / 60.0
REFERENCE_RPM = 4000.0
"""Any speed would do: without a model thrust goes as rpm^2."""


class FanModel(Protocol):
    """A surrogate of one fan."""

    def wrench(self, h: ArrayLike, d: ArrayLike, rpm: ArrayLike) -> Array:
        """Total wrench (..., 6) of one fan in its corner frame."""


def fan_rpm(vehicle: Vehicle, rotor_rpm: ArrayLike) -> Array:
    """One speed per fan, sqrt(mean(rpm_i^2)) over its rotors: (..., rotors) -> (..., fans)."""
    rpm = np.asarray(rotor_rpm, dtype=float)
    squares = np.add.reduceat(rpm * rpm, vehicle.first_rotors, axis=-1)
    return np.asarray(np.sqrt(squares / vehicle.rotor_counts))


def fan_rpm_now(vehicle: Vehicle, rotor_rpm: Sequence[float]) -> tuple[float, ...]:
    """``fan_rpm`` of one instant in plain floats."""
    out = []
    first = 0
    for fan in vehicle.fans:
        count = len(fan.rotors)
        out.append(math.sqrt(sum([v * v for v in rotor_rpm[first : first + count]]) / count))
        first += count
    return tuple(out)


def free_air_thrust(vehicle: Vehicle, model: FanModel | None, fan: Fan, rpm: ArrayLike) -> Array:
    """Free-air thrust [N] of one fan at ``rpm`` (...): the model's own, by ``ct``, or as ``[throttle]`` hovers."""
    if model is not None:
        return model.wrench(np.inf, np.inf, rpm)[..., 2]
    speed = np.asarray(rpm, dtype=float)
    if fan.ct is not None:
        return fan.ct * _dynamic_force(vehicle, speed)
    if vehicle.telemetered:
        raise ConfigError(
            "vehicle file: key 'fan.ct' is missing, and --model none has no free-air rows to "
            "replace it"
        )
    return vehicle.mass_kg * GRAVITY / len(vehicle.fans) * (speed / REFERENCE_RPM) ** 2


def reference_thrust(vehicle: Vehicle, model: FanModel | None) -> Array:
    """Free-air thrust [N] (fans,) at ``REFERENCE_RPM``; without a model as the vehicle file declares it."""
    thrusts = [free_air_thrust(vehicle, model, fan, REFERENCE_RPM) for fan in vehicle.fans]
    return np.array(thrusts, dtype=float)


def rpm_from_servos(vehicle: Vehicle, model: FanModel | None, servo_us: ArrayLike) -> Array:
    """Rotor speeds [rpm] (..., rotors) that give the thrust the ``[throttle]`` curve declares for these outputs.

    Only the thrust is known there; the speed is the one at which a rotor carries its share of the fan's free-air
    thrust. Without a model and without ``ct`` the vehicle's own hover fixes the scale.
    """
    owner = np.asarray(vehicle.rotor_fan)
    whole = servo_thrust(vehicle, servo_us) * vehicle.rotor_counts[owner]
    reference = reference_thrust(vehicle, model)[owner]
    return np.asarray(REFERENCE_RPM * np.sqrt(np.maximum(whole, 0.0) / reference))


def servo_thrust(vehicle: Vehicle, servo_us: ArrayLike) -> Array:
    """Thrust [N] per rotor (..., rotors) declared by ``[throttle]`` for servo outputs [us] (..., 16)."""
    if vehicle.throttle is None:
        raise ConfigError(
            "vehicle file: key 'throttle' is missing, and no rotor speed is telemetered"
        )
    curve = vehicle.throttle
    channels = [rotor.servo - 1 for rotor in vehicle.rotors if rotor.servo is not None]
    pwm = np.asarray(servo_us, dtype=float)[..., channels]
    span = curve.pwm_max_us - curve.pwm_min_us
    u = np.clip((pwm - curve.pwm_min_us) / span, 0.0, 1.0)
    return curve.max_thrust_n * ((1.0 - curve.expo) * u + curve.expo * u * u)


def modelled_wrench(vehicle: Vehicle, model: FanModel | None, state: AirState) -> Array:
    """The declared wrench of the air on the vehicle about the CG, body FRD, shape (..., 6); no adopted effects.

    ``model`` None is the empty model: rotors in free air (``ct``, or ``[throttle]``), nothing else. ``state.rpm`` must
    hold rotor speeds (``rpm_from_servos`` where none is telemetered). Net torque comes from the surrogate at equal
    speeds; a speed difference inside a fan, or between single-rotor fans, adds ``cq`` terms where ``cq`` is given.
    """
    speeds = fan_rpm(vehicle, state.rpm)
    if model is None:
        body = np.zeros((*speeds.shape, 6))
        body[..., 2] = -((speeds / REFERENCE_RPM) ** 2) * reference_thrust(vehicle, None)
    else:
        corner = model.wrench(state.h_m, state.d_m, speeds)
        body = corner_to_body(corner, state.wall_bearing_rad[..., None])
    total: Array = at_cg(body, vehicle.fan_positions_m).sum(axis=-2)
    total[..., 5] += fan_torques(vehicle, state.rpm).sum(axis=-1)
    return total + vane_wrench(vehicle, state.servo_us, -body[..., 2])


def disturbance_wrench(vehicle: Vehicle, model: FanModel, state: AirState) -> Array:
    """What ground and wall add: wrench(h, d, rpm) - wrench(inf, inf, rpm), about the CG, body FRD, (..., 6)."""
    speeds = fan_rpm(vehicle, state.rpm)
    added = model.wrench(state.h_m, state.d_m, speeds) - model.wrench(np.inf, np.inf, speeds)
    body = corner_to_body(added, np.asarray(state.wall_bearing_rad)[..., None])
    return np.asarray(at_cg(body, vehicle.fan_positions_m).sum(axis=-2))


def vane_wrench(vehicle: Vehicle, servo_us: ArrayLike, lift: ArrayLike) -> Array:
    """Wrench (..., 6) of the vanes about the CG, body FRD; servo outputs (..., 16) [us], fan lifts (..., fans) [N]."""
    pwm = np.asarray(servo_us, dtype=float)
    fan_lift = np.asarray(lift, dtype=float)
    total = np.zeros((*fan_lift.shape[:-1], 6))
    for vane in vehicle.vanes:
        deflection = vane.rad_per_us * (pwm[..., vane.servo - 1] - vane.neutral_us)
        side = vane.force_per_thrust_rad * deflection * fan_lift[..., vane.fan - 1]
        wrench = np.zeros_like(total)
        wrench[..., :3] = side[..., None] * np.asarray(vane.axis)
        total += at_cg(wrench, vane.position_m)
    return total


def fan_torques(vehicle: Vehicle, rotor_rpm: ArrayLike) -> Array:
    """Yaw torque [N m] (..., fans) of the rotors; zero where ``cq`` is not given.

    A clockwise rotor turns the body counter-clockwise.
    """
    rpm = np.asarray(rotor_rpm, dtype=float)
    moment = np.zeros((*rpm.shape[:-1], len(vehicle.fans)))
    for k, (rotor, owner) in enumerate(zip(vehicle.rotors, vehicle.rotor_fan, strict=True)):
        fan = vehicle.fans[owner]
        if fan.cq is not None:
            cq = fan.cq / len(fan.rotors)
            torque = cq * _dynamic_force(vehicle, rpm[..., k]) * vehicle.rotor_radius_m
            moment[..., owner] -= rotor.spin * torque
    return moment


def _dynamic_force(vehicle: Vehicle, rpm: Array) -> Array:
    """rho A Omega^2 R^2 [N] at sea-level density."""
    tip_speed = rpm * RPM_TO_RAD_S * vehicle.rotor_radius_m
    return RHO_SEA_LEVEL * vehicle.disc_area_m2 * tip_speed**2
