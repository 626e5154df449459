"""What the adopted effects of a model do to the vehicle, as far as it may be fed forward."""

from __future__ import annotations

import numpy as np

from companion.disturbance.stable_gain import GAIN, STIFFNESS_STEP_M, stable_gain
from models.air_state import AirState
from models.common.frames import Array
from models.common.frozen_copy import with_changes
from models.effects import Context, adopted_wrench, get
from models.effects.adopted_effect import AdoptedEffect
from models.effects.flight_use import Reach
from models.surrogate.fan_surrogate import FanSurrogate
from models.vehicle import Vehicle


def effects_with_size(model: FanSurrogate) -> tuple[int, ...]:
    """Places in ``model.effects`` of the adopted effects that have a size of their own.

    What the others are wrong by is measured as one of the eleven, or not compensated in flight at all.
    """
    return tuple(k for k, e in enumerate(model.effects) if get(e.name).in_flight.gain)


def of_walls_alone(model: FanSurrogate) -> tuple[bool, ...]:
    """Of each adopted effect with a size: whether it says nothing of ground and wall together, and no other does."""
    reaches = [get(e.name).in_flight.reach for e in model.effects]
    corner = Reach.CORNER in reaches
    return tuple([reaches[k] is Reach.WALL and not corner for k in effects_with_size(model)])


def adopted_parts(
    model: FanSurrogate, state: AirState, vehicle: Vehicle, damping_1_s: float
) -> Array:
    """Wrench (k, 6) of every adopted effect that has a size."""
    wrenches = []
    for k in effects_with_size(model):
        only = (model.effects[k],)
        wrenches.append(adopted_disturbance(model, state, vehicle, damping_1_s, only))
    return np.array(wrenches).reshape(-1, 6)


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
    pull = float(disturbance(state.ceiling_m + STIFFNESS_STEP_M)[2] - near[2]) / STIFFNESS_STEP_M
    share = stable_gain(pull, vehicle, damping_1_s) / GAIN
    open_air = disturbance(np.full_like(state.ceiling_m, np.inf))
    out: Array = open_air + share * (near - open_air)
    return out


def adopted_pull_change_n(
    model: FanSurrogate, state: AirState, vehicle: Vehicle, step_m: float
) -> Array:
    """By how much the adopted effects pull the vehicle to the wall less, ``step_m`` further off [N], shape (...)."""
    near, further = (
        adopted_wrench(
            model.effects,
            Context(state=with_changes(state, d_m=d_m), vehicle=vehicle, model=model),
            in_flight=True,
        )
        for d_m in (state.d_m, state.d_m + step_m)
    )
    change = near - further
    bearing = state.wall_bearing_rad
    out: Array = change[..., 0] * np.cos(bearing) + change[..., 1] * np.sin(bearing)
    return out
