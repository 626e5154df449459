"""What the surroundings do to the vehicle: surrogate and adopted effects at every fan, and how far to believe it."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from companion.adaptation.apply import Applied
from companion.adaptation.sizes import effects_with_size
from companion.config import PipelineConfig
from companion.estimation.air_state import air_state
from companion.estimation.disturbance import THRUST_LEAD_S, Disturbance, FanPlaces, Parts, about_cg
from companion.estimation.estimates import Estimates
from companion.estimation.fan_query import FanQuery, fan_query
from companion.estimation.surfaces import Seen, Surface, surface
from companion.estimation.vectors import plus, turned
from models.air_state import AirState
from models.common.frames import Array, Rows
from models.common.frozen_copy import with_changes
from models.effects import Context, adopted_wrench, corrected_state
from models.effects.effect import AdoptedEffect
from models.surrogate.fan_surrogate import FanSurrogate
from models.vehicle import Vehicle
from models.vehicle_wrench import RPM_TO_RAD_S, fan_rpm_now

GAIN = 0.95
"""Of the modelled disturbance, where nothing speaks against it."""
_TILT_LEAD_S = 0.0
"""The same for side forces. Over-prediction costs more than it gives (docs/lab/hold.md)."""
DAMPING_SHARE = 0.2
"""Of the loop's damping that delayed feed-forward towards a surface may take away."""
RESIDUAL_DELAY_S = 0.06
"""What is left of the delay of a side force behind the lead."""
_STIFFNESS_STEP_M = 0.02
"""Step of the difference quotient of a wall's pull: above the noise of a surrogate, below its e-fold of 0.1 m."""
_NO_EFFECTS = np.zeros((0, 6))
_SURE_SIGMA_M = 0.05
_UNSURE_SIGMA_M = 0.10
"""A distance this sure is believed in full; this unsure not at all: half of what the effects reach."""


def modelled_disturbance(
    estimates: Estimates,
    config: PipelineConfig,
    rotor_rpm: tuple[float, ...],
    rotation: Rows,
    t_s: float,
    damping_1_s: float,
    applied: Applied | None = None,
) -> Disturbance:
    """Query the surrogate for every fan, at the two leads, in free air, and a little further from a wall.

    ``applied``: what adaptation makes of it; None: all as modelled, and no parts.
    """
    vehicle = config.vehicle
    model = config.model
    ground = surface(estimates, config, "ground", t_s)
    wall = surface(estimates, config, "wall", t_s)
    ceiling = Surface(Seen.UNDECLARED)
    rpm = fan_rpm_now(vehicle, rotor_rpm)
    soon = fan_query(vehicle, ground, wall, rotation, rpm, THRUST_LEAD_S)
    later = fan_query(vehicle, ground, wall, rotation, rpm, _TILT_LEAD_S)
    adopted = None
    if model.effects:
        ceiling = surface(estimates, config, "ceiling", t_s)
        now = air_state(
            estimates=estimates,
            config=config,
            query=soon,
            ceiling=ceiling,
            rotor_rpm=rotor_rpm,
            t_s=t_s,
            lead_s=THRUST_LEAD_S,
        )
        moved = corrected_state(model.effects, now)
        soon = _shifted(soon, now, moved)
        later = _shifted(later, now, moved)
        adopted = adopted_disturbance(model, moved, vehicle, damping_1_s)
    free = model.free_air_now(rpm)
    lift_n, at_fans, pull_change_n, trusts = _by_surrogate(model, soon, later)
    parts = None
    above = _above_free(lift_n, at_fans, free)
    if applied is None:
        lift, pull, tilt = about_cg(vehicle, above, later.wall_bearing_rad)
        wrench = [a + b + c for a, b, c in zip(lift, pull, tilt, strict=True)]
    else:
        if model.effects:
            effects = _adopted_parts(config, moved, damping_1_s)
        else:
            effects = _NO_EFFECTS
        parts = _parts(vehicle, at_fans, free, soon, effects)
        wrench = applied.compensated(vehicle, above, parts.around, effects).tolist()
    if adopted is not None:
        wrench = [a + b for a, b in zip(wrench, adopted.tolist(), strict=True)]
    if vehicle.vanes:
        fx, fy, fz, mx, my, mz = wrench
        wrench = [*plus((fx, fy, fz), turned(trim_reaction(vehicle), (mx, my, mz))), mx, my, mz]
    gain = GAIN
    if wall.seen is Seen.SURFACE:
        change = pull_change_n
        if applied is not None and parts is not None:
            change = _pull_change_n(change, applied, parts, vehicle)
        if adopted is not None:
            change += adopted_pull_change_n(model, moved, vehicle, _STIFFNESS_STEP_M)
        gain = _stable_gain(change / _STIFFNESS_STEP_M, vehicle, damping_1_s)
    beside = [h < math.inf or d < math.inf for h, d in zip(soon.h_m, soon.d_m, strict=True)]
    trust = min([t for t, one in zip(trusts, beside, strict=True) if one], default=1.0)
    return Disturbance(
        wrench=tuple(wrench),
        free_lift_n=sum([fan[2] for fan in free]),
        trust=min(trust, 1.0) * _sensor_weight(ground) * _sensor_weight(wall),
        gain=gain,
        h_m=soon.h_m,
        d_m=soon.d_m,
        ground=ground,
        wall=wall,
        ceiling=ceiling,
        parts=parts,
    )


def _shifted(query: FanQuery, now: AirState, moved: AirState) -> FanQuery:
    """A query at the heights of a corrected state."""
    known = np.isfinite(now.h_m)
    shift = np.subtract(moved.h_m, now.h_m, out=np.zeros_like(now.h_m), where=known)
    return query._replace(h_m=tuple((np.array(query.h_m) + shift).tolist()))


def _pull_change_n(modelled_n: float, applied: Applied, parts: Parts, vehicle: Vehicle) -> float:
    """How much weaker the pull to the wall gets a little further off [N], as adaptation has it."""
    step_radii = _STIFFNESS_STEP_M / vehicle.rotor_radius_m
    beside_model = applied.near.pull_change_n(parts.around, step_radii)
    return applied.shares[1] * modelled_n + beside_model


Wrenches = list[list[float]]
"""(fans, 6), corner frame."""


def _by_surrogate(
    model: FanSurrogate, soon: FanQuery, later: FanQuery
) -> tuple[list[float], Wrenches, float, list[float]]:
    """Of every fan the lift at the lead of thrust, the wrench at that of tilt, and the trust; before the last by how
    much the wall pulls all of them less a step further off.

    One query, shape (rows, fans): at the lead of thrust, of tilt, and a step further off walls at that.
    """
    h = [soon.h_m, later.h_m]
    d = [soon.d_m, later.d_m]
    beside_wall = min(later.d_m) < math.inf
    if beside_wall:
        h = [*h, later.h_m]
        d = [*d, tuple([d_m + _STIFFNESS_STEP_M for d_m in later.d_m])]
    answer = model.query(np.array(h), np.array(d), np.array(soon.rpm))
    pulls = answer.wrench[:, :, 0].sum(axis=1)
    if beside_wall:
        pull_change_n = float(pulls[1] - pulls[2])
    else:
        pull_change_n = 0.0
    return (
        answer.wrench[0, :, 2].tolist(),
        answer.wrench[1].tolist(),
        pull_change_n,
        answer.trust[0].tolist(),
    )


def _above_free(lift_n: list[float], later: Wrenches, free: Wrenches) -> Wrenches:
    """(fans, 6), corner frame: what the surroundings add to free air, the lift ``lift_n``, all else of ``later``."""
    out = [[a - b for a, b in zip(*fan, strict=True)] for fan in zip(later, free, strict=True)]
    for fan, lift, alone in zip(out, lift_n, free, strict=True):
        fan[2] = lift - alone[2]
    return out


def _parts(
    vehicle: Vehicle, now: Wrenches, free: Wrenches, soon: FanQuery, effects: Array
) -> Parts:
    """What adaptation measures by: all but the lift is at the tilt's lead, which is near enough to this instant."""
    radius = vehicle.rotor_radius_m
    rpm = soon.rpm
    around = FanPlaces(
        tuple([h / radius for h in soon.h_m]),
        tuple([d / radius for d in soon.d_m]),
        tuple([alone[2] for alone in free]),
        soon.wall_bearing_rad,
    )
    vertical = -sum([fan[2] for fan in now])
    if effects.size:
        vertical += float(effects[:, 2].sum())
    tip = sum(rpm) / len(rpm) * RPM_TO_RAD_S * radius
    return Parts(np.array([now, free]), effects, tip, vertical, around)


def _adopted_parts(config: PipelineConfig, state: AirState, damping_1_s: float) -> Array:
    """Wrench (k, 6) of every adopted effect that has a size."""
    model = config.model
    return np.array(
        [
            adopted_disturbance(model, state, config.vehicle, damping_1_s, (model.effects[k],))
            for k in effects_with_size(model)
        ]
    ).reshape(-1, 6)


def adopted_disturbance(
    model: FanSurrogate,
    state: AirState,
    vehicle: Vehicle,
    damping_1_s: float,
    effects: tuple[AdoptedEffect, ...] | None = None,
) -> Array:
    """Wrench (6,) of the adopted effects, with a ceiling's pull no stronger than delay allows.

    As if the vehicle stood still in the air's own motion: drag on its own velocity damps the loop, and feeding it
    forward would take that damping away. ``effects``: only these of the model's.
    """
    if effects is None:
        chosen = model.effects
    else:
        chosen = effects
    still = with_changes(state, velocity_ned=np.zeros(3), rates=np.zeros(3))

    def disturbance(ceiling_m: Array) -> Array:
        context = Context(
            state=with_changes(still, ceiling_m=ceiling_m), vehicle=vehicle, model=model
        )
        return adopted_wrench(chosen, context, in_flight=True)

    near = disturbance(state.ceiling_m)
    if not np.isfinite(np.min(state.ceiling_m)):
        return near
    pull = float(disturbance(state.ceiling_m + _STIFFNESS_STEP_M)[2] - near[2]) / _STIFFNESS_STEP_M
    share = _stable_gain(pull, vehicle, damping_1_s) / GAIN
    open_air = disturbance(np.full_like(state.ceiling_m, np.inf))
    out: Array = open_air + share * (near - open_air)
    return out


def adopted_pull_change_n(
    model: FanSurrogate, state: AirState, vehicle: Vehicle, step_m: float
) -> float:
    """By how much the adopted effects pull the vehicle to the wall less, ``step_m`` further off [N]."""
    near, further = (
        adopted_wrench(
            model.effects,
            Context(state=with_changes(state, d_m=d_m), vehicle=vehicle, model=model),
            in_flight=True,
        )
        for d_m in (state.d_m, state.d_m + step_m)
    )
    change = near - further
    bearing = float(state.wall_bearing_rad)
    return float(change[0] * math.cos(bearing) + change[1] * math.sin(bearing))


@lru_cache(maxsize=4)
def trim_reaction(vehicle: Vehicle) -> Rows:
    """Force per moment (3, 3) that the vanes exert in holding a moment off, [N] over [N m].

    A vane is a side force at its station. Balancing a wall's roll moment with vanes below the CG moves the vehicle
    towards that wall, with more force than the wall's own: 6.7 N per N m on the paper's vehicle.
    """
    axes = np.array([vane.axis for vane in vehicle.vanes]).T
    arms = np.cross([vane.position_m for vane in vehicle.vanes], axes.T).T
    first, second, third = map(tuple, (-axes @ np.linalg.pinv(arms)).tolist())
    return first, second, third


def _sensor_weight(seen: Surface) -> float:
    """1 for a sharp distance, 0 for one uncertain by 10 cm."""
    return min(max((_UNSURE_SIGMA_M - seen.sigma_m) / (_UNSURE_SIGMA_M - _SURE_SIGMA_M), 0.0), 1.0)


def _stable_gain(pull_n_per_m: float, vehicle: Vehicle, damping_1_s: float) -> float:
    """Attraction that grows towards a surface, fed forward late, is negative damping.

    Gain times stiffness times delay stays below a fifth of the loop's own damping (acceleration per m/s).
    """
    if pull_n_per_m <= 0.0:
        return GAIN
    allowed = DAMPING_SHARE * damping_1_s * vehicle.mass_kg
    return min(GAIN, allowed / (pull_n_per_m * RESIDUAL_DELAY_S))
