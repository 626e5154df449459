"""What the page shows of one decision, as plain numbers; None where something is not known or not there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from companion.adaptation.adaptation import Adaptation
from companion.config import PipelineConfig
from companion.estimation.surfaces import Surface
from companion.mavlink.firmware import mode_name
from companion.mavlink.message_table import LAYOUTS
from companion.mavlink.stream_rates import StreamKeeper
from companion.state.decision import Decision
from companion.state.pipeline_state import PipelineState
from models.common.frames import Rows
from models.surrogate.empty import is_empty


def snapshot(
    decision: Decision,
    state: PipelineState,
    config: PipelineConfig,
    streams: StreamKeeper,
    now_s: float,
) -> dict[str, Any]:
    """``now_s`` is the receiver's clock, for the rates of the link."""
    offset = decision.offset
    disturbance = decision.disturbance
    heartbeat = state.heard.heartbeat
    out: dict[str, Any] = {
        "t_s": round(decision.t_s, 3),
        "vehicle": config.vehicle.name,
        "mode": None if heartbeat is None else mode_name(heartbeat),
        "armed": heartbeat is not None and heartbeat.armed,
        "dry_run": config.dry_run,
        "authority": _number(decision.authority),
        "reasons": [reason.value for reason in decision.reasons],
        "offset": {
            "thrust": _number(offset.thrust, 4),
            "roll_deg": _number(math.degrees(offset.roll)),
            "pitch_deg": _number(math.degrees(offset.pitch)),
        },
        "late_s": _number(decision.late_s),
        "rpm": [None if track is None else round(track.value) for track in state.estimates.rotors],
        "rates": [
            [LAYOUTS[w.message_id].name, round(streams.rate(w.message_id, now_s), 1), w.hz]
            for w in streams.wanted
        ],
        "air": None,
        "sizes": None if decision.adaptation is None else _sizes(decision.adaptation),
    }
    if disturbance is not None:
        out["air"] = {
            "wrench": [_number(v, 4) for v in disturbance.wrench],
            "trust": None if is_empty(config.model) else _number(disturbance.trust),
            "ground": _surface(disturbance.ground),
            "wall": _surface(disturbance.wall),
            "fans": _fans(
                disturbance.wall, state.estimates.rows, config, disturbance.h_m, disturbance.d_m
            ),
        }
    return out


def _sizes(known: Adaptation) -> dict[str, Any]:
    """Why nothing is learned now (None: it is), and rows of name, value, sd, unit, share compensated or None."""
    shares = known.share_by_name()
    rows = []
    for name, e in known.estimates().items():
        rows.append(
            [
                name.replace("_", " "),
                _number(e.value),
                _number(e.sd),
                "" if e.unit == "1" else e.unit,
                shares.get(name),
            ]
        )
    return {"paused": known.paused, "rows": rows}


def _number(value: float, digits: int = 3) -> float | None:
    if math.isfinite(value):
        return round(float(value), digits)
    return None


def _surface(surface: Surface) -> dict[str, Any]:
    return {
        "seen": surface.seen.value,
        "distance_m": _number(surface.distance_m),
        "sigma_m": _number(surface.sigma_m),
        "rate_m_s": _number(surface.rate_m_s),
    }


def _fans(
    wall: Surface,
    rows: Rows | None,
    config: PipelineConfig,
    h_m: Sequence[float],
    d_m: Sequence[float],
) -> list[list[Any]]:
    """For the drawing, of each fan: place towards the wall (without one: forward) and its lip radius, h and d [m]."""
    towards = np.array([1.0, 0.0, 0.0])
    if wall.normal_ned is not None and rows is not None:
        body = -np.array(rows).T @ wall.normal_ned
        size = math.hypot(body[0], body[1])
        if size > 0.1:
            towards = np.array([body[0] / size, body[1] / size, 0.0])
    places = config.vehicle.fan_positions_m @ towards
    return [
        [_number(place), _number(lip), _number(h), _number(d)]
        for place, lip, h, d in zip(
            places.tolist(), config.vehicle.lip_radii_m.tolist(), h_m, d_m, strict=True
        )
    ]
