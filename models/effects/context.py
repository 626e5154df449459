"""The physics of a flight that effects may look at: thrust, flow, and wrenches about the centre of gravity."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.air_state import AirState
from models.common.frames import GRAVITY, Array, at_cg, corner_to_body
from models.common.frozen_copy import with_changes
from models.vehicle import RHO_SEA_LEVEL, Vehicle
from models.vehicle_wrench import (
    FanModel,
    fan_rpm,
    fan_torques,
    free_air_thrust,
    rpm_from_servos,
    servo_thrust,
)

GAS_CONSTANT_AIR = 287.05
DOWNWARD = np.array([0.0, 0.0, 1.0])
PULL, TILT = np.eye(6)[[0, 4]]
"""Force towards the wall and moment that tilts to it, in a fan's corner frame."""
APART_S = 0.5
"""Time over which changes of thrust and specific force are compared: what drifts does not count [s]."""
IMPOSSIBLE = 1e-30
"""Probability of what is as good as impossible: its logarithm is a number."""
LEAST_LOAD = 0.2
"""Share of its mass that every vehicle lifts besides: without that much thrust to spare it would not be flown."""


@dataclass(frozen=True, kw_only=True)
class Context:
    """What an effect may look at: the state of the air, the vehicle, and the fan model (None: the empty model).

    ``state`` has leading shape () in flight and (n,) in replay, there on a uniform time axis with NaN where unknown.
    """

    state: AirState
    vehicle: Vehicle
    model: FanModel | None = None
    clock_moved_s: float = 0.0
    """How much later than stamped the rotor speeds were taken to be."""
    commanded: float = 1.0
    """Probability that the thrust changed by command, and not only in response to disturbances (``delays.py``)."""
    accelerometer: bool = True
    """Whether the specific force was measured, and not computed from the velocity."""
    open_sky: bool = False
    """Whether satellites gave a place: the vehicle flew outdoors, where some wind blows on most days."""
    smoothed_s: float = 0.0
    """Standard deviation of the Gaussian low-pass that the signals of a record went through."""
    judged_s: tuple[float, float] | None = None
    """First and last time of a record that is judged, in the air; None: all of it."""

    @property
    def record(self) -> bool:
        """True for a record (n,), False for one instant."""
        return self.state.time_s.ndim == 1

    def elsewhere(self, **places: Array) -> Context:
        """The same instant at other places, such as ``d_m``: what comes of the rotors alone is not worked out again."""
        out = replace(self, state=with_changes(self.state, **places))
        for name in ("rotor_rpm", "rpm", "thrust"):
            out.__dict__[name] = getattr(self, name)
        return out

    @cached_property
    def rotor_rpm(self) -> Array:
        """(..., rotors): telemetered, or as the servo outputs declare."""
        if self.vehicle.telemetered or np.isfinite(self.state.rpm).any():
            return self.state.rpm
        return rpm_from_servos(self.vehicle, self.model, self.state.servo_us)

    @cached_property
    def rpm(self) -> Array:
        """(..., fans)."""
        return fan_rpm(self.vehicle, self.rotor_rpm)

    @cached_property
    def thrust(self) -> Array:
        """Declared free-air thrust of every fan [N], (..., fans)."""
        if not self.vehicle.telemetered and not np.isfinite(self.state.rpm).any():
            per_rotor = servo_thrust(self.vehicle, self.state.servo_us)
            return np.asarray(np.add.reduceat(per_rotor, self.vehicle.first_rotors, axis=-1))
        if self.model is not None:
            return np.asarray(self.model.wrench(np.inf, np.inf, self.rpm)[..., 2])
        each = zip(self.vehicle.fans, np.moveaxis(self.rpm, -1, 0), strict=True)
        return np.stack(
            [free_air_thrust(self.vehicle, self.model, fan, rpm) for fan, rpm in each], axis=-1
        )

    @cached_property
    def shared_thrust(self) -> Array:
        """Declared free-air thrust of every fan by its mean share of the total in a record [N], (..., fans).

        What a fan does more than its share answers disturbances of the moment within the control loop: an effect that
        scales it would be fitted to those. In flight (one instant) it is ``thrust``.
        """
        if not self.record:
            return self.thrust
        total = self.thrust.sum(axis=-1)
        share = np.nanmean(self.thrust, axis=0) / np.nanmean(total)
        return np.asarray(total[..., None] * share)

    @cached_property
    def felt_slope(self) -> float:
        """How much more than declared a change of thrust does in a record, by what the accelerometer feels of it.

        Two-stage least squares with the specific force as instrument (Wooldridge 2010, Econometric Analysis of Cross
        Section and Panel Data, ch. 5): thrust that takes off a disturbance within the control loop is not felt. Noise
        of the accelerometer makes it too large, nothing makes it too small.
        """
        thrust = self.thrust.sum(axis=-1) / self.weight
        felt = -self.state.specific_force[:, 2] / GRAVITY
        apart = max(round(APART_S / self.state.step_s), 1)
        a = thrust[apart:] - thrust[:-apart]
        b = felt[apart:] - felt[:-apart]
        known = np.isfinite(a) & np.isfinite(b)
        return float(b[known] @ b[known]) / max(float(a[known] @ b[known]), 1e-12) - 1.0

    @cached_property
    def shared_rpm(self) -> Array:
        """Rotor speeds (..., rotors) at which every fan gives its ``shared_thrust``."""
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.sqrt(self.shared_thrust / self.thrust)
        return (
            self.rotor_rpm
            * np.where(np.isfinite(ratio), ratio, 1.0)[..., np.asarray(self.vehicle.rotor_fan)]
        )

    @cached_property
    def rotor_wrench(self) -> Array:
        """Declared free-air wrench of all rotors about the CG, (..., 6)."""
        return self.lift(self.thrust)

    @cached_property
    def rotor_moment(self) -> Array:
        """Declared moment of all rotors about the CG, their torques included, (..., 3)."""
        out: Array = self.rotor_wrench[..., 3:].copy()
        out[..., 2] += fan_torques(self.vehicle, self.rotor_rpm).sum(axis=-1)
        return out

    @cached_property
    def rotor_force(self) -> Array:
        """``rotor_wrench`` without its moments (..., 6).

        For scales of the whole thrust: differential thrust depends on inertia and geometry more than on a common scale.
        """
        out = self.rotor_wrench.copy()
        out[..., 3:] = 0.0
        return out

    @cached_property
    def velocity(self) -> Array:
        """Velocity over ground, body FRD, (..., 3)."""
        return np.asarray(
            np.einsum("...ji,...j->...i", self.state.rotation, self.state.velocity_ned)
        )

    @cached_property
    def turning(self) -> Array:
        """What turning adds to the velocity of every fan's reference point, omega x r, body FRD, (..., fans, 3)."""
        return np.asarray(np.cross(self.state.rates[..., None, :], self.vehicle.fan_positions_m))

    @cached_property
    def density(self) -> Array:
        """Air density [kg/m^3] of the ideal gas, (...); NaN where pressure or temperature is unknown."""
        return self.state.pressure_pa / (GAS_CONSTANT_AIR * (self.state.air_temperature_c + 273.15))

    @cached_property
    def mass_flow(self) -> Array:
        """Momentum theory's mass flow of every fan in hover, sqrt(rho A T) [kg/s], (..., fans)."""
        return np.sqrt(RHO_SEA_LEVEL * self.vehicle.disc_area_m2 * np.maximum(self.thrust, 0.0))

    def level_drag(self, velocity: Array, flow: Array, above_m: float) -> Array:
        """Wrench about the CG (..., 6) that takes ``flow`` (..., fans) of air up to the level part of ``velocity``."""
        level = -velocity
        level[..., 2] = 0.0
        return self.wrench_at_cg(flow[..., None] * level, above_m)

    def own_drag(self, above_m: float) -> tuple[Array, Array, Array]:
        """``level_drag`` of moving over ground, of turning, and what sinking adds to that of moving.

        Sinking along the rotor axis adds rho A v_down to the mass flow.
        """
        own = self.velocity[..., None, :]
        sinking = (
            RHO_SEA_LEVEL
            * self.vehicle.disc_area_m2
            * own[..., 2]
            * np.ones(len(self.vehicle.fans))
        )
        return (
            self.level_drag(own, self.mass_flow, above_m),
            self.level_drag(self.turning, self.mass_flow, above_m),
            self.level_drag(own, sinking, above_m),
        )

    def by_model(self, declared: float, empty: float) -> float:
        """One of two numbers: where a model of the surroundings is declared, or none, so that all of it is missing."""
        if self.model is None:
            return empty
        return declared

    def by_kind(self, speeds: float, outputs: float) -> float:
        """One of two numbers: where thrust is declared by rotor speeds, or by servo outputs, which say less."""
        if self.vehicle.telemetered:
            return speeds
        return outputs

    def if_outdoors(self, outdoors: float, elsewhere: float) -> float:
        """One of two numbers: where satellites were received, or where nothing says that the flight was outdoors."""
        if self.open_sky:
            return outdoors
        return elsewhere

    def if_commanded(self, chance: float) -> float:
        """The chance of an effect that shows in commanded changes of the thrust only: others pass for it."""
        return max(chance * self.commanded, IMPOSSIBLE)

    @property
    def most_load_kg(self) -> float:
        """What the rotors can lift besides the vehicle: by their full thrust, or else as much again as it weighs."""
        throttle = self.vehicle.throttle
        if throttle is None:
            return self.vehicle.mass_kg
        lifted = throttle.max_thrust_n * len(self.vehicle.rotors) / GRAVITY
        return max(lifted - self.vehicle.mass_kg, LEAST_LOAD * self.vehicle.mass_kg)

    @property
    def weight(self) -> float:
        """Declared weight [N]."""
        return self.vehicle.mass_kg * GRAVITY

    @property
    def lever(self) -> float:
        """Farthest fan from the CG, or the rotor's radius where that is larger [m]: unit of arms."""
        return float(
            max(
                np.linalg.norm(self.vehicle.fan_positions_m, axis=1).max(),
                self.vehicle.rotor_radius_m,
            )
        )

    def wrench_at_cg(self, forces: Array, above_m: float = 0.0) -> Array:
        """Wrench about the CG (..., 6) of body forces (..., fans, 3) that act ``above_m`` over the reference points."""
        wrenches = np.concatenate([forces, np.zeros_like(forces)], axis=-1)
        return np.asarray(
            at_cg(wrenches, self.vehicle.fan_positions_m - above_m * DOWNWARD).sum(axis=-2)
        )

    def lift(self, forces: Array) -> Array:
        """Wrench about the CG (..., 6) of forces (..., fans) up the fans' axes."""
        return self.wrench_at_cg(-forces[..., None] * DOWNWARD)

    def corners(self, wrenches: Array, bearing: ArrayLike) -> Array:
        """Wrench about the CG (..., 6) of the fans' corner-frame wrenches (..., fans, 6), wall at ``bearing``."""
        body = corner_to_body(wrenches, np.asarray(bearing)[..., None])
        return np.asarray(at_cg(body, self.vehicle.fan_positions_m).sum(axis=-2))

    def pull(self, forces: Array, bearing: ArrayLike) -> Array:
        """Wrench about the CG (..., 6) of forces (..., fans) towards a wall at ``bearing``."""
        return self.corners(forces[..., None] * PULL, bearing)

    def tilt(self, forces: Array, bearing: ArrayLike) -> Array:
        """Wrench about the CG (..., 6) of moments, a force (..., fans) times the radius, that tilt towards a wall."""
        return self.corners((self.vehicle.rotor_radius_m * forces)[..., None] * TILT, bearing)


def decay(distance: Array, length: float) -> Array:
    """exp(-distance/length), 0 at infinity, no more than at contact; NaN stays NaN."""
    return np.exp(-np.maximum(distance, 0.0) / length)


def smoothed(ctx: Context, values: Array) -> Array:
    """A record (n, k) through the low-pass of its measured wrench: for what begins sharply, as an impact does.

    Worked out from smoothed distances it would be sharper than it can have been measured.
    """
    if ctx.smoothed_s == 0.0:
        return values
    return through(ctx, values, lambda w: np.exp(-0.5 * (ctx.smoothed_s * w) ** 2))


def through(ctx: Context, values: Array, response: Callable[[NDArray[Any]], NDArray[Any]]) -> Array:
    """A record (n, k) through a linear filter given by its response at angular frequencies [rad/s]; NaN is bridged."""
    n = len(values)
    step = ctx.state.step_s
    pad = min(n, int(20.0 / step) + 1)
    index = np.arange(n)
    gain = response(2.0 * np.pi * np.fft.rfftfreq(n + 2 * pad, step))
    out = np.full_like(values, np.nan)
    for k, column in enumerate(values.T):
        known = np.isfinite(column)
        if known.any():
            x = np.pad(np.interp(index, index[known], column[known]), pad, mode="edge")
            out[known, k] = np.fft.irfft(np.fft.rfft(x) * gain, len(x))[pad : pad + n][known]
    return out
