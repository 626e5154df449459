"""From the modelled disturbance by ground and wall to an offset of thrust and attitude.

Thrust is corrected multiplicatively (T/k, no algebraic loop), a lateral force by a tilt against it, a moment by a bias
of the attitude, washed out because the autopilot's rate integrator owns its steady part. See docs/lab/hold.md.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from companion.config import PipelineConfig
from companion.disturbance.records import Disturbance
from companion.estimation.vectors import clipped, lagged
from companion.mavlink.firmware import ThrustMap
from models.common.frames import GRAVITY, Rows
from models.vehicle import Vehicle

_MOMENT_STIFFNESS_1_S2 = 180.0
"""Closed-loop attitude stiffness over inertia with the rate integrator frozen (angle P x rate bandwidth)."""
_MOMENT_WASHOUT_S = 1.0
"""The rate integrator owns a steady moment within about this time."""
_MOMENT_LIMIT_RAD = math.radians(2.5)
_FADE_IN_S = 1.0
"""As slowly as the integrators adapt, so that nothing is counted twice."""
_FADE_OUT_S = 0.2
"""As fast as the slew rates of a vehicle file's defaults allow a full offset to go."""


class Offset(NamedTuple):
    """What is added to the base: thrust (share of full throttle), roll and pitch [rad], or an NED acceleration."""

    thrust: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0
    acceleration: tuple[float, float, float] = (0.0, 0.0, 0.0)
    share: float = 0.0
    """How much of the modelled disturbance this cancels, 0...1: gain, trust, limits, slew and fade included."""

    def scaled(self, share: float) -> Offset:
        """The same offset, ``share`` of it."""
        north, east, down = self.acceleration
        return Offset(
            self.thrust * share,
            self.roll * share,
            self.pitch * share,
            (north * share, east * share, down * share),
            self.share * share,
        )


MomentWashout = tuple[float, float]
"""The slow part of the roll and pitch moments [N m], which the autopilot's integrator holds."""


class Offsets(NamedTuple):
    """The offset on its way out, from one setpoint to the next."""

    authority: float = 0.0
    offset: Offset = Offset()
    """Within the slew rates, before the fade."""
    wanted: Offset = Offset()
    """The last good one."""
    applied: Offset = Offset()
    """What went out last: with trust and fade, again within the slew rates."""
    washout: MomentWashout | None = None


def next_offsets(
    old: Offsets,
    disturbance: Disturbance | None,
    config: PipelineConfig,
    thrust: ThrustMap,
    *,
    base_thrust: float | None,
    rotation: Rows | None,
    refused: bool,
    held_back: bool,
    dt_s: float,
) -> Offsets:
    """The offset one step on: it fades while something refuses it, and is gone where nothing may be sent."""
    usable = disturbance is not None and not refused
    wanted = old.wanted
    washout = old.washout
    if disturbance is not None and rotation is not None and base_thrust is not None:
        fresh, washout = wanted_offset(
            disturbance=disturbance,
            washout=washout,
            config=config,
            thrust=thrust,
            base_thrust=base_thrust,
            rotation=rotation,
            dt_s=dt_s,
        )
        if usable:
            wanted = fresh  # otherwise the last good one stays while the authority fades
    if held_back:
        return Offsets(wanted=wanted, washout=washout)
    authority = _fade(old.authority, 1.0 if usable else 0.0, dt_s)
    if authority > 0.0:
        offset = slewed(old.offset, wanted, config, dt_s)
    else:
        offset = Offset()
    # A fade adds to the slew of what fades: the sum is held to the slew rates too.
    if authority == 1.0:
        faded = offset
    else:
        faded = offset.scaled(authority)
    applied = slewed(old.applied, faded, config, dt_s)
    return Offsets(authority, offset, wanted, applied, washout)


def wanted_offset(
    disturbance: Disturbance,
    washout: MomentWashout | None,
    config: PipelineConfig,
    thrust: ThrustMap,
    base_thrust: float,
    rotation: Rows,
    dt_s: float,
) -> tuple[Offset, MomentWashout]:
    """The offset that cancels the disturbance, before limits, slew and fades; and the moment wash-out one step on."""
    vehicle = config.vehicle
    weight = disturbance.gain * disturbance.trust
    fx, fy, fz, mx, my, _ = [v * weight for v in disturbance.wrench]
    own_weight = vehicle.mass_kg * GRAVITY
    ratio = 1.0 - fz / max(disturbance.free_lift_n, 0.5 * own_weight)
    roll_bias, pitch_bias, washout = _moment_bias(mx, my, washout, vehicle, dt_s)
    north, east, down = [(a * fx + b * fy + c * fz) / vehicle.mass_kg for a, b, c in rotation]
    return Offset(
        _thrust_change(ratio, thrust, base_thrust),
        -math.atan2(fy, own_weight) + roll_bias,
        math.atan2(fx, own_weight) + pitch_bias,
        (-north, -east, -down),
        weight,
    ), washout


def _thrust_change(ratio: float, thrust: ThrustMap, base_thrust: float) -> float:
    """The command change that divides the lift of the base by ``ratio``: at most up to full throttle.

    ``ratio`` is lift near the surroundings over lift in free air; a model that takes all of it, or more, asks for all
    the thrust there is.
    """
    full = 1.0 + thrust.slope * (1.0 - thrust.hover)
    lift_share = max(1.0 + thrust.slope * (base_thrust - thrust.hover), 0.0)
    if ratio * full <= lift_share:
        return max(1.0 - base_thrust, 0.0)
    return thrust.change(lift_share * (1.0 / ratio - 1.0))


def _moment_bias(
    mx: float, my: float, washout: MomentWashout | None, vehicle: Vehicle, dt_s: float
) -> tuple[float, float, MomentWashout]:
    low_x, low_y = lagged(washout or (mx, my), (mx, my), min(dt_s / _MOMENT_WASHOUT_S, 1.0))
    stiffness_x, stiffness_y = (
        _MOMENT_STIFFNESS_1_S2 * inertia for inertia in vehicle.inertia_kgm2[:2]
    )
    roll = clipped(-(mx - low_x) / stiffness_x, _MOMENT_LIMIT_RAD)
    pitch = clipped(-(my - low_y) / stiffness_y, _MOMENT_LIMIT_RAD)
    return roll, pitch, (low_x, low_y)


def _fade(authority: float, wanted: float, dt_s: float) -> float:
    """Move the authority 0...1 towards ``wanted`` at most as fast as the fades allow."""
    if wanted > authority:
        return min(wanted, authority + dt_s / _FADE_IN_S)
    return max(wanted, authority - dt_s / _FADE_OUT_S)


def _slew(value: float, wanted: float, limit: float, step: float) -> float:
    """Move ``value`` towards ``wanted`` clipped to +-``limit``, by at most ``step``."""
    if wanted < -limit:
        target = -limit
    elif wanted > limit:
        target = limit
    else:
        target = wanted
    low = value - step
    high = value + step
    if target < low:
        return low
    if target > high:
        return high
    return target


def slewed(old: Offset, wanted: Offset, config: PipelineConfig, dt_s: float) -> Offset:
    """Move the offset towards the wanted one within the vehicle file's limits and slew rates."""
    most = config.most_offset
    rate = config.offset_rates
    thrust, roll, pitch, (north, east, down), _ = old
    wanted_thrust, wanted_roll, wanted_pitch, (x, y, z), share = wanted
    step = rate.acceleration_m_s2 * dt_s
    tilt_step = rate.tilt_rad * dt_s
    g = most.acceleration_m_s2
    tilt = most.tilt_rad
    north = _slew(north, x, g, step)
    east = _slew(east, y, g, step)
    down = _slew(down, z, g, step)
    thrust = _slew(thrust, wanted_thrust, most.thrust, rate.thrust * dt_s)
    roll = _slew(roll, wanted_roll, tilt, tilt_step)
    pitch = _slew(pitch, wanted_pitch, tilt, tilt_step)
    wanted_size = _size(wanted_thrust, wanted_roll, wanted_pitch)
    if wanted_size > 0.0:
        share *= min(_size(thrust, roll, pitch) / wanted_size, 1.0)
    return Offset(thrust, roll, pitch, (north, east, down), share)


def _size(thrust: float, roll: float, pitch: float) -> float:
    """Size of an offset as an acceleration, in g: thrust about hover changes the lift about twice as much."""
    return math.sqrt((2.0 * thrust) ** 2 + roll**2 + pitch**2)
