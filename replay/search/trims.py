"""What every flight has without any effect: wrenches (n, 6) of one prior standard deviation each, without a name."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from models.common.frames import AXES, Array
from models.effects import Context
from replay.residual.record import Record
from replay.search.channel import hundredths
from replay.search.thresholds import CLOCK_SD_S, LIFT_TRIM, OFF_CENTRE, TRIM, USUAL_DRAG

LIFT = AXES.index("Fz")


def trims_of(record: Record) -> Iterator[Array]:
    """A constant on every judged axis, late rotor speeds, and what the accelerometer and the velocity get wrong."""
    shape = len(record.valid), 6
    share = np.where(np.arange(6) == LIFT, LIFT_TRIM, TRIM)
    constant = np.diag(hundredths(record.context) * share)
    for axis in record.axes:
        yield np.broadcast_to(constant[axis], shape)
    yield _late_rotors(record)
    # An accelerometer of its own, not the velocity's derivative.
    if np.isfinite(record.kinematic_bias).any():
        yield _late_velocity(record)
        unit = OFF_CENTRE * record.context.lever
        for per_metre in off_centre(record.context):
            yield unit * np.nan_to_num(per_metre)


def _late_rotors(record: Record) -> Array:
    """Lift by rotor speeds that are late by a standard deviation."""
    out = np.zeros((len(record.valid), 6))
    lift = record.context.rotor_force[:, LIFT]
    change = np.gradient(lift, record.step_s)
    # None beside a gap: that is no change of lift.
    out[:, LIFT] = CLOCK_SD_S * np.nan_to_num(change)
    return out


def _late_velocity(record: Record) -> Array:
    """What the usual drag misses where the velocity is late by a standard deviation."""
    out = np.zeros((len(record.valid), 6))
    mass_flow = record.context.mass_flow.sum(axis=-1)[:, None]
    drag = USUAL_DRAG * mass_flow * record.context.velocity[:, :2]
    change = np.gradient(drag, record.step_s, axis=0)
    out[:, :2] = CLOCK_SD_S * np.nan_to_num(change)
    return out


def off_centre(context: Context) -> Iterator[Array]:
    """What an accelerometer off the centre of gravity feels of turning, for a metre along x, y, z: forces (n, 6) [N].

    m (dw/dt x r + w x (w x r)) with the rates w and the place r: Goldstein, Classical Mechanics, ch. 4.
    """
    rates = context.state.rates
    turn = np.gradient(rates, context.state.time_s, axis=0)
    for place in np.eye(3):
        centripetal = np.cross(rates, np.cross(rates, place))
        acceleration = np.cross(turn, place) + centripetal
        out = np.zeros((len(rates), 6))
        out[:, :3] = context.vehicle.mass_kg * acceleration
        yield out
