"""Whether the vehicle flies: by the autopilot's land detector, unless rotors and ground range contradict it."""

from __future__ import annotations

import math
from typing import NamedTuple

from companion.disturbance.records import Disturbance
from companion.estimation.surfaces import Seen, Surface

ON_GROUND = 1
IN_AIR = 2
TAKE_OFF = 3
"""MAV_LANDED_STATE."""
AIRBORNE_AFTER_S = 1.0
"""So long in the air, it flies."""
_LIFTING_SHARE = 0.75
"""Of the weight: rotors that lift this much carry the vehicle, ground effect included."""
_IDLE_IS_LANDED_S = 2.0
_CARRIED_AGE_S = 0.3
"""Rotors that carried the weight so lately speak against a land detector."""
ABOVE_STANDING_M = 0.10
"""The ground is at least this much further away than where the vehicle stood: several times the range's error."""


class Airborne(NamedTuple):
    """What is known of being in the air."""

    landed_state: int = 0
    """The autopilot's: MAV_LANDED_STATE."""
    since_s: float = math.inf
    carried_s: float = -math.inf
    """When the rotors last carried the weight, or the autopilot last said so."""
    standing_m: float = math.nan
    """Height of the CG over ground as the vehicle stood before take-off; NaN where that was not seen."""
    overruled: bool = False
    """The autopilot says that it stands, and is not believed."""

    def flies(self, t_s: float) -> bool:
        """Whether it has been in the air for a while."""
        return t_s - self.since_s >= AIRBORNE_AFTER_S


def watch(
    air: Airborne,
    disturbance: Disturbance | None,
    weight_n: float,
    t_s: float,
    *,
    telemetered: bool,
    holding: bool,
) -> Airborne:
    """One decision further.

    The autopilot's own land detector decides; where it says nothing, the rotors must carry the weight to lift off. In
    the air a low lift alone is no landing (a hard descent has it too): taking it for one would stop the stream.
    """
    since = air.since_s
    carried = air.carried_s
    standing = air.standing_m
    overruled = False
    if disturbance is None:
        ground = None
    else:
        ground = disturbance.ground
    lifts = disturbance is not None and disturbance.free_lift_n > _LIFTING_SHARE * weight_n
    if lifts or air.landed_state == IN_AIR:
        carried = t_s
    if ground is not None:
        standing = standing_height(standing, ground, since < math.inf)
    if air.landed_state == ON_GROUND:
        carries = telemetered and t_s - carried < _CARRIED_AGE_S
        overruled = ground is not None and flies_all_the_same(ground, standing, carries, holding)
        if not overruled:
            since = math.inf
    elif since == math.inf:
        if carried == t_s:
            since = t_s
    elif air.landed_state == 0 and t_s - carried > _IDLE_IS_LANDED_S:
        since = math.inf
    return Airborne(air.landed_state, since, carried, standing, overruled)


def standing_height(before_m: float, ground: Surface, airborne: bool) -> float:
    """Height of the CG over ground as the vehicle stands [m], NaN until it was seen; ``before_m`` as known so far."""
    if airborne or ground.seen is not Seen.SURFACE:
        return before_m
    return ground.distance_m


def flies_all_the_same(ground: Surface, standing_m: float, carried: bool, holding: bool) -> bool:
    """Whether a vehicle that is said to stand on the ground does not.

    It was held in the air a moment ago, its rotors carry its weight, and the ground is clearly further away than it
    was before take-off. All three, or the autopilot is believed: what stands has rotors at the least thrust, because
    it does not answer to less. Silence would be no help: an autopilot that believes it has landed idles its motors.
    """
    if not holding or not carried or ground.seen is not Seen.SURFACE or math.isnan(standing_m):
        return False
    return ground.distance_m > standing_m + ABOVE_STANDING_M
