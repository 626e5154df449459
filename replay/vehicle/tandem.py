"""How a log of the paper's tandem is known: by its outputs, as no parameter of an autopilot says such a frame."""

from __future__ import annotations

import numpy as np

from replay.flightlog import FlightLog

NAME = "the paper's tandem"
HOW = "outputs 1 to 4 in pairs, vanes on 5 and 6"
_FRAME_PARAMETERS = {"FRAME_CLASS", "FRAME", "CA_AIRFRAME", "CA_ROTOR_COUNT"}
_NEUTRAL_US, _DEFLECTED_US = 1500.0, 250.0
"""Of the vanes."""
_SAME_US = 2.0
"""The two rotors of a coaxial fan get one output; they differ by rounding."""


def is_tandem(log: FlightLog) -> bool:
    """Whether rotors 1 and 2, and 3 and 4, get one output each, and two vanes move about their middle."""
    if log.servo is None or _FRAME_PARAMETERS & set(log.parameters):
        return False
    outputs = log.servo.values[(log.servo.values[:, :6] > 0.0).all(axis=1)]
    if len(outputs) < 0.5 * len(log.servo):
        return False
    pairs = np.abs(outputs[:, [0, 2]] - outputs[:, [1, 3]]).max() <= _SAME_US
    vanes = outputs[:, 4:6]
    moved = np.ptp(vanes, axis=0).min() > 0.0 and np.abs(vanes - _NEUTRAL_US).max() < _DEFLECTED_US
    return bool(pairs and moved)
