"""The amended model: a model directory with what belongs to the vehicle of the effects that were found."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from models.air_state import blank_state
from models.common.errors import ConfigError
from models.effects import AdoptedEffect, BelongsTo, Context, Effect, get
from models.surrogate.empty import empty_model
from models.surrogate.fan_identity import identity
from models.surrogate.fan_surrogate import FanSurrogate
from models.vehicle import Vehicle
from models.vehicle_wrench import reference_thrust
from replay.search.estimates import IntervalEstimate

LEARNT_FROM = "learnt_from"
OF_DAY = "of_day"
"""Keys of ``model.json``: [{"name", "sha256"}] of logs; {effect: {"spread": {coefficient: standard deviation about
zero}, "shape": {parameter: value}}} of what belongs to one flight."""


def amended(
    model: FanSurrogate | None,
    vehicle: Vehicle,
    effects: Sequence[AdoptedEffect],
    logs: Sequence[Path] = (),
) -> FanSurrogate:
    """The model with ``effects`` added to those it has; weather and load start at zero, with their spread.

    ``logs``: what the effects were found in, so that nobody judges the model on them.
    """
    if model is None and np.ptp(thrust := reference_thrust(vehicle, None)) > 1e-6 * float(
        np.max(thrust)
    ):
        raise ConfigError(
            "--save-model: the fans' ct differ, and a model directory holds one fan; train a "
            "model for this vehicle"
        )
    if model is None:
        base = empty_model(vehicle)
    else:
        base = model
    new = tuple(get(e.name).next_flight(e) for e in effects if not get(e.name).all_of_day)
    info: dict[str, Any] = dict(base.info)
    if logs:
        known = {entry["sha256"]: entry for entry in info.get(LEARNT_FROM, [])}
        info[LEARNT_FROM] = list(
            (known | {e["sha256"]: e for e in map(_entry, dict.fromkeys(logs))}).values()
        )
    if "fan" not in info and any(get(e.name).in_flight.of_model is not None for e in new):
        # Its map is in rotor radii.
        info["fan"] = identity(
            base.free_air_law, vehicle.rotor_radius_m, vehicle.fans[0].lip_radius_m
        ).as_info()
    context = Context(
        state=blank_state((), len(vehicle.fans), len(vehicle.rotors)), vehicle=vehicle, model=model
    )
    days = {e.name: _day(e, context) for e in effects}
    of_day = info.get(OF_DAY, {}) | {name: day for name, day in days.items() if day["spread"]}
    if of_day:
        info[OF_DAY] = of_day
    return base.with_effects((*base.effects, *new), info)


def to_adopt(
    effect: Effect,
    estimates: Sequence[IntervalEstimate],
    context: Context,
    without: Sequence[str] = (),
    *,
    doubt: float = 0.0,
) -> AdoptedEffect:
    """What was found, with the sizes that another flight may be predicted by.

    A coefficient of the vehicle is taken towards its prior mean by its own interval, d -> d d^2/(d^2 + sd^2): an
    interval that is wider than the posterior says that other flights differ (positive-part James-Stein shrinkage: Efron
    & Morris 1973, JASA 68, 117). Offsets of a sensor stay as found: one by one they are known worse than together.
    ``doubt``: how far what answers the wind may be of the one wind it was found in (``of_one_wind``), by so much less
    of it is taken.
    """
    parameters = {e.name: e.value for e in estimates}
    of_wind = any(
        (c.belongs_to or effect.belongs_to) is BelongsTo.WEATHER for c in effect.coefficients
    )
    if of_wind:
        share = 1.0 - doubt
    else:
        share = 1.0
    by_name = {e.name: e for e in estimates}
    for c in effect.coefficients if effect.belongs_to is not BelongsTo.INSTRUMENT else ():
        e = by_name[c.name]
        low, high = e.ci95 or (e.value, e.value)
        if effect.kept:
            mean = c.mean(context)
        else:
            mean = 0.0
        sd = (high - low) / (2.0 * 1.96)
        off = e.value - mean
        parameters[c.name] = mean + share * off**3 / max(off**2 + sd**2, 1e-300)
    return AdoptedEffect(effect.name, parameters, tuple(without))


def of_one_wind(wind_m_s: float, speed_m_s: float) -> float:
    """Share of a drag that may be of the one wind in which it was found: 1/2 w^2 / (w^2 + v^2).

    Drag and inflow grow with the speed of the air. Half of what was found may be the wind's where all air speed is its
    own; nothing in still air, where all of it is the vehicle's. w the wind, v the RMS of the own level speed.
    """
    return 0.5 * wind_m_s**2 / max(wind_m_s**2 + speed_m_s**2, 1e-12)


def learnt_from(model: FanSurrogate, log: Path) -> bool:
    """Whether the model was made from this log."""
    known: Sequence[Mapping[str, str]] = model.info.get(LEARNT_FROM, [])
    return bool(known) and _entry(log)["sha256"] in {entry["sha256"] for entry in known}


def known_day(model: FanSurrogate) -> dict[str, dict[str, float]]:
    """Effects of one flight that the model was made beside, each with its shape."""
    return {name: dict(day["shape"]) for name, day in model.info.get(OF_DAY, {}).items()}


def _entry(log: Path) -> dict[str, str]:
    with log.open("rb") as file:
        return {"name": log.name, "sha256": hashlib.file_digest(file, "sha256").hexdigest()}


def _day(adopted: AdoptedEffect, context: Context) -> dict[str, dict[str, float]]:
    """Of an effect: standard deviation of what differs from flight to flight, and its shape."""
    effect = get(adopted.name)
    start = effect.of_next_flight(adopted.parameters)
    return {
        "spread": {
            c.name: float(c.spread(context)) for c in effect.coefficients if effect.of_day(c)
        },
        "shape": {s.name: start[s.name] for s in effect.shapes},
    }
