"""What the adopted effects of a model do to the vehicle, as far as it may be fed forward."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from companion.disturbance.stable_gain import GAIN, STIFFNESS_STEP_M, stable_gain
from models.air_state import AirState
from models.common.frames import Array
from models.common.frozen_copy import with_changes
from models.effects import Context, adopted_wrench, adopted_wrenches, get
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


class Adopted(NamedTuple):
    """What the adopted effects do to the vehicle at one instant, body FRD about the CG."""

    wrench: Array
    """(6,): of all of them."""
    with_size: Array
    """(k, 6): of each that has a size of its own."""
    pull_change_n: float
    """How much weaker they pull to the wall, ``STIFFNESS_STEP_M`` further off [N]; 0 where no wall is seen."""


def adopted_now(
    model: FanSurrogate, state: AirState, vehicle: Vehicle, damping_1_s: float
) -> Adopted:
    """The adopted effects as the flight program feeds them forward, each worked out once.

    As if the vehicle stood still in the air's own motion: drag on its own velocity damps the loop, and feeding it
    forward would take that damping away. A ceiling pulls no stronger than delay allows.
    """
    still = with_changes(state, velocity_ned=np.zeros(3), rates=np.zeros(3))
    here = Context(state=still, vehicle=vehicle, model=model)
    each = adopted_wrenches(model.effects, here, in_flight=True)
    change_n = 0.0
    beside = [k for k, e in enumerate(model.effects) if _of_walls(e)]
    if beside and np.isfinite(np.min(state.d_m)):
        further = here.elsewhere(d_m=state.d_m + STIFFNESS_STEP_M)
        away = adopted_wrench([model.effects[k] for k in beside], further, in_flight=True)
        change_n = float(_towards_wall(each[beside].sum(axis=0) - away, state))
    if np.isfinite(np.min(state.ceiling_m)):
        each = _under_ceiling(model, here, each, damping_1_s)
    return Adopted(each.sum(axis=0), each[list(effects_with_size(model))], change_n)


def _of_walls(effect: AdoptedEffect) -> bool:
    return get(effect.name).in_flight.reach is not Reach.ANYWHERE


def _under_ceiling(model: FanSurrogate, here: Context, each: Array, damping_1_s: float) -> Array:
    """The wrenches ``each`` (n, 6), with as much of the ceiling's pull as is stable."""
    ceiling_m = here.state.ceiling_m
    lower = here.elsewhere(ceiling_m=ceiling_m + STIFFNESS_STEP_M)
    open_air = here.elsewhere(ceiling_m=np.full_like(ceiling_m, np.inf))
    change = adopted_wrenches(model.effects, lower, in_flight=True) - each
    pull = float(change.sum(axis=0)[2]) / STIFFNESS_STEP_M
    share = stable_gain(pull, here.vehicle, damping_1_s) / GAIN
    without = adopted_wrenches(model.effects, open_air, in_flight=True)
    out: Array = without + share * (each - without)
    return out


def adopted_pull_change_n(
    model: FanSurrogate, state: AirState, vehicle: Vehicle, step_m: float
) -> Array:
    """By how much the adopted effects pull the vehicle to the wall less, ``step_m`` further off [N], shape (...)."""
    here = Context(state=state, vehicle=vehicle, model=model)
    further = here.elsewhere(d_m=state.d_m + step_m)
    near, away = [adopted_wrench(model.effects, c, in_flight=True) for c in (here, further)]
    return _towards_wall(near - away, state)


def _towards_wall(wrench: Array, state: AirState) -> Array:
    bearing = state.wall_bearing_rad
    out: Array = wrench[..., 0] * np.cos(bearing) + wrench[..., 1] * np.sin(bearing)
    return out
