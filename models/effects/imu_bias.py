"""The accelerometer reads a constant too much in body axes, or stands askew on the rotors.

Valid: constant temperature.
Source: Woodman 2007, University of Cambridge UCAM-CL-TR-696, section 4: accelerometer bias. Prior of the offset: zero-g
output of soldered parts, 20 mg (ICM-42688-P, and 0.15 mg/K) to 50 mg (ICM-20948), by their data sheets. Bound: 0.75
m/s^2, by which two accelerometers may differ before ArduPilot refuses to arm (ARMING_ACCTHRESH); PX4's
estimator learns no more than 0.4 m/s^2 (EKF2_ABL_LIM).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from models.common.frames import Array
from models.effects.coefficient import BelongsTo, Coefficient
from models.effects.context import Context
from models.effects.effect import Effect
from models.effects.flight_use import NOT_FLOWN
from models.effects.mounting_tilt import TILTS, tilt_words, tilted_thrust
from models.effects.search_hints import SearchHints
from models.effects.shown import Shown

USUAL_M_S2 = 0.3
MOST_M_S2 = 0.75
"""Standard deviation of an offset, 30 mg, and what an autopilot still flies with."""


def _lacking(ctx: Context) -> str | None:
    if ctx.accelerometer:
        return None
    return "the acceleration is computed from the velocity: there is no accelerometer"


def _offset(name: str, belongs_to: BelongsTo | None = None) -> Coefficient:
    return Coefficient(
        name=name,
        unit="m/s^2",
        low=-MOST_M_S2,
        high=MOST_M_S2,
        typical=USUAL_M_S2,
        belongs_to=belongs_to,
    )


def _wrenches(ctx: Context, _: tuple[float, ...]) -> tuple[Array, ...]:
    out = np.zeros((*ctx.state.time_s.shape, 6, 3))
    out[..., :3, :] = ctx.vehicle.mass_kg * np.eye(3)
    return (*np.moveaxis(out, -1, 0), *tilted_thrust(ctx))


def _words(_: Context, p: Mapping[str, float]) -> str:
    names = (("x", "forward"), ("y", "to the right"), ("z", "downwards"))
    size = ", ".join(f"{p[key]:+.2f} m/s² {name}" for key, name in names)
    return (
        f"the accelerometer reads {size} too much; the rotors are tilted against it by "
        f"{tilt_words(p)}"
    )


EFFECT = Effect(
    name="imu_bias",
    belongs_to=BelongsTo.INSTRUMENT,
    equation="dF = m b + T (pitch, -roll, 0), b constant in the body",
    sign="b > 0: the accelerometer reads too much along that axis; pitch > 0: rotors are tilted "
    "forward of it",
    axes=("Fx", "Fy", "Fz"),
    channels=("ax_m_s2", "ay_m_s2", "az_m_s2"),
    excite="turn by 180 degrees: a bias turns with the vehicle, wind does not",
    coefficients=(
        *(_offset(axis) for axis in "xy"),
        # Along the lift it cannot be told from a load, or from the battery: that is of the day.
        _offset("z", BelongsTo.LOAD),
        *TILTS,
    ),
    wrenches=_wrenches,
    lacking=_lacking,
    every_flight=True,
    search=SearchHints(
        chance=0.3,
    ),
    aliases=("wind", "payload", "thrust_scale"),
    in_flight=NOT_FLOWN,
    # Attitude is the accelerometer's own: how it is mounted shows in no velocity.
    kinematic_bias=lambda *_: np.eye(3, 5),
    shown=Shown(in_words=_words),
)
