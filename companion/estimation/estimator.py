"""The estimator as a whole: what is heard of attitude, position, ranges and rotors, and what is known by it.

``readings`` and ``rotors`` take messages in, ``beams`` tracks the ranges, ``surfaces`` answers what they see.
"""

from __future__ import annotations

from companion.estimation.beams import moved
from companion.estimation.estimates import Estimates, blank_estimates
from companion.estimation.position_trust import position_reset
from companion.estimation.readings import take_range
from companion.estimation.rotors import rotor_speeds, take_rotors, take_servo, take_temperatures
from companion.estimation.surfaces import Seen, surface
from companion.estimation.velocity_bias import corrected
from companion.mavlink.samples import Attitude, LocalPosition
from models.common.frames import rotation_rows
from models.common.frozen_copy import with_changes

__all__ = [
    "Seen",
    "blank_estimates",
    "rotor_speeds",
    "surface",
    "take_attitude",
    "take_position",
    "take_range",
    "take_rotors",
    "take_servo",
    "take_temperatures",
]


def take_attitude(estimates: Estimates, sample: Attitude) -> Estimates:
    """The newest attitude; the rotation is kept beside it, in plain floats."""
    return with_changes(estimates, attitude=sample, rows=rotation_rows(*sample.q_ned_frd))


def take_position(estimates: Estimates, sample: LocalPosition) -> Estimates:
    """Position and velocity; the vehicle's own velocity measures the rate of every track."""
    known = estimates.velocity_bias
    if known.sent is None:
        reset = None
    else:
        reset = position_reset(known.sent, sample)
    known, sample = corrected(known, sample, set_anew=reset is not None)
    beams = tuple([moved(beam, sample, reset) for beam in estimates.beams])
    return with_changes(
        estimates,
        position=sample,
        velocity_bias=known,
        beams=beams,
        reset=reset or estimates.reset,
    )
