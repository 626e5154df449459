"""The rotors stand askew in the frame of the logged attitude: a part of the thrust along its level axes.

Where an accelerometer has measured, that is a part of ``imu_bias``. Without one (an acceleration computed from the
velocity, as of motion capture) it is the only constant of the body that an instrument can make.

Valid: everywhere.
Source: Rotation by a small angle. Prior: the frame of a motion capture is set on the vehicle by eye.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from models.common.frames import Array
from models.effects.coefficient import BelongsTo, Coefficient
from models.effects.context import Context
from models.effects.effect import Effect
from models.effects.flight_use import NOT_FLOWN
from models.effects.search_hints import SearchHints
from models.effects.shown import Shown

USUAL_RAD = 0.0175
MOST_RAD = 0.07
"""Standard deviation of a tilt, one degree; four degrees: a vehicle flown by that frame would drift by 0.7 m/s^2."""


def tilted_thrust(ctx: Context) -> tuple[Array, Array]:
    """Wrench (..., 6) of rotors that are tilted by 1 rad in pitch, and in roll."""
    lift = ctx.thrust.sum(axis=-1)
    pitch = np.zeros((*lift.shape, 6))
    roll = np.zeros((*lift.shape, 6))
    pitch[..., 0] = lift
    roll[..., 1] = -lift
    return pitch, roll


def _wrenches(ctx: Context, _: tuple[float, ...]) -> tuple[Array, ...]:
    return tilted_thrust(ctx)


def _lacking(ctx: Context) -> str | None:
    if ctx.accelerometer:
        return "how the accelerometer is mounted is a part of imu_bias"
    return None


def tilt_words(p: Mapping[str, float]) -> str:
    """The two angles."""
    return (
        f"{np.degrees(p['pitch']):+.1f} degrees in pitch and {np.degrees(p['roll']):+.1f} in roll"
    )


def _words(_: Context, p: Mapping[str, float]) -> str:
    return f"the rotors are tilted against the frame of the logged attitude by {tilt_words(p)}"


TILTS = tuple(
    Coefficient(name=axis, unit="rad", low=-MOST_RAD, high=MOST_RAD, typical=USUAL_RAD)
    for axis in ("pitch", "roll")
)

EFFECT = Effect(
    name="mounting_tilt",
    belongs_to=BelongsTo.INSTRUMENT,
    equation="dF = T (pitch, -roll, 0)",
    sign="pitch > 0: the rotors are tilted forward of the frame of the logged attitude",
    axes=("Fx", "Fy"),
    channels=("pitch_rad", "roll_rad"),
    excite="turn by 180 degrees: a tilt turns with the vehicle, wind does not",
    coefficients=TILTS,
    wrenches=_wrenches,
    lacking=_lacking,
    search=SearchHints(
        chance=0.1,
    ),
    aliases=("wind", "rotor_drag"),
    in_flight=NOT_FLOWN,
    shown=Shown(in_words=_words),
)
