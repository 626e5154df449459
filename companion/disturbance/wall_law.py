"""How steeply the pull of the wall beside the vehicle grows towards it, over the distance, as the model has it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from companion.config import PipelineConfig
from companion.disturbance.adopted_effects import adopted_pull_change_n
from companion.disturbance.correction import Correction
from companion.disturbance.records import FanPlaces
from companion.disturbance.stable_gain import STIFFNESS_STEP_M
from models.air_state import AirState, blank_state
from models.common.frames import GRAVITY, Array
from models.common.frozen_copy import with_changes
from models.vehicle import Vehicle

NEAR_RADII = 4.0
"""Rotor radii from lip to wall within which its pull is felt: the models' data end at 3.8."""
_GRID = tuple(0.25 * k for k in range(1, 17))
"""Distances in rotor radii: 4 cm apart on the paper's vehicle."""
_DOUBT = 1.25
"""A pull so much steeper than modelled is held too: models of two halves of one flow differ by as much and more."""
_CONTACT_SHARE = 0.074
_LENGTH_RADII = 1.2
"""Without a model: a pull of so much of the weight at the wall, a third of it so far off, as around the paper's robot
(0.8 1/s^2 at 0.30 m)."""
_ANY_RPM = 3000.0


class WallLaw(NamedTuple):
    """Stiffness of the pull [1/s^2] over the distance of the nearest lip [m], from near to far."""

    distances_m: tuple[float, ...]
    stiffness_1_s2: tuple[float, ...]

    def steepest(self, from_m: float) -> float:
        """The largest stiffness at ``from_m`` or further off."""
        beside = int(np.searchsorted(self.distances_m, from_m, side="right")) - 1
        return max(self.stiffness_1_s2[max(beside, 0) :])

    def least_m(self, held_1_s2: float) -> float:
        """The least distance from which on ``held_1_s2`` is not exceeded; 0 where it never is."""
        over = np.flatnonzero(np.array(self.stiffness_1_s2) > held_1_s2)
        if not len(over):
            return 0.0
        return self.distances_m[min(int(over[-1]) + 1, len(self.distances_m) - 1)]


class Lips(NamedTuple):
    """Where the fans are: heights [m], by how much each lip is further off the wall than the nearest [m], rpm."""

    h_m: tuple[float, ...]
    behind_m: tuple[float, ...]
    rpm: tuple[float, ...]


def wall_law(
    config: PipelineConfig,
    lips: Lips,
    correction: Correction | None = None,
    around: FanPlaces | None = None,
) -> WallLaw:
    """k = -da/dd of the pull a over the mass: the model's, with what adaptation makes of it, or one that is assumed.

    ``around``: the places as adaptation measures by them; without it the correction is left out.
    """
    radius = config.vehicle.rotor_radius_m
    grid_m = [radius * gap for gap in _GRID]
    near = np.add.outer(grid_m, lips.behind_m)
    changes = _modelled_n(config, lips, near)
    if correction is not None and around is not None:
        step_radii = STIFFNESS_STEP_M / radius
        for k, row in enumerate(near):
            place = around._replace(gaps=tuple([float(d) / radius for d in row]))
            changes[k] = correction.pull_change_n(changes[k], place, step_radii)
    if config.model.effects:
        beside = _beside(config.vehicle, lips, near)
        adopted = adopted_pull_change_n(config.model, beside, config.vehicle, STIFFNESS_STEP_M)
        changes = [a + float(b) for a, b in zip(changes, adopted, strict=True)]
    per_step = _DOUBT / (STIFFNESS_STEP_M * config.vehicle.mass_kg)
    stiffness = [max(per_step * change, 0.0) for change in changes]
    if config.model.info.get("method") == "none":
        stiffness = [max(k, _assumed(gap, radius)) for k, gap in zip(stiffness, _GRID, strict=True)]
    return WallLaw(tuple(grid_m), tuple(stiffness))


def _modelled_n(config: PipelineConfig, lips: Lips, near_m: Array) -> list[float]:
    """By how much the wall pulls all fans less, a step further off than ``near_m`` (places, fans) [N]."""
    d_m = np.stack([near_m, near_m + STIFFNESS_STEP_M])
    answer = config.model.query(np.broadcast_to(lips.h_m, d_m.shape), d_m, np.array(lips.rpm))
    pull = answer.wrench[..., 0].sum(axis=-1)
    return [float(change) for change in pull[0] - pull[1]]


def _beside(vehicle: Vehicle, lips: Lips, near_m: Array) -> AirState:
    """A record of level hovers with the lips ``near_m`` (places, fans) from a wall ahead."""
    places = len(near_m)
    state = blank_state((places,), len(vehicle.fans), len(vehicle.rotors))
    rpm = np.array([lips.rpm[fan] for fan in vehicle.rotor_fan])
    return with_changes(
        state,
        h_m=np.tile(lips.h_m, (places, 1)),
        d_m=near_m,
        rpm=np.tile(rpm, (places, 1)),
    )


def _assumed(gap_radii: float, radius_m: float) -> float:
    """k [1/s^2] of a pull of ``_CONTACT_SHARE`` g exp(-gap / ``_LENGTH_RADII``)."""
    length_m = _LENGTH_RADII * radius_m
    return _CONTACT_SHARE * GRAVITY / length_m * math.exp(-gap_radii / _LENGTH_RADII)


def hovering(config: PipelineConfig, height_m: float) -> Lips:
    """All lips equally near, fans at ``height_m``, at the speed that carries the weight in free air."""
    vehicle = config.vehicle
    fans = len(vehicle.fans)
    lift = sum([fan[2] for fan in config.model.free_air_now([_ANY_RPM] * fans)])
    rpm = _ANY_RPM * math.sqrt(vehicle.mass_kg * GRAVITY / abs(lift))
    return Lips((height_m,) * fans, (0.0,) * fans, (rpm,) * fans)
