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
    """Of one flight at 50 Hz: parts (6, t) by name, and the wrench that ideal sensors and the declared model differ by."""

    parts: Mapping[str, Array]
    difference: Array
    modelled: Array


def thinned(track: Track) -> Track:
    """Every fifth sample."""
    return replace(track, **{name: getattr(track, name)[..., ::EVERY] for name in track.__dataclass_fields__})


def explain(frame: Airframe, c: Conditions, whole: Track) -> Explained:
    """Take one flight apart."""
    s = thinned(whole)
    R = loads.rotation(s.quaternion)
    origin = s.position - loads.into_world(R, s.cg)
    places = loads.rotor_places(frame, R, origin)
    near = loads.near_surfaces(frame, c, places)
    out: dict[str, list[Wrench]] = {}

    def add(name: str, force: Array, moment: Array) -> None:
        out.setdefault(name, []).append((force, moment))

    def lifted(name: str, more: Array, torque: bool = False) -> None:
        force, moment = loads.from_rotors(frame, more, np.zeros((2, *more.shape)))
        if torque:
            moment = moment.copy()
            moment[2] -= (np.array(frame.spin)[:, None] * more).sum(axis=0) * frame.hover_torque / frame.hover_thrust
        add(name, force, moment)

    declared, lift, yaw = _by_motor(frame, c, s, lifted)
    lift = _by_blades(frame, c, s, lift, lifted)
    lift = _by_surfaces(frame, c, s, R, places, near, lift, declared, lifted, add)
    lift = _by_air(frame, c, s, R, lift, lifted, add)
    _by_body(frame, c, s, R, places, add)
    parts = {name: np.sum([np.concatenate(w) for w in several], axis=0) for name, several in out.items()}
    modelled = _declared(frame, c, s, R, places, declared, yaw)
    difference = _measured(frame, c, s) - modelled
    parts["rest"] = difference - np.sum(list(parts.values()), axis=0)
    return Explained(parts, difference, modelled)


def _by_motor(frame: Airframe, c: Conditions, s: Track, lifted) -> tuple[Array, Array, Array]:
    """Declared free-air thrust, thrust by true rotor speed, and declared shaft torque; parts of curve, pack and motor."""
    true = frame.hover_thrust * (s.omega / frame.hover_speed) ** 2
    per = frame.hover_torque / frame.hover_thrust
    if frame.declares == "esc":
        bent = true * (s.omega / frame.hover_speed) ** c.reynolds
        lifted("thrust_curve", bent - true)
        return true, bent, true * per
    declared = power.bent(frame, float(c.declared_slope)).thrust(s.output)
    stand = power.steady_thrust(frame, s.output, np.full(s.output.shape, frame.nominal_v))
    sagged = power.steady_thrust(frame, s.output, s.volts)
    hot = power.steady_thrust(frame, s.output, s.volts, s.warm)
    thin = hot * (power.steady_speed(frame, s.output * s.volts, s.warm, c.rho / RHO0) ** 2
                  / power.steady_speed(frame, s.output * s.volts, s.warm) ** 2)  # fmt: skip
    keep = float(np.exp(-STEP_S / motor_tau(frame, np.array(c.slow))))
    late = lfilter([1.0 - keep], [1.0, -keep], thin, axis=-1, zi=thin[:, :1] * keep)[0]
    lifted("thrust_curve", stand - declared, True)
    lifted("battery_sag", sagged - stand, True)
    lifted("thermal_derating", hot - sagged, True)
    lifted("air_density", thin - hot, True)
    lifted("motor_lag", late - thin, True)
    return declared, true, declared * per


def _by_blades(frame: Airframe, c: Conditions, s: Track, lift: Array, lifted) -> Array:
    lifted("air_density", lift * (c.rho / RHO0 - 1.0))
    lift = lift * c.rho / RHO0
    lifted("thrust_scale", lift * c.scale)
    lift = lift * (1.0 + c.scale)
    weak = np.where(np.arange(frame.count) == c.weak_rotor, c.weak_share, 0.0)[:, None]
    lifted("fan_imbalance", lift * weak)
    return lift * (1.0 + weak)


def seen_height(frame: Airframe, c: Conditions, R: Array, origin: Array, places: Array) -> Array:
    """Height of each rotor (rotors, t) over the surface that the down-looking rangefinder sees, its offset included."""
    sensor = origin + np.einsum("jkt,k->jt", R, np.array(DOWN.position_m))
    floor = np.where(sensor[0] > c.edge_north, c.table_m, 0.0)
    return np.maximum(-places[2] - floor + c.range_bias * R[2, 2], 0.0)


def _by_surfaces(frame, c, s, R, places, near, lift, declared, lifted, add) -> Array:
    flat = loads.near_surfaces(frame, replace(c, edge_north=np.inf), places)
    if not frame.table:
        lifted("ground_effect", lift * flat.ground)
        lifted("partial_ground", lift * (near.ground - flat.ground))
    else:
        true = near.ground / c.ground_gain
        origin = s.position - loads.into_world(R, s.cg)
        seen = surfaces.ground_gain(frame, seen_height(frame, c, R, origin, places))
        level = surfaces.ground_gain(frame, seen_height(frame, replace(c, range_bias=0.0), R, origin, places))
        lifted("ground_effect", lift * (near.ground - true))
        lifted("partial_ground", lift * (true - level))
        lifted("range_offset", lift * (level - seen))
    lift = lift * (1.0 + near.ground)
    lifted("ceiling", lift * near.ceiling)
    lift = lift * (1.0 + near.ceiling)
    share = (c.wall_gain - 1.0) / c.wall_gain if frame.table else 1.0
    north_only = loads.near_surfaces(frame, replace(c, wall_east=np.inf), places)
    add("wall_effect", *(share * part for part in loads.wall_wrench(frame, north_only, lift, R, 0)))
    lifted("wall_effect", -share * lift * north_only.loss)
    add("second_wall", *loads.wall_wrench(frame, near, lift, R, 1))
    lifted("second_wall", -lift * (near.loss - north_only.loss))
    return lift * (1.0 - near.loss)


def _by_air(frame: Airframe, c: Conditions, s: Track, R: Array, lift: Array, lifted, add) -> Array:
    own = loads.into_body(R, s.velocity)
    air = loads.into_body(R, s.velocity - s.wind)
    ux, uy, climb = loads.at_rotors(frame, own, s.rates)
    wx, wy, wz = loads.at_rotors(frame, air, s.rates)
    still = np.zeros_like(climb)
    rho = float(c.rho)
    hover = rotor.settled_thrust(frame, s.omega, still, still, rho)
    steps = [rotor.settled_thrust(frame, s.omega, w, a, rho) / hover for w, a in (
        (climb, still), (climb, ux * ux + uy * uy), (wz, wx * wx + wy * wy))]  # fmt: skip
    lifted("vertical_inflow", lift * (steps[0] - 1.0))
    lifted("x_translational_lift", lift * (steps[1] - steps[0]))
    lifted("wind", lift * (steps[2] - steps[1]))
    drag = -loads.rotor_drag_constant(frame, c) * s.omega
    none = np.zeros_like(lift)
    own_side = loads.from_rotors(frame, none, np.stack([drag * ux, drag * uy]))
    all_side = loads.from_rotors(frame, none, np.stack([drag * wx, drag * wy]))
    add("rotor_drag", *own_side)
    add("wind", all_side[0] - own_side[0], all_side[1] - own_side[1])
    body = loads.body_drag(c, own)
    add("body_drag", body, np.zeros_like(body))
    add("wind", loads.body_drag(c, air) - body, np.zeros_like(body))
    return lift * steps[2]


def _by_body(frame: Airframe, c: Conditions, s: Track, R: Array, places: Array, add) -> None:
    w, zero = s.rates, np.zeros_like(s.felt)
    spin = np.array(frame.spin)[:, None]
    inertia = frame.rotor_inertia * c.slow
    momentum = (inertia * spin * s.omega).sum(axis=0)
    change = (inertia * spin * np.gradient(s.omega, STEP_S, axis=-1)).sum(axis=0)
    add("gyroscopic", zero, np.stack([-w[1] * momentum, w[0] * momentum, -change]))
    own = np.array([c.cg_x, c.cg_y, 0.0])[:, None] * np.ones_like(w)
    kg = np.where(s.time >= c.load_at_s, c.load_kg, 0.0)
    mass = frame.mass_kg + kg
    total = mass * s.felt
    add("payload", -kg * s.felt, -loads.cross(s.cg - own, total))
    add("cg_offset", zero, -loads.cross(own, total))
    add("imu_bias", frame.mass_kg * np.array([c.bias_x, c.bias_y, c.bias_z])[:, None] * np.ones_like(w), zero)
    if c.slung_kg > 0.0:
        add("slung_load", loads.into_body(R, s.rope), zero)
    if c.bumper_n_m > 0.0:
        add("contact", *loads.contact(frame, c, R, places, s.velocity))
    origin = s.position - loads.into_world(R, s.cg)
    for name, (force, moment) in loads.no_catalogue(c, s.time, R, origin).items():
        add(name, force, moment)


def _measured(frame: Airframe, c: Conditions, s: Track) -> Array:
    """What ideal sensors at the declared CG make of the flight with declared mass and inertia (6, t)."""
    felt = at_declared_cg(s) + np.array([c.bias_x, c.bias_y, c.bias_z])[:, None]
    inertia = np.array(frame.inertia)[:, None]
    return np.concatenate([frame.mass_kg * felt, inertia * s.turning + loads.cross(s.rates, inertia * s.rates)])


def at_declared_cg(s: Track) -> Array:
    """Specific force at the declared CG, where the IMU sits (3, t)."""
    return s.felt - loads.cross(s.turning, s.cg) - loads.cross(s.rates, loads.cross(s.rates, s.cg))


def _declared(frame: Airframe, c: Conditions, s: Track, R: Array, places: Array, thrust: Array, torque: Array) -> Array:
    lift = thrust
    walls = (np.zeros_like(s.felt), np.zeros_like(s.felt))
    if frame.table:
        origin = s.position - loads.into_world(R, s.cg)
        lift = thrust * (1.0 + surfaces.ground_gain(frame, seen_height(frame, c, R, origin, places)))
        plain = loads.near_surfaces(frame, replace(c, wall_gain=1.0, wall_east=np.inf), places)
        walls = loads.wall_wrench(frame, plain, thrust, R, 0)
        lift = lift * (1.0 - plain.loss)
    force, moment = loads.from_rotors(frame, lift, np.zeros((2, *lift.shape)))
    moment = moment.copy()
    moment[2] -= (np.array(frame.spin)[:, None] * torque).sum(axis=0)
    return np.concatenate([force + walls[0], moment + walls[1]])


def low_pass(x: Array, hz: float = BAND_HZ, step_s: float = STEP_S) -> Array:
    """Zero-phase along the last axis."""
    return sosfiltfilt(butter(2, hz, fs=1.0 / step_s, output="sos"), x, axis=-1)


def size(frame: Airframe, part: Array) -> float:
    """95th percentile below 2 Hz: of the force over the weight, or of the moment over weight times arm if that is more."""
    slow = low_pass(part)
    weight = frame.mass_kg * 9.80665
    force = np.percentile(np.sqrt((slow[:3] ** 2).sum(axis=0)), 95.0) / weight
    moment = np.percentile(np.sqrt((slow[3:] ** 2).sum(axis=0)), 95.0) / (weight * frame.arm_m)
    return float(max(force, moment))


def sizes(frame: Airframe, explained: Explained) -> dict[str, float]:
    """Size of every part."""
    return {name: size(frame, part) for name, part in explained.parts.items()}


def lag_beyond_delay(frame: Airframe, explained: Explained) -> float:
    """Size of what a constant delay of the outputs, up to 0.2 s, does not undo of a lag of the motors."""
    if "motor_lag" not in explained.parts:
        return 0.0
    late = explained.modelled + explained.parts["motor_lag"]
    return min(size(frame, (late - np.roll(explained.modelled, k, axis=-1))[:, 20:]) for k in range(11))
