"""The disturbance by the model: surrogate and adopted effects at every fan, and how far to believe them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from companion.config import PipelineConfig
from companion.disturbance.about_cg import about_cg
from companion.disturbance.adopted_effects import adopted_now
from companion.disturbance.air_state import air_state
from companion.disturbance.correction import Correction
from companion.disturbance.fan_query import FanQuery, fan_query
from companion.disturbance.records import THRUST_LEAD_S, Disturbance, FanPlaces, Parts
from companion.disturbance.stable_gain import GAIN, STIFFNESS_STEP_M, stable_gain
from companion.disturbance.surrogate_query import Wrenches, above_free_air, surrogate_answer
from companion.disturbance.vane_reaction import trim_reaction
from companion.estimation.estimates import Estimates
from companion.estimation.surfaces import Seen, Surface, surface
from companion.estimation.vectors import plus, turned
from models.air_state import AirState
from models.common.frames import Array, Rows
from models.effects import corrected_state
from models.vehicle import Vehicle
from models.vehicle_wrench import RPM_TO_RAD_S, fan_rpm_now

_TILT_LEAD_S = 0.0
"""How far ahead side forces are looked up. Over-prediction costs more than it gives (docs/lab/hold.md)."""
_NO_EFFECTS = np.zeros((0, 6))
_SURE_SIGMA_M = 0.05
_UNSURE_SIGMA_M = 0.10
"""A distance this sure is believed in full; this unsure not at all: half of what the effects reach."""


class Surroundings(NamedTuple):
    """What is near, where every fan is to it at both leads, and the air that adopted effects look at."""

    ground: Surface
    wall: Surface
    ceiling: Surface
    at_thrust_lead: FanQuery
    at_tilt_lead: FanQuery
    air: AirState | None
    """None where no effect is adopted."""


def modelled_disturbance(
    *,
    estimates: Estimates,
    config: PipelineConfig,
    rotor_rpm: tuple[float, ...],
    rotation: Rows,
    t_s: float,
    damping_1_s: float,
    correction: Correction | None = None,
) -> Disturbance:
    """Query the surrogate for every fan, at the two leads, in free air, and a little further from a wall.

    ``correction``: what adaptation makes of it; None: all as modelled, and no parts.
    """
    vehicle = config.vehicle
    model = config.model
    rpm = fan_rpm_now(vehicle, rotor_rpm)
    near = _surroundings(estimates, config, rotor_rpm, rpm, rotation, t_s)
    adopted = None
    if near.air is not None:
        adopted = adopted_now(model, near.air, vehicle, damping_1_s)
    free = model.free_air_now(rpm)
    answer = surrogate_answer(model, near.at_thrust_lead, near.at_tilt_lead)
    above = above_free_air(answer, free)
    change_n = answer.pull_change_n
    if correction is None:
        parts = None
        lift, pull, tilt = about_cg(vehicle, above, near.at_tilt_lead.wall_bearing_rad)
        wrench = [a + b + c for a, b, c in zip(lift, pull, tilt, strict=True)]
    else:
        effects = _NO_EFFECTS
        if adopted is not None:
            effects = adopted.with_size
        parts = _parts(vehicle, answer.wrenches, free, near.at_thrust_lead, effects)
        wrench = correction.compensated(vehicle, above, parts.around, effects).tolist()
        step_radii = STIFFNESS_STEP_M / vehicle.rotor_radius_m
        if near.wall.seen is Seen.SURFACE:
            change_n = correction.pull_change_n(change_n, parts.around, step_radii)
    if adopted is not None:
        wrench = [a + b for a, b in zip(wrench, adopted.wrench.tolist(), strict=True)]
    if vehicle.vanes:
        wrench = _with_vanes(wrench, vehicle)
    gain = GAIN
    if near.wall.seen is Seen.SURFACE:
        if adopted is not None:
            change_n += adopted.pull_change_n
        gain = stable_gain(change_n / STIFFNESS_STEP_M, vehicle, damping_1_s)
    return Disturbance(
        wrench=tuple(wrench),
        free_lift_n=sum([fan[2] for fan in free]),
        trust=_trust(answer.trust, near),
        gain=gain,
        h_m=near.at_thrust_lead.h_m,
        d_m=near.at_thrust_lead.d_m,
        ground=near.ground,
        wall=near.wall,
        ceiling=near.ceiling,
        parts=parts,
    )


def _surroundings(
    estimates: Estimates,
    config: PipelineConfig,
    rotor_rpm: tuple[float, ...],
    fan_rpm: tuple[float, ...],
    rotation: Rows,
    t_s: float,
) -> Surroundings:
    """What is near at ``t_s``; where effects are adopted, at the heights that they correct."""
    vehicle = config.vehicle
    model = config.model
    ground = surface(estimates, config, "ground", t_s)
    wall = surface(estimates, config, "wall", t_s)
    at_thrust_lead = fan_query(vehicle, ground, wall, rotation, fan_rpm, THRUST_LEAD_S)
    at_tilt_lead = fan_query(vehicle, ground, wall, rotation, fan_rpm, _TILT_LEAD_S)
    if not model.effects:
        ceiling = Surface(Seen.UNDECLARED)
        return Surroundings(
            ground=ground,
            wall=wall,
            ceiling=ceiling,
            at_thrust_lead=at_thrust_lead,
            at_tilt_lead=at_tilt_lead,
            air=None,
        )
    ceiling = surface(estimates, config, "ceiling", t_s)
    measured = air_state(
        estimates=estimates,
        config=config,
        query=at_thrust_lead,
        ceiling=ceiling,
        rotor_rpm=rotor_rpm,
        t_s=t_s,
        lead_s=THRUST_LEAD_S,
    )
    corrected = corrected_state(model.effects, measured)
    return Surroundings(
        ground=ground,
        wall=wall,
        ceiling=ceiling,
        at_thrust_lead=_at_corrected_heights(at_thrust_lead, measured, corrected),
        at_tilt_lead=_at_corrected_heights(at_tilt_lead, measured, corrected),
        air=corrected,
    )


def _at_corrected_heights(query: FanQuery, measured: AirState, corrected: AirState) -> FanQuery:
    """A query moved by as much as the heights were corrected."""
    known = np.isfinite(measured.h_m)
    none = np.zeros_like(measured.h_m)
    shift = np.subtract(corrected.h_m, measured.h_m, out=none, where=known)
    return query._replace(h_m=tuple((np.array(query.h_m) + shift).tolist()))


def _with_vanes(wrench: list[float], vehicle: Vehicle) -> list[float]:
    """The wrench (6,) with the side force of the vanes that hold its moment off."""
    fx, fy, fz, mx, my, mz = wrench
    reaction = turned(trim_reaction(vehicle), (mx, my, mz))
    return [*plus((fx, fy, fz), reaction), mx, my, mz]


def _trust(of_fans: list[float], near: Surroundings) -> float:
    """0...1: the least of the fans beside a surface, by how sure ground and wall are."""
    query = near.at_thrust_lead
    least = 1.0
    for trust, h_m, d_m in zip(of_fans, query.h_m, query.d_m, strict=True):
        if h_m < math.inf or d_m < math.inf:
            least = min(trust, least)
    return least * _sensor_weight(near.ground) * _sensor_weight(near.wall)


def _parts(
    vehicle: Vehicle, near: Wrenches, free: Wrenches, query: FanQuery, effects: Array
) -> Parts:
    """What adaptation measures by: all but the lift is at the tilt's lead, which is near enough to this instant."""
    radius = vehicle.rotor_radius_m
    around = FanPlaces(
        heights=tuple([h / radius for h in query.h_m]),
        gaps=tuple([d / radius for d in query.d_m]),
        free_lift_n=tuple([alone[2] for alone in free]),
        bearing_rad=query.wall_bearing_rad,
    )
    vertical = -sum([fan[2] for fan in near])
    if effects.size:
        vertical += float(effects[:, 2].sum())
    return Parts(
        at_fans=np.array([near, free]),
        effects=effects,
        tip_m_s=sum(query.rpm) / len(query.rpm) * RPM_TO_RAD_S * radius,
        vertical_n=vertical,
        around=around,
    )


def _sensor_weight(seen: Surface) -> float:
    """1 for a sharp distance, 0 for one uncertain by 10 cm."""
    return min(max((_UNSURE_SIGMA_M - seen.sigma_m) / (_UNSURE_SIGMA_M - _SURE_SIGMA_M), 0.0), 1.0)
