"""When the autopilot's land detector is not believed: in the air, by what rotors and ground range say."""

from __future__ import annotations

import math

from companion.estimation.estimator import Seen, Surface

ABOVE_STANDING_M = 0.10
"""The ground is at least this much further away than where the vehicle stood: several times the range's error."""


def standing_height(before_m: float, ground: Surface, airborne: bool) -> float:
    """Height of the CG over ground as the vehicle stands [m], NaN until it was seen; ``before_m`` as known so far."""
    return before_m if airborne or ground.seen is not Seen.SURFACE else ground.distance_m


def flies_all_the_same(ground: Surface, standing_m: float, carried: bool, holding: bool) -> bool:
    """Whether a vehicle that is said to stand on the ground does not.

    It was held in the air a moment ago, its rotors carry its weight, and the ground is clearly further away than it
    was before take-off. All three, or the autopilot is believed: what stands has rotors at the least thrust, because
    it does not answer to less. Silence would be no help: an autopilot that believes it has landed idles its motors.
    """
    if not holding or not carried or ground.seen is not Seen.SURFACE or math.isnan(standing_m):
        return False
    return ground.distance_m > standing_m + ABOVE_STANDING_M
