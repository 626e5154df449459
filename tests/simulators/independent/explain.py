"""The wrench that each effect adds to what the vehicle file declares, from the recorded states of a flight.

The declared model is evaluated without sensor errors; the effects are switched on one after the other, so that their
parts add up to measured minus declared but for a remainder (``rest``: turbulence, inflow that has not settled).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import butter, lfilter, sosfiltfilt

from . import loads, power, rotor, surfaces
from .airframes import DOWN, RHO0, Airframe, Array
from .conditions import Conditions
from .controller import motor_tau
from .flight import DT, Track

EVERY = 5
STEP_S = EVERY * DT
BAND_HZ = 2.0
Wrench = tuple[Array, Array]


@dataclass(frozen=True)
class Explained:
    """Of one flight at 50 Hz: parts (6, t) by name, what ideal sensors and the model differ by, the model."""

    parts: Mapping[str, Array]
    difference: Array
    modelled: Array


def thinned(track: Track) -> Track:
    """Every fifth sample."""
    return replace(
        track, **{name: getattr(track, name)[..., ::EVERY] for name in track.__dataclass_fields__}
    )


class _Parts:
    """Wrenches by name of one vehicle, added up."""

    def __init__(self, frame: Airframe) -> None:
        self.frame = frame
        self.by_name: dict[str, Array] = {}

    def add(self, name: str, force: Array, moment: Array) -> None:
        """A wrench about the declared CG."""
        wrench = np.concatenate([force, moment])
        self.by_name[name] = self.by_name[name] + wrench if name in self.by_name else wrench

    def lift(self, name: str, more: Array, torque: bool = False) -> None:
        """More thrust of each rotor (rotors, t); with the shaft torque that belongs to it where ``torque``."""
        force, moment = loads.from_rotors(self.frame, more, np.zeros((2, *more.shape)))
        if torque:
            moment[2] -= (
                (_spin(self.frame) * more).sum(axis=0)
                * self.frame.hover_torque
                / self.frame.hover_thrust
            )
        self.add(name, force, moment)


@dataclass(frozen=True)
class _Scene:
    """A thinned flight and what follows from its states."""

    frame: Airframe
    c: Conditions
    s: Track
    R: Array
    origin: Array
    places: Array
    near: loads.Near


def _spin(frame: Airframe) -> Array:
    return np.array(frame.spin)[:, None]


def explain(frame: Airframe, c: Conditions, whole: Track) -> Explained:
    """Take one flight apart."""
    s = thinned(whole)
    R = loads.rotation(s.quaternion)
    origin = s.position - loads.into_world(R, s.cg)
    places = loads.rotor_places(frame, R, origin)
    scene = _Scene(frame, c, s, R, origin, places, loads.near_surfaces(frame, c, places))
    parts = _Parts(frame)
    declared, lift = _by_motor(scene, parts)
    lift = _by_blades(scene, parts, lift)
    lift = _by_surfaces(scene, parts, lift)
    _by_air(scene, parts, lift)
    _by_body(scene, parts)
    modelled = _declared(scene, declared)
    difference = _measured(frame, c, s) - modelled
    rest = difference - np.sum(list(parts.by_name.values()), axis=0)
    return Explained({**parts.by_name, "rest": rest}, difference, modelled)


def _by_motor(scene: _Scene, parts: _Parts) -> tuple[Array, Array]:
    """Declared free-air thrust, and thrust by true rotor speed; parts of curve, pack and motor."""
    frame, c, s = scene.frame, scene.c, scene.s
    true = frame.hover_thrust * (s.omega / frame.hover_speed) ** 2
    if frame.declares == "esc":
        bent = true * (s.omega / frame.hover_speed) ** c.reynolds
        parts.lift("thrust_curve", bent - true)
        return true, bent
    declared = power.bent(frame, float(c.declared_slope)).thrust(s.output)
    stand = power.steady_thrust(frame, s.output, np.full(s.output.shape, frame.nominal_v))
    sagged = power.steady_thrust(frame, s.output, s.volts)
    hot = power.steady_thrust(frame, s.output, s.volts, s.warm)
    volts = s.output * s.volts
    faster = power.steady_speed(frame, volts, s.warm, c.rho / RHO0) / power.steady_speed(
        frame, volts, s.warm
    )
    thin = hot * faster**2
    keep = float(np.exp(-STEP_S / motor_tau(frame, np.array(c.slow))))
    late = lfilter([1.0 - keep], [1.0, -keep], thin, axis=-1, zi=thin[:, :1] * keep)[0]
    parts.lift("thrust_curve", stand - declared, True)
    parts.lift("battery_sag", sagged - stand, True)
    parts.lift("thermal_derating", hot - sagged, True)
    parts.lift("air_density", thin - hot, True)
    parts.lift("motor_lag", late - thin, True)
    return declared, true


def _by_blades(scene: _Scene, parts: _Parts, lift: Array) -> Array:
    frame, c = scene.frame, scene.c
    parts.lift("air_density", lift * (c.rho / RHO0 - 1.0))
    lift = lift * c.rho / RHO0
    parts.lift("thrust_scale", lift * c.scale)
    lift = lift * (1.0 + c.scale)
    weak = np.where(np.arange(frame.count) == c.weak_rotor, c.weak_share, 0.0)[:, None]
    parts.lift("fan_imbalance", lift * weak)
    return lift * (1.0 + weak)


def seen_height(frame: Airframe, c: Conditions, R: Array, origin: Array, places: Array) -> Array:
    """Height of each rotor (rotors, t) over the surface that the down-looking rangefinder sees, its offset included."""
    sensor = origin + np.einsum("jkt,k->jt", R, np.array(DOWN.position_m))
    floor = np.where(sensor[0] > c.edge_north, c.table_m, 0.0)
    return np.maximum(-places[2] - floor + c.range_bias * R[2, 2], 0.0)


def _by_surfaces(scene: _Scene, parts: _Parts, lift: Array) -> Array:
    frame, c, near, places = scene.frame, scene.c, scene.near, scene.places
    flat = loads.near_surfaces(frame, replace(c, edge_north=np.inf), places)
    if frame.table:
        true = near.ground / c.ground_gain
        unbiased = replace(c, range_bias=0.0)
        seen = surfaces.ground_gain(frame, seen_height(frame, c, scene.R, scene.origin, places))
        level = surfaces.ground_gain(
            frame, seen_height(frame, unbiased, scene.R, scene.origin, places)
        )
        parts.lift("ground_effect", lift * (near.ground - true))
        parts.lift("partial_ground", lift * (true - level))
        parts.lift("range_offset", lift * (level - seen))
    else:
        parts.lift("ground_effect", lift * flat.ground)
        parts.lift("partial_ground", lift * (near.ground - flat.ground))
    lift = lift * (1.0 + near.ground)
    parts.lift("ceiling", lift * near.ceiling)
    lift = lift * (1.0 + near.ceiling)
    # A declared wall acts in its own size; what is beyond it is the effect.
    share = (c.wall_gain - 1.0) / c.wall_gain if frame.table else 1.0
    first = loads.near_surfaces(frame, replace(c, wall_east=np.inf), places)
    parts.add(
        "wall_effect", *(share * part for part in loads.wall_wrench(frame, first, lift, scene.R, 0))
    )
    parts.lift("wall_effect", -share * lift * first.loss)
    parts.add("second_wall", *loads.wall_wrench(frame, near, lift, scene.R, 1))
    parts.lift("second_wall", -lift * (near.loss - first.loss))
    return lift * (1.0 - near.loss)


def _by_air(scene: _Scene, parts: _Parts, lift: Array) -> None:
    frame, c, s = scene.frame, scene.c, scene.s
    own = loads.into_body(scene.R, s.velocity)
    air = loads.into_body(scene.R, s.velocity - s.wind)
    ux, uy, climb = loads.at_rotors(frame, own, s.rates)
    wx, wy, through = loads.at_rotors(frame, air, s.rates)
    still = np.zeros_like(climb)
    rho = float(c.rho)

    def gain(climbing: Array, across2: Array) -> Array:
        return rotor.settled_thrust(frame, s.omega, climbing, across2, rho) / hover

    hover = rotor.settled_thrust(frame, s.omega, still, still, rho)
    moving = gain(climb, ux * ux + uy * uy)
    # What turning adds is a moment: a rotor that it moves down meets more air.
    mx, my, rising = loads.at_rotors(frame, own, np.zeros_like(s.rates))
    not_turning = gain(rising + still, mx * mx + my * my + still)
    parts.lift("vertical_inflow", lift * (not_turning - 1.0))
    parts.lift("rate_damping", lift * (moving - not_turning))
    parts.lift("wind", lift * (gain(through, wx * wx + wy * wy) - moving))
    drag = -loads.rotor_drag_constant(frame, c) * s.omega
    own_side = loads.from_rotors(frame, still, np.stack([drag * ux, drag * uy]))
    all_side = loads.from_rotors(frame, still, np.stack([drag * wx, drag * wy]))
    parts.add("rotor_drag", *own_side)
    parts.add("wind", all_side[0] - own_side[0], all_side[1] - own_side[1])
    body = loads.body_drag(c, own)
    parts.add("body_drag", body, np.zeros_like(body))
    parts.add("wind", loads.body_drag(c, air) - body, np.zeros_like(body))


def _by_body(scene: _Scene, parts: _Parts) -> None:
    frame, c, s = scene.frame, scene.c, scene.s
    w, zero = s.rates, np.zeros_like(s.felt)
    inertia = frame.rotor_inertia * c.slow
    momentum = (inertia * _spin(frame) * s.omega).sum(axis=0)
    change = (inertia * _spin(frame) * np.gradient(s.omega, STEP_S, axis=-1)).sum(axis=0)
    parts.add("gyroscopic", zero, np.stack([-w[1] * momentum, w[0] * momentum, -change]))
    own = np.array([c.cg_x, c.cg_y, 0.0])[:, None] * np.ones_like(w)
    kg = np.where(s.time >= c.load_at_s, c.load_kg, 0.0)
    total = (frame.mass_kg + kg) * s.felt
    parts.add("payload", -kg * s.felt, -loads.cross(s.cg - own, total))
    parts.add("cg_offset", zero, -loads.cross(own, total))
    parts.add(
        "imu_bias",
        frame.mass_kg * np.array([c.bias_x, c.bias_y, c.bias_z])[:, None] * np.ones_like(w),
        zero,
    )
    if c.slung_kg > 0.0:
        parts.add("slung_load", loads.into_body(scene.R, s.rope), zero)
    if c.bumper_n_m > 0.0:
        parts.add("contact", *loads.contact(frame, c, scene.R, scene.places, s.velocity))
    for name, (force, moment) in loads.no_catalogue(c, s.time, scene.R, scene.origin).items():
        parts.add(name, force, moment)


def _measured(frame: Airframe, c: Conditions, s: Track) -> Array:
    """What ideal sensors at the declared CG make of the flight with declared mass and inertia (6, t)."""
    felt = at_declared_cg(s) + np.array([c.bias_x, c.bias_y, c.bias_z])[:, None]
    inertia = np.array(frame.inertia)[:, None]
    return np.concatenate(
        [frame.mass_kg * felt, inertia * s.turning + loads.cross(s.rates, inertia * s.rates)]
    )


def at_declared_cg(s: Track) -> Array:
    """Specific force at the declared CG, where the IMU sits (3, t)."""
    return s.felt - loads.cross(s.turning, s.cg) - loads.cross(s.rates, loads.cross(s.rates, s.cg))


def _declared(scene: _Scene, thrust: Array) -> Array:
    """The declared wrench (6, t): ``thrust`` (rotors, t) of free air, and ground and wall by a table."""
    frame, c = scene.frame, scene.c
    torque = (_spin(frame) * thrust).sum(axis=0) * frame.hover_torque / frame.hover_thrust
    if not frame.table:
        force, moment = loads.from_rotors(frame, thrust, np.zeros((2, *thrust.shape)))
        moment[2] -= torque
        return np.concatenate([force, moment])
    lift = thrust * (
        1.0
        + surfaces.ground_gain(frame, seen_height(frame, c, scene.R, scene.origin, scene.places))
    )
    plain = loads.near_surfaces(frame, replace(c, wall_gain=1.0, wall_east=np.inf), scene.places)
    force, moment = loads.from_rotors(frame, lift * (1.0 - plain.loss), np.zeros((2, *lift.shape)))
    moment[2] -= torque
    wall = loads.wall_wrench(frame, plain, thrust, scene.R, 0)
    return np.concatenate([force + wall[0], moment + wall[1]])


def low_pass(x: Array, hz: float = BAND_HZ, step_s: float = STEP_S) -> Array:
    """Zero-phase along the last axis."""
    return sosfiltfilt(butter(2, hz, fs=1.0 / step_s, output="sos"), x, axis=-1)


def size(frame: Airframe, part: Array, percent: float = 95.0) -> float:
    """Percentile below 2 Hz: of the force over the weight or, if more, of the moment over weight times arm."""
    slow = low_pass(part)
    weight = frame.mass_kg * 9.80665
    force = np.percentile(np.sqrt((slow[:3] ** 2).sum(axis=0)), percent) / weight
    moment = np.percentile(np.sqrt((slow[3:] ** 2).sum(axis=0)), percent) / (weight * frame.arm_m)
    return float(max(force, moment))


def sizes(frame: Airframe, explained: Explained) -> dict[str, float]:
    """Size of every part."""
    return {name: size(frame, part) for name, part in explained.parts.items()}


def largest(frame: Airframe, explained: Explained) -> dict[str, float]:
    """The largest that every part becomes for a moment: what touches a wall twice is hardly in a percentile."""
    return {name: size(frame, part, 100.0) for name, part in explained.parts.items()}


def lag_beyond_delay(frame: Airframe, explained: Explained) -> float:
    """Size of what a constant delay of the outputs, up to 0.2 s, does not undo of a lag of the motors."""
    if "motor_lag" not in explained.parts:
        return 0.0
    late = explained.modelled + explained.parts["motor_lag"]
    return min(
        size(frame, (late - np.roll(explained.modelled, k, axis=-1))[:, 20:]) for k in range(11)
    )
