"""A motor that fails in flight, said as an effect that begins: ``fan_imbalance`` with ``since_s``."""

from __future__ import annotations

from typing import Any

from models.effects import Effect, catalogue
from replay.flightlog import LogFault, MotorLoss
from replay.search.estimates import IntervalEstimate
from replay.search.thresholds import SURE


def loss_json(fault: LogFault) -> dict[str, Any]:
    """One entry of ``effects`` (docs/formats.md) of a fault that has a ``loss``."""
    loss = _loss(fault)
    effect = _of_one_fan()
    probability = min(loss.probability, SURE)
    return {
        "name": effect.name,
        "axes": effect.axes,
        "since_s": fault.since_s,
        "parameters": {e.name: e.as_json() for e in _parameters(loss)},
        "explains": loss.explains,
        "q_value": 1.0 - probability,
        "probability": probability,
        "channels": [fault.channel],
        "status": "candidate",
        "belongs_to": effect.belongs_to.value,
        "kept": False,
        "equation": effect.equation,
        "sign": effect.sign,
        "what": fault.what,
    }


def loss_text(fault: LogFault) -> list[str]:
    """The same in two lines."""
    probability = min(_loss(fault).probability, SURE)
    name = _of_one_fan().name
    return [
        f"  {name} since {fault.since_s:.1f} s (probability {probability:.2f}): {fault.what}",
        "    not kept: a motor that failed is repaired before the next flight",
    ]


def _loss(fault: LogFault) -> MotorLoss:
    if fault.loss is None:
        raise ValueError(f"no motor fails: {fault.what}")
    return fault.loss


def _of_one_fan() -> Effect:
    """The effect of the catalogue that is of one fan."""
    return next(e for e in catalogue() if "fan" in {shape.name for shape in e.shapes})


def _parameters(loss: MotorLoss) -> list[IntervalEstimate]:
    low, high = loss.interval
    one = len(loss.motors) == 1
    return [
        IntervalEstimate(name="scale", value=-loss.share, ci95=(-high, -low), unit="1"),
        IntervalEstimate(
            name="fan",
            value=float(loss.motors[0]),
            ci95=None if one else (float(min(loss.motors)), float(max(loss.motors))),
            unit="1",
            determined=one,
        ),
    ]
