"""The accelerometer reads a constant too much in body axes, or stands askew on the rotors.

Valid: constant temperature.
Source: Woodman 2007, University of Cambridge UCAM-CL-TR-696, section 4: accelerometer bias.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from models.effects.effect import NOT_FLOWN, BelongsTo, Coefficient, Context, Effect, Shown
from models.frames import Array


def _wrenches(ctx: Context, _: tuple[float, ...]) -> tuple[Array, ...]:
    out = np.zeros((*ctx.state.time_s.shape, 6, 5))
    out[..., :3, :3] = ctx.vehicle.mass_kg * np.eye(3)
    # Rotors that do not stand square to the accelerometer: a part of the thrust along its level axes.
    lift = ctx.thrust.sum(axis=-1)
    out[..., 0, 3], out[..., 1, 4] = lift, -lift
    return tuple(np.moveaxis(out, -1, 0))


def _words(_: Context, p: Mapping[str, float]) -> str:
    names = (("x", "forward"), ("y", "to the right"), ("z", "downwards"))
    size = ", ".join(f"{p[key]:+.2f} m/s² {name}" for key, name in names)
    tilt = f"{np.degrees(p['pitch']):+.1f} degrees in pitch and {np.degrees(p['roll']):+.1f} in roll"
    return f"the accelerometer reads {size} too much; the rotors are tilted against it by {tilt}"


EFFECT = Effect(
    name="imu_bias",
    belongs_to=BelongsTo.INSTRUMENT,
    equation="dF = m b + T (pitch, -roll, 0), b constant in the body",
    sign="b > 0: the accelerometer reads too much along that axis; pitch > 0: rotors are tilted forward of it",
    axes=("Fx", "Fy", "Fz"),
    channels=("ax_m_s2", "ay_m_s2", "az_m_s2"),
    excite="turn by 180 degrees: a bias turns with the vehicle, wind does not",
    coefficients=(
        *(Coefficient(a, "m/s^2", -1.5, 1.5, typical=0.3) for a in "xy"),
        # Along the lift it cannot be told from a load, or from the battery: that is of the day.
        Coefficient("z", "m/s^2", -1.5, 1.5, typical=0.3, belongs_to=BelongsTo.LOAD),
        *(Coefficient(a, "rad", -0.15, 0.15, typical=0.02) for a in ("pitch", "roll")),
    ),
    wrenches=_wrenches,
    aliases=("wind", "payload", "thrust_scale"),
    in_flight=NOT_FLOWN,
    chance=0.3,
    # Attitude is the accelerometer's own: how it is mounted shows in no velocity.
    kinematic_bias=lambda *_: np.eye(3, 5),
    shown=Shown(in_words=_words),
)
