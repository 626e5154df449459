"""Thrust follows the battery voltage: where thrust is declared by outputs, or where reported speeds are not true.

Valid: V within 30 % of V0.
Source: brushless motor at constant duty: speed follows the voltage, thrust its square; Hughes & Drury 2013, Electric
Motors and Drives, ch. 3. A loaded motor's speed follows it less than in proportion, which gives powers of 1 to 2.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from models.common.frames import Array
from models.effects.coefficient import BelongsTo, Coefficient, Shape
from models.effects.context import Context, through
from models.effects.effect import Effect
from models.effects.pictures import more, nearest, over
from models.effects.search_hints import SearchHints
from models.effects.shown import Shown

KNOWN_TO = 0.01
"""Standard deviation of ``at_reference``: a voltage is measured to half a percent, and thrust goes with its square. A
level that is further off is a load, or a thrust that is declared wrong, whatever the pack does."""
ANSWERED = 0.003
"""Standard deviation of ``ohmic`` where the thrust only answers disturbances."""
SLOW_S = 1.0
"""Standard deviation of the Gaussian that voltage goes through: packs empty over minutes, telemetry is noisy [s]."""


def _wrenches(ctx: Context, shape: tuple[float, ...]) -> tuple[Array, ...]:
    volts = ctx.state.battery_voltage_v
    if ctx.record:
        # Noise of the voltage would be fitted instead of what the pack does, and make its power too small.
        volts = through(ctx, volts[:, None], lambda omega: np.exp(-0.5 * (SLOW_S * omega) ** 2))[
            :, 0
        ]
    fuller = volts / shape[0] - 1.0
    # The drop over the pack's resistance, when the current rises with the thrust, is faster than that.
    above = ctx.thrust.sum(axis=-1) / ctx.weight - 1.0
    return ctx.rotor_force * fuller[..., None], ctx.rotor_force, -ctx.rotor_force * above[..., None]


def _grid(ctx: Context) -> Sequence[tuple[float, ...]]:
    curve = ctx.vehicle.throttle
    return ((float(np.nanmax(ctx.state.battery_voltage_v)) if curve is None else curve.voltage_v,),)


def _ohmic(ctx: Context) -> float:
    # A loop that answers losses of lift by more thrust passes for thrust that falls with the current: of the mixture of
    # both the standard deviation.
    usual = ctx.by_kind(0.01, 0.1)
    return math.sqrt(ctx.commanded * usual**2 + (1.0 - ctx.commanded) * ANSWERED**2)


def _lacking(ctx: Context) -> str | None:
    known = ctx.state.battery_voltage_v[np.isfinite(ctx.state.battery_voltage_v)]
    if not known.size:
        return "no battery voltage in the log"
    if np.ptp(known) > 0.005 * float(np.median(known)):
        return None
    return "the battery voltage did not change"


def _words(ctx: Context, p: Mapping[str, float]) -> str:
    low = nearest(ctx.state.battery_voltage_v)
    share = p["power"] * (low / p["reference_v"] - 1.0)
    return f"at {low:.1f} V the rotors give {more(share)} thrust than at {p['reference_v']:.1f} V"


EFFECT = Effect(
    name="battery_sag",
    equation="dF = F_rotors (p (V/V0 - 1) + e - r (u - 1)), e at the reference voltage, u "
    "declared thrust over weight",
    sign="power > 0: thrust falls with the voltage; ohmic > 0: and with the current, faster than "
    "the voltage is logged; ohmic < 0: the declared curve holds that drop already",
    axes=("Fz",),
    channels=("battery_voltage_v", "servo_1", "rpm_1"),
    excite="fly on a full and on an empty battery",
    coefficients=(
        Coefficient(name="power", unit="1", low=0.0, high=4.0, typical=0.6, centre=1.5),
        Coefficient(
            name="at_reference",
            unit="1",
            low=-0.3,
            high=0.3,
            typical=KNOWN_TO,
            belongs_to=BelongsTo.LOAD,
        ),
        Coefficient(name="ohmic", unit="1", low=-0.2, high=0.8, typical=_ohmic, optional=True),
    ),
    main=("power",),
    wrenches=_wrenches,
    shapes=(Shape(name="reference_v", unit="V", continuous=False),),
    grid=_grid,
    lacking=_lacking,
    search=SearchHints(
        # Thrust follows the speed, whatever the voltage: only reported speeds that are not true can drift with it.
        chance=lambda ctx: ctx.by_kind(0.0003, 0.15),
    ),
    aliases=("thermal_derating", "thrust_scale"),
    shown=Shown(
        drawn=lambda ctx, axis: over("battery [V]", ctx.state.battery_voltage_v, axis),
        in_words=_words,
    ),
)
