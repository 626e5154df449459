"""A vehicle's motion ahead of a measured state: its model integrated over measured rotor speeds or outputs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from models.air_state import AirState, blank_state
from models.common.errors import ConfigError
from models.common.frames import GRAVITY, Array, rotation_from_quaternion
from models.effects import AdoptedEffect, Context, adopted_wrench
from models.surrogate.fan_surrogate import FanSurrogate
from models.vehicle import Vehicle
from models.vehicle_wrench import modelled_wrench

STATE = 13
"""Numbers of a state: position (3), velocity (3), quaternion (4), rates (3)."""
POSITION = slice(0, 3)
VELOCITY = slice(3, 6)
QUATERNION = slice(6, 10)
RATES = slice(10, 13)
STEP_S = 0.01
STANDARD_PASCAL = 101_325.0
STANDARD_CELSIUS = 15.0


@dataclass(frozen=True)
class FlightModel:
    """What flies.

    Parameters
    ----------
    vehicle : Vehicle
        Its mass, inertia and rotors.
    fan_model : FanSurrogate or None
        Of its fans; its adopted effects act, too. None: rotors in free air.
    effects : tuple of AdoptedEffect
        What acts besides.

    Examples
    --------
    >>> from models.vehicle import load_vehicle
    >>> from replay import FlightModel
    >>> FlightModel(load_vehicle("my.toml")).adopted
    ()
    """

    vehicle: Vehicle
    fan_model: FanSurrogate | None = None
    effects: tuple[AdoptedEffect, ...] = ()

    @property
    def adopted(self) -> tuple[AdoptedEffect, ...]:
        """All effects that act."""
        if self.fan_model is None:
            return self.effects
        return (*self.fan_model.effects, *self.effects)

    def wrench(self, state: AirState) -> Array:
        """Of air and load about the CG.

        Parameters
        ----------
        state : AirState
            Leading shape (...).

        Returns
        -------
        ndarray (..., 6)
            Force [N] and moment [N m], body FRD.
        """
        context = Context(state=state, vehicle=self.vehicle, model=self.fan_model)
        turning = replace(state, rpm=context.rotor_rpm)
        declared = modelled_wrench(self.vehicle, self.fan_model, turning)
        return declared + adopted_wrench(self.adopted, context)


@dataclass(frozen=True, kw_only=True)
class Surroundings:
    """What is near at the start of ``n`` windows, as the ranges say it; ``inf``: nothing. It stands still."""

    h_m: Array
    """(n, fans) from every fan's reference point down to the ground."""
    d_m: Array
    """(n, fans) from every fan's lip to the wall."""
    wall_bearing_rad: Array
    """(n,) the wall seen from the nose."""

    @classmethod
    def none(cls, windows: int, fans: int) -> Surroundings:
        """Free air."""
        far = np.full((windows, fans), np.inf)
        return cls(h_m=far, d_m=far, wall_bearing_rad=np.zeros(windows))


def rollout(
    model: FlightModel,
    states: ArrayLike,
    inputs: ArrayLike,
    *,
    step_s: float = STEP_S,
    near: Surroundings | None = None,
    beside: ArrayLike | None = None,
    rotations: ArrayLike | None = None,
    weather: AirState | None = None,
) -> Array:
    """The motion that follows from measured states and rotor speeds, by the model.

    Parameters
    ----------
    model : FlightModel
        What flies.
    states : array_like (n, 13)
        Where ``n`` windows begin: position NED [m], velocity NED [m/s], quaternion (w first, body FRD to NED), body
        rates [rad/s].
    inputs : array_like (n, steps, rotors)
        Rotor speeds [rpm] in the order of ``Vehicle.rotors``, or outputs [us] where the thrust is declared by outputs;
        step k uses those of step k alone.
    step_s : float
        Length of a step [s].
    near : Surroundings or None
        Ground and wall at the start. None: free air.
    beside : array_like (n, steps, 6) or None
        A wrench that acts besides [N, N m], body FRD about the CG.
    rotations : array_like (n, steps, 3, 3) or None
        The measured attitude; it is then not predicted, nor are the rates.
    weather : AirState or None
        Leading shape (n,): its battery, pressure and temperature hold over the window.

    Returns
    -------
    ndarray (n, steps, 13)
        States after each step, as ``states``.

    Raises
    ------
    ConfigError
        Shapes do not fit, or a quaternion is 0.

    Examples
    --------
    A vehicle of 3 kg at rest, 2 m up, with its rotors stopped, falls for half a second:

    >>> import numpy as np
    >>> from models.vehicle import load_vehicle
    >>> from replay import FlightModel, rollout
    >>> start = np.zeros((1, 13))
    >>> start[0, [2, 6]] = -2.0, 1.0
    >>> path = rollout(FlightModel(load_vehicle("my.toml")), start, np.zeros((1, 50, 4)))
    >>> path.shape, float(path[0, -1, 2].round(2))
    ((1, 50, 13), -0.77)
    """
    start = np.asarray(states, dtype=float)
    commands = np.asarray(inputs, dtype=float)
    _check(model, start, commands)
    air = _Air(model.vehicle, start, near, weather)
    return _path(model, air, start, commands, step_s=step_s, beside=beside, rotations=rotations)


def _path(
    model: FlightModel,
    air: _Air,
    start: Array,
    commands: Array,
    *,
    step_s: float,
    beside: ArrayLike | None,
    rotations: ArrayLike | None,
) -> Array:
    """``rollout`` of states (n, 13) and commands (n, steps, rotors) that were checked."""
    others = None if beside is None else np.asarray(beside, dtype=float)
    measured = None if rotations is None else np.asarray(rotations, dtype=float)
    windows, steps, _ = commands.shape
    out = np.empty((windows, steps, STATE))
    now = start
    for k in range(steps):
        if measured is None:
            halfway = turned_by(now[:, QUATERNION], 0.5 * step_s * now[:, RATES])
            attitude = rotation_from_quaternion(halfway)
        else:
            attitude = measured[:, k]
        wrench = model.wrench(air.at(now, attitude, commands[:, k]))[:, 0]
        if others is not None:
            wrench = wrench + others[:, k]
        now = _step(model.vehicle, now, attitude, wrench, step_s)
        if measured is not None:
            now[:, QUATERNION] = start[:, QUATERNION]
            now[:, RATES] = start[:, RATES]
        out[:, k] = now
    return out


def _check(model: FlightModel, states: Array, inputs: Array) -> None:
    if not isinstance(model, FlightModel):
        raise ConfigError(
            f"rollout: model is a {type(model).__name__}; give FlightModel(vehicle, surrogate)"
        )
    if states.ndim != 2 or states.shape[1] != STATE:
        raise ConfigError(f"rollout: states have the shape {states.shape}, not (n, {STATE})")
    rotors = len(model.vehicle.rotors)
    if inputs.ndim != 3 or inputs.shape[0] != len(states) or inputs.shape[2] != rotors:
        raise ConfigError(
            f"rollout: inputs have the shape {inputs.shape}, not ({len(states)}, steps, {rotors})"
        )
    if not states[:, QUATERNION].any(axis=1).all():
        raise ConfigError("rollout: a quaternion of states is 0; level is 1, 0, 0, 0")


def _step(vehicle: Vehicle, now: Array, attitude: Array, wrench: Array, step_s: float) -> Array:
    """The states (n, 13) one step later.

    The body is rigid: m v' = R F + m g, J w' = M - w x J w (Euler). Velocity and rates take a step of the acceleration
    that velocity and rates at its start make at the attitude of its middle; place and attitude take the mean of their
    rates of change over the step.
    """
    inertia = np.asarray(vehicle.inertia_kgm2)
    rates = now[:, RATES]
    turning = np.cross(rates, inertia * rates)
    angular = (wrench[:, 3:] - turning) / inertia
    linear = np.einsum("nij,nj->ni", attitude, wrench[:, :3] / vehicle.mass_kg)
    linear[:, 2] += GRAVITY
    out = np.empty_like(now)
    out[:, VELOCITY] = now[:, VELOCITY] + step_s * linear
    out[:, POSITION] = now[:, POSITION] + step_s * 0.5 * (now[:, VELOCITY] + out[:, VELOCITY])
    out[:, RATES] = rates + step_s * angular
    turned = step_s * 0.5 * (rates + out[:, RATES])
    out[:, QUATERNION] = turned_by(now[:, QUATERNION], turned)
    return out


def turned_by(quaternion: Array, angle: Array) -> Array:
    """Unit quaternions (n, 4), turned by the rotation vectors ``angle`` (n, 3) [rad] in the body's frame."""
    size = np.linalg.norm(angle, axis=1)
    scale = 0.5 * np.sinc(size / (2.0 * np.pi))
    w, x, y, z = quaternion.T
    dw = np.cos(0.5 * size)
    dx, dy, dz = (scale[:, None] * angle).T
    out = np.stack(
        [
            w * dw - x * dx - y * dy - z * dz,
            w * dx + x * dw + y * dz - z * dy,
            w * dy - x * dz + y * dw + z * dx,
            w * dz + x * dy - y * dx + z * dw,
        ],
        axis=1,
    )
    return np.asarray(out / np.linalg.norm(out, axis=1, keepdims=True))


class _Air:
    """The states of the air that effects look at, of ``n`` windows; leading shape (n, 1): one instant each."""

    def __init__(
        self, vehicle: Vehicle, start: Array, near: Surroundings | None, weather: AirState | None
    ) -> None:
        if near is None:
            near = Surroundings.none(len(start), len(vehicle.fans))
        self._vehicle = vehicle
        self._near = near
        self._fans = self._fans_at(start, rotation_from_quaternion(start[:, QUATERNION]))
        rotation = rotation_from_quaternion(start[:, QUATERNION])
        heading = np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0])
        self._azimuth = heading + near.wall_bearing_rad
        windows = len(start)
        blank = blank_state((windows, 1), len(vehicle.fans), len(vehicle.rotors))
        pascal = np.full((windows, 1), STANDARD_PASCAL)
        celsius = np.full((windows, 1), STANDARD_CELSIUS)
        self._blank = replace(blank, pressure_pa=pascal, air_temperature_c=celsius)
        if weather is not None:
            self._blank = replace(
                self._blank,
                battery_voltage_v=weather.battery_voltage_v[:, None],
                battery_current_a=weather.battery_current_a[:, None],
                esc_temperature_c=weather.esc_temperature_c[:, None],
                pressure_pa=weather.pressure_pa[:, None],
                air_temperature_c=weather.air_temperature_c[:, None],
            )

    def _fans_at(self, states: Array, rotation: Array) -> Array:
        """Places (n, fans, 3) of the fans' reference points, NED."""
        arms = np.einsum("nij,fj->nfi", rotation, self._vehicle.fan_positions_m)
        return np.asarray(states[:, None, POSITION] + arms)

    def at(self, states: Array, rotation: Array, inputs: Array) -> AirState:
        """The air at some states (n, 13)."""
        moved = self._fans_at(states, rotation) - self._fans
        towards = np.stack([np.cos(self._azimuth), np.sin(self._azimuth)], axis=1)
        nearer = np.einsum("nfi,ni->nf", moved[..., :2], towards)
        heading = np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0])
        state = replace(
            self._blank,
            position_ned=states[:, None, POSITION],
            velocity_ned=states[:, None, VELOCITY],
            rotation=rotation[:, None],
            rates=states[:, None, RATES],
            h_m=np.maximum(self._near.h_m - moved[..., 2], 0.0)[:, None],
            d_m=np.maximum(self._near.d_m - nearer, 0.0)[:, None],
            wall_bearing_rad=(self._azimuth - heading)[:, None],
        )
        if self._vehicle.telemetered:
            return replace(state, rpm=inputs[:, None])
        servo = np.full((len(states), 1, 16), np.nan)
        channels = [rotor.servo - 1 for rotor in self._vehicle.rotors if rotor.servo is not None]
        servo[:, 0, channels] = inputs
        return replace(state, servo_us=servo)
