"""The ground rangefinder reads a fixed length too much or too little: the model is asked at the wrong height.

Valid: offsets below 0.15 m.
Source: lever arm and zero offset of a range sensor: first order of the modelled lift in the height.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from models.air_state import AirState
from models.common.frames import Array
from models.effects.coefficient import BelongsTo, Coefficient, Shape
from models.effects.context import Context
from models.effects.effect import Effect
from models.effects.flight_use import FlightUse, InFlight
from models.effects.pictures import over_height
from models.effects.search_hints import SearchHints
from models.effects.shown import Shown
from models.vehicle_wrench import disturbance_wrench


def _wrenches(ctx: Context, shape: tuple[float, ...]) -> tuple[Array, ...]:
    assert ctx.model is not None
    state = replace(ctx.state, rpm=ctx.shared_rpm)
    moved = replace(state, h_m=np.maximum(state.h_m - shape[0], 0.0))
    change = disturbance_wrench(ctx.vehicle, ctx.model, moved) - disturbance_wrench(
        ctx.vehicle, ctx.model, state
    )
    return (change / shape[0],)


SIZES_M = (0.02, 0.03, 0.045, 0.065, 0.09, 0.12)


def _lacking(ctx: Context) -> str | None:
    if ctx.model is None:
        return "the empty model has no ground effect that a wrong height could shift"
    if np.isfinite(ctx.state.h_m).any():
        return None
    return "no height over ground in the log"


def _corrected(state: AirState, p: Mapping[str, float]) -> AirState:
    return replace(state, h_m=state.h_m - p["offset_m"])


def _words(_: Context, p: Mapping[str, float]) -> str:
    size = p["offset_m"]
    return (
        f"the rangefinder to the ground reads {abs(size) * 100.0:.1f} cm too "
        f"{'much' if size > 0.0 else 'little'}"
    )


EFFECT = Effect(
    name="range_offset",
    belongs_to=BelongsTo.INSTRUMENT,
    equation="dF = o (F_model(h - a) - F_model(h))/a, taken where a = o",
    sign="offset > 0: the rangefinder reads too much",
    axes=("Fx", "Fy", "Fz", "Mx", "My", "Mz"),
    channels=("range_down_m", "rpm_1"),
    excite="hover at three heights or more between 0.7 and 4 radii",
    coefficients=(Coefficient(name="offset_m", unit="m", low=-0.15, high=0.15, typical=0.05),),
    wrenches=_wrenches,
    shapes=(
        Shape(name="secant_m", unit="m", typical=0.04, tried=(*(-s for s in SIZES_M), *SIZES_M)),
    ),
    lacking=_lacking,
    search=SearchHints(
        at_shape=True,
        chance=0.03,
    ),
    aliases=("ground_effect", "vertical_inflow"),
    in_flight=FlightUse(use=InFlight.MEASUREMENT, corrected=_corrected),
    shown=Shown(drawn=over_height, in_words=_words),
)
