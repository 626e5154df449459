"""Time in which an output no longer drives the motor that it drove at take-off."""

from __future__ import annotations

import numpy as np

from models.common.frames import Array
from models.vehicle.motor_outputs import declared_motors
from replay.flightlog import FlightLog
from replay.residual.grid import Mask


def motors_reassigned(log: FlightLog, t_s: Array) -> Mask:
    """Samples (n,) after a parameter gave an output of a motor another function, as a test of a failed motor does."""
    out = np.zeros(len(t_s), bool)
    parameters = dict(log.parameters)
    at_take_off = declared_motors(parameters)
    for k, change in enumerate(log.parameter_changes):
        parameters[change.name] = change.after
        if declared_motors(parameters) != at_take_off:
            later = log.parameter_changes[k + 1 :]
            if later:
                until = later[0].t_s
            else:
                until = np.inf
            out |= (t_s >= change.t_s) & (t_s < until)
    return out
